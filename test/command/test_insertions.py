#!/usr/bin/python3
"""A few random insertions (insertions.py draws them), each step judged by the oracle. argv[1] or CATNAV is the command;
CATNAV_SEED draws others. All of them: make test-insertions COUNT=N SEED=S."""
import json
import os
import sys
import tempfile
import unittest

import oracle_runs

try:
    import insertions
except ImportError:  # no numpy
    insertions = None

COUNT, SEED = 20, int(os.environ.get("CATNAV_SEED", "7"))


@unittest.skipUnless(insertions, "numpy is not there")
@unittest.skipUnless(os.access(oracle_runs.ORACLE, os.X_OK), "the oracle is not built")
class Insertions(unittest.TestCase):
    def test_random_insertions_end_in_a_verdict_with_nothing_crossing_or_outside(self):
        print("seed %d, %d insertions" % (SEED, COUNT), file=sys.stderr)
        ran = touched = 0
        for case in range(COUNT):
            with self.subTest("make test-insertions SEED=%d FIRST=%d COUNT=1" % (SEED, case)):
                report, frames, wrong, _ = insertions.insertion(SEED, case, timeout=10)
                self.assertEqual(wrong, [])
                ran += frames > 0
                touched += bool(report["contact"]["force_max"])
        self.assertGreater(ran, COUNT / 2)
        self.assertGreater(touched, COUNT / 5)

    def test_a_device_that_would_be_turned_inside_out_within_a_step_does_not_cross_itself(self):
        for name in "back_through_itself", "twisted", "crushed":
            file = os.path.join(oracle_runs.DATA, "scenes", "inside_out", name + ".yaml")
            with tempfile.TemporaryDirectory() as folder:
                run = oracle_runs.judged(folder, file, oracle_runs.read_scene(file))
            self.assertEqual((insertions.faults(run), run.frames), ([], run.report["steps"] + 1))

    def test_a_tip_that_the_sheath_still_guides_does_not_pass_through_the_wall_before_it(self):
        scene = {"scene": "guided", "step": 0.01, "time_limit": 0.3,
                 "vessels": [{"name": "room", "shape": {"box": {"min": [-0.1, -0.02, -0.02], "max": [0.005, 0.02, 0.02]}}}],
                 "bodies": [{"name": "device", "model": "tet10", "drive": {"speed": 0.05},
                             "shape": {"catheter": {"length": 0.06, "diameter": 0.002, "entry": [0, 0, 0],
                                                    "direction": [1, 0, 0], "stations": 4, "sides": 4}},
                             "material": {"young": 1e7, "poisson": 0.3, "density": 1000},
                             "waypoints": [[0.0035, 0.004, 0]], "waypoint_tolerance": 1e-4, "path": {"max_turn_deg": 180}}]}
        with tempfile.TemporaryDirectory() as folder:
            file = os.path.join(folder, "scene.yaml")
            with open(file, "w") as out:
                json.dump(scene, out)
            run = oracle_runs.judged(folder, file, scene)
        self.assertEqual((run.crossings, run.outside, run.report["verdict"]["code"]), (0, 0, "NUMERICS"), run.places)
        self.assertGreater(run.frames, 10)


if __name__ == "__main__":
    unittest.main()
