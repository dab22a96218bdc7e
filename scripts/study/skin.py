"""Skins: pictures after figures 4 and 8 of Egger, Skinning a Deformation Model (EPFL 2004), smoothness against
anchors a vertex, the time of an update against vertices; and the tissue that carries them: a whole step of molecules
beside one of tetrahedra."""
import csv
import io
import math
import os
import subprocess

os.environ.setdefault("MPLCONFIGDIR", "/tmp")
import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt
import numpy as np
from matplotlib.collections import LineCollection, PolyCollection

import problems

SKIN, GRID, PAPER = "#009e73", "#0072b2", "#d55e00"
AIM = 4.0  # [ms], 100,000 vertices on four anchors with normals, two threads


def ask(study, *words):
    """Rows of a part of `catnav study skin`."""
    words = ("study", "skin") + words
    text = subprocess.run([study.catnav, *words], check=True, capture_output=True, text=True).stdout
    study.commands += 1
    return [{**row, "command": "catnav " + " ".join(words)} for row in csv.DictReader(io.StringIO(text))]


def measure(study, name, *words):
    """The same, kept as a table."""
    rows = ask(study, *words)
    study.table(name, rows)
    study.say("skin: " + name)
    return rows


def save(figure, study, name):
    figure.savefig(study.path(name + ".svg"), metadata={"Date": None})
    figure.savefig(study.path(name + ".png"))
    plt.close(figure)


def figure4(study):
    rows = measure(study, "figure4", "bezier", "5" if study.quick else "50")
    figure, axes = plt.subplots(1, 2, figsize=(8.4, 3.6), sharey=True)
    for part, against, label in ((axes[0], "control_points", "control points (1600 intervals)"),
                                 (axes[1], "intervals", "intervals (100 control points)")):
        found = [row for row in rows if row["against"] == against]
        x = [float(row[against]) for row in found]
        for key, name, colour, marker in (("double_sum_fps", "Bezier, double sum (the paper's)", PAPER, "x"),
                                          ("grid_fps", "Bezier, one sum after the other", GRID, "s"),
                                          ("skin_fps", "skin, 4 anchors, as many vertices", SKIN, "o")):
            part.loglog(x, [float(row[key]) for row in found], marker=marker, color=colour, label=name)
        part.axhline(20, color="0.5", linewidth=0.8, linestyle=":")
        part.set_xlabel(label)
    axes[0].text(x[0], 23, "20 a second: the paper's aim", color="0.4", fontsize=7)
    axes[0].set_ylabel("frames a second, one thread, with normals")
    axes[0].legend(fontsize=7)
    save(figure, study, "figure4")
    return rows


def read_shape(rows):
    """Vertices, faces, and links as (vertex, place of its anchor)."""
    place = {}
    links, faces = [], []
    for row in rows:
        kind, number = row["kind"].split()
        at = [float(row[key]) for key in "abc"]
        if kind == "vertex":
            place[int(number)] = at
        elif kind == "link":
            links.append((int(number), at))
        else:
            faces.append([int(corner) for corner in at])
    return np.array([place[i] for i in range(len(place))]), np.array(faces), links


def view(points):
    """Seen from the side of the bend and a little from above: across, up, towards the eye."""
    right, up = np.array([0.94, 0.34, 0]), np.array([-0.1, 0.28, 0.95])
    right /= np.linalg.norm(right)
    towards = np.cross(right, up)
    towards /= np.linalg.norm(towards)
    return points @ np.column_stack([right, np.cross(towards, right), towards])


def figure8(study):
    figure, axes = plt.subplots(2, 2, figsize=(7.4, 5.6))
    figure.subplots_adjust(wspace=0.05, hspace=0.12)
    shapes = {n: ask(study, "shape", str(n)) for n in (1, 4)}
    study.table("figure8", [{"anchors": n, **line} for n, lines in shapes.items() for line in lines])
    for row, n in enumerate(shapes):
        x, faces, links = read_shape(shapes[n])
        seen, centre = view(x), view(np.array([at for _, at in links]))
        corners = x[faces]
        face_normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        length = np.linalg.norm(face_normal, axis=1, keepdims=True)
        face_normal = np.divide(face_normal, length, out=np.zeros_like(face_normal), where=length > 0)
        order = np.argsort(seen[faces].mean(axis=1)[:, 2])
        shade = np.clip(view(face_normal) @ (np.array([0.35, 0.55, 0.76])), 0, 1)
        colour = np.outer(0.25 + 0.75 * shade, (0.78, 0.85, 0.92)).clip(0, 1)
        lines = np.stack([seen[[vertex for vertex, _ in links], :2], centre[:, :2]], axis=1)
        left, right = axes[row]
        left.add_collection(PolyCollection(seen[faces][:, :, :2], facecolor=(0.6, 0.7, 0.8, 0.04), rasterized=True))
        left.add_collection(LineCollection(lines, color="#c03020", linewidth=0.4, alpha=0.6))
        left.plot(centre[:, 0], centre[:, 1], "o", color="0.15", markersize=4)
        right.add_collection(PolyCollection(seen[faces][order][:, :, :2], facecolor=colour[order],
                                            edgecolor=colour[order], linewidth=0.2, rasterized=True))
        for part in (left, right):
            part.set_aspect("equal")
            part.autoscale_view()
            part.axis("off")
        left.set_title("%d anchor%s a vertex" % (n, "" if n == 1 else "s"), loc="left")
    save(figure, study, "figure8")


