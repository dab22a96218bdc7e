"""Stability: what a body does under extreme stiffness, Poisson's ratio, steps, elements, start states, units and
missing terms; each factor alone and all pairs. A cell is one run of a small free body: a load pulls its ends for
the first half of the run, then it is left alone."""
import math
import os

import numpy

import tools

LENGTH, DEPTH = 0.1, 0.02  # of the body [m]
CELLS = {"tet4": (8, 2, 2), "tet10": (4, 2, 2), "rod": (32, 1, 1)}
STEPS, SIMULATED = 200, 5.0  # at most, per cell; [s]
RECOVERED = 0.01  # distance from the rest shape, over its size, up to which it counts as recovered

# What happened, best to worst; the last three are failures.
RESULTS = ("recovered", "still deformed", "refused", "stopped", "slow", "not finite", "hang", "crash")
FAILURES = RESULTS[5:]
TEXT = {"recovered": "back in its rest shape (within 1 % of its size)",
        "still deformed": "finite to the end, its rest shape not yet reached",
        "refused": "refused at the door, with the reason",
        "stopped": "stopped (exit status 4), last good state kept",
        "slow": "still at work at the time limit of a cell, stopped cleanly when asked to",
        "not finite": "a number that is not finite came out",
        "hang": "not at its end at the time limit, and not to be stopped",
        "crash": "the process died"}

# Factors and levels, the first of each the base case.
FACTORS = {
    "young": [("8.7 MPa", 8.7e6), ("20 kPa", 2e4), ("0.15 GPa", 1.5e8), ("158 GPa", 1.58e11),
              ("200 GPa", 2e11), ("contrast 1e7", None)],
    "poisson": [("0.33", 0.33), ("0", 0.0), ("0.45", 0.45), ("0.49", 0.49), ("0.499", 0.499),
                ("0.4999", 0.4999)],
    "step": [("10 ms", 1e-2), ("10 us", 1e-5), ("0.1 ms", 1e-4), ("1 ms", 1e-3), ("0.1 s", 0.1),
             ("1 s", 1.0)],
    "mesh": [("regular", 1), ("aspect 10", 10), ("aspect 100", 100), ("aspect 1e3", 1000),
             ("aspect 1e4", 10000), ("slivers", "sliver"), ("volume 1e-12", "flat"), ("1 element", "one")],
    "start": [("rest", None), ("100 m/s", "thrown"), ("100 rev/s", "spun"), ("stretched 10x", "stretched"),
              ("inverted", "inverted"), ("scrambled", "scrambled"), ("in a plane", "plane"),
              ("in a point", "point")],
    "units": [("as meant", 1.0), ("m as mm", 1e-3), ("mm as m", 1e3)],
    "zero": [("none", None), ("density 0", "density"), ("damping 0", "damping"), ("load 0", "load")],
}


def beam_mesh(cells, length=LENGTH, depth=DEPTH):
    """Nodes and Kuhn tetrahedra of a beam along +x, mirrored so that faces agree."""
    n = [c + 1 for c in cells]
    grid = numpy.stack(numpy.meshgrid(*[numpy.arange(k) for k in n], indexing="ij"), -1).reshape(-1, 3)
    nodes = grid * [length / cells[0], depth / cells[1], depth / cells[2]]
    tets = []
    for cell in numpy.ndindex(*cells):
        mirror = [c % 2 for c in cell]
        for order in ((0, 1, 2), (0, 2, 1), (1, 0, 2), (1, 2, 0), (2, 0, 1), (2, 1, 0)):
            at, corners = [0, 0, 0], []
            for k in (None,) + order:
                if k is not None:
                    at[k] = 1
                p = [c + (a ^ m) for c, a, m in zip(cell, at, mirror)]
                corners.append((p[0] * n[1] + p[1]) * n[2] + p[2])
            tets.append(corners)
    return nodes, turned_right(nodes, numpy.array(tets))


def turned_right(nodes, tets):
    """The same tetrahedra with positive volume."""
    a, b, c, d = (nodes[tets[:, k]] for k in range(4))
    wrong = numpy.einsum("ij,ij->i", numpy.cross(b - a, c - a), d - a) < 0
    tets[wrong] = tets[wrong][:, [0, 1, 3, 2]]
    return tets


