"""Contact: `strict`, `project` and `penalty` side by side on the same scenes, and what contact does in hard cases:
deep overlap at the start, fast impact, a sharp spike, long rest, a squeeze from both sides."""
import numpy

import left_out
import stability
import theory

METHODS = ("strict", "project", "penalty")
SOFT = {"young": 2e5, "poisson": 0.33, "density": 1000, "damping": 2.0}
FLOOR = [{"name": "floor", "shape": {"plane": {"point": [0, 0, 0], "normal": [0, 0, 1]}}}]
RESULTS = ("held", "refused", "stopped", "parted", "through", "not finite", "hang", "crash")
FAILURES = RESULTS[4:]
TEXT = {"held": "nothing crossed, nothing outside, finite to the end", "refused": "named before the run: pair, depth, place",
        "stopped": "stopped (exit status 4 or 2) with the reason, nothing crossed up to there",
        "parted": "crossings at the start were gone at the end (`project` and `penalty`)",
        "through": "something crossed or lay outside in a run of `strict`"}


def ball(study, name="ball"):
    stability.write_mesh(study.path("scenes/" + name), *theory.ball_mesh())
    return name + ".node"


def bend(study, step):
    return {**left_out.tube_scene(4.0), "step": step}


def drop(study, step):
    """A soft ball falls on a floor and comes to rest."""
    return {"scene": "drop", "step": step, "time_limit": 1.0, "gravity": [0, 0, -9.81], "obstacles": FLOOR, "bodies": [{
        "name": "ball", "shape": {"file": ball(study), "scale": 0.05, "translate": [0, 0, 0.1]}, "model": "tet4",
        "material": SOFT}]}


def squeeze(study, step, narrow=0.85, end=1.0):
    """A soft ball is led through a tube narrower than it is; after 1 s it is in the narrowest place."""
    axis = [[0, 0, 0.05 * i] for i in range(11)]
    radius = 0.05 * numpy.interp(numpy.arange(11), [0, 4, 6, 10], [2, narrow, narrow, 2])
    return {"scene": "squeeze", "step": step, "time_limit": end, "planner": {"replans": 0}, "obstacles": [
        {"name": "tube", "shape": {"tube": {"axis": axis, "radius": list(radius), "thickness": 0.01}}}], "bodies": [{
            "name": "ball", "shape": {"file": ball(study), "scale": 0.05}, "model": "tet4", "material": {**SOFT, "young": 2e4},
            "drive": {"nodes": "uniform", "speed": 0.3, "path_distance": 0.005},
            "waypoints": [[0, 0, 0.25], [0, 0, 0.5]], "waypoint_tolerance": 0.01}]}


# Scene, title, how it is made, its step.
SCENES = (("bend", "a catheter drawn through a bent tube", bend, 0.01),
          ("drop", "a soft ball dropped on a floor", drop, 0.004),
          ("squeeze", "a soft ball led through a tube of 85 % of its width", squeeze, 0.004))


def measured(name, method, step, outcome, size):
    gap = outcome.figure("contact", "gap_min")
    return {"scene": name, "method": method, "dt": step, "status": outcome.status, "message": outcome.message,
            "steps": outcome.figure("steps"), "penetration": None if gap is None else max(0.0, -gap) / size,
            "crossings": outcome.figure("contact", "intersections"), "outside": outcome.figure("contact", "outside_nodes"),
            "force_max": outcome.figure("contact", "force_max"), "total_s": outcome.solve_s,
            "step_ms_median": outcome.figure("time", "step_ms", "median"),
            "step_ms_p95": outcome.figure("time", "step_ms", "p95"),
            "momentum_error": outcome.figure("contact", "momentum_error"), "command": outcome.command}


def side_by_side(study):
    rows = []
    for name, title, make, step in SCENES:
        fine = step / (4 if study.quick else 8)  # of the converged run
        end = {"squeeze": 0.4}.get(name, 0.2) if study.quick else None

        def run(method, dt, limit=150):
            scene = make(study, dt)
            if end:
                scene["time_limit"] = end
            return study.run(study.write_scene("contact_" + name, scene), {"contact.method": method, "step": dt},
                             limit=limit, points=True)
        truth = run("strict", fine, 300)
        if truth.last is None:
            study.note("Contact, %s: no converged run (%s)" % (title, truth.message))
            continue
        size = float(numpy.linalg.norm(numpy.ptp(truth.rest, 0)))
        study.contact_truth[name] = "run of `strict` at steps of %g ms" % (1e3 * fine)
        for method in METHODS:
            for dt in (step, step / 2) if study.quick else (2 * step, step, step / 2, step / 4):
                outcome = run(method, dt)
                row = {"title": title, **measured(name, method, dt, outcome, size)}
                if outcome.last is not None and outcome.status in ("ran", "reached", "time_limit"):
                    row["error"] = float(numpy.linalg.norm(outcome.last - truth.last, axis=1).max() / size)
                rows.append(row)
        study.say("contact: " + title)
    return rows


def block(z, **more):
    return {"name": "block", "shape": {"beam": {"size": [0.1, 0.1, 0.05], "cells": [3, 3, 2]},
                                       "translate": [0, 0, z]}, "model": "tet4", "material": SOFT, **more}


def write_spike(study):
    """A needle of four sides, 2 mm wide at its foot and 10 cm high, standing on z = 0."""
    with open(study.path("scenes/spike.obj"), "w") as file:
        file.write("v 0.049 0.049 0\nv 0.051 0.049 0\nv 0.051 0.051 0\nv 0.049 0.051 0\nv 0.05 0.05 0.1\n"
                   "f 1 2 5\nf 2 3 5\nf 3 4 5\nf 4 1 5\nf 2 1 3\nf 1 4 3\n")


