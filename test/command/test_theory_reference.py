#!/usr/bin/python3
"""Contact problems whose answers are reference data, as the study runs them: a rod in a bend, a rod that coils in a
tube, a sphere pressed on a flat. Every case of CATNAV_REFERENCE at the tolerance it states. (Push, capstan, incline
and thick tubes have C tests of their own.)"""
import os
import sys
import tempfile
import unittest
from concurrent.futures import ThreadPoolExecutor

HERE = os.path.dirname(os.path.abspath(__file__))
ROOT = os.path.dirname(os.path.dirname(HERE))
CATNAV = os.path.abspath(sys.argv.pop(1) if len(sys.argv) > 1 and os.access(sys.argv[1], os.X_OK)
                         else os.environ.get("CATNAV", "catnav"))
sys.dont_write_bytecode = True
sys.path.insert(0, os.path.join(ROOT, "scripts", "study"))
import theory
import tools


class Theory(unittest.TestCase):
    def test_every_figure_is_within_the_tolerance_of_the_reference(self):
        files = {theory.bend: "rod_in_bend_three_contacts", theory.helix: "helical_buckling", theory.hertz: "hertz"}
        with tempfile.TemporaryDirectory() as folder:
            study = tools.Study(folder, CATNAV, False, 1, ROOT)
            there = [problem for problem, name in files.items()
                     if os.path.exists(os.path.join(study.reference, "data", name + ".json"))]
            if not there:
                self.skipTest("no such file in " + study.reference)
            with ThreadPoolExecutor(2) as pool:
                rows = [row for found in pool.map(lambda problem: list(problem(study)), there) for row in found]
        self.assertGreaterEqual(len(rows), len(there))
        for row in rows:
            self.assertTrue(row["within"], "%s, %s: %s is %s, not %g (%s)" % (
                row["problem"], row["case"], row["quantity"], row["ours"], row["theory"], row["message"]))


if __name__ == "__main__":
    unittest.main()
