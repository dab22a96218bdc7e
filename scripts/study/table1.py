#!/usr/bin/python3
"""catnav study table1: Table 1 of the first paper (Moss, Lin, Manocha 2008), our columns beside each of its own. Every
scene runs whole by its own method; the paper's goes on from three states of that run (at 25, 50 and 90 % of its steps),
on the same mesh, path and threads, and its whole run is reckoned from the steps it took there: marked by ~. --whole
runs it from the start to its end instead."""
import argparse
import json
import os
import subprocess
import sys

sys.dont_write_bytecode = True
sys.path.insert(0, os.path.dirname(os.path.abspath(__file__)))
import yaml

import tools

ROOT = os.path.dirname(os.path.dirname(os.path.dirname(os.path.abspath(__file__))))
COLUMNS = (("rigid nodes", "%d"), ("deformable nodes", "%d"), ("planning [s]", "%.2f"), ("simulation [s]", "%.1f"),
           ("collision [s]", "%.2f"), ("ms a step", "%.1f"))
# Scene of launch/scenes, title, and the paper's row: its Total; planning "< 0.1" is written as 0.1.
SCENES = (("bear", "1 bear through a tube", (1053, 5252, 0.1, 358.8, 3.12, 239)),
          ("snake", "2 snake among rocks", (5302, 6832, 207.1, 1830.9, 43.4, 304)),
          ("fish", "3 four fish", (4477, 19272, 274.8, 2665.7, 77.6, 950)),
          ("artery", "4 catheter in arteries", (0, 11563, 0.1, 879.5, 44.4, 142)))
METHODS = (("ours", {}), ("paper's method", tools.PAPER))
BARS = {"bear": 1, "snake": 5, "fish": 5, "artery": 1}  # planning at most [s]
OF_TETRAHEDRA = {"artery": {"bodies.0.model": "tet4"}}  # the paper's method knows no rod
DIFFERENT = ("The paper states no time step, density, damping, tolerance or scene size: those of ours stand with each "
             "scene. Its times are of a 2 GHz laptop of 2008 and of other meshes with as many nodes; its `planning` "
             "has no map of the free space, ours is counted with the planning. Ours solves every step's equation to "
             "its tolerance and lets nothing cross; the paper's method takes one linear solve by conjugate gradients "
             "(to 1e-4, at most 1000 iterations) and moves crossing vertices apart afterwards.")


def measured(outcome):
    """Our row: the table's columns, then what came of the run."""
    figure = outcome.figure
    if outcome.report is None or not figure("steps"):
        return None
    return {"figures": (figure("counts", "rigid_nodes"), figure("counts", "deformable_nodes"),
                        figure("time", "planning_s") + figure("time", "map_s"), figure("time", "simulation_s"),
                        figure("time", "collision_s"), 1e3 * figure("time", "simulation_s") / figure("steps")),
            "steps": figure("steps"), "status": outcome.status, "step_ms": figure("time", "step_ms", "median"),
            "step_ms_p95": figure("time", "step_ms", "p95"), "residual": figure("solver", "residual_max"),
            "crossings": figure("contact", "intersections"), "outside": figure("contact", "outside_nodes"),
            "simulated": figure("time", "simulated_s"), "message": outcome.message}


def reckoned(study, file, name, ours, given):
    """The paper's row from its steps at three states of our run: medians, times the steps of ours."""
    folder = study.path("table1_" + name)
    words = [study.catnav, "study", "paper", file, "--out", folder, "--quiet", "--threads", str(given.threads),
             "--steps", str(given.states), "--total", str(ours["steps"])]
    if given.steps:
        words += ["--set", "time_limit=%.17g" % ours["simulated"]]
    try:
        done = subprocess.run(words, stdin=subprocess.DEVNULL, capture_output=True, text=True, timeout=2 * given.seconds)
    except subprocess.TimeoutExpired:
        return None, "its states were not reached in %g s" % (2 * given.seconds)
    if done.returncode:
        return None, (done.stderr.strip().split("\n") or [""])[-1]
    with open(os.path.join(folder, "paper.json")) as text:
        states = json.load(text)["states"]
    rows = [{row["method"]: row for row in state["methods"]} for state in states]
    mean = lambda method, *keys: sum(value(row[method], *keys) for row in rows) / len(rows)
    fem, collision = mean("paper", "fem_ms", "median"), mean("paper", "collision_ms", "median")
    ratio = mean("paper", "step_ms", "median") / mean("own", "step_ms", "median")
    return {"figures": ours["figures"][:3] + (1e-3 * fem * ours["steps"], 1e-3 * collision * ours["steps"], fem),
            "steps": sum(row["paper"]["steps"] for row in rows), "status": "reckoned",
            "step_ms": mean("paper", "step_ms", "median"), "step_ms_p95": mean("paper", "step_ms", "p95"),
            "residual": max(row["paper"]["residual"]["max"] for row in rows),
            "crossings": sum(row["paper"]["intersections"] for row in rows),
            "outside": sum(row["paper"]["outside_nodes"] for row in rows), "simulated": None, "ratio": ratio,
            "message": "%d steps from each of %d states of our run; a step takes %.2f times as long as ours" % (
                given.states, len(rows), ratio)}, "catnav " + " ".join(words[1:])


