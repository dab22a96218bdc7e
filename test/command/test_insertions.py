#!/usr/bin/python3
"""A few random insertions (insertions.py draws them), each step judged by the oracle. argv[1] or CATNAV is the command;
CATNAV_SEED draws others. All of them: make test-insertions COUNT=N SEED=S."""
import os
import sys
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
                report, frames, wrong, _ = insertions.insertion(SEED, case, timeout=5)
                self.assertEqual(wrong, [])
                ran += frames > 0
                touched += bool(report["contact"]["force_max"])
        self.assertGreater(ran, COUNT / 2)
        self.assertGreater(touched, 0)

    def test_a_device_that_would_be_turned_inside_out_within_a_step_does_not_cross_itself(self):
        for seed, case in (23, 11), (1, 53):  # back through itself; twisted by half a turn between two sections
            report, frames, wrong, _ = insertions.insertion(seed, case, timeout=60)
            self.assertEqual((wrong, frames), ([], report["steps"] + 1))


if __name__ == "__main__":
    unittest.main()
