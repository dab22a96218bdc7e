"""Pictures as SVG and PNG. A model has one colour and one line everywhere, a method one marker, so that a picture
can be read without colours."""
import os

os.environ.setdefault("MPLCONFIGDIR", "/tmp")
import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt
import numpy
from matplotlib.colors import ListedColormap
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

import detection
import stability

plt.rcParams.update({"font.size": 9, "axes.titlesize": 10, "axes.grid": True, "grid.color": "0.88",
                     "axes.axisbelow": True, "legend.frameon": False, "svg.hashsalt": "catnav",
                     "savefig.bbox": "tight", "savefig.dpi": 150})

COLOUR = {"tet4": "#0072b2", "tet10": "#d55e00", "rod": "#009e73", "molecules": "#cc79a7"}
LINE = {"tet4": "--", "tet10": "-.", "rod": "-", "molecules": (0, (5, 1))}
MARKER = {"auto": "o", "cholesky": "s", "cg": "^", "pcg": "v", "chain": "D", "midpoint": "P", "trbdf2": "*",
          "explicit": "X"}
PAPER_LOOK = {"color": "0.25", "linestyle": ":", "marker": "x"}


def draw(study, part, found):
    """The pictures of a part of the study, from what it returned."""
    if part == "accuracy":
        stiffness(study, study.stiffness)
        cook(study, study.cook)
        for problem, rows in found:
            error_against_time(study, problem, rows)
    elif part == "stability":
        for model in dict.fromkeys(row["model"] for row in found):
            stability_map(study, model, [row for row in found if row["model"] == model])
    elif part == "speed":
        cost_against_size(study, *found[1:3])
    elif part == "contact":
        methods(study, found[0])
    elif part == "theory" and found:
        beside_theory(study, found)
    elif part == "detection" and found:
        detection_cost(study, found)


def save(figure, study, name):
    figure.savefig(study.path(name + ".svg"), metadata={"Date": None})
    figure.savefig(study.path(name + ".png"))
    plt.close(figure)


def look(row):
    """Line, marker and label of a row's series."""
    if row["method"] == "paper":
        return {**PAPER_LOOK, "label": "tet4, paper's method (one solve, CG)"}
    extra = row["integrator"] if row["integrator"] != "euler" else row["linear"]
    label = row["model"] + ("" if extra == "auto" else ", " + extra)
    return {"color": COLOUR[row["model"]], "linestyle": LINE[row["model"]], "marker": MARKER.get(extra, "o"),
            "label": label, "markersize": 5 if extra == "auto" else 4, "linewidth": 1.6 if extra == "auto" else 0.8}


LEAST = 1e-6  # errors below are shown here: round-off, or the reference's own last digits


def shown(row):
    return max(row["error"], LEAST)


def error_against_time(study, problem, rows):
    figure, axes = plt.subplots(figsize=(5.4, 4.0))
    good = [row for row in rows if row.get("error") is not None and row.get("total_s")]
    series = {}
    for row in good:
        series.setdefault((row["model"], row["method"], row["linear"], row["integrator"]), []).append(row)
    for found in series.values():
        style = look(found[0])
        steps = {row["dt"] for row in found}
        main = max(steps, key=lambda step: sum(row["dt"] == step for row in found))  # finer meshes at one step
        line = [row for row in found if row["dt"] == main]
        axes.plot([row["total_s"] for row in line], [shown(row) for row in line], **style)
        rest = [row for row in found if row["dt"] != main]
        axes.plot([row["total_s"] for row in rest], [shown(row) for row in rest],
                  **{**style, "label": None, "linestyle": "none", "markerfacecolor": "white"})
    front = sorted((row for row in good if row["pareto"]), key=lambda row: row["total_s"])
    axes.plot([row["total_s"] for row in front], [shown(row) for row in front], color="0.75", linewidth=6,
              alpha=0.6, zorder=0, solid_capstyle="round", label="Pareto front", marker="o", markersize=9)
    axes.set(xscale="log", yscale="log", xlabel="time of all steps [s]", ylabel="relative error [-]",
             title=problem.title.replace("`", ""))
    for label in dict.fromkeys(look(row)["label"] for row in rows):
        if label not in {look(row)["label"] for row in good}:
            axes.plot([], [], linestyle="none", label=label + ": no result")
    handles, labels = axes.get_legend_handles_labels()
    if any(row["dt"] is not None for row in good):
        main = max({row["dt"] for row in good}, key=lambda step: sum(row["dt"] == step for row in good))
        handles.append(Line2D([], [], color="0.4", marker="o", linestyle="none", markerfacecolor="white"))
        labels.append("other steps than %g ms" % (1e3 * main))
    axes.legend(handles, labels, loc="center left", bbox_to_anchor=(1.02, 0.5))
    save(figure, study, "accuracy_" + problem.name)


