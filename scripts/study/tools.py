"""What the parts of the study share: scenes written as files, `catnav run` with a time limit, tables, frames.

A scene is a dict written as YAML into FOLDER/scenes; what differs between rows is given by --set, so that each
row can be run again by hand from FOLDER with the command it carries. SI units throughout."""
import csv
import json
import math
import os
import re
import signal
import subprocess
import sys
import tempfile
import time
from concurrent.futures import ThreadPoolExecutor

import numpy

GRACE = 20  # seconds in which a run that is asked to stop must have stopped
MODELS = ("tet4", "tet10", "rod")  # in the order in which tables and legends name them
PAPER = {"solver.newton": 1, "solver.linear": "cg", "contact.method": "project"}  # the first paper's method


def flow(value):
    """A value as YAML on one line."""
    if isinstance(value, dict):
        return "{" + ", ".join("%s: %s" % (key, flow(item)) for key, item in value.items()) + "}"
    if isinstance(value, (list, tuple)):
        return "[" + ", ".join(flow(item) for item in value) + "]"
    if value is None or isinstance(value, bool):
        return json.dumps(value)
    return repr(float(value)) if isinstance(value, (float, numpy.floating)) else str(value)


def scene_text(scene):
    """A scene as YAML: keys of the scene and of its bodies a line each."""
    lines = []
    for key, value in scene.items():
        if key in ("bodies", "vessels", "obstacles"):
            lines.append("%s:" % key)
            for body in value:
                for i, (name, item) in enumerate(body.items()):
                    lines.append("%s%s: %s" % ("    " if i else "  - ", name, flow(item)))
        else:
            lines.append("%s: %s" % (key, flow(value)))
    return "\n".join(lines) + "\n"


