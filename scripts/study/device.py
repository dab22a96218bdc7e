#!/usr/bin/python3
"""catnav study device SCENE.yaml: which devices pass. The scene runs with thicker and stiffer devices than its own (or
thinner and softer ones, where its own does not arrive) until the largest diameter and the largest Young's modulus that
reach the target within the limits are bracketed, each run with its verdict: what stops the next one."""
import argparse
import math
import os
import sys

sys.dont_write_bytecode = True
sys.path.insert(0, os.path.dirname(os.path.abspath(__file__)))
import matplotlib

import plots
import tools
import yaml

ROOT = os.path.dirname(os.path.dirname(os.path.dirname(os.path.abspath(__file__))))
STEPS = 8  # at most so many times the first ratio away from the scene's own device
COLUMNS = ("search", "diameter", "young", "bending", "passes", "status", "code", "message", "quantity", "value", "limit",
           "x", "y", "z", "steps", "replans", "gap_min", "force_max", "simulated_s", "wall_s", "command")


class Device:
    """The scene's first body and what is set for another diameter or modulus."""

    def __init__(self, scene):
        body = scene["bodies"][0]
        shape = (body.get("shape") or {}).get("catheter")
        if not shape:
            sys.exit("catnav study device: the scene's first body is no catheter: it has no diameter to choose")
        self.diameter, self.bore = float(shape["diameter"]), float(shape.get("inner_diameter", 0))
        self.young, core = float(body["material"]["young"]), shape.get("core")
        self.core = float(core["young"]) * float(core["diameter"])**4 if core else 0.0

    def settings(self, diameter, young):
        """The bore keeps its share of the diameter; a core stays as it is."""
        found = {"bodies.0.shape.catheter.diameter": diameter, "bodies.0.material.young": young}
        if self.bore:
            found["bodies.0.shape.catheter.inner_diameter"] = self.bore * diameter / self.diameter
        return found

    def bending(self, diameter, young):
        """Bending stiffness of the true section [N m^2]; the core's is added."""
        bore = self.bore * diameter / self.diameter
        return math.pi / 64 * (young * (diameter**4 - bore**4) + self.core)


class Search:
    """Runs of one scene, each kept; pass or not."""

    def __init__(self, study, file, device, seconds):
        self.study, self.file, self.device, self.seconds, self.rows = study, file, device, seconds, []

    def measure(self, task):
        name, diameter, young = task
        known = next((row for row in self.rows if (row["diameter"], row["young"]) == (diameter, young)), None)
        if known:
            return known
        outcome = self.study.run(self.file, self.device.settings(diameter, young), threads=1, limit=self.seconds)
        place = outcome.figure("verdict", "position") or [None] * 3
        row = {"search": name, "diameter": diameter, "young": young, "bending": self.device.bending(diameter, young),
               "passes": outcome.status == "reached", "status": outcome.status,
               "code": outcome.figure("verdict", "code"), "message": outcome.message,
               "quantity": outcome.figure("verdict", "quantity"), "value": outcome.figure("verdict", "value"),
               "limit": outcome.figure("verdict", "limit"), "x": place[0], "y": place[1], "z": place[2],
               "steps": outcome.figure("steps"), "replans": outcome.figure("replans"),
               "gap_min": outcome.figure("contact", "gap_min"), "force_max": outcome.figure("contact", "force_max"),
               "simulated_s": outcome.figure("time", "simulated_s"), "wall_s": outcome.wall, "command": outcome.command}
        self.study.say("diameter %.4g mm, E %.4g Pa: %s" % (1e3 * diameter, young, "passes" if row["passes"] else
                                                            outcome.message))
        return row

    def all(self, tasks):
        found = self.study.pool(self.measure, tasks, workers=self.study.threads)
        self.rows += [row for row in found if row not in self.rows]
        self.study.table("device", self.rows, COLUMNS)
        return found

    def bracket(self, name, at, start, ratio, closeness):
        """(largest that passes, smallest that does not) of a quantity; at(value) = (diameter, young). Steps of
        `ratio` away from start, several at a time on as many cores, then the gap between is cut in as many parts
        until it is closer than `closeness`."""
        def run(values):
            return [row["passes"] for row in self.all([(name,) + at(value) for value in values])]
        up, cores = run([start])[0], self.study.threads
        good, bad = (start, None) if up else (None, start)
        for first in range(1, STEPS + 1, cores):
            values = [start * ratio**(k if up else -k) for k in range(first, min(first + cores, STEPS + 1))]
            for value, passes in zip(values, run(values)):
                if passes and bad is None or passes and not up and good is None:
                    good = value
                elif not passes and (bad is None or not up and good is None):
                    bad = value
            if good is not None and bad is not None:
                break
        while good is not None and bad is not None and bad / good > 1 + closeness:
            values = [good * (bad / good)**(k / (cores + 1)) for k in range(1, cores + 1)]
            for value, passes in zip(values, run(values)):
                if not passes:
                    bad = value
                    break
                good = value
        return good, bad


