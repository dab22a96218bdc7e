#!/usr/bin/python3
"""`catnav study` as a user meets it: words, table, CSV, JSON. argv[1] or CATNAV is the command."""
import csv
import json
import os
import re
import subprocess
import sys
import tempfile
import unittest

CATNAV = os.path.abspath(sys.argv.pop(1) if len(sys.argv) > 1 and os.access(sys.argv[1], os.X_OK)
                         else os.environ.get("CATNAV", "catnav"))
DATA = os.environ.get("CATNAV_TEST_DATA",
                      os.path.join(os.path.dirname(os.path.abspath(__file__)), "..", "data"))

PIPE = """scene: pipe
step: 0.02
planner: {resolution: 1.0e-3}
vessels: [{name: artery, surface: {file: %s}}]
bodies:
- name: wire
  shape: {catheter: {length: 0.06, diameter: 2.0e-3, stations: 13}}
  material: {young: 1.0e+7, poisson: 0.3, density: 1100}
  waypoints: [[0.002, 0, 0.03]]
""" % os.path.join(DATA, "scenes", "pipe.stl")


class Study(unittest.TestCase):
    def setUp(self):
        self.folder = tempfile.TemporaryDirectory()
        self.addCleanup(self.folder.cleanup)
        self.pipe = self.path("pipe.yaml")
        with open(self.pipe, "w") as file:
            file.write(PIPE)

    def path(self, name):
        return os.path.join(self.folder.name, name)

    def run_it(self, *words, status=0):
        done = subprocess.run([CATNAV, "study", *words], capture_output=True, text=True, timeout=120,
                              cwd=self.folder.name)
        self.assertEqual(done.returncode, status, done.stdout + done.stderr)
        return done

    def test_without_a_study_the_studies_are_listed(self):
        for words in ([], ["fly"], ["fly", self.pipe]):
            done = self.run_it(*words, status=1)
            self.assertEqual(done.stdout, "")
            self.assertIn("usage: catnav study STUDY SCENE.yaml", done.stderr)
            self.assertIn("\n    paper ", done.stderr)
        self.assertIn('"fly"', done.stderr)
        self.assertIn("paper", self.run_it("--help").stdout)

    def test_a_scene_that_cannot_be_studied_is_refused(self):
        self.assertIn("SCENE.yaml", self.run_it("paper", status=1).stderr)
        self.assertIn("gone.yaml", self.run_it("paper", self.path("gone.yaml"), status=1).stderr)
        self.assertIn("outside the free space",
                      self.run_it("paper", self.pipe, "--set", "bodies.wire.waypoints=[[1, 1, 1]]", status=1).stderr)
        self.assertIn("cannot be", self.run_it("paper", self.pipe, "--out", self.pipe, status=1).stderr)

    def test_the_paper_is_a_table_a_csv_and_a_json_of_the_same_figures(self):
        done = self.run_it("paper", self.pipe, "--out", self.path("a/b"), "--threads", "1")
        self.assertEqual(done.stderr, "")
        rows = [line for line in done.stdout.split("\n") if re.match(r"(\d+ %)? +(own|paper) +200 ", line)]
        self.assertEqual(len(rows), 6)
        with open(self.path("a/b/paper.csv")) as file:
            table = list(csv.DictReader(file))
        with open(self.path("a/b/paper.json")) as file:
            study = json.load(file, parse_constant=lambda word: self.fail("not JSON: " + word))
        self.assertEqual((study["study"], study["scene"], study["threads"]), ("paper", "pipe", 1))
        self.assertEqual([s["fraction"] for s in study["states"]], [0.25, 0.5, 0.9])
        found = [(s, m) for s in study["states"] for m in s["methods"]]
        self.assertEqual([m["method"] for _, m in found], ["own", "paper"] * 3)
        for (state, method), row, printed in zip(found, table, rows):
            self.assertEqual((row["method"], int(row["step"])), (method["method"], state["step"]))
            self.assertEqual((method["steps"], method["failure"]), (200, None))
            self.assertAlmostEqual(float(row["step_ms_median"]), method["step_ms"]["median"], 6)
            self.assertIn("%.2f" % method["step_ms"]["median"], printed)
            self.assertIn("%.1e" % method["residual"]["max"], printed)
        self.assertTrue(all(len(row) == len(table[0]) and None not in row for row in table))

    def test_the_folder_is_build_study_unless_said(self):
        self.run_it("paper", self.pipe, "--quiet")
        self.assertEqual(sorted(os.listdir(self.path("build/study"))), ["paper.csv", "paper.json"])


if __name__ == "__main__":
    unittest.main()