def stiffness(study, rows):
    """Relative error of a catheter's bending, torsion and axial stiffness against its unknowns."""
    figure, all_axes = plt.subplots(1, 3, figsize=(9.2, 3.2), sharey=True)
    for axes, what in zip(all_axes, ("bending", "torsion", "axial")):
        for model in dict.fromkeys(row["model"] for row in rows):
            line = [row for row in rows if row["model"] == model and row[what] is not None]
            axes.plot([row["dof"] for row in line], [max(abs(row[what]), LEAST) for row in line],
                      color=COLOUR[model], linestyle=LINE[model], marker="o", markersize=4, label=model)
        axes.axhline(0.05, color="0.5", linewidth=0.8, linestyle=":")
        axes.set(xscale="log", yscale="log", title=what, xlabel="unknowns of 1 m of catheter [-]")
    all_axes[0].set_ylabel("error of stiffness [-]")
    all_axes[0].text(0.02, 0.05, "5 %", transform=all_axes[0].get_yaxis_transform(), va="bottom", fontsize=8)
    all_axes[2].legend(loc="center left", bbox_to_anchor=(1.02, 0.5))
    figure.tight_layout()
    save(figure, study, "stiffness")


def cook(study, rows):
    """Error of the corner's deflection of Cook's membrane against time and unknowns, a column for each nu."""
    cases = list(dict.fromkeys((row["plane"], row["nu"]) for row in rows))
    if not cases:
        return
    figure, grid = plt.subplots(2, len(cases), figsize=(2.6 * len(cases) + 1, 5.0), sharey=True, squeeze=False)
    for column, (plane, nu) in enumerate(cases):
        for axes, key, label in ((grid[0][column], "total_s", "time [s]"), (grid[1][column], "dof", "unknowns [-]")):
            for model in ("tet4", "tet10"):
                line = [row for row in rows if row["model"] == model and (row["plane"], row["nu"]) == (plane, nu)]
                axes.plot([row[key] for row in line], [shown(row) for row in line], color=COLOUR[model],
                          linestyle=LINE[model], marker="o", markersize=4, label=model)
            axes.set(xscale="log", yscale="log", xlabel=label, ylabel="" if column else "error of the corner [-]",
                     title="plane %s, nu = %.4g" % (plane, nu) if key == "total_s" else "")
    grid[0][-1].legend(loc="center left", bbox_to_anchor=(1.02, 0.5))
    figure.tight_layout()
    save(figure, study, "cook")


# Result -> grey level that orders them in print, colour, letter
RESULT_LOOK = {"recovered": ("#e4f1e4", ""), "still deformed": ("#f4e3a1", "·"), "refused": ("#b5c7de", "R"),
               "stopped": ("#e08a4f", "S"), "slow": ("#c9a0dc", "L"), "not finite": ("#8c1a1a", "N"),
               "hang": ("#5b0f4d", "H"), "crash": ("#000000", "C")}


