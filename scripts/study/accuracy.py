"""Error against run time: each problem by every model, solver, integrator and the first paper's method."""
import csv
import subprocess

import problems
from tools import PAPER

COLUMNS = ["problem", "reference", "model", "method", "linear", "integrator", "resolution", "nodes", "dof", "dt",
           "error", "step_ms_median", "step_ms_p95", "step_ms_p99", "step_ms_max", "total_s", "total_s_min", "total_s_max", "runs",
           "time_over_paper", "newton_max", "linear_max", "residual_max", "inverted_max", "status", "message",
           "pareto", "command"]

def ways(study, problem, model):
    """(method, linear solver, integrator) worth a curve: the default; other solvers and integrators; the paper's,
    which knows only linear tetrahedra."""
    found = [("own", "auto", "euler")]
    if not study.quick:
        found += [("own", linear, "euler") for linear in problem.solvers if linear in study.linear]
    if problem.steps[0] is not None:
        found += [("own", "auto", integrator) for integrator in study.integrators if integrator != "euler" and
                  (integrator != "explicit" or model == "molecules") and (integrator == "trbdf2" or model != "tet10")]
    if model == "tet4":
        found.append(("paper", "cg", "euler"))
    return found


def one(study, problem, file, model, way, resolution, step, runs):
    """One row: the median of `runs` timings."""
    method, linear, integrator = way
    settings = {"bodies.0.model": model, **resolution[1]}
    if step:
        settings["step"] = step
    settings.update(PAPER if method == "paper" else {"solver.linear": linear} if linear != "auto" else {})
    if integrator != "euler":
        settings["solver.integrator"] = integrator
    row = {"problem": problem.name, "reference": problem.answer, "model": model, "method": method, "linear": linear,
           "integrator": integrator, "resolution": resolution[0], "dt": step}
    done = []
    while len(done) < runs:
        outcome = study.run(file, settings, threads=1, limit=problem.limit, points=problem.points)
        done.append(outcome)
        if outcome.solve_s is None or outcome.solve_s > problem.fair or outcome.status not in problem.finished:
            break
    done = sorted(done, key=lambda outcome: outcome.solve_s or 0)
    middle = done[len(done) // 2]
    row.update(status=middle.status, message=middle.message, command=middle.command, runs=len(done))
    if middle.report:
        row.update(nodes=middle.figure("counts", "nodes"), dof=middle.figure("counts", "dof"),
                   total_s=middle.solve_s, total_s_min=done[0].solve_s, total_s_max=done[-1].solve_s,
                   **{"step_ms_" + key: middle.figure("time", "step_ms", key) for key in ("median", "p95", "p99", "max")},
                   **{key: middle.figure("solver", key) for key in ("newton_max", "linear_max", "residual_max",
                                                                    "inverted_max")})
        if middle.status in problem.finished:
            row["error"] = problem.error(middle, model)
    return row


def mark_pareto(rows):
    """Marks the rows to which no other of the same problem is both faster and better."""
    for row in rows:
        row["pareto"] = row.get("error") is not None and not any(
            other.get("error") is not None and other is not row and other["problem"] == row["problem"] and
            other["error"] <= row["error"] and other["total_s"] <= row["total_s"] for other in rows)


def over_paper(rows):
    """Run time over the paper's method on the same mesh with the same step."""
    def key(row):
        return row["problem"], row["resolution"], row["dt"]
    paper = {key(row): row.get("total_s") for row in rows if row["method"] == "paper"}
    for row in rows:
        theirs = paper.get(key(row))
        if theirs and row.get("total_s") and row["model"] == "tet4":
            row["time_over_paper"] = row["total_s"] / theirs


def curve_of(study, problem, file, model, way):
    """Rows of one curve, with one thread: other curves are timed beside it, one for each core."""
    rows = []
    other_solver = way[0] == "own" and way[1] != "auto"
    runs = 1 if study.quick or other_solver else 3
    for resolution, step in pairs_of(problem.settings(model, study.quick), problem.steps_of(model)):
        rows.append(one(study, problem, file, model, way, resolution, step, runs))
        if rows[-1]["status"] in ("refused", "late", "hang"):  # finer ones would be no better
            break
    return rows


def study_problem(study, problem):
    if not problem.converge(study):
        return []
    file = study.write_scene(problem.name, problem.scene)
    curves = [(model, way) for model in study.models + (study.tissues if problem.tissue else [])
              for way in ways(study, problem, model)]
    rows = sum(study.pool(lambda curve: curve_of(study, problem, file, *curve), curves), [])
    over_paper(rows)
    mark_pareto(rows)
    return rows


def pairs_of(resolutions, steps):
    """Each mesh with the middle step, each step with the finest mesh but one: the arms of a cross."""
    middle, mesh = steps[min(1, len(steps) - 1)], resolutions[max(0, len(resolutions) - 2)]
    return [(resolution, middle) for resolution in resolutions] + \
           [(mesh, step) for step in steps if step != middle]


def stiffness(study):
    """What a catheter's mesh makes of bending, torsion and axial stiffness: the report's stiffness_error."""
    scene = {"scene": "stiffness", "step": 0.01, "time_limit": 0.01, "contact": {"method": "none"},
             "bodies": [problems.catheter(1.0, 455)]}
    file = study.write_scene("stiffness", scene)
    rows = []
    for model in study.models:
        for count in (58, 115) if study.quick else (58, 115, 229, 455, 909):
            outcome = study.run(file, {"bodies.0.model": model, "bodies.0.shape.catheter.stations": count})
            row = {"model": model, "stations": count, "nodes": outcome.figure("counts", "nodes"),
                   "dof": outcome.figure("counts", "dof"), "status": outcome.status, "command": outcome.command}
            for what in ("bending", "torsion", "axial"):
                row[what] = outcome.figure("bodies", 0, "stiffness_error", what)
                row["polygon_" + what] = outcome.figure("bodies", 0, "stiffness_error", "polygon", what)
            rows.append(row)
    study.table("stiffness", rows)
    return rows


def cook(study):
    """Cook's membrane by `catnav study cook` (a scene's `fixed` cannot hold nodes across a plane alone): the corner's
    deflection against time and unknowns, each the median of three timings."""
    try:
        found = problems.cases(study, "cook_membrane")["cases"]
    except OSError as error:
        study.note("Cook's membrane is left out: its reference cannot be read (%s)" % error)
        return []
    # of the same two-dimensional computation as the file's, E u / F
    cases = [("strain", 0.499, 2.5 * 7.7771833)] + [
        (c["plane"], c["nu"], c["corner_x48_y60_vertical"] * c["E"] / c["shear_force_per_thickness"]) for c in found]
    rows = []
    for plane, nu, truth in sorted(cases, key=lambda case: case[1]):
        words = ["study", "cook", repr(nu), "--cells", "16" if study.quick else "64"] + ["--stress"] * (plane == "stress")
        timings = []
        for _ in range(1 if study.quick else 3):
            done = subprocess.run([study.catnav] + words, capture_output=True, text=True, timeout=300)
            if done.returncode:
                study.note("Cook's membrane, nu %g, is left out: %s" % (nu, done.stderr.strip()))
                break
            timings.append(list(csv.DictReader(done.stdout.splitlines())))
        for same in zip(*timings):
            seconds = sorted(float(row["seconds"]) for row in same)
            deflection = float(same[0]["corner"])
            rows.append({"plane": plane, "nu": nu, "model": same[0]["model"], "cells": int(same[0]["cells"]),
                         "nodes": int(same[0]["nodes"]), "dof": int(same[0]["dof"]), "deflection": deflection,
                         "reference": truth, "error": abs(deflection / truth - 1), "total_s": seconds[len(seconds) // 2],
                         "total_s_min": seconds[0], "total_s_max": seconds[-1], "runs": len(seconds),
                         "command": "catnav " + " ".join(words)})
    study.table("cook", rows)
    study.say("accuracy: Cook's membrane, %d rows" % len(rows))
    return rows


def run(study):
    study.stiffness, study.cook = stiffness(study), cook(study)
    rows = []
    kinds = [problems.Cantilever, problems.Elastica, problems.OwnWeight, problems.Twist, problems.Sway,
             problems.Swing]
    for kind in kinds if study.quick else kinds + [problems.Liver]:
        try:
            problem = kind(study)
        except (OSError, StopIteration, KeyError, ValueError) as error:
            study.note("Problem `%s` is left out: its reference cannot be read (%s)" % (kind.__name__, error))
            continue
        found = study_problem(study, problem)
        study.say("accuracy: %s, %d rows" % (problem.name, len(found)))
        if found:
            rows.append((problem, found))
            study.table("accuracy_" + problem.name, found, COLUMNS)
    study.table("accuracy", [row for _, found in rows for row in found], COLUMNS)
    return rows
