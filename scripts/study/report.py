"""index.md: what was run, what came out, how to repeat each row."""
import collections
import os
import platform
import time

import contact
import detection
import equal
import soak
import stability


def number(value, form="%.3g"):
    return "-" if value is None else form % value


def percent(value):
    if value is None:
        return "-"
    return "%.2g %%" % (100 * value) if abs(value) < 0.995 else "%.0f %%" % (100 * value)


def duration(seconds):
    if seconds is None:
        return "-"
    for scale, unit in ((1, "s"), (1e-3, "ms"), (1e-6, "us")):
        if seconds >= scale:
            return "%.3g %s" % (seconds / scale, unit)
    return "%.3g us" % (1e6 * seconds)


def table(head, rows):
    lines = ["| " + " | ".join(head) + " |", "|" + "---|" * len(head)]
    return lines + ["| " + " | ".join(str(cell).replace("|", "\\|") for cell in row) + " |" for row in rows] + [""]


def cpu():
    try:
        with open("/proc/cpuinfo") as file:
            return next(line.split(":")[1].strip() for line in file if line.startswith("model name"))
    except (OSError, StopIteration):
        return platform.machine()


def picture(name, text):
    return ["![%s](%s.png)" % (text, name), "", "[SVG](%s.svg), [CSV](%s.csv), [JSON](%s.json)" % (name, name, name),
            ""]


CLOSE = 0.05  # the error that a clinician's question bears, and the bar of the catheter


def to_close(rows):
    """Least time to an error of CLOSE, or the least error in brackets."""
    good = [row for row in rows if row.get("error") is not None]
    close = [row["total_s"] for row in good if row["error"] <= CLOSE]
    if close:
        return duration(min(close))
    return "(%s)" % percent(min(row["error"] for row in good)) if good else "(no result)"


def summary(study, parts):
    lines = ["## In short", ""]
    if parts.get("accuracy"):
        def chosen(rows, model, method):
            return [row for row in rows if row["model"] == model and row["method"] == method]
        lines += ["Time of all steps to an error of at most %s; in brackets the least error where none came so close:"
                  % percent(CLOSE), ""]
        models = study.models + study.tissues
        lines += table(["problem"] + ["`%s`" % m for m in models] + ["paper's method"],
                       [[problem.title] + [to_close(chosen(rows, m, "own")) if m in study.models or problem.tissue
                                           else "-" for m in models] +
                        [to_close(chosen(rows, "tet4", "paper"))] for problem, rows in parts["accuracy"]])
    if "stability" in parts:
        found = collections.Counter(row["result"] for row in parts["stability"])
        lines += ["Stability: of %d extreme cells %s." % (sum(found.values()), ", ".join(
            "%d %s" % (found[r], r) for r in stability.RESULTS if found[r])), ""]
    if parts.get("theory"):
        off = [row for row in parts["theory"] if not row["within"]]
        lines += ["Contact beside theory: %d of %d figures within the reference's tolerance%s." % (
            len(parts["theory"]) - len(off), len(parts["theory"]),
            "; beyond it: " + ", ".join("%s, %s" % (row["problem"], row["case"]) for row in off) if off else ""), ""]
    if "contact" in parts:
        strict = [row for row in parts["contact"][0] + parts["contact"][1] if row["method"] == "strict"]
        lines += ["`strict`: %d crossings and %d points outside in %d steps of %d runs of this study." % (
            sum(row["crossings"] or 0 for row in strict), sum(row["outside"] or 0 for row in strict),
            sum(row["steps"] or 0 for row in strict), len(strict)), ""]
    if "speed" in parts:
        ratios = ["%s, `%s`: %.3g times" % (row["case"], row["model"], row["paper_over_own"])
                  for row in parts["speed"][0] if row["method"] == "own" and row.get("paper_over_own")]
        best = ["%s, `%s` at %g ms: %.3g times" % (row["case"], row["model"], 1e3 * row["step_s"], row["paper_over_own"])
                for row in parts["speed"][3] if row["best"]]
        lines += ["A step of the paper's method takes, over ours (solved to the tolerance): " + "; ".join(ratios) +
                  ".", ""]
        lines += ["At no larger error it takes, over ours: " + "; ".join(best) + ".", ""] if best else []
    return lines


