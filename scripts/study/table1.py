#!/usr/bin/python3
"""catnav study table1: Table 1 of the first paper (Moss, Lin, Manocha 2008), our columns beside each of its own:
every scene runs whole by its own method, then by the paper's on the same mesh, path and threads."""
import argparse
import os
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
    for title, paper, found, note in rows:
        print("%-24s %-*s" % (title, width, "paper, 2008") +
              "".join("%18s" % (form % value) for (_, form), value in zip(COLUMNS, paper)), file=out)
        for name, row in found:
            line = "".join("%18s" % (form % value) for (_, form), value in zip(COLUMNS, row["figures"])) if row else \
                "  no step was made"
            print("%-24s %-*s" % ("", width, name) + line, file=out)
        for name, row in found:
            if row:
                print("%-24s %s: %d steps, %.3g s simulated, %s; a step with contact and checks %.1f ms (95 %%: %.1f); "
                      "residual up to %.1e, %d crossings, %d points outside" % (
                          "", name, row["steps"], row["simulated"], row["status"], row["step_ms"], row["step_ms_p95"],
                          row["residual"], row["crossings"], row["outside"]), file=out)
                if row["status"] != "reached":
                    print("%-24s %s" % ("", row["message"]), file=out)
        print("%-24s %s\n" % ("", note), file=out)
    print(DIFFERENT, file=out)


def words():
    parser = argparse.ArgumentParser(prog="catnav study table1", description=__doc__)
    parser.add_argument("--out", default="build/study")
    parser.add_argument("--scenes", default=",".join(name for name, _, _ in SCENES), help="of these alone")
    parser.add_argument("--seconds", type=float, default=900, help="that one run may take")
    parser.add_argument("--steps", type=int, default=0, help="no more than these of every run")
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
            rows.append((title, paper, [], "not yet a scene of this version: left out"))
            continue
        with open(file) as text:
            scene = yaml.safe_load(text)
        short = {"time_limit": given.steps * float(scene.get("step", 0.01))} if given.steps else {}
        found = []
        for method, settings in METHODS:
            model = OF_TETRAHEDRA.get(name, {}) if settings else {}
            outcome = study.run(file, {**settings, **model, **short}, limit=given.seconds)
            row = measured(outcome)
            if row is None:
                study.note("%s, %s: %s" % (title, method, outcome.message))
            found.append((method, row))
            table.append({"scene": name, "method": method, "command": outcome.command, **(row or {}),
                          **dict(zip((column for column, _ in COLUMNS), row["figures"] if row else ()))})
            study.say("table1: %s, %s: %s" % (title, method, outcome.status))
        rows.append((title, paper, found, chosen(scene)))
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
