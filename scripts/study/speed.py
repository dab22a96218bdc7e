"""Speed: step times beside the first paper's method, and cost against size from 1,000 to 200,000 elements."""
import csv
import os
import subprocess

import numpy

import equal
import problems
from tools import PAPER

NONE = {"method": "none"}


def swing(stations):
    return {"scene": "swing", "step": 0.01, "time_limit": 0.3, "gravity": [0, 0, -problems.GRAVITY],
            "contact": NONE, "bodies": [problems.catheter(1.0, stations, fixed={"box": problems.HELD})]}


def turning(name, size, cells, spin, force):
    """A free body that spins while three loads bend it: the two ends against the middle."""
    length = size[0]
    far, thin = 10 * length, length / cells[0] / 4

    def slab(x):
        return [[x - thin, -far, -far], [x + thin, far, far]]
    middle = length / cells[0] * round(cells[0] / 2)
    return {"scene": name, "step": 0.01, "time_limit": 0.3, "contact": NONE, "bodies": [{
        "name": name, "shape": {"beam": {"size": size, "cells": cells}}, "model": "tet4",
        "material": {"young": 5e7, "poisson": 0.33, "density": 1000}, "start": {"spin": [0, 0, spin]},
        "load": [{"box": slab(0), "force": [0, 0, force / 2]}, {"box": slab(length), "force": [0, 0, force / 2]},
                 {"box": slab(middle), "force": [0, 0, -force]}]}]}


# Title and scene of what is timed.
def bodies(quick):
    bear, snake = ([4, 4, 4], [16, 2, 2]) if quick else ([16, 17, 17], [192, 5, 5])
    count = 29 if quick else 455
    return [("catheter, swinging", swing(count)),
            ("bear size, turning and bending", turning("bear", [0.32, 0.32, 0.32], bear, 3.0, 5e4)),
            ("snake size, turning and bending", turning("snake", [1.92, 0.05, 0.05], snake, 3.0, 100.0))]


LONGEST = 150  # seconds that the two methods side by side may take


def beside(study, title, scene):
    """Own and the paper's method on one mesh: in turns from the same states of one run (`catnav study paper`), or
    where that would take too long, one after the other on fewer steps."""
    short = [own_steps(study, title, scene, "tet4", {}, 5),
             {**own_steps(study, title, scene, "tet4", PAPER, 5), "method": "paper"}]
    times = [row["step_ms_median"] for row in short]
    if None not in times and 1e-3 * sum(times) * 600 < LONGEST:
        return in_turns(study, title, scene)
    rows = [own_steps(study, title, scene, "tet4", {}, 20),
            {**own_steps(study, title, scene, "tet4", PAPER, 20), "method": "paper"}]
    for row in rows:
        row["note"] = "20 steps from the start, one after the other"
    return rows


def in_turns(study, title, scene):
    file = study.write_scene("speed_" + scene["scene"], scene)
    words = ["study", "paper", file, "--out", "paper_" + scene["scene"], "--threads", str(study.threads), "--quiet"]
    command = "catnav " + " ".join(words[:-1])
    try:
        done = subprocess.run([study.catnav] + words, cwd=study.folder, capture_output=True, text=True, timeout=400)
    except subprocess.TimeoutExpired:
        return [{"case": title, "model": "tet4", "method": "paper", "status": "hang", "command": command}]
    path = study.path("paper_%s/paper.csv" % scene["scene"])
    if done.returncode or not os.path.exists(path):
        return [{"case": title, "model": "tet4", "method": "own and paper", "status": "failed",
                 "message": done.stderr.strip()[-200:], "command": command}]
    with open(path) as table:
        rows = list(csv.DictReader(table))
    found = []
    for method in ("own", "paper"):
        these = [row for row in rows if row["method"] == method]

        def middle(key):
            values = [float(row[key]) for row in these if row[key]]
            return float(numpy.median(values)) if values else None
        found.append({"case": title, "model": "tet4", "method": method, "status": "ran", "command": command,
                      "step_ms_median": middle("step_ms_median"), "step_ms_p95": middle("step_ms_p95"),
                      "residual": middle("residual_median"), "residual_max": max(float(r["residual_max"])
                                                                                 for r in these),
                      "steps": sum(int(row["steps"]) for row in these), "note": "200 steps each from three states"})
    return found


def own_steps(study, title, scene, model, settings, steps):
    file = study.write_scene("speed_%s" % scene["scene"], scene)
    outcome = study.run(file, {"bodies.0.model": model, "time_limit": steps * scene["step"], **settings}, limit=300)
    return {"case": title, "model": model, "method": "own", "status": outcome.status,
            "message": None if outcome.status == "ran" else outcome.message, "command": outcome.command,
            "nodes": outcome.figure("counts", "nodes"), "dof": outcome.figure("counts", "dof"),
            "step_ms_median": outcome.figure("time", "step_ms", "median"),
            "step_ms_p95": outcome.figure("time", "step_ms", "p95"),
            "solve_ms_median": outcome.figure("time", "fem_ms", "median"),
            "residual_max": outcome.figure("solver", "residual_max"), "steps": outcome.figure("steps"),
            "newton_max": outcome.figure("solver", "newton_max")}


