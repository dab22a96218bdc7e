#!/usr/bin/python3
"""catnav study soak LOG.csv [--out DIR]: what a soak of the node shows (scripts/ros/hammer.py soak writes LOG.csv):
memory, handles and time of a step against time, DIR/soak.svg and .png, DIR/soak.csv, and one line of figures."""
import argparse
import csv
import os
import shutil
import sys
from statistics import median

COLUMNS = "time_s", "memory_bytes", "handles", "cpu_ms_a_step", "cpu_ms_a_step_newborn", "wall_ms_a_step", "crossings"
KEPT = os.path.join(os.path.dirname(os.path.abspath(__file__)), "soak.csv")


def read(path):
    """Notes (lines that begin with #) and rows of a log."""
    with open(path) as file:
        lines = file.read().splitlines()
    notes = [line[1:].strip() for line in lines if line.startswith("#")]
    found = csv.reader(line for line in lines if line and not line.startswith("#"))
    head = next(found, None)
    if head is None or tuple(head) != COLUMNS:
        raise ValueError("%s: the head is %s, not %s" % (path, head, ",".join(COLUMNS)))
    rows = []
    for row in found:
        if len(row) != len(COLUMNS):
            raise ValueError("%s: %d values in row %d: %d are needed" % (path, len(row), len(rows) + 1, len(COLUMNS)))
        rows.append(tuple(float(value) for value in row))
    if len(rows) < 3:
        raise ValueError("%s: %d rows, at least 3 are needed" % (path, len(rows)))
    return notes, rows


def figures(rows):
    """Growth of memory and handles after the first ten minutes (of a short log: its first third), by medians of its
    first and last tenth; what a step takes in the last third against the first, in percent: processor time in the node,
    in newborn processes, their difference (the node's own drift) and by the wall clock."""
    settled = [r for r in rows if r[0] > min(600, rows[-1][0] / 3)]
    third, tenth = len(rows) // 3, len(settled) // 10 + 1
    growth, handles = (median(r[i] for r in settled[-tenth:]) - median(r[i] for r in settled[:tenth]) for i in (1, 2))
    # of each third the tenth percentile: what a step takes where nobody else disturbs it
    least = [[sorted(r[i] for r in part)[len(part) // 10] for part in (rows[:third], rows[-third:])] for i in (3, 4, 5)]
    own, newborn, wall = (100 * (last / first - 1) for first, last in least)
    return {"seconds": rows[-1][0], "repeats": len(rows), "memory_growth_bytes": growth,
            "memory_most_bytes": max(r[1] for r in settled) - settled[0][1], "handles_growth": handles,
            "step_cpu_percent": own, "step_cpu_newborn_percent": newborn, "step_drift_percent": own - newborn,
            "step_wall_percent": wall, "crossings": sum(r[6] for r in rows)}


def sentence(f):
    return ("soak, %.0f s: %d times the same plan; after 10 minutes memory %+.2f MiB (at most %+.2f), handles %+.0f; processor "
            "time of a step, last third to first: %+.1f %% (%+.1f %% in newborn processes), drift %+.1f %%, by the wall clock "
            "%+.1f %%; crossings %.0f" % (f["seconds"], f["repeats"], f["memory_growth_bytes"] / 2**20,
                                          f["memory_most_bytes"] / 2**20, f["handles_growth"], f["step_cpu_percent"],
                                          f["step_cpu_newborn_percent"], f["step_drift_percent"], f["step_wall_percent"],
                                          f["crossings"]))


def plot(rows, folder):
    """soak.svg and soak.png: memory, handles and step time of the repeated plan."""
    os.environ.setdefault("MPLCONFIGDIR", "/tmp")
    import matplotlib
    matplotlib.use("Agg")
    from matplotlib import pyplot
    figure, axes = pyplot.subplots(3, 1, sharex=True, figsize=(8, 6))
    minutes = [r[0] / 60 for r in rows]
    for axis, name, values in ((axes[0], "memory [MiB]", [r[1] / 2**20 for r in rows]),
                               (axes[1], "handles", [r[2] for r in rows]),
                               (axes[2], "step, newborn\nprocess = 1", [r[3] / r[4] for r in rows])):
        axis.plot(minutes, values, ".", markersize=2, color="#0072b2")
        axis.set_ylabel(name)
        axis.set_ylim(0, 1.15 * max(values))
    axes[-1].set_xlabel("time [min]")
    for ending in "svg", "png":
        figure.savefig(os.path.join(folder, "soak." + ending), **({"metadata": {"Date": None}} if ending == "svg" else {}))
    pyplot.close(figure)


def run(study):
    """The kept log, into the study's folder."""
    notes, rows = read(KEPT)
    plot(rows, study.folder)
    study.table("soak", [dict(zip(COLUMNS, row)) for row in rows])
    study.say(sentence(figures(rows)))
    return notes, figures(rows)


def main():
    parser = argparse.ArgumentParser(prog="catnav study soak", description=__doc__)
    parser.add_argument("log", metavar="LOG.csv")
    parser.add_argument("--out", default="build/study")
    parser.add_argument("--catnav", help=argparse.SUPPRESS)
    given = parser.parse_args()
    try:
        _, rows = read(given.log)
        os.makedirs(given.out, exist_ok=True)
        copy = os.path.join(given.out, "soak.csv")
        if not (os.path.exists(copy) and os.path.samefile(copy, given.log)):
            shutil.copyfile(given.log, copy)
        plot(rows, given.out)
    except (OSError, ValueError) as error:
        print("catnav study: %s" % error, file=sys.stderr)
        return 1
    print(sentence(figures(rows)))
    return 0


if __name__ == "__main__":
    sys.exit(main())