def accuracy_part(study, parts):
    lines = ["## Error against run time", "",
             "Each point is one run, at the median of %s. The line of a model leads from coarse to fine meshes. "
             "The broad grey line is the Pareto front: no run is both faster and better. *Paper's method* is the "
             "first paper's: linear tetrahedra, one solve of the frozen rotation a step, block-Jacobi CG to 1e-4 "
             "with at most 1,000 iterations." % ("one timing" if study.quick else
             "three timings with one thread, as many runs at once as there are cores (one timing where a run "
             "takes over 5 s, the catheter scene's apart, and with other than the default linear solver)"), ""]
    lines += ["### Stiffness of the catheter's mesh", "",
              "Bending, torsion and axial stiffness of 1 m of the seed's catheter (1.35 mm, E 8.7 MPa, nu 0.33, "
              "rings of 6) over beam theory of the true circle, minus one, as each report states it.", ""]
    lines += picture("stiffness", "error of bending, torsion and axial stiffness")
    lines += table(["model", "stations", "nodes", "unknowns", "bending", "torsion", "axial"],
                   [[row["model"], row["stations"], row["nodes"], row["dof"]] +
                    [percent(row[what]) for what in ("bending", "torsion", "axial")] for row in study.stiffness])
    if study.cook:
        lines += ["### Cook's membrane", "",
                  "Deflection of the loaded edge's upper corner by one static solve, one cell through the thickness. "
                  "Reference: cook_membrane.json, second-order triangles in two dimensions, extrapolated; nu 0.499 by the "
                  "same computation.", ""]
        lines += picture("cook", "error of Cook's membrane against time and unknowns")
        finest = {(row["plane"], row["nu"], row["model"]): row for row in study.cook}
        lines += table(["plane", "nu", "model", "cells a side", "unknowns", "error", "time"],
                       [[row["plane"], "%.4g" % row["nu"], row["model"], row["cells"], row["dof"],
                         percent(row["error"]), duration(row["total_s"])] for row in finest.values()])
    for problem, rows in parts:
        lines += ["### " + problem.title, "", "Reference: %s." % problem.answer, ""]
        lines += picture("accuracy_" + problem.name, problem.title)
        series = collections.OrderedDict()
        for row in rows:
            series.setdefault((row["model"], row["method"], row["linear"], row["integrator"]), []).append(row)
        body = []
        for (model, method, linear, integrator), found in series.items():
            good = [row for row in found if row.get("error") is not None]
            if not good:
                body.append([model, method, linear, integrator, "-", "-", "-", "-", found[0]["message"] or
                             found[0]["status"]])
                continue
            best = min(good, key=lambda row: row["error"])
            body.append([model, method, linear, integrator, percent(best["error"]),
                         "%s%s" % (best["resolution"], ", %g ms steps" % (1e3 * best["dt"]) if best["dt"] else ""),
                         duration(best["total_s"]), number(best["residual_max"], "%.1e"),
                         to_close(good) if best["error"] <= CLOSE else "not reached"])
        lines += table(["model", "method", "linear", "integrator", "least error", "at", "time", "residual",
                        "time to 5 %"], body)
    return lines


def theory_part(rows):
    lines = ["## Contact beside theory", "",
             "Scenes whose answer is known from theory or an independent computation (reference data), run as any "
             "other scene; the error is over the size of theory's figure.", ""]
    lines += picture("theory", "errors beside their tolerances")
    return lines + table(["problem", "case", "quantity", "ours", "theory", "error", "tolerance", "", "time"],
                         [[row["problem"], row["case"], row["quantity"], number(row["ours"], "%.4g"),
                           number(row["theory"], "%.4g"), number(row["error"], "%.1e"), number(row["tolerance"], "%.2g"),
                           "within" if row["within"] else "**beyond**" if row["error"] is not None else row["message"],
                           duration(row["time_s"])] for row in rows])


