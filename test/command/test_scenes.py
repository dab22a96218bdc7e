#!/usr/bin/python3
"""The scenes of launch/scenes. argv[1] or CATNAV is the command. CATNAV_SCENES=all: whole runs at full size too."""
import csv
import json
import math
import os
import subprocess
import sys
import tempfile
import unittest
import xml.etree.ElementTree

CATNAV = os.path.abspath(sys.argv.pop(1) if len(sys.argv) > 1 and os.access(sys.argv[1], os.X_OK)
                         else os.environ.get("CATNAV", "catnav"))
ROOT = os.path.join(os.path.dirname(os.path.abspath(__file__)), "..", "..")
SCENES = os.path.join(ROOT, "launch", "scenes")
DATA = os.environ.get("CATNAV_TEST_DATA", os.path.join(ROOT, "test", "data"))

WALL = """scene: slits
time_limit: 20
vessels: [{name: room, shape: {box: {min: [0, 0, 0], max: [0.6, 0.6, 0.08]}}}]
obstacles:
%s
bodies:
- name: cube
  shape: {beam: {size: [0.04, 0.04, 0.04], cells: [4, 4, 4]}, translate: [0.1, 0.28, 0.02]}
  model: tet4
  material: {young: 2.0e+4, poisson: 0.33, density: 1000}
  drive: {nodes: uniform, speed: 0.3, path_distance: 5.0e-3}
  waypoints: [[0.5, 0.3, 0.04]]
  waypoint_tolerance: 0.02
  path: {clearance: 0.01, region: {plane: {point: [0, 0, 0.04], normal: [0, 0, 1]}}}
  limits: [{quantity: volume, reduce: mean, limit: 5.0e-3}]
"""


def wall_with(folder, *slits):
    """A scene file: a cube of 4 cm before a wall with slits (from y, to y) [m]."""
    ends = [-0.1] + [y for slit in slits for y in slit] + [0.7]
    parts = ["- {name: part_%d, shape: {box: {min: [0.25, %g, -0.1], max: [0.35, %g, 0.2]}}}" % (i, low, high)
             for i, (low, high) in enumerate(zip(ends[::2], ends[1::2]))]
    file = os.path.join(folder, "slits.yaml")
    with open(file, "w") as out:
        out.write(WALL % "\n".join(parts))
    return file


def run(scene, **settings):
    """Exit status, report and messages of a run; settings: key__path=value."""
    with tempfile.TemporaryDirectory() as folder:
        report = os.path.join(folder, "report.json")
        words = [CATNAV, "run", os.path.join(SCENES, scene), "--report", report, "--quiet"]
        for key, value in settings.items():
            words += ["--set", key.replace("__", ".") + "=" + str(value)]
        done = subprocess.run(words, capture_output=True, text=True, timeout=1800)
        with open(report) as file:
            return done.returncode, json.load(file), done.stdout + done.stderr


def path(scene, *words, **settings):
    """Points of a scene's plan."""
    with tempfile.TemporaryDirectory() as folder:
        out = os.path.join(folder, "path.csv")
        words = [CATNAV, "plan", os.path.join(SCENES, scene), "--out", out, *words]
        for key, value in settings.items():
            words += ["--set", key.replace("__", ".") + "=" + json.dumps(value)]
        subprocess.run(words, check=True, capture_output=True, timeout=600)
        with open(out) as file:
            return [{k: float(v) for k, v in row.items()} for row in csv.DictReader(file)]


def sharpest_turn(way, chord):
    """Largest angle between the chords before and after a point of the path."""
    def at(s):
        i = next(i for i in range(1, len(way)) if way[i]["s"] >= s or i == len(way) - 1)
        a, b = way[i - 1], way[i]
        t = (s - a["s"]) / (b["s"] - a["s"])
        return [a[k] + t * (b[k] - a[k]) for k in "xyz"]

    largest = 0
    for p in way:
        if not chord <= p["s"] <= way[-1]["s"] - chord:
            continue
        before, here, after = at(p["s"] - chord), at(p["s"]), at(p["s"] + chord)
        u, w = ([b - a for a, b in zip(*ends)] for ends in ((before, here), (here, after)))
        cosine = sum(a * b for a, b in zip(u, w)) / math.hypot(*u) / math.hypot(*w)
        largest = max(largest, math.acos(min(1, cosine)))
    return largest