def mesh_of(kind, cells):
    """The body's mesh: regular; one layer squeezed to an aspect ratio; four flat elements at one end (slivers of
    0.1 degrees, or with 1e-12 of the mean volume); a single tetrahedron."""
    if kind == "one":
        nodes = numpy.array([[0, 0, 0], [LENGTH, 0, 0], [0, LENGTH, 0], [0, 0, LENGTH]], float)
        return nodes, numpy.array([[0, 1, 2, 3]])
    nodes, tets = beam_mesh(cells)
    if kind in ("sliver", "flat"):  # a node pressed onto the end face: elements with one height, four long edges
        h = LENGTH / cells[0]
        height = h * math.tan(math.radians(0.1)) if kind == "sliver" else h * 1e-12
        end = len(nodes)
        face = [i for i in range(end) if nodes[i, 0] > LENGTH * (1 - 1e-9)]
        first = face[0]
        quad = sorted(face, key=lambda i: numpy.linalg.norm(nodes[i] - nodes[first]))[:4]
        whole = [t for t in tets if sum(i in quad for i in t) == 3]  # the triangles of that end's quad
        apex = nodes[quad].mean(0) + [height, 0, 0]
        extra = [[i for i in t if i in quad] + [end] for t in whole]
        nodes = numpy.vstack([nodes, apex])
        return nodes, turned_right(nodes, numpy.vstack([tets, numpy.array(extra)]))
    if kind != 1:
        h = LENGTH / cells[0]
        beyond = nodes[:, 0] > h * (cells[0] // 2 + 0.5)
        nodes[beyond, 0] -= h * (1 - 1 / kind)
    return nodes, tets


def write_mesh(path, nodes, tets):
    with open(path + ".node", "w") as file:
        file.write("%d 3 0 0\n" % len(nodes))
        file.writelines("%d %.17g %.17g %.17g\n" % (i, *x) for i, x in enumerate(nodes))
    with open(path + ".ele", "w") as file:
        file.write("%d 4 0\n" % len(tets))
        file.writelines("%d %d %d %d %d\n" % (i, *t) for i, t in enumerate(tets))


def start_points(kind, nodes, tets):
    """Start positions of the nodes [m], or None. tets: None of a rod, whose nodes lie along it."""
    if kind == "stretched":
        return nodes * [10, 1, 1]
    if kind == "inverted":  # a corner goes through the opposite face, the middles of its edges go with it
        corner, face = (tets[0, 0], tets[0, 1:]) if tets is not None else (0, [min(2, len(nodes) - 1)])
        way = 2 * (nodes[face].mean(0) - nodes[corner])
        far = 2 * nodes - nodes[corner]  # of a middle: the other end of its edge
        ends = nodes if tets is None else nodes[:tets.max() + 1]
        middle = numpy.array([numpy.linalg.norm(ends - x, axis=1).min() < 1e-9 * LENGTH for x in far])
        middle[:len(ends)] = False
        moved = nodes + 0.5 * way * middle[:, None]
        moved[corner] += way
        return moved
    if kind == "scrambled":
        low, size = nodes.min(0), numpy.ptp(nodes, 0)
        return low + numpy.random.RandomState(1).rand(*nodes.shape) * numpy.where(size > 0, size, DEPTH)
    if kind == "plane":
        return nodes * [1, 1, 0]
    if kind == "point":
        return numpy.repeat(nodes.mean(0)[None], len(nodes), 0)
    return None


def all_nodes(study, model, name, nodes, tets):
    """Nodes of second-order tetrahedra, corners first: as a run of one step says they are."""
    if name not in study.nodes:
        write_mesh(study.path("scenes/" + name), nodes, tets)
        outcome = study.run(study.write_scene("nodes_" + name, {
            "scene": "nodes", "step": 0.01, "time_limit": 0.01, "contact": {"method": "none"}, "bodies": [{
                "name": "body", "shape": {"file": name + ".node"}, "model": model,
                "material": {"young": 8.7e6, "poisson": 0.33, "density": 1100}}]}), threads=1, points=True)
        study.nodes[name] = outcome.rest if outcome.rest is not None else nodes
    return study.nodes[name]


def cells_of(nth):
    """Cells as dicts of levels by factor: base, each factor alone, every nth pair."""
    base = {factor: levels[0][0] for factor, levels in FACTORS.items()}
    found = [base]
    names, pairs = list(FACTORS), []
    for factor in names:
        found += [{**base, factor: level[0]} for level in FACTORS[factor][1:]]
    for i, one in enumerate(names):
        for two in names[i + 1:]:
            pairs += [{**base, one: a[0], two: b[0]} for a in FACTORS[one][1:] for b in FACTORS[two][1:]]
    return found + pairs[::nth]


def changed(cell):
    return [factor for factor, levels in FACTORS.items() if cell[factor] != levels[0][0]]


def level(cell, factor):
    return next(entry[1] for entry in FACTORS[factor] if entry[0] == cell[factor])


def slug(text):
    return "".join(c if c.isalnum() else "_" for c in text)


def scene_of(study, model, cell):
    """The cell's scene file, or None where the model has no such body (a rod has no tetrahedra to squeeze)."""
    cells, kind = CELLS[model], level(cell, "mesh")
    if model == "rod" and kind in ("sliver", "flat"):
        return None
    scale, zero, start = level(cell, "units"), level(cell, "zero"), level(cell, "start")
    young, step = level(cell, "young"), level(cell, "step")
    count = max(2, min(STEPS, round(SIMULATED / step)))
    length, depth, nodes, tets = LENGTH, DEPTH, None, None
    if model == "rod":  # one element is one segment; an element's aspect is its length over its depth
        if kind == "one":
            cells = (1, 1, 1)
        elif kind != 1:
            depth = LENGTH / cells[0] / kind
        shape = {"beam": {"size": [length, depth, depth], "cells": list(cells)}, "scale": scale}
        nodes = numpy.linspace([0, depth / 2, depth / 2], [length, depth / 2, depth / 2], cells[0] + 1)
    else:
        nodes, tets = mesh_of(kind, cells)
        name = "mesh_%s_%s" % (model, slug(cell["mesh"]))
        if model == "tet10" and start not in (None, "thrown", "spun"):
            nodes = all_nodes(study, model, name, nodes, tets)
        if not os.path.exists(study.path("scenes/%s.node" % name)):
            write_mesh(study.path("scenes/" + name), nodes, tets)
        shape = {"file": name + ".node", "scale": scale}
        length = numpy.ptp(nodes[:, 0])
    far = 10 * LENGTH * scale
    material = {"young": 2e4 if young is None else young, "poisson": level(cell, "poisson"),
                "density": 0 if zero == "density" else 1100, "damping": 0 if zero == "damping" else 5.0}
    if young is None:
        material["regions"] = [{"box": [[0.5 * length * scale, -far, -far], [far, far, far]], "young": 2e11}]
    body = {"name": "body", "shape": shape, "model": model, "material": material}
    if start == "thrown":
        body["start"] = {"velocity": [100, 0, 0]}
    elif start == "spun":
        body["start"] = {"spin": [0, 0, 2 * math.pi * 100]}
    else:
        points = start_points(start, nodes, tets)
        if points is not None:
            name = "start_%s_%s_%s_%s.txt" % (model, slug(cell["mesh"]), start, slug(cell["units"]))
            if not os.path.exists(study.path("scenes/" + name)):
                numpy.savetxt(study.path("scenes/" + name), points * scale, "%.17g")
            body["start"] = {"positions": name}
    if zero != "load":  # a tenth of the soft end's stiffness over its section
        force = 0.1 * material["young"] * depth**2 * scale**2
        tiny = 1e-3 * length * scale
        until = 0.5 * count * step
        body["load"] = [{"box": [[-far, -far, -far], [tiny, far, far]], "force": [-force, 0, 0], "until": until},
                        {"box": [[length * scale - tiny, -far, -far], [far, far, far]], "force": [force, 0, 0],
                         "until": until}]
    name = "stable_%s_%s" % (model, "__".join(slug(cell[f]) for f in changed(cell)) or "base")
    return study.write_scene(name, {"scene": name, "step": step, "time_limit": count * step,
                                    "contact": {"method": "none"}, "bodies": [body]})


def judge(outcome):
    """(result, shape error) of a cell's run."""
    if outcome.status in ("hang", "crash"):
        return outcome.status, None
    if outcome.status == "refused":
        return ("refused", None) if outcome.message else ("crash", None)
    body = outcome.figure("bodies", 0)
    error = body.get("shape_error") if body else None
    if outcome.last is not None:
        if not numpy.isfinite(outcome.last).all():
            return "not finite", None
        if error is None:
            error = tools.shape_error(outcome.last, outcome.rest)
    if body is None or None in body["tip"] + body["goal"] or body["energy"] is None:
        return "not finite", error
    if outcome.status in ("failed", "late"):
        return {"failed": "stopped", "late": "slow"}[outcome.status], error
    return ("recovered" if error is not None and error <= RECOVERED else "still deformed"), error


def run_cell(study, model, linear, cell, limit):
    row = {"model": model, "linear": linear, **cell, "changed": " + ".join(changed(cell)) or "base"}
    scene = scene_of(study, model, cell)
    if scene is None:
        return None
    settings = {"solver.linear": linear} if linear != "auto" else {}
    outcome = study.run(scene, settings, threads=1, limit=limit, points=True)
    row["result"], row["shape_error"] = judge(outcome)
    row["start_error"] = tools.shape_error(outcome.first, outcome.rest) if outcome.first is not None else None
    row.update(facts(outcome))
    return row


def study_grid(study, model, linear, cells, limit):
    """Rows of a model and solver, two cells at a time."""
    rows = study.pool(lambda cell: run_cell(study, model, linear, cell, limit), cells)
    return [row for row in rows if row]


def large(study, model, linear):
    """200,000 elements, apart (a rod: its most, 100,000): at rest and spinning, a few steps."""
    shape = {"beam": {"size": [2.6, 0.04, 0.04], "cells": [520, 8, 8] if model != "rod" else [100000, 1, 1]}}
    rows = []
    for name, steps in (("rest", 2), ("100 rev/s", 1))[:1 if model == "tet10" and not study.every_cell else 2]:
        body = {"name": "body", "shape": shape, "model": model,
                "material": {"young": 8.7e6, "poisson": 0.33, "density": 1100, "damping": 5.0}}
        if name != "rest":
            body["start"] = {"spin": [2 * math.pi * 100, 0, 0]}
        scene = study.write_scene("large_%s_%s" % (model, slug(name)), {
            "scene": "large", "step": 0.01, "time_limit": 0.01 * steps, "gravity": [0, 0, -9.81],
            "contact": {"method": "none"}, "bodies": [body]})
        settings = {"solver.linear": linear} if linear != "auto" else {}
        outcome = study.run(scene, settings, limit=180, points=True)
        size = "100,000" if model == "rod" else "200,000"
        row = {"model": model, "linear": linear, "changed": "%s elements, %s" % (size, name), "start": name}
        row["result"], row["shape_error"] = judge(outcome)
        row.update(facts(outcome))
        rows.append(row)
    return rows


def facts(outcome):
    return {"status": outcome.status, "exit": outcome.code, "message": outcome.message,
            "steps": outcome.figure("steps"), "newton_max": outcome.figure("solver", "newton_max"),
            "residual_max": outcome.figure("solver", "residual_max"),
            "inverted_max": outcome.figure("solver", "inverted_max"), "wall_s": outcome.wall,
            "command": outcome.command}


def run(study):
    rows = []
    for model in study.models:
        solvers = ["auto"] + [s for s in ("cholesky", "cg", "pcg", "chain") if s in study.linear and not study.quick]
        for linear in solvers:
            cells = cells_of(20 if study.quick else 1 if study.every_cell else {"auto": 1, "cg": 8}.get(linear, 4))
            rows += study_grid(study, model, linear, cells, 10 if study.quick else 30)
            study.say("stability: %s, %s" % (model, linear))
        if not study.quick:
            rows += large(study, model, "auto")
        study.table("stability_" + model, [row for row in rows if row["model"] == model])
    study.table("stability", rows)
    study.table("stability_failures", [row for row in rows if row["result"] in FAILURES], list(rows[0]))
    return rows
