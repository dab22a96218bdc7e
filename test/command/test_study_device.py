#!/usr/bin/python3
"""`catnav study device`: which devices pass a narrow bend, and what stops the next one."""
import csv
import json
import os
import shlex
import subprocess
import sys
import tempfile
import unittest

CATNAV = os.path.abspath(sys.argv.pop(1) if len(sys.argv) > 1 and os.access(sys.argv[1], os.X_OK)
                         else os.environ.get("CATNAV", "catnav"))

# A quarter bend that narrows from 8 to 5 mm
NARROW = """scene: narrow
step: 0.02
time_limit: 6
planner: {resolution: 5.0e-4, replans: 0}
vessels:
- name: artery
  shape:
    tube:
      axis: [[0, 0, -0.01], [0, 0, 0], [0, 0, 0.02], [0.001, 0, 0.0278], [0.004, 0, 0.035], [0.00879, 0, 0.0412],
             [0.015, 0, 0.046], [0.0222, 0, 0.049], [0.03, 0, 0.05], [0.06, 0, 0.05]]
      radius: [4.0e-3, 4.0e-3, 4.0e-3, 3.6e-3, 3.0e-3, 2.5e-3, 2.5e-3, 3.0e-3, 4.0e-3, 4.0e-3]
bodies:
- name: wire
  shape: {catheter: {length: 0.1, diameter: 1.0e-3, entry: [0, 0, 0], direction: [0, 0, 1], stations: 41, inserted: 0.002}}
  material: {young: 4.0e+6, poisson: 0.33, density: 1100}
  waypoints: [[0.045, 0, 0.05]]
  waypoint_tolerance: 1.0e-3
"""


class Device(unittest.TestCase):
    def setUp(self):
        self.folder = tempfile.TemporaryDirectory()
        self.addCleanup(self.folder.cleanup)
        with open(os.path.join(self.folder.name, "narrow.yaml"), "w") as file:
            file.write(NARROW)

    def study(self, *words, status=0):
        done = subprocess.run([CATNAV, "study", "device", *words], capture_output=True, text=True, timeout=600,
                              cwd=self.folder.name)
        self.assertEqual(done.returncode, status, done.stdout + done.stderr)
        return done

    def test_the_largest_that_passes_and_what_stops_the_next_are_found(self):
        closeness = 0.3
        done = self.study("narrow.yaml", "--out", "out", "--closeness", str(closeness))
        with open(os.path.join(self.folder.name, "out", "device.json")) as file:
            rows = json.load(file)
        with open(os.path.join(self.folder.name, "out", "device.csv")) as file:
            self.assertEqual(len(list(csv.DictReader(file))), len(rows))
        for ending in ("svg", "png"):
            self.assertGreater(os.path.getsize(os.path.join(self.folder.name, "out", "device." + ending)), 0)
        self.assertTrue(rows[0]["passes"], rows[0]["message"])
        for key, other in (("diameter", "young"), ("young", "diameter")):
            line = sorted((row for row in rows if row[other] == rows[0][other]), key=lambda row: row[key])
            good = max(row[key] for row in line if row["passes"])
            stops = next(row for row in line if row[key] > good)
            self.assertGreaterEqual(good, rows[0][key])
            self.assertLessEqual(stops[key] / good, 1 + closeness)
            self.assertFalse(stops["passes"])
            self.assertIn(stops["message"], done.stdout)
            self.assertIn("%.4g" % (1e3 * good if key == "diameter" else good), done.stdout)
        stiff = [row["bending"] / row["young"] / row["diameter"]**4 for row in rows]
        self.assertLess(max(stiff) / min(stiff) - 1, 1e-9)
        last = shlex.split(rows[-1]["command"])
        again = subprocess.run([CATNAV] + last[1:] + ["--quiet", "--report", "again.json"], cwd=self.folder.name)
        with open(os.path.join(self.folder.name, "again.json")) as file:
            report = json.load(file)
        self.assertEqual((again.returncode, report["verdict"]["code"], report["steps"]),
                         (0 if rows[-1]["passes"] else 2 if rows[-1]["status"] == "infeasible" else 3, rows[-1]["code"],
                          rows[-1]["steps"]))

    def test_what_is_no_catheter_or_no_scene_is_refused(self):
        with open(os.path.join(self.folder.name, "box.yaml"), "w") as file:
            file.write(NARROW.split("vessels")[0] + "bodies: [{name: box, shape: {beam: {size: [1, 1, 1], cells: [1, 1, 1]}}}]\n")
        self.assertIn("no catheter", self.study("box.yaml", status=1).stderr)
        self.assertIn("gone.yaml", self.study("gone.yaml", status=1).stderr)
        self.assertIn("SCENE.yaml", self.study(status=1).stderr)
        self.assertIn("closeness", self.study("narrow.yaml", "--closeness", "0", status=1).stderr)


if __name__ == "__main__":
    unittest.main()
