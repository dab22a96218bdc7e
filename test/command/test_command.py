#!/usr/bin/python3
"""The command as a user meets it: words, exit status, report, frames, signals. argv[1] or CATNAV is the command."""
import csv
import json
import os
import pty
import signal
import subprocess
import sys
import tempfile
import time
import unittest

CATNAV = os.path.abspath(sys.argv.pop(1) if len(sys.argv) > 1 and os.access(sys.argv[1], os.X_OK)
                         else os.environ.get("CATNAV", "catnav"))
DATA = os.environ.get("CATNAV_TEST_DATA",
                      os.path.join(os.path.dirname(os.path.abspath(__file__)), "..", "data"))
SCENES = os.path.join(DATA, "scenes")

BEAM = """scene: beam
step: 0.01
time_limit: 0.2
gravity: [0, 0, -9.81]
bodies:
- name: bar
  shape: {beam: {size: [0.1, 0.01, 0.01], cells: [10, 1, 1]}}
  material: {young: 1.0e+6, poisson: 0.3, density: 1000}
  fixed: {box: [[0, 0, 0], [0, 0.01, 0.01]]}
"""
PIPE = """scene: pipe
vessels: [{name: artery, surface: {file: %s}}]
bodies:
- name: wire
  shape: {catheter: {length: 0.06, diameter: 2.0e-3, stations: 13}}
  material: {young: 1.0e+7, poisson: 0.3, density: 1100}
  waypoints: [[0.002, 0, 0.03]]
""" % os.path.join(SCENES, "pipe.stl")