def write_sheet(study):
    """One layer of triangles, two-sided, at z = 0."""
    n, cell = 8, 0.05
    with open(study.path("scenes/sheet.obj"), "w") as file:
        for i in range(n + 1):
            for j in range(n + 1):
                file.write("v %g %g 0\n" % (cell * (i - 2) - 0.05, cell * (j - 2) - 0.05))
        for i in range(n):
            for j in range(n):
                a = i * (n + 1) + j + 1
                file.write("f %d %d %d\nf %d %d %d\n" % (a, a + n + 1, a + n + 2, a, a + n + 2, a + 1))


def hard_cases(study):
    """(case, scene, --set entries): each by strict, those that a response can part by the others, too."""
    write_spike(study)
    write_sheet(study)
    weight = {"gravity": [0, 0, -9.81]}
    sheet = [{"name": "sheet", "surface": {"file": "sheet.obj"}}]
    found = []
    for depth in (0.005, 0.02):
        scene = {"scene": "overlap", "step": 0.005, "time_limit": 1.0, "obstacles": FLOOR, "bodies": [block(-depth)]}
        found.append(("starts %g mm deep in a floor" % (1e3 * depth), scene, METHODS))
    for young in (1e4, 1e7, 1.6e11):
        for step in (1e-3, 1e-2):
            shot = block(0.5, start={"velocity": [3.0, 2.0, -100.0], "spin": [20.0, 5.0, 1.0]})
            shot["material"] = {**SOFT, "young": young}
            scene = {"scene": "shot", "step": step, "time_limit": 20 * step, "obstacles": sheet, "bodies": [shot]}
            found.append(("shot at 100 m/s on one layer, E %g Pa, step %g ms" % (young, 1e3 * step), scene, ("strict",)))
    spike = [{"name": "spike", "surface": {"file": "spike.obj"}}]
    found.append(("falls on a needle", {"scene": "spike", "step": 0.005, "time_limit": 1.0, **weight, "obstacles": spike,
                                        "bodies": [block(0.12)]}, ("strict",)))
    found.append(("thrown on a needle at 10 m/s", {
        "scene": "spike_fast", "step": 0.005, "time_limit": 0.2, "obstacles": spike,
        "bodies": [block(0.12, start={"velocity": [0, 0, -10.0]})]}, ("strict",)))
    for narrow in (0.7, 0.5):
        found.append(("led through a tube of %.0f %% of its width" % (100 * narrow), squeeze(study, 0.004, narrow, 3.0),
                      ("strict",)))
    return found


def judge(outcome, method):
    if outcome.status in ("hang", "crash"):
        return outcome.status
    if outcome.last is not None and not numpy.isfinite(outcome.last).all():
        return "not finite"
    bad = (outcome.figure("contact", "intersections") or 0) + (outcome.figure("contact", "outside_nodes") or 0)
    if method == "strict":
        if bad:
            return "through"
        code = outcome.figure("verdict", "code")
        if code == "NO_CONTACT_FREE_START" or outcome.status == "refused":
            return "refused"
        return "held" if outcome.status in ("ran", "reached", "time_limit") else "stopped"
    return "parted" if outcome.status == "ran" and outcome.parted else "stopped" if outcome.status == "failed" else \
        "still crossing"


def one_hard(study, task):
    number, (case, scene, methods), method = task
    file = study.write_scene("hard_%d" % number, scene)
    outcome = study.run(file, {"contact.method": method}, threads=1, limit=60, points=True)
    outcome.parted = False
    if method != "strict" and outcome.last is not None:
        outcome.parted = bool(outcome.last[:, 2].min() > -1e-4 * 0.05)
    row = {"case": case, "method": method, "result": judge(outcome, method),
           **measured("", method, scene["step"], outcome, 0.1)}
    return row


def sustained(study):
    """A block at rest on a floor for ten thousand steps: how far it creeps in the last nine thousand."""
    scene = {"scene": "rest", "step": 0.005, "time_limit": 5.0, "gravity": [0, 0, -9.81], "obstacles": FLOOR,
             "bodies": [block(0.0005)]}
    file = study.write_scene("hard_rest", scene)
    both = [study.run(file, {"time_limit": 0.005 * steps}, threads=1, limit=120, points=True)
            for steps in ((200, 400) if study.quick else (1000, 10000))]
    row = {"case": "rests on a floor for %d steps" % (both[1].figure("steps") or 0), "method": "strict",
           "result": judge(both[1], "strict"), **measured("", "strict", 0.005, both[1], 0.1)}
    if both[0].last is not None and both[1].last is not None:
        row["creep"] = float(numpy.linalg.norm(both[1].last - both[0].last, axis=1).max() / 0.15)
        row["kinetic"], row["kinetic_before"] = both[1].figure("bodies", 0, "kinetic"), both[0].figure("bodies", 0, "kinetic")
    return row


def run(study):
    study.contact_truth = {}
    rows = side_by_side(study)
    study.table("contact", rows)
    cases = hard_cases(study)
    if study.quick:
        cases = cases[:3] + cases[8:9]
    tasks = [(i, case, method) for i, case in enumerate(cases) for method in case[2]]
    hard = study.pool(lambda task: one_hard(study, task), tasks) + [sustained(study)]
    study.table("contact_hard", hard)
    study.say("contact: %d hard cases" % len(hard))
    return rows, hard