def smoothness(study):
    rows = measure(study, "smoothness", "smooth")
    figure, axes = plt.subplots(1, 3, figsize=(9.6, 3.4), sharey=True)
    names = {"2x2x9": "2 x 2 x 9 anchors", "3x3x13": "3 x 3 x 13 anchors", "1x1x9": "9 anchors on the axis"}
    for part, (bar, name) in zip(axes, names.items()):
        for around, colour in (("32", PAPER), ("64", GRID), ("128", SKIN)):
            found = {row["per_vertex"]: float(row["degrees"]) for row in rows
                     if row["bar"] == bar and row["edges_around"] == around}
            part.semilogy(range(1, 9), [found[str(n)] for n in range(1, 9)], marker="o", color=colour,
                          label="%s edges around" % around)
            part.axhline(found["exact"], color=colour, linewidth=0.8, linestyle=":")
        part.set_title(name)
        part.set_xlabel("anchors a vertex")
    axes[0].set_ylabel("largest angle between\nneighbouring faces [degrees]")
    axes[0].legend(fontsize=7)
    axes[2].text(1, found["exact"] * 0.86, "dotted: the body bent exactly", fontsize=7, color="0.4", va="top")
    save(figure, study, "smoothness")
    return rows


def update_time(study):
    """Least and median time of an update against vertices, 4 anchors and embedded, one thread and two."""
    rows = measure(study, "skin_speed", "speed", "5" if study.quick else "200")
    figure, axes = plt.subplots(figsize=(5.4, 3.8))
    for kind, per, label in (("blend", "4", "4 anchors"), ("embed", "4", "embedded")):
        for threads, line in (("1", "--"), ("2", "-")):
            found = [row for row in rows if (row["kind"], row["per_vertex"], row["threads"]) == (kind, per, threads)]
            axes.loglog([int(row["vertices"]) for row in found], [float(row["best_ms"]) for row in found], line,
                        color=SKIN if kind == "blend" else GRID, marker="o", markersize=4,
                        label="%s, %s thread%s" % (label, threads, "s" if threads == "2" else ""))
    axes.axhline(AIM, color="0.5", linewidth=0.8, linestyle=":")
    axes.set(xlabel="vertices", ylabel="least time of an update with normals [ms]")
    axes.legend(fontsize=8)
    save(figure, study, "skin_speed")
    return rows


def block(nodes, model):
    """A clamped cube of about so many nodes under its weight, in contact with nothing."""
    side = 0.3
    around = max(2, round(nodes ** (1 / 3)) - 1)  # cells of tetrahedra
    spacing = side / max(1.5, nodes / 2) ** (1 / 3)  # a body-centred lattice has two in a cell
    return {"scene": "tissue", "step": 0.01, "time_limit": 0.2, "gravity": [0, 0, -problems.GRAVITY],
            "contact": {"method": "none"}, "bodies": [{
                "name": "block", "shape": {"beam": {"size": [side] * 3, "cells": [around] * 3}}, "model": model,
                "molecules": {"radius": round(spacing * math.sqrt(3) / 4, 8)},
                "material": {"young": 2e5, "poisson": 0.25, "density": 1000},
                "fixed": {"box": [[-1, -1, -1], [0.6 * spacing, 1, 1]]}}]}


def tissue(study):
    """Whole steps of molecules, implicit and explicit, and of tet4 with as many nodes, one after the other."""
    rows = []
    for nodes in (300, 1000) if study.quick else (1000, 3000, 10000, 30000):
        for model, integrator in (("tet4", "euler"), ("molecules", "euler"), ("molecules", "explicit")):
            file = study.write_scene("tissue_%d_%s" % (nodes, model), block(nodes, model))
            best = None
            for _ in range(1 if study.quick else 3):
                outcome = study.run(file, {"solver.integrator": integrator}, limit=300)
                took = outcome.figure("time", "step_ms", "median")
                if took and (best is None or took < best.figure("time", "step_ms", "median")):
                    best = outcome
            outcome = best or outcome
            rows.append({"model": model, "integrator": integrator, "nodes": outcome.figure("counts", "nodes"),
                         "dof": outcome.figure("counts", "dof"), "status": outcome.status,
                         "message": None if outcome.status == "ran" else outcome.message,
                         "step_ms_median": outcome.figure("time", "step_ms", "median"),
                         "step_ms_p95": outcome.figure("time", "step_ms", "p95"),
                         "newton_max": outcome.figure("solver", "newton_max"),
                         "residual_max": outcome.figure("solver", "residual_max"), "command": outcome.command})
        study.say("skin: tissue of %d" % nodes)
    study.table("tissue", rows)
    return rows


def run(study):
    found = {"figure4": figure4(study), "speed": update_time(study), "smoothness": smoothness(study),
             "tissue": tissue(study)}
    figure8(study)
    return found