class Scenes(unittest.TestCase):
    def unharmed(self, report, shape_error):
        """Arrived, in its limits, nothing ever crossed or outside, and in its own shape again."""
        self.assertEqual(report["verdict"]["code"], "REACHED", report["verdict"]["message"])
        self.assertEqual(report["contact"]["intersections"], 0)
        self.assertEqual(report["contact"]["outside_nodes"], 0)
        self.assertGreater(report["contact"]["gap_min"], 0)
        self.assertLessEqual(report["solver"]["residual_max"], 1e-3)
        for limit in report["limits"]:
            self.assertLessEqual(limit["worst"], limit["limit"])
        for body in report["bodies"]:
            self.assertLess(body["shape_error"], shape_error)
            self.assertLess(abs(body["volume"] / body["rest_volume"] - 1), 1e-3)

    def test_every_scene_has_a_launch_file_that_opens_it_in_a_view_of_its_own(self):
        for name in sorted(f[:-len(".yaml")] for f in os.listdir(SCENES) if f.endswith(".yaml")):
            if name == "all_keys":
                continue
            launch = os.path.join(SCENES, "..", ("demo" if name == "liver" else name) + ".launch")
            said = {arg.get("name"): arg.get("value") or arg.get("default")
                    for arg in xml.etree.ElementTree.parse(launch).iter("arg")}
            self.assertEqual((said["scene"], said["view"]), (name, "demo" if name == "liver" else name))
            self.assertTrue(os.path.exists(os.path.join(SCENES, "..", "rviz", said["view"] + ".rviz")))

    def test_roslaunch_can_say_what_every_argument_of_a_launch_file_means(self):
        for name in sorted(f for f in os.listdir(os.path.join(SCENES, "..")) if f.endswith(".launch")):
            root = xml.etree.ElementTree.parse(os.path.join(SCENES, "..", name)).getroot()
            given = [arg for arg in root.findall("arg") if arg.get("value") is None]  # what `roslaunch --ros-args` lists
            self.assertTrue(given, name)
            for arg in given:
                self.assertTrue(arg.get("doc"), f"{name}: {arg.get('name')}")

    # bear
    def test_the_bear_and_its_tube_are_of_the_papers_size(self):
        status, report, said = run("bear.yaml", time_limit=0.01)
        self.assertEqual(status, 3, said)
        self.assertGreaterEqual(report["counts"]["deformable_nodes"], 5252)
        self.assertGreaterEqual(report["counts"]["rigid_nodes"], 1053)

    def test_the_bear_whose_surface_crosses_itself_is_refused_with_the_pairs(self):
        status, report, said = run("bear.yaml", bodies__bear__shape__file=os.path.join(DATA, "bodies",
                                                                                     "bullet_teddy.obj"))
        self.assertEqual((status, report["verdict"]["code"]), (1, "BAD_INPUT"), said)
        for word in ("6 pairs of triangles cross", "1722-3111", "1747-3173"):
            self.assertIn(word, report["verdict"]["message"])

    def test_a_coarse_bear_comes_through_a_wider_tube_with_its_shape(self):
        status, report, said = run("bear.yaml", bodies__bear__shape__max_volume=0, step=0.01, contact__gap=0.04,
                                   bodies__bear__drive__speed=8, obstacles__tube__shape__translate=[0, -0.9, 0],
                                   obstacles__tube__shape__tube__radius=[1.2, 1.025, 0.9, 0.8, 0.75, 0.75, 0.75, 0.8,
                                                                         0.9, 1.025, 1.2],
                                   bodies__bear__waypoints=[[0, 2.2, 0.05], [0, 4.6, 0.05]])
        self.assertEqual(status, 0, said)
        self.assertGreater(report["contact"]["force_max"], 0)
        self.unharmed(report, 1e-3)

    @unittest.skipUnless(os.environ.get("CATNAV_SCENES") == "all", "whole runs: CATNAV_SCENES=all")
    def test_the_bear_comes_through_the_tube_with_its_shape(self):
        status, report, said = run("bear.yaml")
        self.assertEqual(status, 0, said)
        self.unharmed(report, 1e-4)

    # snake
    def test_the_snake_and_its_rocks_are_of_the_papers_size(self):
        status, report, said = run("snake.yaml", time_limit=0.01)
        self.assertEqual(status, 3, said)
        self.assertGreaterEqual(report["counts"]["deformable_nodes"], 6832)
        self.assertGreaterEqual(report["counts"]["rigid_nodes"], 5302)
        self.assertEqual(report["contact"]["intersections"] + report["contact"]["outside_nodes"], 0)

    def test_the_snakes_way_winds_between_the_rocks_on_the_ground(self):
        straight, slithering = (path("snake.yaml", bodies__snake__path__deviation=deviation)
                                for deviation in ([], [{"amplitude": 0.5, "wavelength": 6, "normal": [0, 0, 1]}]))
        for way in straight, slithering:
            self.assertLess(max(abs(p["z"]) for p in way), 1e-3)
            self.assertGreaterEqual(min(p["clearance"] for p in way), 0.14)
            self.assertLessEqual(sharpest_turn(way, 0.56), math.radians(22.5))
            self.assertEqual([way[-1][k] for k in "xyz"], [18.5, 0, 0])
            self.assertTrue(any(2 < p["x"] < 11 and abs(p["y"]) < 4.2 for p in way))  # not around the field
        self.assertGreater(slithering[-1]["s"], 1.01 * straight[-1]["s"])

    def test_the_same_seed_gives_the_same_way_on_one_thread_and_on_two(self):
        one, two, other = (path("snake.yaml", "--threads", threads, seed=seed)
                           for threads, seed in (("1", 3), ("2", 3), ("2", 4)))
        self.assertEqual(one, two)
        self.assertNotEqual(one, other)

    @unittest.skipUnless(os.environ.get("CATNAV_SCENES") == "all", "whole runs: CATNAV_SCENES=all")
    def test_the_snake_slithers_to_the_other_side(self):
        status, report, said = run("snake.yaml")
        self.assertEqual(status, 0, said)
        self.unharmed(report, 0.1)  # it ends in a curve of its path

    # molecules
    def test_the_bear_and_the_cushion_of_molecules_touch_by_their_skins(self):
        counts = {}
        for model, method, more in (("molecules", "strict", {}), ("molecules", "penalty", {}), ("tet4", "strict", {}),
                                    ("molecules", "penalty", {"solver__integrator": "explicit"})):
            status, report, said = run("molecules.yaml", time_limit=0.1, bodies__bear__model=model,
                                       bodies__cushion__model=model, contact__method=method, **more)
            self.assertEqual((status, report["verdict"]["code"]), (0, "RAN"), said)
            self.assertGreater(report["contact"]["force_max"], 0)
            self.assertLessEqual(report["solver"]["residual_max"], 1e-3)
            crossed = report["contact"]["intersections"] + report["contact"]["outside_nodes"]
            (self.assertEqual if method == "strict" else self.assertGreater)(crossed, 0)
            counts[model] = report["counts"]["deformable_nodes"]
        self.assertGreater(min(counts.values()), 2000)

    @unittest.skipUnless(os.environ.get("CATNAV_SCENES") == "all", "whole runs: CATNAV_SCENES=all")
    def test_the_bear_comes_to_rest_on_the_cushion(self):
        for model in "molecules", "tet4":
            status, report, said = run("molecules.yaml", bodies__bear__model=model, bodies__cushion__model=model)
            self.assertEqual((status, report["verdict"]["code"]), (0, "RAN"), said)
            self.assertEqual(report["contact"]["intersections"] + report["contact"]["outside_nodes"], 0)
            bear, cushion = report["bodies"][:2]
            self.assertLess(bear["kinetic"] + cushion["kinetic"], 1e-3)
            self.assertGreater(bear["com"][2], cushion["com"][2])

    # ways that break a limit
    def test_a_slit_too_narrow_for_the_volume_limit_is_left_for_a_wide_one_farther_off(self):
        with tempfile.TemporaryDirectory() as folder:
            file = wall_with(folder, (0.03, 0.15), (0.288, 0.312))
            status, report, said = run(file, planner__replans=0)
            self.assertEqual((status, report["verdict"]["code"], report["verdict"]["quantity"]),
                             (2, "LIMIT_BROKEN", "volume"), said)
            self.assertGreater(report["verdict"]["value"], report["verdict"]["limit"])
            status, report, said = run(file)
            self.assertEqual((status, report["replans"]), (0, 1), said)
            self.unharmed(report, 0.1)

    def test_of_equal_detours_a_refused_one_is_not_tried_again(self):
        narrow = [(0.208, 0.232), (0.288, 0.312), (0.368, 0.392)]
        with tempfile.TemporaryDirectory() as folder:
            status, report, said = run(wall_with(folder, (0.03, 0.15), *narrow))
            self.assertEqual((status, report["replans"]), (0, 3), said)  # each narrow one once, then the wide one
            self.unharmed(report, 0.1)
            status, report, said = run(wall_with(folder, *narrow))
            self.assertEqual((status, report["verdict"]["code"], report["replans"]), (2, "LIMIT_BROKEN", 2), said)

    # the paper's table
    def test_the_papers_table_stands_beside_our_figures_for_both_methods(self):
        for more, steps in (["--whole"], 2), (["--states", "1"], 3):
            with tempfile.TemporaryDirectory() as folder:
                words = [CATNAV, "study", "table1", "--scenes", "bear", "--steps", "2", "--out", folder, *more]
                done = subprocess.run(words, capture_output=True, text=True, timeout=300)
                self.assertEqual(done.returncode, 0, done.stderr)
                with open(os.path.join(folder, "table1.json")) as file:
                    rows = json.load(file)
            for word in ("planning [s]", "collision [s]", "ms a step", "358.8", "3.12", "paper's method",
                         "density 1000", "at most 1 s wanted"):
                self.assertIn(word, done.stdout)
            self.assertEqual("~" in done.stdout, steps == 3)  # reckoned, and said so
            self.assertEqual([row["method"] for row in rows], ["ours", "paper's method"])
            self.assertEqual([row["steps"] for row in rows], [2, steps])
            for row in rows:  # the paper's for as many steps as ours
                self.assertAlmostEqual(row["ms a step"], 1e3 * row["simulation [s]"] / 2)
            self.assertEqual(rows[0]["deformable nodes"], rows[1]["deformable nodes"])

    def test_a_table_of_scenes_that_are_none_is_refused(self):
        for word in ("--scenes", "--seconds"):
            done = subprocess.run([CATNAV, "study", "table1", word, "none"], capture_output=True, text=True, timeout=60)
            self.assertEqual(done.returncode, 1, done.stderr)
            self.assertIn("none", done.stderr)


if __name__ == "__main__":
    unittest.main()