class Command(unittest.TestCase):
    def setUp(self):
        self.folder = tempfile.TemporaryDirectory()
        self.addCleanup(self.folder.cleanup)
        self.beam = self.write("beam.yaml", BEAM)
        self.pipe = self.write("pipe.yaml", PIPE)

    def path(self, name):
        return os.path.join(self.folder.name, name)

    def write(self, name, text):
        with open(self.path(name), "w") as file:
            file.write(text)
        return self.path(name)

    def run_it(self, *words, status=0):
        done = subprocess.run([CATNAV, *words], capture_output=True, text=True, timeout=120)
        self.assertEqual(done.returncode, status, done.stdout + done.stderr)
        return done

    def start(self, *words):
        """The command, half a second after its start: its signals are caught by then."""
        command = subprocess.Popen([CATNAV, *words], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
        self.addCleanup(command.kill)
        time.sleep(0.5)
        return command

    def report(self, name="report.json"):
        with open(self.path(name)) as file:
            return json.load(file, parse_constant=lambda word: self.fail("not JSON: " + word))

    # words
    def test_version_and_help_of_every_command(self):
        self.assertRegex(self.run_it("--version").stdout, r"^catnav \d+\.\d+\.\d+\n$")
        page = self.run_it("--help").stdout
        for name in ("run", "plan", "check"):
            self.assertIn("    %-8s " % name, page)
            own = self.run_it(name, "--help").stdout
            self.assertEqual(own, self.run_it("help", name).stdout)
            for part in ("NAME", "SYNOPSIS", "OPTIONS", "EXIT STATUS"):
                self.assertIn(part, own)

    def test_a_wrong_word_is_one_sentence_and_exit_1(self):
        for words in ([], ["fly"], ["--fly"], ["help", "fly"], ["run"], ["run", "--fly", self.beam],
                      ["run", self.beam, self.beam], ["run", self.beam, "--threads"],
                      ["run", self.beam, "--threads", "0"], ["run", self.beam, "--threads", "2x"],
                      ["run", self.beam, "--quiet=1"], ["run", self.beam, "--set", "step"],
                      ["run", self.beam, "--every=0"], ["plan", self.beam], ["plan", "--out", self.path("p.csv")],
                      ["check"], ["check", "x.stl", "--scale", "nan"], ["check", "x.stl", "--scale", "0,1"]):
            done = self.run_it(*words, status=1)
            self.assertEqual(done.stdout, "")
            self.assertEqual(done.stderr.count("\n"), 1, done.stderr)

    def test_threads_beyond_64_are_refused_at_once_by_their_range(self):
        for words in (["run", self.beam], ["plan", self.pipe, "--out", self.path("p.csv")]):
            for threads in ("65", "100000", "99999999999999999999"):
                done = self.run_it(*words, "--threads", threads, status=1)
                self.assertIn("from 1 to 64", done.stderr)
        self.run_it("run", self.beam, "--threads", "64", "--quiet")

    # refused scenes
    def test_an_unreadable_scene_names_file_and_line_and_leaves_no_report(self):
        bad = self.write("bad.yaml", BEAM.replace("step: 0.01", "step: 0,01"))
        done = self.run_it("run", bad, "--report", self.path("report.json"), status=1)
        self.assertTrue(done.stderr.startswith(bad + ":2: step: expected a number > 0 [s]"), done.stderr)
        self.assertFalse(os.path.exists(self.path("report.json")))
        done = self.run_it("run", self.beam, "--set", "bodies.bar.modle=rod", status=1)
        self.assertIn('the nearest known key is "model"', done.stderr)

    def test_a_refused_run_still_writes_its_report(self):
        self.write("open.obj", "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n")
        scene = self.write("refused.yaml", BEAM.replace("beam: {size: [0.1, 0.01, 0.01], cells: [10, 1, 1]}",
                                                        "file: open.obj"))
        self.run_it("run", scene, "--report", self.path("report.json"), "--quiet", status=1)
        report = self.report()
        self.assertEqual((report["status"], report["verdict"]["code"]), ("bad_input", "BAD_INPUT"))
        self.assertEqual(report["verdict"]["fault"], "OPEN")
        self.assertTrue(report["verdict"]["message"])

    def test_a_refused_wall_still_writes_its_report(self):
        self.write("broken.stl", "solid a\n facet normal nan 0 0\n outer loop\n vertex 0 0 x\n")
        self.run_it("run", self.pipe, "--set", "vessels.artery.surface.file=broken.stl", "--report",
                    self.path("report.json"), status=1)
        self.assertEqual((self.report()["verdict"]["code"], self.report()["verdict"]["fault"]), ("BAD_INPUT", "NUMBER"))

    def test_a_refusal_is_said_once_and_on_one_line(self):
        self.write("open.obj", "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n")
        body = ("run", self.beam, "--set", "bodies.0.shape={file: open.obj}")  # refused by the run's door
        self.write("broken.stl", "solid a\n facet normal nan 0 0\n outer loop\n vertex 0 0 x\n")
        wall = ("run", self.pipe, "--set", "vessels.artery.surface.file=broken.stl")  # by the world's
        name = ("run", self.beam, "--set", 'bodies.0.name="a\n\nb"')  # by the scene's, quoting line ends
        for words in (body, wall, name, (*body, "--quiet"), ("plan", *wall[1:], "--out", self.path("p.csv"))):
            done = self.run_it(*words, status=1)
            self.assertEqual((done.stdout, done.stderr.count("\n")), ("", 1), done.stdout + done.stderr)
            self.assertRegex(done.stderr, r"open\.obj|broken\.stl|control character")

    def test_a_report_that_cannot_be_written_is_told_before_the_run(self):
        started = time.monotonic()
        done = self.run_it("run", self.beam, "--set", "time_limit=1e6", "--report", self.path("no/r.json"), status=1)
        self.assertIn("no/r.json: cannot be written", done.stderr)
        self.assertLess(time.monotonic() - started, 30)
        self.write("file", "")
        done = self.run_it("run", self.beam, "--frames", self.path("file"), status=1)
        self.assertIn("folder", done.stderr)

    # runs
    def test_a_run_ends_with_its_verdict_report_and_frames(self):
        done = self.run_it("run", self.beam, "--report", self.path("report.json"), "--frames", self.path("f/g"))
        self.assertTrue(done.stdout.startswith("ran: "), done.stdout)
        self.assertIn(self.path("report.json"), done.stdout)
        self.assertIn(self.path("f/g/frames.pvd"), done.stdout)
        self.assertEqual(done.stderr, "")  # no bar where there is no terminal
        report = self.report()
        self.assertEqual((report["scene"], report["status"], report["steps"]), ("beam", "ran", 20))
        self.assertLess(report["bodies"][0]["tip"][2], 0.005)  # it hangs down
        pieces = sorted(os.listdir(self.path("f/g")))
        self.assertEqual(pieces, sorted(["bar_%d.vtu" % i for i in range(21)] + ["frames.pvd"]))

    def test_every_and_set_and_quiet_do_what_they_say(self):
        done = self.run_it("run", self.beam, "--quiet", "--every=4", "--frames=" + self.path("f"), "--set",
                           "step=0.02", "--report", self.path("report.json"))
        self.assertEqual(done.stdout + done.stderr, "")
        self.assertEqual(self.report()["steps"], 10)
        self.assertEqual(sorted(os.listdir(self.path("f"))),  # every fourth and the last
                         ["bar_0.vtu", "bar_10.vtu", "bar_4.vtu", "bar_8.vtu", "frames.pvd"])

    def test_threads_change_no_bit_of_the_answer(self):
        answers = []
        for threads in ("1", "2", "3"):
            self.run_it("run", self.pipe, "--threads", threads, "--report", self.path("report.json"))
            report = self.report()
            for varies in ("time", "memory_peak_bytes", "threads", "left_out"):
                report.pop(varies)
            answers.append(report)
        self.assertEqual(answers[0], answers[1])
        self.assertEqual(answers[0], answers[2])
        self.assertEqual(answers[0]["status"], "reached")
        self.assertEqual(answers[0]["contact"]["intersections"], 0)

    def test_a_signal_stops_within_a_step_and_still_writes_the_report(self):
        for number in (signal.SIGINT, signal.SIGTERM):
            run = subprocess.Popen([CATNAV, "run", self.beam, "--set", "time_limit=1e6", "--report",
                                    self.path("report.json")], stdout=subprocess.PIPE, stderr=subprocess.PIPE)
            time.sleep(1.0)
            run.send_signal(number)
            run.communicate(timeout=30)
            self.assertEqual(run.returncode, 130)
            report = self.report()
            self.assertEqual((report["status"], report["verdict"]["code"]), ("interrupted", "CANCELLED"))
            self.assertGreater(report["steps"], 0)
            os.unlink(self.path("report.json"))

    def test_a_second_signal_ends_at_once(self):
        words = ("--set", "planner.resolution=2e-4")  # seconds of mapping, in which no signal is looked at
        for start in (("run", self.pipe), ("plan", self.pipe, "--out", self.path("p.csv"))):
            for first, second in ((signal.SIGINT, signal.SIGINT), (signal.SIGINT, signal.SIGTERM)):
                command = self.start(*start, *words)
                command.send_signal(first)
                time.sleep(0.3)
                self.assertIsNone(command.poll())
                command.send_signal(second)
                command.communicate(timeout=1.5)
                self.assertEqual(command.returncode, -second)

    def test_a_mesh_or_material_that_spoils_the_answer_is_told_before_it(self):
        locks = ("--set", "bodies.0.material.poisson=0.49", "--set", "bodies.0.model=tet4")
        done = self.run_it("run", self.beam, *locks)
        self.assertRegex(done.stderr, r"^warning: body .*lock.* 0\.49.*tet10")
        self.assertNotIn("warning", self.run_it("run", self.beam, *locks, "--quiet").stderr)
        self.assertNotIn("warning", self.run_it("run", self.beam, "--set", "bodies.0.model=tet10").stderr)
        with open(self.path("flat.node"), "w") as node, open(self.path("flat.ele"), "w") as ele:
            node.write("5 3 0 0\n0 0 0 0\n1 0.1 0 0\n2 0 0.1 0\n3 0 0 0.1\n4 0.03 0.03 -0.000001\n")
            ele.write("2 4 0\n0 0 1 2 3\n1 0 2 1 4\n")
        with open(self.path("flat.yaml"), "w") as scene:
            scene.write("step: 0.01\ntime_limit: 0.02\ncontact: {method: none}\nbodies:\n- name: chip\n  shape: {file: flat.node}\n"
                        "  model: tet4\n  material: {young: 1.0e+5, poisson: 0.3, density: 1000}\n")
        done = self.run_it("run", self.path("flat.yaml"))
        self.assertRegex(done.stderr, r"^warning: body chip: tetrahedron 1 of 2 has .*\(1 are slivers")

    def test_a_terminal_shows_progress(self):
        try:
            main, terminal = pty.openpty()
        except OSError:
            self.skipTest("no pseudo-terminals on this machine")
        run = subprocess.Popen([CATNAV, "run", self.beam, "--set", "time_limit=100"], stdout=subprocess.PIPE,
                               stderr=terminal)
        os.close(terminal)
        seen = b""
        try:
            while b"steps/s" not in seen:
                seen += os.read(main, 4096)
        except OSError:
            self.fail("no bar in: %r" % seen)
        finally:
            run.terminate()
            run.communicate(timeout=30)
            os.close(main)
        self.assertIn(b"of 100 s", seen)

    # plan
    def test_a_plan_is_a_table_of_the_path(self):
        self.run_it("plan", self.pipe, "--out", self.path("p.csv"))
        with open(self.path("p.csv")) as file:
            self.assertEqual(file.readline(), "s,x,y,z,clearance,waypoint\n")
            file.seek(0)
            rows = [{k: float(v) for k, v in row.items()} for row in csv.DictReader(file)]
        self.assertEqual(rows[-1]["waypoint"], 0)
        self.assertLess(abs(rows[-1]["z"] - 0.03) + abs(rows[-1]["x"] - 0.002), 1e-9)
        for a, b in zip(rows, rows[1:]):
            step = sum((a[k] - b[k]) ** 2 for k in "xyz") ** 0.5
            self.assertLess(abs(b["s"] - a["s"] - step), 1e-9)
        self.assertGreater(min(row["clearance"] for row in rows), 1e-3)

    def test_no_plan_is_infeasible(self):
        done = self.run_it("plan", self.pipe, "--out", self.path("p.csv"), "--set",
                           "obstacles=[{name: plug, shape: {box: {min: [-1, -1, 0.015], max: [1, 1, 0.02]}}}]",
                           status=2)
        self.assertTrue(done.stderr.startswith("infeasible: "), done.stderr)
        self.assertFalse(os.path.exists(self.path("p.csv")))

    def test_a_signal_ends_a_plan_in_one_word_without_a_path(self):
        for number in (signal.SIGINT, signal.SIGTERM):
            plan = self.start("plan", self.pipe, "--out", self.path("p.csv"), "--set", "planner.resolution=2e-4",
                              "--report", self.path("report.json"))
            plan.send_signal(number)
            self.assertEqual(plan.communicate(timeout=120), ("", "interrupted\n"))
            self.assertEqual(plan.returncode, 130)
            self.assertFalse(os.path.exists(self.path("p.csv")))
            report = self.report()
            self.assertEqual((report["status"], report["verdict"]["code"]), ("interrupted", "CANCELLED"))

    # check
    def test_the_mesh_doctor_tells_usable_from_refused(self):
        ball = os.path.join(SCENES, "ball.obj")
        self.assertIn("usable", self.run_it("check", ball).stdout)
        self.assertEqual(json.loads(self.run_it("check", ball, "--json").stdout)["check"], "usable")
        with open(ball) as file:
            text = file.read()
        missing = self.write("missing.obj", text.replace("f 1 12 6\n", "f 1 12 99\n"))
        self.assertIn("missing.obj", self.run_it("check", missing, status=1).stderr)
        turned = self.write("turned.obj", text.replace("f 1 12 6\n", "f 12 1 6\n"))
        self.assertEqual(json.loads(self.run_it("check", turned, "--json", status=1).stdout)["check"], "refused")
        self.run_it("check", self.path("gone.stl"), status=1)

    def test_the_mesh_doctor_reads_tetrahedra(self):
        self.write("t.node", "4 3 0 0\n0 0 0 0\n1 1 0 0\n2 0 1 0\n3 0 0 1\n")
        self.write("t.ele", "1 4 0\n0 0 1 2 3\n")
        self.assertIn("tetrahedra", self.run_it("check", self.path("t.node"), "--scale", "0.001").stdout)
        self.write("t.ele", "1 4 0\n0 0 1 2 9\n")
        self.assertIn("t.ele", self.run_it("check", self.path("t.node"), status=1).stderr)


if __name__ == "__main__":
    unittest.main()