def draw(study, search, found):
    """Every run in the plane of diameter and modulus."""
    figure, axes = plots.plt.subplots(figsize=(5.4, 4.0))
    for passes, colour, marker, label in ((True, "#009e73", "o", "arrives"), (False, "#d55e00", "x", "does not")):
        some = [row for row in search.rows if row["passes"] == passes]
        axes.plot([1e3 * row["diameter"] for row in some], [row["young"] for row in some], linestyle="none", color=colour,
                  marker=marker, label=label)
    for name, (good, bad, stopped) in found.items():
        if stopped:
            axes.annotate(" %s" % (stopped["quantity"] or stopped["code"] or stopped["status"]),
                          (1e3 * stopped["diameter"], stopped["young"]), fontsize=8, color="#d55e00")
    axes.set(xscale="log", yscale="log", xlabel="diameter [mm]", ylabel="Young's modulus [Pa]",
             title="Devices that pass: %s" % os.path.basename(search.file))
    axes.xaxis.set_minor_formatter(matplotlib.ticker.FormatStrFormatter("%g"))
    axes.xaxis.set_major_formatter(matplotlib.ticker.FormatStrFormatter("%g"))
    axes.tick_params(axis="x", which="both", labelsize=7)
    axes.legend()
    plots.save(figure, study, "device")


def words():
    parser = argparse.ArgumentParser(prog="catnav study device", description=__doc__)
    parser.add_argument("scene", metavar="SCENE.yaml")
    parser.add_argument("--out", default="build/study")
    parser.add_argument("--closeness", type=float, default=0.05, help="of the bracket, relative")
    parser.add_argument("--seconds", type=float, default=900, help="that one run may take")
    parser.add_argument("--threads", type=int, default=os.cpu_count() or 2, help="runs at a time")
    parser.add_argument("--catnav", default="catnav", help=argparse.SUPPRESS)
    parser.error = lambda said: sys.exit("catnav study device: %s" % said)
    given = parser.parse_args()
    if not 0 < given.closeness < 10 or not 0 < given.threads <= 64 or not given.seconds > 0:
        sys.exit("catnav study device: --closeness from above 0 to 10, --threads from 1 to 64, --seconds above 0")
    return given


def main():
    given = words()
    file = os.path.abspath(given.scene)
    try:
        with open(file) as text:
            device = Device(yaml.safe_load(text))
        study = tools.Study(given.out, os.path.abspath(given.catnav), False, given.threads, ROOT)
    except (OSError, yaml.YAMLError, KeyError, TypeError, ValueError) as error:
        print("catnav study device: %s: %s" % (given.scene, error), file=sys.stderr)
        return 1
    search = Search(study, file, device, given.seconds)
    if search.all([("own", device.diameter, device.young)])[0]["status"] == "refused":
        print(search.rows[0]["message"], file=sys.stderr)
        return 1
    found, lines = {}, []
    for name, unit, scale, at, start, ratio in (
            ("diameter", "mm", 1e3, lambda d: (d, device.young), device.diameter, 2**0.5),
            ("young", "Pa", 1, lambda e: (device.diameter, e), device.young, 4.0)):
        good, bad = search.bracket(name, at, start, ratio, given.closeness)
        stopped = next((row for row in search.rows if bad is not None and (row["diameter"], row["young"]) == at(bad)), None)
        found[name] = (good, bad, stopped)
        what = "diameter" if name == "diameter" else "Young's modulus"
        lines.append("largest %s that passes: %s" % (what, "none down to %.4g %s" % (scale * bad, unit) if good is None else
                                                     "%.4g %s%s" % (scale * good, unit, "" if bad else " at least")))
        if good is not None:
            lines.append("  bending stiffness %.3g N m^2" % device.bending(*at(good)))
        if stopped:
            lines.append("  %.4g %s does not: %s: %s" % (scale * bad, unit, stopped["code"] or stopped["status"],
                                                         stopped["message"]))
    draw(study, search, found)
    print("%s: own device %.4g mm, %.4g Pa: %s; %d runs" % (
        os.path.basename(file), 1e3 * device.diameter, device.young,
        "passes" if search.rows[0]["passes"] else search.rows[0]["message"], len(search.rows)))
    print("\n".join(lines))
    print("%s/device.csv, device.json, device.svg, device.png" % given.out)
    return 0


if __name__ == "__main__":
    try:
        sys.exit(main())
    except KeyboardInterrupt:
        sys.exit(130)