def contact_part(study, rows, hard):
    lines = ["## Contact: `strict`, `project`, `penalty`", "",
             "The same scenes by each response, at several steps. Error: largest distance of a node at the end from the "
             "converged run's, over the body's size. Depth: the deepest that anything ever was inside a wall, over the "
             "body's size. Crossings (pairs of triangles) and points outside are summed over the steps by the one exact "
             "test that judges every method.", ""]
    lines += ["- %s: %s" % (scene, truth) for scene, truth in study.contact_truth.items()] + [""]
    lines += picture("contact", "error and depth against run time")
    lines += table(["scene", "method", "step [ms]", "worst depth", "crossings", "outside", "error", "median step [ms]",
                    "95 % [ms]", "ended"],
                   [[row["title"], row["method"], number(1e3 * row["dt"]), number(row["penetration"], "%.1e"),
                     number(row["crossings"], "%d"), number(row["outside"], "%d"), number(row.get("error"), "%.1e"),
                     number(row["step_ms_median"]), number(row["step_ms_p95"]), row["status"]] for row in rows])
    lines += ["### Hard cases", ""]
    lines += ["- *%s*: %s" % item for item in contact.TEXT.items()] + [""]
    lines += table(["case", "method", "result", "steps", "crossings", "outside", "worst depth", "median step [ms]",
                    "said"],
                   [[row["case"], row["method"], row["result"], number(row["steps"], "%d"),
                     number(row["crossings"], "%d"), number(row["outside"], "%d"), number(row["penetration"], "%.1e"),
                     number(row["step_ms_median"]),
                     "crept %.1e of its size, kinetic energy %.1e to %.1e J" % (
                         row["creep"], row["kinetic_before"], row["kinetic"]) if row.get("creep") is not None else
                     row["message"] if row["result"] in ("refused", "stopped") else ""] for row in hard])
    return lines + ["[CSV](contact_hard.csv), [JSON](contact_hard.json)", ""]


def detection_part(rows):
    lines = ["## Collision detection", "",
             "A wall and a tube of as many triangles that lies on its bottom all along: building the AABB tree of one, "
             "refitting it, and finding every pair of boxes within the gap. Exponents are least-squares slopes over "
             "the law each should follow besides n.", ""]
    lines += picture("detection", "build, refit and query against triangles")
    return lines + table(["", "law", "exponent of n", "at %.0f triangles [ms]" % rows[-1]["triangles"]],
                         [[key[:-3], detection.LAWS[key], number(rows[0]["exponent_" + key[:-3]], "%.2f"),
                           number(rows[-1][key])] for key in detection.COSTS])


def stability_part(study, rows):
    lines = ["## Stability", "",
             "A small free body of at most 500 elements is pulled at its ends for the first half of a run of at "
             "most %d steps or %g s, then left alone: it should find back to its rest shape. Each factor is "
             "taken to its extremes alone, and in pairs: %s (at steps of 10 us the run ends after 2 ms, too early "
             "to be at rest). What happened:"
             % (stability.STEPS, stability.SIMULATED, "every twentieth in this quick study" if study.quick else
                "all with every solver" if study.every_cell else
                "all with the default solver, every fourth with the others, every eighth with `cg`"), ""]
    lines += ["- *%s*: %s" % (result, stability.TEXT[result]) for result in stability.RESULTS] + [""]
    counts = collections.OrderedDict()
    for row in rows:
        counts.setdefault((row["model"], row["linear"]), collections.Counter())[row["result"]] += 1
    lines += table(["model", "linear"] + list(stability.RESULTS) + ["all"],
                   [list(key) + [found[r] for r in stability.RESULTS] + [sum(found.values())]
                    for key, found in counts.items()])
    failed = [row for row in rows if row["result"] in stability.FAILURES]
    lines += ["**%s**" % ("%d cells failed (not finite, hang or crash): [list](stability_failures.csv)" % len(failed)
                          if failed else "No cell gave a number that is not finite, hung or crashed."), ""]
    for model in dict.fromkeys(row["model"] for row in rows):
        lines += ["![%s](stability_%s.png)" % (model, model), ""]
    lines += ["[SVG: %s], [CSV](stability.csv), [JSON](stability.json)" % ", ".join(
        "[%s](stability_%s.svg)" % (m, m) for m in dict.fromkeys(row["model"] for row in rows)), "",
        "Reasons given where a run was refused or stopped:", ""]
    reasons = collections.OrderedDict()
    for row in rows:
        if row["result"] in ("refused", "stopped"):
            reasons.setdefault((row["result"], reason(row["message"])), []).append(row)
    lines += table(["result", "reason", "cells", "such as"],
                   [[result, text, len(found), "%s %s: %s" % (found[0]["model"], found[0]["linear"], levels(found[0]))]
                    for (result, text), found in sorted(reasons.items(), key=lambda item: -len(item[1]))[:15]])
    return lines


def reason(message):
    """A message without the numbers that differ from cell to cell."""
    words = message.split(": ", 1)[-1] if message.startswith("scenes/") else message
    return " ".join("#" if any(c.isdigit() for c in word) else word for word in words.split())[:160]


