#!/usr/bin/python3
"""`catnav study` as a user meets it: words, table, CSV, JSON. argv[1] or CATNAV is the command."""
import csv
import json
import os
import re
import shlex
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

    def test_without_a_folder_the_usage_is_told(self):
        done = self.run_it(status=1)
        self.assertEqual(done.stdout, "")
        self.assertIn("usage: catnav study DIR", done.stderr)
        self.assertIn("study paper", done.stderr)
        self.assertIn("catnav study paper SCENE.yaml", self.run_it("--help").stdout)

    def test_a_folder_or_a_part_that_cannot_be_is_refused(self):
        self.assertIn("too many", self.run_it("fly", self.pipe, status=1).stderr)
        self.assertIn("pipe.yaml", self.run_it(self.pipe, "--quick", status=1).stderr)
        self.assertIn("accuracy", self.run_it(self.path("o"), "--only", "beauty", status=1).stderr)

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

    def test_the_log_of_a_soak_is_drawn_and_read(self):
        log = os.path.join(os.path.dirname(os.path.abspath(__file__)), "../../scripts/study/soak.csv")
        done = subprocess.run([CATNAV, "study", "soak", log, "--out", self.path("soak")], capture_output=True, text=True,
                              timeout=60)
        self.assertEqual(done.returncode, 0, done.stderr)
        self.assertRegex(done.stdout, r"soak, \d{4} s: \d+ times .* crossings 0")
        self.assertEqual(sorted(os.listdir(self.path("soak"))), ["soak.csv", "soak.png", "soak.svg"])
        with open(self.path("grown.csv"), "w") as file:  # a MiB a minute, a handle a row, steps that take twice as long
            file.write("time_s,memory_bytes,handles,cpu_ms_a_step,cpu_ms_a_step_newborn,wall_ms_a_step,crossings\n")
            file.writelines("%d,%d,%d,%g,1,1,1\n" % (60 * i, 2**20 * i, i, 2 if i > 20 else 1) for i in range(40))
        done = subprocess.run([CATNAV, "study", "soak", self.path("grown.csv"), "--out", self.path("grown")],
                              capture_output=True, text=True, timeout=60)
        self.assertRegex(done.stdout, r"memory \+26.* \(at most \+28.*handles \+26.*drift \+100.0 %.* crossings 40")
        for text in ("", "a,b\n1,2\n", "time_s,memory_bytes\n"):
            with open(self.path("bad.csv"), "w") as file:
                file.write(text)
            done = subprocess.run([CATNAV, "study", "soak", self.path("bad.csv"), "--out", self.path("bad")],
                                  capture_output=True, text=True, timeout=60)
            self.assertEqual(done.returncode, 1)
            self.assertIn("bad.csv", done.stderr)


