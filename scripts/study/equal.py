"""At no larger error: what a simulated second costs the paper's method and ours, on bodies that turn and bend,
against a run of ours that is converged in step and mesh."""
import numpy

from tools import PAPER

TRBDF2 = {"solver.integrator": "trbdf2"}
# Cells of the timed mesh, of the reference's and of a coarse one; nodes at multiples of size / common stand in all.
MESHES = {"bear": ([16, 16, 16], [8, 8, 8], [4, 4, 4], [4, 4, 4]),
          "snake": ([192, 5, 5], [96, 2, 2], [48, 1, 1], [48, 1, 1])}
QUICK = {"bear": ([4, 4, 4], [2, 2, 2], [2, 2, 2], [2, 2, 2]),
         "snake": ([16, 2, 2], [8, 1, 1], [8, 1, 1], [8, 1, 1])}
DURATION = 0.3  # [s]


def choices(full, half, coarse):
    """Method, model, cells, step [s], further settings."""
    return [("paper", "tet4", full, 0.01, PAPER), ("own", "tet4", full, 0.01, {}), ("own", "tet4", full, 0.03, {}),
            ("own", "tet4", full, 0.01, TRBDF2), ("own", "tet4", full, 0.02, TRBDF2), ("own", "tet4", full, 0.03, TRBDF2),
            ("own", "tet10", half, 0.03, TRBDF2), ("own", "tet10", coarse, 0.01, TRBDF2),
            ("own", "tet10", coarse, 0.03, TRBDF2)]


def places(outcome, size, common):
    """Where the nodes of the common grid are at the end, by their place in it."""
    at = outcome.rest / numpy.array(size) * numpy.array(common)
    index = numpy.rint(at)
    there = numpy.abs(at - index).max(1) < 1e-6
    return dict(zip(map(tuple, index[there].astype(int)), outcome.last[there]))


def distance(a, b, size):
    """Root mean square over the body's diagonal."""
    apart = numpy.array([a[key] - b[key] for key in a.keys() & b.keys()])
    return float(numpy.sqrt((apart**2).sum(1).mean()) / numpy.linalg.norm(size))


def run(study, title, scene):
    """Rows of one body, the paper's first; `best` marks the cheapest of ours with no larger error."""
    name = scene["scene"]
    size = scene["bodies"][0]["shape"]["beam"]["size"]
    *meshes, common = (QUICK if study.quick else MESHES)[name]
    file = study.write_scene("equal_" + name, scene)

    def outcome_of(model, cells, step, settings):
        return study.run(file, {"bodies.0.model": model, "bodies.0.shape.beam.cells": cells, "step": step,
                                "time_limit": DURATION, **settings}, limit=200, points=True)
    reference = [outcome_of("tet10", meshes[1], step, TRBDF2) for step in (0.002, 0.001)]
    if any(found.last is None for found in reference):
        study.note("%s: the reference did not end: %s" % (title, reference[-1].message))
        return []
    exact = places(reference[1], size, common)
    left = distance(places(reference[0], size, common), exact, size)
    rows = []
    for method, model, cells, step, settings in choices(*meshes):
        found = outcome_of(model, cells, step, settings)
        row = {"case": title, "method": method, "model": model, "cells": " ".join(map(str, cells)), "step_s": step,
               "integrator": settings.get("solver.integrator", "euler"), "status": found.status, "best": False,
               "nodes": found.figure("counts", "nodes"), "reference_error": left, "command": found.command}
        if found.last is not None and found.solve_s:
            row["error"] = distance(places(found, size, common), exact, size)
            row["second_s"] = found.solve_s / DURATION
        rows.append(row)
    paper = rows[0]
    if paper.get("error") is None:
        return rows
    as_good = [row for row in rows[1:] if row.get("error") is not None and row["error"] <= paper["error"]]
    for row in as_good:
        row["paper_over_own"] = paper["second_s"] / row["second_s"]
    if as_good:
        min(as_good, key=lambda row: row["second_s"])["best"] = True
    return rows