def levels(row):
    names = [f for f in row["changed"].split(" + ") if f in stability.FACTORS]
    return ", ".join("%s %s" % (name, row[name]) for name in names) or row["changed"]


def equal_part(study, rows):
    lines = ["### At no larger error", "",
             "Time that %.3g s of motion take, over that time, and the error at its end: root mean square distance of "
             "common nodes from a run of second-order tetrahedra and steps of 1 ms, over the body's diagonal; that run's "
             "own error is its distance from one with steps of 2 ms. The last column compares runs that are no worse "
             "than the paper's method; the cheapest is marked." % equal.DURATION, ""]
    lines += table(["case", "method", "model", "cells", "step [ms]", "integrator", "error", "reference's", "time [s/s]",
                    "paper's time over it"],
                   [[row["case"], row["method"], row["model"], row["cells"], number(1e3 * row["step_s"]),
                     row["integrator"], number(row.get("error"), "%.1e"), number(row["reference_error"], "%.0e"),
                     number(row.get("second_s")), number(row.get("paper_over_own"), "%.3g x") +
                     (" *" if row["best"] else "")] for row in rows])
    return lines + ["[CSV](equal_error.csv), [JSON](equal_error.json)", ""]


def speed_part(study, rows, sizes, fits, as_good):
    lines = ["## Speed", "",
             "Median and 95 %% step times in one sitting, %d threads. *Own* is the default method: every step is "
             "solved to the tolerance. Where both methods stand, they went on from the same states for the steps "
             "that the last column names; ratios for whole runs are extrapolated from these." % study.threads, ""]
    lines += table(["case", "model", "method", "median [ms]", "95 % [ms]", "its solve alone [ms]", "residual, median", "largest",
                    "paper's time over it", "timed"],
                   [[row["case"], row["model"], row["method"], number(row.get("step_ms_median")),
                     number(row.get("step_ms_p95")), number(row.get("solve_ms_median")), number(row.get("residual"), "%.1e"),
                     number(row.get("residual_max"), "%.1e"), number(row.get("paper_over_own"), "%.3g x")
                     if row["status"] == "ran" else row.get("message") or row["status"],
                     row.get("note") or "%s steps" % row.get("steps")] for row in rows])
    lines += ["[CSV](speed.csv), [JSON](speed.json)", ""] + (equal_part(study, as_good) if as_good else [])
    lines += ["### Cost against size", "",
              "A clamped body under its weight, 10 ms steps, grown by length (a beam of 4 x 4 cells) or compact "
              "(a cube); exponents are least-squares slopes, of memory above the smallest body's over elements above its. "
              "The matrix of some thousand `tet10` still lies in the cache, where a block of it costs a product about a third "
              "of what it costs from memory (1.1 and 3.7 ns where this was measured): the exponent over all sizes has that "
              "step in it, the one from 30,000 elements on has not.", ""]
    lines += picture("cost", "step time and memory against elements")
    lines += table(["model", "shape", "time grows as", "from 30,000 elements on", "memory grows as", "largest body",
                    "its step [ms]", "its memory [MiB]"], [cost_row(key, exponents, sizes) for key, exponents in fits.items()])
    stopped = [row for row in sizes if row["status"] != "ran"]
    if stopped:
        lines += ["Sizes that were not timed: " + "; ".join("%s %s: `%s`: %s" % (
            row["model"], row["shape"], row["command"], row["message"]) for row in stopped), ""]
    return lines


def cost_row(key, exponents, sizes):
    done = [row for row in sizes if (row["model"], row["shape"]) == key and row["status"] == "ran"]
    last = done[-1] if done else {}
    return [*key, number(exponents[0], "n^%.2f"), number(exponents[2], "n^%.2f"), number(exponents[1], "n^%.2f"),
            last.get("elements", "-"), number(last.get("step_ms")), number(last.get("memory_mib"), "%.0f")]