def read_frame(path):
    """Points [m] and rest points [m] (n x 3 each) of a .vtu with raw appended data."""
    with open(path, "rb") as file:
        data = file.read()
    start = data.index(b'<AppendedData encoding="raw">')
    arrays = []
    for name in (b"Points", b"displacement"):
        offset = int(re.search(rb'Name="' + name + rb'"[^>]*offset="(\d+)"', data[:start]).group(1))
        at = data.index(b"_", start) + 1 + offset
        size = int(numpy.frombuffer(data, "<u8", 1, at)[0])
        arrays.append(numpy.frombuffer(data, "<f8", size // 8, at + 8).reshape(-1, 3))
    return arrays[0], arrays[0] - arrays[1]


def frame_files(folder, body):
    """Frames of a body in `folder`, first to last."""
    found = [(int(match.group(1)), name) for name in os.listdir(folder)
             for match in [re.fullmatch(re.escape(body) + r"_(\d+)\.vtu", name)] if match]
    return [os.path.join(folder, name) for _, name in sorted(found)]


def shape_error(points, rest):
    """Largest distance from the rest shape after the best rigid motion, over the size of its box."""
    a, b = points - points.mean(0), rest - rest.mean(0)
    size = numpy.linalg.norm(rest.max(0) - rest.min(0))
    u, _, vt = numpy.linalg.svd(a.T @ b)
    turn = u @ numpy.diag([1, 1, numpy.sign(numpy.linalg.det(u @ vt)) or 1]) @ vt
    return float(numpy.linalg.norm(a @ turn - b, axis=1).max() / size)


class Outcome:
    """What one run gave. status: the report's, or `refused`, `late` (stopped at its time limit), `hang` (it did not
    stop), `crash`. Figures of a run without report are None."""

    def __init__(self, status, message, code, report, wall, command):
        self.status, self.message, self.code, self.report = status, message, code, report
        self.wall, self.command, self.first, self.last, self.rest = wall, command, None, None, None

    def figure(self, *keys):
        value = self.report
        for key in keys:
            if value is None:
                return None
            if isinstance(key, int):
                value = value[key] if key < len(value) else None
            else:
                value = value.get(key)
        return value

    @property
    def solve_s(self):
        """Wall time of the steps [s]."""
        parts = [self.figure("time", "simulation_s"), self.figure("time", "collision_s")]
        return None if None in parts else sum(parts)


class Study:
    """Folder, command and options of one study; notes are sentences for the report."""

    def __init__(self, folder, catnav, quick, threads, root, every_cell=False):
        self.every_cell = every_cell  # of the stability grid, with every solver
        self.folder, self.catnav, self.quick, self.threads = os.path.abspath(folder), catnav, quick, threads
        self.root, self.notes, self.commands = root, [], 0  # root: of the package, launch/ and test/ in it
        self.reference = os.path.abspath(os.environ.get("CATNAV_REFERENCE",
                                                        os.path.join(root, "test", "data", "reference")))
        self.took = {}  # seconds, by part
        self.nodes = {}  # of second-order meshes, by name
        self.begun = time.monotonic()
        self.version = subprocess.run([catnav, "--version"], capture_output=True, text=True).stdout.strip()
        os.makedirs(os.path.join(self.folder, "scenes"), exist_ok=True)
        self.linear = self.choices("solver.linear")
        self.integrators = self.choices("solver.integrator")
        self.models = [model for model in MODELS if self.has_model(model)]
        self.tissues = ["molecules"] if self.has_model("molecules") else []  # where a problem is for them

    def say(self, text):
        print("%4.0f s  %s" % (time.monotonic() - self.begun, text), file=sys.stderr, flush=True)

    def note(self, text):
        if text not in self.notes:
            self.notes.append(text)

    def path(self, name):
        return os.path.join(self.folder, name)

    def write_scene(self, name, scene):
        with open(self.path("scenes/%s.yaml" % name), "w") as file:
            file.write(scene if isinstance(scene, str) else scene_text(scene))
        return "scenes/%s.yaml" % name

    def run(self, scene, settings=None, threads=None, limit=120, points=False):
        """Runs a scene file (path from the folder). points: those of the first and last frame and at rest, too."""
        words = [scene]
        for key, value in (settings or {}).items():
            words += ["--set", "%s=%s" % (key, flow(value))]
        words += ["--threads", str(threads or self.threads)]
        command = "catnav run " + " ".join("'%s'" % w if re.search(r"[^\w./=:,+-]", w) else w for w in words)
        self.commands += 1
        with tempfile.TemporaryDirectory() as scratch:
            report_file, frames = os.path.join(scratch, "report.json"), os.path.join(scratch, "frames")
            extra = ["--quiet", "--report", report_file]
            if points:
                extra += ["--frames", frames, "--every", "1000000"]
            begun, late = time.monotonic(), False
            process = subprocess.Popen([self.catnav, "run"] + words + extra, cwd=self.folder, text=True,
                                       stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE)
            try:
                errors = process.communicate(timeout=limit)[1]
            except subprocess.TimeoutExpired:  # asked to stop, as by Ctrl-C: within a step, with a report
                late = True
                process.send_signal(signal.SIGINT)
                try:
                    errors = process.communicate(timeout=GRACE)[1]
                except subprocess.TimeoutExpired:
                    process.kill()
                    process.communicate()
                    return Outcome("hang", "no end within %g s, nor %g s after it was asked to stop"
                                   % (limit, GRACE), None, None, limit, command)
            wall = time.monotonic() - begun
            report = None
            if os.path.exists(report_file):
                with open(report_file) as file:
                    report = json.load(file)
            message = (report["verdict"]["message"] if report else
                       (errors.strip().split("\n") or [""])[-1]).replace(self.folder + "/", "")
            code = process.returncode
            status = ("crash" if code < 0 or code > 130 else "refused" if code == 1 else
                      "late" if late else report["status"] if report else "crash")
            if late:
                message = "not at its end after %g s, stopped after %s steps" % (
                    limit, report["steps"] if report else "no")
            outcome = Outcome(status, message or "", code, report, wall, command)
            if points and report and report["bodies"] and os.path.isdir(frames):
                files = frame_files(frames, report["bodies"][0]["name"])
                if files:
                    outcome.first = read_frame(files[0])[0]
                    outcome.last, outcome.rest = read_frame(files[-1])
            return outcome

    def pool(self, work, tasks, workers=2):
        """work(task) for every task, `workers` at a time; results in the tasks' order."""
        with ThreadPoolExecutor(workers) as pool:
            try:
                return list(pool.map(work, tasks))
            except KeyboardInterrupt:
                pool.shutdown(cancel_futures=True)
                raise

    def choices(self, key):
        """What a key that takes one of several words takes, as its refusal lists them."""
        file = self.write_scene("probe", probe_scene("tet4"))
        found = re.search(r"expected one of ([\w|]+)", self.run(file, {key: "none_of_these"}).message)
        return found.group(1).split("|") if found else []

    def has_model(self, model):
        """True where this version runs the model; else says so once."""
        outcome = self.run(self.write_scene("probe", probe_scene(model)))
        ran = outcome.figure("bodies", 0, "model") if outcome.status == "ran" else None
        if ran != model:
            self.note("Body model `%s` is left out: %s" % (
                model, "it runs as `%s`" % ran if ran else outcome.message or outcome.status))
        return ran == model

    def table(self, name, rows, columns=None):
        """Writes rows (dicts) as NAME.csv and NAME.json."""
        columns = columns or list(dict.fromkeys(key for row in rows for key in row))
        with open(self.path(name + ".csv"), "w", newline="") as file:
            writer = csv.DictWriter(file, columns, extrasaction="ignore", lineterminator="\n")
            writer.writeheader()
            writer.writerows({key: csv_cell(row.get(key)) for key in columns} for row in rows)
        with open(self.path(name + ".json"), "w") as file:
            json.dump([{key: finite(row.get(key)) for key in columns} for row in rows], file, indent=1)
            file.write("\n")


def finite(value):
    """JSON has no infinity: None in its place."""
    return None if isinstance(value, float) and not math.isfinite(value) else value


def csv_cell(value):
    if value is None or finite(value) is None:
        return ""
    return "%.9g" % value if isinstance(value, float) else value


def probe_scene(model):
    return {"scene": "probe", "step": 0.01, "time_limit": 0.01, "contact": {"method": "none"},
            "bodies": [{"name": "body", "shape": {"beam": {"size": [0.1, 0.01, 0.01], "cells": [4, 1, 1]}},
                        "model": model, "molecules": {"radius": 0.002}, "material": {"young": 1e6, "poisson": 0.3, "density": 1000}}]}