def value(row, *keys):
    for key in keys:
        row = row[key]
    return row if row is not None else 0


def chosen(scene):
    """What the paper leaves open, as the scene has it."""
    material = scene["bodies"][0]["material"]
    return "step %g s, density %g kg/m3, damping %g 1/s and %g s" % (
        float(scene.get("step", 0.01)), float(material["density"]), float(material.get("damping", 0)),
        float(material.get("damping_stiffness", 0)))


def show(rows, out):
    width = max(len(name) for name, _ in METHODS) + 2
    head = "%-24s %-*s" % ("", width, "") + "".join("%18s" % name for name, _ in COLUMNS)
    print(head, file=out)
    for title, paper, found, note, bar in rows:
        print("%-24s %-*s" % (title, width, "paper, 2008") +
              "".join("%18s" % (form % value) for (_, form), value in zip(COLUMNS, paper)), file=out)
        for name, row in found:
            line = "".join("%18s" % (("~" if row["status"] == "reckoned" and i > 2 else "") + form % value)
                           for i, ((_, form), value) in enumerate(zip(COLUMNS, row["figures"]))) if row else \
                "  no step was made"
            print("%-24s %-*s" % ("", width, name) + line, file=out)
        for name, row in found:
            if row:
                print("%-24s %s: %d steps, %s simulated, %s; a step with contact and checks %.1f ms (95 %%: %.1f); "
                      "residual up to %.1e, %d crossings, %d points outside" % (
                          "", name, row["steps"], "-" if row["simulated"] is None else "%.3g s" % row["simulated"], row["status"], row["step_ms"], row["step_ms_p95"],
                          row["residual"], row["crossings"], row["outside"]), file=out)
                if row["status"] != "reached":
                    print("%-24s %s" % ("", row["message"]), file=out)
        if found and found[0][1]:
            took = found[0][1]["figures"][2]
            print("%-24s planning with the map %.2f s, at most %g s wanted: %s" % (
                "", took, bar, "kept" if took <= bar else "missed"), file=out)
        print("%-24s %s\n" % ("", note), file=out)
    print(DIFFERENT, file=out)


def words():
    parser = argparse.ArgumentParser(prog="catnav study table1", description=__doc__)
    parser.add_argument("--out", default="build/study")
    parser.add_argument("--scenes", default=",".join(name for name, _, _ in SCENES), help="of these alone")
    parser.add_argument("--seconds", type=float, default=900, help="that one run may take")
    parser.add_argument("--steps", type=int, default=0, help="no more than these of every run")
    parser.add_argument("--states", type=int, default=50, help="steps of the paper's method from each state")
    parser.add_argument("--whole", action="store_true", help="the paper's method, too, from start to end")
    parser.add_argument("--threads", type=int, default=os.cpu_count() or 2)
    parser.add_argument("--catnav", default="catnav", help=argparse.SUPPRESS)
    parser.error = lambda said: sys.exit("catnav study table1: %s" % said)
    given = parser.parse_args()
    unknown = set(given.scenes.split(",")) - {name for name, _, _ in SCENES}
    if unknown:
        sys.exit("catnav study table1: no scene of the table is named %s" % ", ".join(sorted(unknown)))
    return given


def main():
    given = words()
    try:
        study = tools.Study(given.out, os.path.abspath(given.catnav), False, given.threads, ROOT)
    except OSError as error:
        print("catnav study: %s" % error, file=sys.stderr)
        return 1
    rows, table = [], []
    for name, title, paper in SCENES:
        file = os.path.join(ROOT, "launch", "scenes", name + ".yaml")
        if name not in given.scenes.split(","):
            continue
        if not os.path.exists(file):
            rows.append((title, paper, [], "not yet a scene of this version: left out", BARS[name]))
            continue
        with open(file) as text:
            scene = yaml.safe_load(text)
        short = {"time_limit": given.steps * float(scene.get("step", 0.01))} if given.steps else {}
        found = []
        for method, settings in METHODS:
            model = OF_TETRAHEDRA.get(name, {}) if settings else {}
            if settings and not given.whole and found[0][1]:
                row, said = reckoned(study, file, name, found[0][1], given)
                status, command = ("reckoned", said) if row else (said, "")
            else:
                outcome = study.run(file, {**settings, **model, **short}, limit=given.seconds)
                row, said, status, command = measured(outcome), outcome.message, outcome.status, outcome.command
            if row is None:
                study.note("%s, %s: %s" % (title, method, said))
            found.append((method, row))
            table.append({"scene": name, "method": method, "command": command, **(row or {}),
                          **dict(zip((column for column, _ in COLUMNS), row["figures"] if row else ()))})
            study.say("table1: %s, %s: %s" % (title, method, status))
        rows.append((title, paper, found, chosen(scene), BARS[name]))
    for row in table:
        row.pop("figures", None)
    study.table("table1", table)
    show(rows, sys.stdout)
    for note in study.notes:
        print(note)
    return 0


if __name__ == "__main__":
    try:
        sys.exit(main())
    except KeyboardInterrupt:
        sys.exit(130)