def stability_map(study, model, rows):
    """Levels against levels: the worst result over the solvers; the diagonal is a level alone."""
    labels, owner = [], []
    for factor, levels in stability.FACTORS.items():
        labels += [level[0] for level in levels[1:]]
        owner += [factor] * (len(levels) - 1)
    place = {(factor, label): i for i, (factor, label) in enumerate(zip(owner, labels))}
    grid = numpy.full((len(labels), len(labels)), numpy.nan)
    for row in rows:
        factors = [f for f in row["changed"].split(" + ") if f in stability.FACTORS]
        if factors:
            at = [place[f, row[f]] for f in factors]
            i, j = max(at), min(at)
            worst = stability.RESULTS.index(row["result"])
            grid[i, j] = worst if numpy.isnan(grid[i, j]) else max(grid[i, j], worst)
    figure, axes = plt.subplots(figsize=(9.5, 8.2))
    colours = ListedColormap([RESULT_LOOK[result][0] for result in stability.RESULTS])
    axes.imshow(grid, cmap=colours, vmin=-0.5, vmax=len(stability.RESULTS) - 0.5, aspect="equal")
    for i, j in zip(*numpy.nonzero(~numpy.isnan(grid))):
        result = stability.RESULTS[int(grid[i, j])]
        axes.text(j, i, RESULT_LOOK[result][1], ha="center", va="center", fontsize=7,
                  color="white" if result in stability.FAILURES else "black")
    axes.set_xticks(range(len(labels)), labels, rotation=90)
    axes.set_yticks(range(len(labels)), labels)
    axes.grid(False)
    for edge in range(len(labels) + 1):
        new = edge in (0, len(labels)) or owner[edge] != owner[edge - 1]
        axes.axhline(edge - 0.5, color="0.35" if new else "white", linewidth=0.9 if new else 0.6)
        axes.axvline(edge - 0.5, color="0.35" if new else "white", linewidth=0.9 if new else 0.6)
    for factor in stability.FACTORS:
        at = [i for i, name in enumerate(owner) if name == factor]
        axes.text(len(labels) - 0.3, sum(at) / len(at), factor, va="center", fontweight="bold")
    axes.set_xlim(-0.5, len(labels) - 0.5)
    for side in axes.spines.values():
        side.set_visible(False)
    present = {result for result in stability.RESULTS if result in [row["result"] for row in rows]}
    solvers = list(dict.fromkeys(row["linear"] for row in rows))
    axes.set_title("%s: what happened, worst of %s\n(diagonal: one factor alone; below it: pairs)"
                   % (model, ", ".join(solvers)), loc="left")
    axes.legend(handles=[Patch(facecolor=RESULT_LOOK[r][0], edgecolor="0.4", label="%s %s" % (
        RESULT_LOOK[r][1].strip("·") and "(%s)" % RESULT_LOOK[r][1], r)) for r in stability.RESULTS if r in present],
        loc="upper right", frameon=True, facecolor="white", edgecolor="none", framealpha=1)
    save(figure, study, "stability_" + model)


def cost_against_size(study, rows, fits):
    """Step time and memory against elements, log-log; `fits`: {(model, shape): (exponent of time, of memory)}."""
    figure, both = plt.subplots(1, 2, figsize=(9.2, 3.8))
    marker = {"grown by length": "o", "compact": "s"}
    for axes, key, scale, label in ((both[0], "step_ms", 1, "mean step [ms]"),
                                    (both[1], "memory_mib", 1, "peak memory [MiB]")):
        for (model, shape), exponents in fits.items():
            line = [row for row in rows if row["model"] == model and row["shape"] == shape and row.get(key)]
            power = exponents[0 if axes is both[0] else 1]
            axes.plot([row["elements"] for row in line], [scale * row[key] for row in line],
                      color=COLOUR[model], linestyle=LINE[model], marker=marker[shape], markersize=4,
                      markerfacecolor=COLOUR[model] if shape != "compact" else "white",
                      label="%s, %s" % (model, shape) + (": n^%.2f" % power if power else ""))
        axes.set(xscale="log", yscale="log", xlabel="elements [-]", ylabel=label)
        axes.legend(loc="lower center", bbox_to_anchor=(0.5, 1.0), fontsize=8, ncol=1)
    figure.tight_layout()
    save(figure, study, "cost")


