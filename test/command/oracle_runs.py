"""Runs of the command judged by the oracle (test/oracle). CATNAV or argv[1] is the command, CATNAV_ORACLE the oracle."""
import json
import math
import os
import re
import signal
import subprocess
import sys

HERE = os.path.dirname(os.path.abspath(__file__))
ROOT = os.path.abspath(os.path.join(HERE, "..", ".."))
BUILD = os.path.join(ROOT, "build")
CATNAV = os.path.abspath(sys.argv.pop(1) if len(sys.argv) > 1 and os.access(sys.argv[1], os.X_OK)
                         else os.environ.get("CATNAV", os.path.join(BUILD, "devel", "lib", "catnav", "catnav")))
ORACLE = os.environ.get("CATNAV_ORACLE", os.path.join(BUILD, "test", "oracle"))
DATA = os.path.abspath(os.environ.get("CATNAV_TEST_DATA", os.path.join(ROOT, "test", "data")))
STATUS = {"reached": 0, "ran": 0, "bad_input": 1, "infeasible": 2, "time_limit": 3, "failed": 4, "interrupted": 130}


class Run:
    """status (exit), said, report (None if none was written), and of the oracle's frames: crossings, outside, places."""


def words_for(scene):
    """What the oracle must be told of a scene (a dictionary as its file)."""
    vessels, obstacles = scene.get("vessels", []), scene.get("obstacles", [])
    words = ["--vessels", str(len(vessels))]
    for i, wall in enumerate(vessels + obstacles):
        if wall.get("wall", {}).get("model", "rigid") != "rigid" or "body" in wall:
            words += ["--deforms", "%d=%s" % (i, wall["name"])]
    for body in scene["bodies"]:
        catheter = body["shape"].get("catheter")
        if catheter and (catheter.get("sheath", "auto") == "on" or catheter.get("sheath", "auto") == "auto" and vessels):
            numbers = [*catheter.get("entry", [0, 0, 0]), *catheter.get("direction", [0, 0, 1]),
                       catheter["diameter"] / 2 * 1.6]  # a triangle as large as the circle reaches 1.56 radii
            words += ["--sheath", ",".join([body["name"], *map(repr, map(float, numbers))])]
    return words


def read_scene(file):
    import yaml

    class Loader(yaml.SafeLoader):
        pass
    Loader.add_implicit_resolver("tag:yaml.org,2002:float",  # 1e-3 is a number too
                                 re.compile(r"^[-+]?[0-9]*\.?[0-9]*([eE][-+]?[0-9]+)?$"), list("-+.0123456789"))
    Loader.yaml_implicit_resolvers = {  # on and off are words
        c: [(tag, pattern) for tag, pattern in found if not tag.endswith(":bool")]
        for c, found in Loader.yaml_implicit_resolvers.items()}
    with open(file) as text:
        return yaml.load(text, Loader)


def judged(folder, file, scene, *settings, timeout=300, threads=1):
    """Runs a scene's file with its frames in `folder`, for `timeout` seconds at most, and has them judged. The
    settings must not change where walls and sheaths are."""
    run = Run()
    frames, report = os.path.join(folder, "frames"), os.path.join(folder, "report.json")
    if os.path.exists(report):
        os.unlink(report)
    words = [CATNAV, "run", file, "--frames", frames, "--report", report, "--quiet", "--threads", str(threads)]
    for setting in settings:
        words += ["--set", setting]
    command = subprocess.Popen(words, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    try:
        said = command.communicate(timeout=timeout)
    except subprocess.TimeoutExpired:
        command.send_signal(signal.SIGINT)  # it ends with its step, and what it did until then is judged
        try:
            said = command.communicate(timeout=60)
        except subprocess.TimeoutExpired:
            command.kill()
            said = command.communicate()
    run.status, run.said, run.report = command.returncode, "".join(said), None
    if os.path.exists(report):
        with open(report) as text:
            run.report = json.load(text, parse_constant=lambda word: math.nan)
    run.frames = run.crossings = run.outside = 0
    run.places = ""
    if run.report and run.report["steps"] > 0:
        done = subprocess.run([ORACLE, frames, *words_for(scene)], capture_output=True, text=True)
        found = re.match(r"(\d+) frames, (\d+) crossings, (\d+) outside\n", done.stdout)
        if not found:
            raise RuntimeError("the oracle: " + done.stdout + done.stderr)
        run.frames, run.crossings, run.outside = map(int, found.groups())
        run.places = done.stdout
    return run