class Everything(unittest.TestCase):
    """One quick study, looked at from all sides."""
    @classmethod
    def setUpClass(cls):
        cls.folder = tempfile.TemporaryDirectory()
        cls.addClassCleanup(cls.folder.cleanup)
        cls.done = subprocess.run([CATNAV, "study", cls.folder.name, "--quick"], capture_output=True, text=True,
                                  timeout=900)

    def rows(self, name):
        with open(os.path.join(self.folder.name, name + ".csv")) as file:
            rows = list(csv.DictReader(file))
        with open(os.path.join(self.folder.name, name + ".json")) as file:
            same = json.load(file, parse_constant=lambda word: self.fail("not JSON: " + word))
        self.assertEqual((len(rows), list(rows[0]) if rows else None), (len(same), list(same[0]) if same else None))
        return same

    def test_it_ends_well_and_leads_through_what_it_made(self):
        self.assertEqual(self.done.returncode, 0, self.done.stderr)
        with open(os.path.join(self.folder.name, "index.md")) as file:
            page = file.read()
        files = os.listdir(self.folder.name)
        links = re.findall(r"\]\(([^)]+)\)", page)
        self.assertGreater(len(links), 20)
        for link in links:
            self.assertIn(link, files)
        for picture in [name[:-4] for name in files if name.endswith(".svg")]:
            for ending in (".png", ".csv", ".json"):
                self.assertGreater(os.path.getsize(os.path.join(self.folder.name, picture + ending)), 0)
        for head in ("Error against run time", "Contact beside theory", "Contact: `strict`, `project`, `penalty`", "Stability",
                     "Speed", "Collision detection", "What is left out", "Skins and molecules"):
            self.assertIn("## " + head, page)

    def test_the_error_falls_with_finer_meshes_and_the_papers_method_is_there(self):
        rows = self.rows("accuracy")
        for problem in ("cantilever", "elastica", "own_weight", "twist"):
            for model in {row["model"] for row in rows}:
                errors = [row["error"] for row in rows if (row["problem"], row["model"], row["method"]) ==
                          (problem, model, "own") and row["error"] is not None]
                if model == "tet4":
                    self.assertTrue(len(errors) > 2 and errors == sorted(errors, reverse=True), (problem, errors))
                elif errors:
                    self.assertLessEqual(errors[-1], max(errors[0], 1e-3), (problem, model, errors))
            self.assertTrue(any(row["problem"] == problem and row["method"] == "paper" and
                                row["error"] is not None for row in rows), problem)
            self.assertTrue(any(row["problem"] == problem and row["pareto"] for row in rows), problem)

    def test_molecules_stand_beside_the_others_and_skins_are_measured(self):
        for problem in ("cantilever", "sway"):
            errors = [row["error"] for row in self.rows("accuracy")
                      if (row["problem"], row["model"], row["integrator"]) == (problem, "molecules", "euler")]
            self.assertTrue(errors and None not in errors and errors[-1] < 0.15, (problem, errors))
        self.assertTrue(any(row["integrator"] == "explicit" and row["error"] is not None
                            for row in self.rows("accuracy_sway")))
        angles = {row["per_vertex"]: float(row["degrees"]) for row in self.rows("smoothness")
                  if (row["bar"], row["edges_around"]) == ("3x3x13", "64")}
        self.assertTrue({str(n) for n in range(1, 9)} <= set(angles))
        self.assertLess(angles["4"], 0.5 * angles["1"])
        speed = [row for row in self.rows("skin_speed") if int(row["vertices"]) > 90000]
        self.assertTrue(speed and all(float(row["best_ms"]) > 0 for row in speed))
        self.assertEqual({row["against"] for row in self.rows("figure4")}, {"control_points", "intervals"})
        self.assertEqual({row["anchors"] for row in self.rows("figure8")}, {1, 4})
        tissue = self.rows("tissue")
        self.assertEqual([row["status"] for row in tissue], ["ran"] * len(tissue))

    def test_parts_of_skins_that_are_none_are_refused(self):
        for words in ([], ["speed", "0"], ["shape", "9"], ["shape", "1", "2"], ["beauty"]):
            done = subprocess.run([CATNAV, "study", "skin", *words], capture_output=True, text=True, timeout=60)
            self.assertEqual((done.returncode, done.stdout), (1, ""), words)
            self.assertIn("usage", done.stderr)

    def test_a_row_is_repeated_by_its_command(self):
        row = next(row for row in self.rows("accuracy") if row["problem"] == "elastica" and row["method"] == "own")
        words = shlex.split(row["command"])
        self.assertEqual(words[:2], ["catnav", "run"])
        subprocess.run([CATNAV] + words[1:] + ["--quiet", "--report", "again.json"], cwd=self.folder.name, check=True)
        with open(os.path.join(self.folder.name, "again.json")) as file:
            again = json.load(file)
        self.assertEqual((again["counts"]["dof"], again["solver"]["newton_max"]), (row["dof"], row["newton_max"]))

    def test_no_cell_hangs_crashes_or_gives_a_number_that_is_not_finite(self):
        rows = self.rows("stability")
        self.assertEqual(self.rows("stability_failures"), [])
        self.assertGreater(len(rows), 50)
        self.assertEqual({row["result"] for row in rows} - {"recovered", "still deformed", "refused", "stopped", "slow"}, set())
        self.assertGreater(sum(row["result"] == "recovered" for row in rows), len(rows) / 2)
        self.assertTrue(all(row["message"] for row in rows if row["result"] in ("refused", "stopped")))

    def test_contact_is_beside_theory_and_strict_lets_nothing_cross(self):
        theory = self.rows("theory")
        self.assertGreater(len(theory), 15)
        self.assertEqual([row for row in theory if not row["within"]], [])
        rows, hard = self.rows("contact"), self.rows("contact_hard")
        self.assertEqual({row["method"] for row in rows}, {"strict", "project", "penalty"})
        for row in rows + hard:
            if row["method"] == "strict":
                self.assertEqual((row["crossings"], row["outside"]), (0, 0), row)
        self.assertTrue(all(row["step_ms_median"] > 0 and row["error"] is not None for row in rows))
        self.assertTrue(any(row["penetration"] > 0 for row in rows if row["method"] == "penalty"))
        deep = [row for row in hard if "deep" in row["case"]]
        self.assertTrue(deep and all(row["result"] == ("refused" if row["method"] == "strict" else "parted") for row in deep))
        self.assertTrue(all("deep, near" in row["message"] for row in deep if row["method"] == "strict"))
        self.assertTrue(all(row["result"] == "held" for row in hard if "deep" not in row["case"]))

    def test_cook_s_membrane_is_a_curve_for_every_poisson_s_ratio(self):
        rows = self.rows("cook")
        self.assertEqual({round(row["nu"], 4) for row in rows}, {0.3, 0.3333, 0.49, 0.499, 0.4999})
        for nu in {row["nu"] for row in rows}:
            errors = {model: [row["error"] for row in rows if (row["model"], row["nu"]) == (model, nu)]
                      for model in ("tet4", "tet10")}
            self.assertTrue(all(len(e) > 2 and e == sorted(e, reverse=True) for e in errors.values()), errors)
            self.assertLess(errors["tet10"][-1], 0.03 if nu < 0.4999 else 0.05)
            self.assertLess(errors["tet10"][-1], 0.5 * errors["tet4"][-1])
        self.assertIn("POISSON", Study.run_it(self, "cook", "0.5", status=1).stderr)

    def test_detection_is_measured_against_triangles(self):
        rows = self.rows("detection")
        self.assertGreater(len(rows), 3)
        self.assertTrue(all(row["build_ms"] > 0 and row["refit_ms"] > 0 and row["pairs"] > row["triangles"] for row in rows))
        self.assertIn("TRIANGLES", Study.run_it(self, "detection", "many", status=1).stderr)

    def test_speed_and_what_is_left_out_are_measured(self):
        speed = self.rows("speed")
        self.assertTrue({"own", "paper"} <= {row["method"] for row in speed if row["step_ms_median"]})
        self.assertTrue(all(row["memory_mib"] > 0 for row in self.rows("cost") if row["status"] == "ran"))
        for case in {row["case"] for row in self.rows("equal_error")}:
            paper, *own = [row for row in self.rows("equal_error") if row["case"] == case]
            best = [row for row in own if row["best"]]
            self.assertEqual((paper["method"], len(best)), ("paper", 1))
            self.assertLessEqual(best[0]["error"], paper["error"])
        self.assertEqual({row["what"] for row in self.rows("left_out")},
                         {"self_contact", "refit", "refactor", "wall_solve", "inertia", "stress"})


if __name__ == "__main__":
    unittest.main()