def left_out_part(rows):
    lines = ["## What is left out", "",
             "Every entry of `leave_out` forced on (left out) and off (done) on two scenes: a wire drawn through a "
             "bent tube, and a catheter let go. The difference is the largest distance between nodes at the end "
             "over the body's size.", ""]
    lines += table(["entry", "scene", "model", "difference", "the report says", "time left out", "time done",
                    "saved"],
                   [[row["what"], row["scene"], row["model"],
                     number(row.get("difference"), "%.1e") if row.get("difference") is not None
                     else row.get("message") or "%s / %s" % (row["status_on"], row["status_off"]),
                     number(row.get("reported_error"), "%.1e"),
                     duration(row["time_on_s"]), duration(row["time_off_s"]),
                     percent(row["time_saved_s"] / row["time_off_s"]) if row.get("time_saved_s") is not None
                     else "-"] for row in rows])
    return lines + ["[CSV](left_out.csv), [JSON](left_out.json)", ""]


def skin_part(study, found):
    largest = max((row for row in found["speed"] if (row["kind"], row["per_vertex"]) == ("blend", "4")
                   and int(row["vertices"]) >= 90000), key=lambda row: (row["threads"], -int(row["vertices"])))
    lines = ["## Skins and molecules", "",
             "%s vertices on 4 anchors each, with vertex normals: %s ms at best, %s ms in the median, %s threads."
             % (largest["vertices"], largest["best_ms"], largest["update_ms"], largest["threads"]), ""]
    lines += picture("skin_speed", "time of an update against vertices")
    lines += ["The largest angle between neighbouring faces of a bent capsule against anchors a vertex, dotted the "
              "body bent exactly:", ""]
    lines += picture("smoothness", "smoothness against anchors a vertex")
    lines += ["One anchor a vertex and four, the same bent body:", "", "![figure 8](figure8.png)", "",
              "[SVG](figure8.svg), [CSV](figure8.csv), [JSON](figure8.json)", "", "Bezier skins by the paper's double sum and by one sum after the other, beside "
              "a skin on anchors of as many vertices, one thread:", ""]
    lines += picture("figure4", "frames a second against control points and intervals")
    lines += ["A clamped cube under its weight: whole steps (solve, recomputed residual, limits) of tetrahedra and of "
              "molecules with about as many nodes, the least median of three runs, %d threads:" % study.threads, ""]
    lines += table(["model", "integrator", "nodes", "step, median [ms]", "95 % [ms]", "Newton", "residual"],
                   [[row["model"], row["integrator"], row["nodes"], number(row["step_ms_median"]),
                     number(row["step_ms_p95"]) if row["status"] == "ran" else row["message"],
                     row["newton_max"], number(row["residual_max"], "%.1e")] for row in found["tissue"]])
    return lines + ["[CSV](tissue.csv), [JSON](tissue.json)", ""]


def soak_part(notes, figures):
    return ["## A node over hours", "", "Not measured here: a kept log. " + " ".join(notes), "", soak.sentence(figures) + ".",
            ""] + picture("soak", "memory, handles and step time against time")


def write(study, parts):
    lines = ["# catnav study", "",
             "%s study of %s on %s, %d threads, %s; %.0f s in all, %d runs."
             % ("Quick" if study.quick else "Full", study.version, cpu(), study.threads,
                time.strftime("%Y-%m-%d"), time.monotonic() - study.begun, study.commands), "",
             "Every row of every table carries the command that repeats it, to be given in this folder "
             "(`scenes/` holds the scenes): column `command`. All units are SI unless a head says otherwise. "
             "The whole is made anew by `catnav study DIR%s`; times are this machine's, so compare ratios."
             % (" --quick" if study.quick else ""), ""]
    lines += summary(study, parts)
    if "accuracy" in parts:
        lines += accuracy_part(study, parts["accuracy"])
    if parts.get("theory"):
        lines += theory_part(parts["theory"])
    if "contact" in parts:
        lines += contact_part(study, *parts["contact"])
    if "stability" in parts:
        lines += stability_part(study, parts["stability"])
    if "speed" in parts:
        lines += speed_part(study, *parts["speed"])
    if parts.get("detection"):
        lines += detection_part(parts["detection"])
    if "left_out" in parts:
        lines += left_out_part(parts["left_out"])
    if "skin" in parts:
        lines += skin_part(study, parts["skin"])
    if "soak" in parts:
        lines += soak_part(*parts["soak"])
    lines += ["Time taken: " + ", ".join("%s %.0f s" % item for item in study.took.items()) + ".", ""]
    if study.notes:
        lines += ["## Not run", ""] + ["- " + note for note in study.notes] + [""]
    with open(os.path.join(study.folder, "index.md"), "w") as file:
        file.write("\n".join(lines))