METHOD = {"strict": ("#009e73", "-", "o"), "project": ("#d55e00", "--", "x"), "penalty": ("#0072b2", "-.", "s")}


def methods(study, rows):
    """Error and depth of the ways to respond to contact against run time, a column for each scene."""
    scenes = list(dict.fromkeys(row["scene"] for row in rows))
    if not scenes:
        return
    figure, grid = plt.subplots(2, len(scenes), figsize=(3.2 * len(scenes), 5.0), squeeze=False)
    for column, scene in enumerate(scenes):
        for line, (key, label) in enumerate((("error", "error / size [-]"), ("penetration", "worst depth / size [-]"))):
            axes = grid[line][column]
            for name, (colour, style, marker) in METHOD.items():
                found = [row for row in rows if row["scene"] == scene and row["method"] == name and row["total_s"] and
                         row.get(key) is not None]
                axes.plot([row["total_s"] for row in found], [max(row[key], LEAST) for row in found], color=colour,
                          linestyle=style, marker=marker, markersize=5, label=name)
            axes.set(xscale="log", yscale="log", ylim=(0.5 * LEAST, 3), xlabel="time of all steps [s]" if line else "",
                     ylabel="" if column else label, title="" if line else scene)
    grid[1][0].text(0.02, LEAST, "none", transform=grid[1][0].get_yaxis_transform(), va="bottom", fontsize=8)
    grid[0][-1].legend(loc="center left", bbox_to_anchor=(1.02, 0.5))
    figure.tight_layout()
    save(figure, study, "contact")


def beside_theory(study, rows):
    """Error of every figure beside its tolerance."""
    shown_rows = [row for row in rows if row["error"] is not None]
    figure, axes = plt.subplots(figsize=(6.4, 0.19 * len(shown_rows) + 1.0))
    place = range(len(shown_rows), 0, -1)
    axes.plot([row["tolerance"] for row in shown_rows], place, linestyle="none", marker="|", color="0.35", markersize=8,
              label="tolerance of the reference")
    for within, colour, label in ((True, "#009e73", "within"), (False, "#d55e00", "beyond")):
        some = [(max(row["error"], LEAST), at) for row, at in zip(shown_rows, place) if row["within"] == within]
        if some:
            axes.plot(*zip(*some), linestyle="none", marker="o" if within else "x", color=colour, markersize=4, label=label)
    axes.set_yticks(place, ["%s, %s: %s" % (row["problem"], row["case"], row["quantity"].split(" [")[0])
                            for row in shown_rows], fontsize=6)
    axes.set(xscale="log", xlabel="error over the size of theory's figure [-]", xlim=(0.5 * LEAST, 1))
    axes.legend(loc="lower left", bbox_to_anchor=(0, 1), ncol=3)
    save(figure, study, "theory")


def detection_cost(study, rows):
    """Build, refit and query against triangles, beside n log n and n."""
    figure, axes = plt.subplots(figsize=(5.0, 3.6))
    n = numpy.array([row["triangles"] for row in rows])
    for key, colour, marker in (("build_ms", "#d55e00", "s"), ("query_ms", "#0072b2", "o"), ("refit_ms", "#009e73", "^")):
        values = [row[key] for row in rows]
        law = n * numpy.log(n) if detection.LAWS[key] == "n log n" else n
        axes.plot(n, law * values[0] / law[0], color=colour, linestyle=":", linewidth=0.8)
        axes.plot(n, values, color=colour, marker=marker, markersize=4,
                  label="%s (dotted: %s)" % (key[:-3], detection.LAWS[key]))
    axes.set(xscale="log", yscale="log", xlabel="triangles of a surface [-]", ylabel="time [ms]")
    axes.legend()
    save(figure, study, "detection")
