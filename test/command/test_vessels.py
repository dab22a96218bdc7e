#!/usr/bin/python3
"""Catheters of rod and tet4 in real vessels, every accepted step judged by the oracle: the demo's arteries, a carotid
bifurcation, the aorta and its arch. The first steps, under a load that presses them to the wall; with CATNAV_LONG=1
(make test-oracle) as far as the target. argv[1] or CATNAV is the command."""
import json
import os
import tempfile
import unittest

from oracle_runs import DATA, ORACLE, judged

LONG = os.environ.get("CATNAV_LONG", "0") != "0"


@unittest.skipUnless(os.access(ORACLE, os.X_OK), "the oracle is not built")
class Vessels(unittest.TestCase):
    def insert(self, file, entry, direction, target, length, diameter, step=0.01, resolution=None):
        """All in millimetres but the step [s]."""
        file = os.path.join(DATA, "vessels", file)
        if not os.path.exists(file):
            self.skipTest("no " + file)
        catheter = {"length": 1e-3 * length, "diameter": 1e-3 * diameter, "entry": [1e-3 * x for x in entry],
                    "direction": direction, "stations": int(length / diameter / 1.6), "sides": 6}
        scene = {"scene": "vessel", "step": step, "time_limit": 120 if LONG else 24.5 * step,
                 "gravity": [5.7, 5.7, -5.7] if LONG else [120, 120, -120],
                 "vessels": [{"name": "artery", "surface": {"file": file, "scale": 0.001}}],
                 "bodies": [{"name": "catheter", "shape": {"catheter": catheter},
                             "material": {"young": 8.7e6, "poisson": 0.33, "density": 1100},
                             "waypoints": [[1e-3 * x for x in target]], "waypoint_tolerance": 2e-3,
                             "drive": {} if LONG else {"speed": 0.3, "path_distance": 5e-3}}]}
        if resolution:
            scene["planner"] = {"resolution": 1e-3 * resolution}
        for model in "rod", "tet4":
            with self.subTest(model), tempfile.TemporaryDirectory() as folder:
                scene["bodies"][0]["model"] = model
                with open(os.path.join(folder, "scene.yaml"), "w") as out:
                    json.dump(scene, out)
                run = judged(folder, os.path.join(folder, "scene.yaml"), scene, timeout=7200 if LONG else 120)
                self.assertIn(run.report["status"], ["reached"] if LONG else ["reached", "time_limit"], run.said)
                self.assertEqual((run.crossings, run.outside), (0, 0), run.places)
                self.assertEqual(run.frames, run.report["steps"] + 1)
                self.assertGreater(run.report["contact"]["force_max"], 0)
                self.assertEqual(run.report["contact"]["intersections"] + run.report["contact"]["outside_nodes"], 0)
                if LONG:
                    print(os.path.basename(file), model, run.frames, "frames", run.report["contact"], flush=True)

    def test_from_the_groin_to_the_liver(self):
        self.insert("bp3d/bp3d_leg_to_liver_merged.stl", [46.81, -137.58, 705.57], [0, 0, 1],
                    [-45.00, -149.58, 1117.32], 1000, 1.35, resolution=None if LONG else 1.3)

    def test_up_a_carotid_artery(self):
        self.insert("beamadapter/beamadapter_carotids.stl", [0.5, 0.5, 0.2], [0, -1, 0], [1.9, -82, 22.6], 130, 1)

    def test_through_the_aorta_to_its_arch(self):
        self.insert("steve/steve_vessel_architecture_collision.obj", [-82.72, 23.71, 20.02], [-1, 0, 0],
                    [-383.49, 22.04, -16.64], 600, 1.8)


if __name__ == "__main__":
    unittest.main()
