#!/usr/bin/python3
"""Pictures of skins, after figures 4 and 8 of Egger, Skinning a Deformation Model (EPFL 2004), with the CSV they
are made from.

    skin.py BENCH FOLDER    runs BENCH (`make -C build bench_skin` builds build/bench/bench_skin) and writes
                            figure4, figure8 and smoothness as .svg and .png, and speed, beside their .csv
"""
import csv
import io
import os
import subprocess
import sys

os.environ.setdefault("MPLCONFIGDIR", "/tmp")
import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt
import numpy as np
from matplotlib.collections import LineCollection, PolyCollection

plt.rcParams.update({"font.size": 9, "axes.titlesize": 10, "axes.grid": True, "grid.color": "0.88",
                     "axes.axisbelow": True, "legend.frameon": False, "svg.hashsalt": "catnav",
                     "savefig.bbox": "tight", "savefig.dpi": 150})
SKIN, GRID, PAPER = "#009e73", "#0072b2", "#d55e00"


def run(bench, folder, name, *words):
    """Output of a part of the bench, kept as CSV."""
    text = subprocess.run([bench, *words], check=True, capture_output=True, text=True).stdout
    with open(os.path.join(folder, name + ".csv"), "w") as file:
        file.write(text)
    return list(csv.DictReader(io.StringIO(text)))


def save(figure, folder, name):
    figure.savefig(os.path.join(folder, name + ".svg"), metadata={"Date": None})
    figure.savefig(os.path.join(folder, name + ".png"))
    plt.close(figure)


def figure4(bench, folder):
    rows = run(bench, folder, "figure4", "bezier")
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
    save(figure, folder, "figure4")


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


def figure8(bench, folder):
    figure, axes = plt.subplots(2, 2, figsize=(7.4, 5.6))
    figure.subplots_adjust(wspace=0.05, hspace=0.12)
    for row, n in enumerate((1, 4)):
        x, faces, links = read_shape(run(bench, folder, "figure8_%d" % n, "shape", str(n)))
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
    save(figure, folder, "figure8")


def smoothness(bench, folder):
    rows = run(bench, folder, "smoothness", "smooth")
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
    save(figure, folder, "smoothness")


def main():
    if len(sys.argv) != 3:
        sys.exit(__doc__)
    bench, folder = sys.argv[1:]
    os.makedirs(folder, exist_ok=True)
    figure4(bench, folder)
    figure8(bench, folder)
    smoothness(bench, folder)
    run(bench, folder, "speed", "speed")


if __name__ == "__main__":
    main()