def step_times(study):
    rows = []
    for title, scene in bodies(study.quick):
        rows += beside(study, title, scene)
        study.say("speed: %s" % title)
    for title, scene in bodies(study.quick):
        name = scene["bodies"][0]["name"]
        for model in study.models:
            counts = {"rod": (50, 100, 454), "tet10": (115,), "tet4": ()}[model] if name == "catheter" else \
                {"rod": (), "tet10": (0,), "tet4": ()}[model]
            if study.quick:
                counts = [min(count, 50) for count in counts[:1]]
            for count in counts:
                if count:
                    rows.append(own_steps(study, "%s, %d elements" % (title, count) if model == "rod" else
                                          "%s, %d stations" % (title, count), scene, model,
                                          {"bodies.0.shape.catheter.stations": count + (model == "rod")}, 100))
                else:
                    half = [max(1, c // 2) for c in scene["bodies"][0]["shape"]["beam"]["cells"]]
                    rows.append(own_steps(study, title + ", cells twice as long", scene, model,
                                          {"bodies.0.shape.beam.cells": half}, 30))
    for row in rows:
        paper = next((r for r in rows if r["method"] == "paper" and row["case"].startswith(r["case"])), None)
        if paper and paper.get("step_ms_median") and row.get("step_ms_median"):
            row["paper_over_own"] = paper["step_ms_median"] / row["step_ms_median"]
    return rows


LARGE = 29000  # elements from which on a matrix of tet10 (96 MB) fits no cache


def cost(study):
    """One body of each kind of growth, clamped and pulled down by its weight, in sizes from 1,000 elements."""
    rows = []
    for model in study.models:
        sizes = (1000, 3000, 10000, 30000, 100000, 200000)[:2 if study.quick else 5 if model == "rod" else 6]
        for shape in ("grown by length", "compact"):
            if model == "rod" and shape == "compact":
                continue
            for size in sizes:
                row = one_size(study, model, shape, size)
                rows.append(row)
                if row["status"] != "ran":
                    break
        study.say("speed: cost against size, " + model)
    fits = {}
    for model, shape in dict.fromkeys((row["model"], row["shape"]) for row in rows):
        line = [row for row in rows if (row["model"], row["shape"]) == (model, shape) and row["status"] == "ran"]
        large = [row for row in line if row["elements"] >= LARGE]
        fits[model, shape] = (*(exponent(line, key) for key in ("step_ms", "memory_mib")), exponent(large, "step_ms"))
        for row in line:
            row["exponent_time"], row["exponent_memory"], row["exponent_time_large"] = fits[model, shape]
    return rows, fits


def exponent(line, key):
    """Least-squares slope of log key over log elements; of memory above the smallest body's over elements above its."""
    if len(line) < 2:
        return None
    values, n = (numpy.array([row[k] for row in line], float) for k in (key, "elements"))
    if key == "memory_mib":
        values, n = values[1:] - values[0], n[1:] - n[0]
    good = values > 0
    return float(numpy.polyfit(numpy.log(n[good]), numpy.log(values[good]), 1)[0]) if good.sum() > 1 else None


def one_size(study, model, shape, size):
    cell = 0.01
    if model == "rod":
        cells = [size, 1, 1]
    elif shape == "compact":
        side = max(1, round((size / 6) ** (1 / 3)))
        cells = [max(1, round(size / 6 / side**2)), side, side]
    else:
        cells = [max(1, round(size / 96)), 4, 4]
    lengths = [cell * c for c in cells]
    file = study.write_scene("cost_" + shape.split()[0], {
        "scene": "cost", "step": 0.01, "time_limit": 0.05, "gravity": [0, 0, -problems.GRAVITY], "contact": NONE,
        "bodies": [{"name": "body", "shape": {"beam": {"size": lengths, "cells": cells}}, "model": model,
                    "material": {"young": 5e7, "poisson": 0.33, "density": 1000},
                    "fixed": {"box": problems.HELD}}]})
    outcome = study.run(file, {"bodies.0.shape.beam.size": lengths, "bodies.0.shape.beam.cells": cells,
                               "bodies.0.model": model}, limit=90)
    memory = outcome.figure("memory_peak_bytes")
    elements = outcome.figure("counts", "tets")
    return {"shape": shape, "model": model, "elements": size if model == "rod" else elements,
            "nodes": outcome.figure("counts", "nodes"), "dof": outcome.figure("counts", "dof"),
            "status": outcome.status, "message": None if outcome.status == "ran" else outcome.message,
            "step_ms": 1e3 * outcome.solve_s / outcome.figure("steps") if outcome.status == "ran" else None,
            "newton_max": outcome.figure("solver", "newton_max"), "linear_max": outcome.figure("solver", "linear_max"),
            "residual_max": outcome.figure("solver", "residual_max"),
            "memory_mib": memory / 2**20 if memory else None, "load_s": outcome.wall - outcome.solve_s
            if outcome.solve_s is not None else None, "command": outcome.command}


def run(study):
    rows = step_times(study)
    study.table("speed", rows)
    as_good = []
    for title, scene in bodies(study.quick)[1:]:
        as_good += equal.run(study, title, scene)
        study.say("speed: %s, at no larger error" % title)
    study.table("equal_error", as_good)
    sizes, fits = cost(study)
    study.table("cost", sizes)
    return rows, sizes, fits, as_good
