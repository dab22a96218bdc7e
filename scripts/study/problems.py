"""Problems with a known answer: a scene, meshes of growing fineness for each model, and the error of a run.

Answers come from the reference folder's files, or from a converged run that the row names. A static problem has
density 0: each step is then a static equilibrium under a load that grows in RAMP steps."""
import csv
import json
import math
import os

import numpy

RAMP = 10          # steps in which a static load grows
GRAVITY = 9.81     # [m/s^2]
HELD = [[-1e-9, -1.0, -1.0], [1e-9, 1.0, 1.0]]  # nodes at x = 0


class Problem:
    """settings(model): [(name of the resolution, --set entries)], coarse to fine; error(outcome, model): number,
    1 = all of the answer; steps [s] for dynamic problems."""
    steps = (None,)
    limit = 30       # of a run [s]
    points = False   # whether `error` needs the last frame
    finished = ("ran",)  # status of a run that got to its end
    fair = 5         # time of a run [s] that is a fair sample by itself
    tissue = False   # whether molecules may try
    solvers = ("cholesky", "cg", "pcg")  # to be shown besides the default

    def __init__(self, name, title, answer, scene):
        self.name, self.title, self.answer, self.scene = name, title, answer, scene

    def steps_of(self, model):
        return self.steps

    def converge(self, study):
        """Makes the answer where it is a run's; False: there is none."""
        return True


def cases(study, name):
    with open(os.path.join(study.reference, "data", name + ".json")) as file:
        return json.load(file)


def table(study, name):
    """Rows of a reference table as lists of numbers."""
    with open(os.path.join(study.reference, "data", name + ".csv")) as file:
        return [[float(cell) for cell in row] for row in list(csv.reader(file))[1:] if row]


def static(scene_name, body, loads, **more):
    """A scene of one body held at x = 0; loads [(box, force[, moment])] grow over RAMP steps."""
    ramp = [{"box": box, **{name: [f / RAMP for f in value] for name, value in zip(("force", "moment"), values)},
             "from": 0.01 * i} for i in range(RAMP) for box, *values in loads]
    body = {**body, "fixed": {"box": HELD}}
    if ramp:
        body["load"] = ramp
    return {"scene": scene_name, "step": 0.01, "time_limit": 0.01 * (RAMP + 1), "contact": {"method": "none"},
            "solver": {"tolerance": 1e-6}, **more, "bodies": [body]}


def square_cells(size, slenderness, counts, slender_cells):
    """Resolutions of a square beam: `slender_cells` cells of the depth's division along each depth."""
    return [("%d over depth" % n, {"bodies.0.shape.beam.cells": [int(slenderness * n * slender_cells), n, n]})
            for n in counts]


def segments(counts):
    return [("%d segments" % n, {"bodies.0.shape.beam.cells": [n, 1, 1]}) for n in counts]


def packings(depth, counts):
    """Molecules on a lattice with so many cells over the depth; the layer next to x = 0 is held."""
    return [("%d lattice cells over depth" % n, {
        "bodies.0.molecules.radius": float("%.9g" % (depth * 3**0.5 / (4 * n))),
        "bodies.0.fixed.box": [HELD[0], [0.3 * depth / n, 1.0, 1.0]]}) for n in counts]


class Cantilever(Problem):
    """Small tip load on a square beam, ten depths long."""
    tissue = True

    def __init__(self, study):
        data = cases(study, "cantilever")["cases"]
        case = next(c for c in data if c["section"] == "square" and c["line_load"] == 0)
        length, depth = case["length"], case["size"]
        limits = cases(study, "p1_convergence")["solid_limits"]
        solid = [s["solid_limit_over_timoshenko"] for s in limits
                 if s["nu"] == case["nu"] and math.isclose(s["length"] / s["depth"], length / depth)]
        self.case, self.solid = case, solid[0] if solid else 1.0
        end = [[length * (1 - 1e-6), -1.0, -1.0], [length * (1 + 1e-6), 1.0, 1.0]]
        super().__init__(
            "cantilever", "Cantilever, small tip load, L/d = %g, nu = %g" % (length / depth, case["nu"]),
            "cantilever.json: Timoshenko's deflection" +
            ("; tetrahedra: times the clamped solid's %.4f (p1_convergence.json)" % self.solid if solid else ""),
            static("cantilever", {"name": "beam", "shape": {"beam": {"size": [length, depth, depth],
                                                                     "cells": [10, 1, 1]}}, "model": "tet4",
                                  "material": {"young": case["E"], "poisson": case["nu"], "density": 0}},
                   [(end, [0, 0, -case["tip_force"]])]))

    def settings(self, model, quick):
        ratio = self.case["length"] / self.case["size"]
        if model == "rod":
            return segments((2, 4, 8, 16) if quick else (2, 4, 8, 16, 32, 64))
        if model == "molecules":
            return packings(self.case["size"], (2, 3) if quick else (2, 3, 4, 6, 8))
        counts = {"tet4": (1, 2, 3, 4) if quick else (1, 2, 4, 8), "tet10": (1, 2) if quick else (1, 2, 3, 4)}
        return square_cells(self.case["size"], ratio, counts[model], 1)

    def error(self, outcome, model):
        truth = self.case["tip_timoshenko"] * (1 if model == "rod" else self.solid)
        return abs((0.5 * self.case["size"] - outcome.figure("bodies", 0, "tip", 2)) / truth - 1)


class Elastica(Problem):
    """Dead tip load that bends a square beam of 100 depths through more than a right angle's two thirds."""
    LENGTH, DEPTH, YOUNG, tissue = 1.0, 0.01, 1e7, True
    solvers = ("cholesky",)  # CG needs minutes on bodies so slender: the paper's method shows it

    def __init__(self, study):
        rows = table(study, "elastica_tip_load")
        row = min(rows, key=lambda r: abs(r[0] - 5))
        self.x, self.z = row[1] * self.LENGTH, -row[2] * self.LENGTH
        force = row[0] * self.YOUNG * self.DEPTH**4 / 12 / self.LENGTH**2
        end = [[self.LENGTH * (1 - 1e-6), -1.0, -1.0], [self.LENGTH * (1 + 1e-6), 1.0, 1.0]]
        super().__init__(
            "elastica", "Large bending under a tip load, P L^2 / EI = %g, L/d = 100" % row[0],
            "elastica_tip_load.csv: the tip of an inextensible rod",
            static("elastica", {"name": "beam", "shape": {"beam": {
                "size": [self.LENGTH, self.DEPTH, self.DEPTH], "cells": [50, 1, 1]}}, "model": "tet4",
                "material": {"young": self.YOUNG, "poisson": 0.3, "density": 0}}, [(end, [0, 0, -force])]))

    def settings(self, model, quick):
        if model == "rod":
            return segments((5, 10, 20, 40) if quick else (5, 10, 20, 40, 80, 160))
        if model == "molecules":
            return packings(self.DEPTH, (2,) if quick else (2, 3, 4))
        if model == "tet10":  # by their length: one over the depth is enough
            return [("%d x 1 x 1 cells" % n, {"bodies.0.shape.beam.cells": [n, 1, 1]})
                    for n in ((12, 25) if quick else (12, 25, 50, 100))]
        return [("%d over depth" % n, {"bodies.0.shape.beam.cells": [50 * n, n, n]})
                for n in ((1, 2, 3) if quick else (1, 2, 3, 4))]

    def error(self, outcome, model):
        tip = outcome.figure("bodies", 0, "tip")
        return math.hypot(tip[0] - self.x, tip[2] - 0.5 * self.DEPTH - self.z) / self.LENGTH


def catheter(length, stations, young=8.7e6, poisson=0.33, density=1100, **more):
    """The catheter of the seed, 4 French, lying along +x from its start at x = 0 to its tip."""
    return {"name": "catheter", "shape": {"catheter": {
        "length": length, "diameter": 1.35e-3, "entry": [0, 0, 0], "direction": [1, 0, 0], "inserted": length,
        "stations": stations, "sides": 6, "sheath": "off"}}, "model": "tet4",
        "material": {"young": young, "poisson": poisson, "density": density}, **more}


def stations(counts, sides=6):
    return [("%d stations" % n, {"bodies.0.shape.catheter.stations": n}) if sides == 6 else
            ("%d stations of %d" % (n, sides), {"bodies.0.shape.catheter.stations": n,
                                                "bodies.0.shape.catheter.sides": sides}) for n in counts]


class OwnWeight(Problem):
    """A catheter let go to its rest under its own weight, damped; its length follows from the table's load."""
    solvers = ("cholesky",)

    def __init__(self, study):
        rows = table(study, "elastica_own_weight")
        row = min(rows, key=lambda r: abs(r[0] - 10))
        diameter, young, density = 1.35e-3, 8.7e6, 1100
        line, bending = density * GRAVITY * math.pi * diameter**2 / 4, young * math.pi * diameter**4 / 64
        self.length = (row[0] * bending / line) ** (1 / 3)
        self.x, self.z = row[1] * self.length, -row[2] * self.length
        super().__init__(
            "own_weight", "Catheter of %.0f mm bending under its own weight, w L^3 / EI = %g"
            % (1e3 * self.length, row[0]), "elastica_own_weight.csv: the tip of an inextensible rod",
            {"scene": "own_weight", "step": 0.05, "time_limit": 3.0, "gravity": [0, 0, -GRAVITY],
             "contact": {"method": "none"}, "solver": {"tolerance": 1e-6},
             "bodies": [catheter(self.length, 41, fixed={"box": HELD})]})
        self.scene["bodies"][0]["material"]["damping"] = 20.0  # [1/s], about critical: 3 s bring it to rest

    def settings(self, model, quick):
        if model == "rod":
            return stations((6, 11, 21, 41) if quick else (6, 11, 21, 41, 81, 161))
        if model == "tet10":
            return stations((11, 21) if quick else (11, 21, 41), 6) + ([] if quick else stations((41,), 12))
        return stations((21, 41, 81) if quick else (21, 41, 81, 161), 6) + ([] if quick else stations((321,), 12))

    def error(self, outcome, model):
        tip = outcome.figure("bodies", 0, "tip")
        return math.hypot(tip[0] - self.x, tip[2] - self.z) / self.length


class Twist(Problem):
    """A couple at the end of a square beam turns it about its axis."""
    LENGTH, DEPTH, points, tissue = 1.0, 0.1, True, True

    def __init__(self, study):
        case = next(c for c in cases(study, "cantilever")["cases"] if c["section"] == "square" and
                    c["size"] == self.DEPTH)
        self.gj, self.torque = case["GJ"], 0.05 * case["GJ"] / self.LENGTH
        low, high = self.LENGTH * (1 - 1e-6), self.LENGTH * (1 + 1e-6)
        end = [[low, -1.0, -1.0], [high, 1.0, 1.0]]
        super().__init__(
            "twist", "Twist of a square beam by a couple at its end, L/d = %g" % (self.LENGTH / self.DEPTH),
            "cantilever.json: Saint-Venant's GJ, between a quarter and three quarters of the length",
            static("twist", {"name": "beam", "shape": {"beam": {
                "size": [self.LENGTH, self.DEPTH, self.DEPTH], "cells": [8, 1, 1]}}, "model": "tet4",
                "material": {"young": case["E"], "poisson": case["nu"], "density": 0}},
                   [(end, [0, 0, 0], [self.torque, 0, 0])]))

    def settings(self, model, quick):
        if model == "rod":
            return segments((4, 8, 16) if quick else (4, 8, 16, 32, 64))
        if model == "molecules":
            return packings(self.DEPTH, (2, 3) if quick else (2, 3, 4, 6, 8))
        counts = {"tet4": (1, 2, 3, 4) if quick else (1, 2, 4, 6, 8), "tet10": (1, 2) if quick else (1, 2, 3, 4)}
        return [("%d over depth" % n, {"bodies.0.shape.beam.cells": [8 * n, n, n]}) for n in counts[model]]

    def error(self, outcome, model):
        turn = [mean_turn(outcome.rest, outcome.last, part * self.LENGTH) for part in (0.25, 0.75)]
        return abs((turn[1] - turn[0]) / (0.5 * self.LENGTH * self.torque / self.gj) - 1)


def mean_turn(rest, last, x):
    """Angle [rad] about x by which the section at x has turned, least squares over its points."""
    section = numpy.abs(rest[:, 0] - x) <= 1e-6 * numpy.ptp(rest[:, 0])
    a, b = rest[section, 1:], last[section, 1:]
    a, b = a - a.mean(0), b - b.mean(0)
    return math.atan2((a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]).sum(), (a * b).sum())


class Sway(Problem):
    """A thick bar let go as a horizontal cantilever, a tissue more than a wire; where its end is when it is low."""
    LENGTH, DEPTH, TIME, limit, solvers, tissue = 0.3, 0.06, 0.15, 60, (), True

    def __init__(self, study):
        super().__init__(
            "sway", "A bar of five depths let go: its end after %g s" % self.TIME, "",
            {"scene": "sway", "step": 0.005, "time_limit": self.TIME, "gravity": [0, 0, -GRAVITY],
             "contact": {"method": "none"},
             "bodies": [{"name": "bar", "shape": {"beam": {"size": [self.LENGTH, self.DEPTH, self.DEPTH],
                                                           "cells": [5, 1, 1]}}, "model": "tet4",
                         "material": {"young": 1e6, "poisson": 0.25, "density": 1000}, "fixed": {"box": HELD}}]})
        self.steps = (0.015, 0.005) if study.quick else (0.015, 0.005, 0.0025, 0.001)

    def settings(self, model, quick):
        if model == "molecules":
            return packings(self.DEPTH, (2, 3) if quick else (2, 3, 4, 6))
        if model == "rod":
            return segments((4, 8) if quick else (4, 8, 16, 32))
        counts = {"tet4": (1, 2) if quick else (1, 2, 4, 6), "tet10": (1,) if quick else (1, 2, 3)}
        return [("%d over depth" % n, {"bodies.0.shape.beam.cells": [5 * n, n, n]}) for n in counts[model]]

    def converge(self, study):
        """The answer: second-order tetrahedra and steps, extrapolated in the step; its uncertainty: how far the
        next coarser mesh's is from it."""
        if "tet10" not in study.models or "trbdf2" not in study.integrators:
            return False
        file, fine = study.write_scene(self.name, self.scene), 2 if study.quick else 4
        step, tips = (0.0025 if study.quick else 0.001), {}
        for cells, dt in ((fine - 1, step), (fine, step), (fine, 2 * step)):
            outcome = study.run(file, {"bodies.0.model": "tet10", "solver.integrator": "trbdf2", "step": dt,
                                       "bodies.0.shape.beam.cells": [5 * cells, cells, cells]}, limit=4 * self.limit)
            if outcome.status != "ran":
                study.note("Sway: no converged run (%s: %s)" % (outcome.command, outcome.message))
                return False
            tips[cells, dt] = numpy.array(outcome.figure("bodies", 0, "tip"))
        self.truth = tips[fine, step] + (tips[fine, step] - tips[fine, 2 * step]) / 3
        self.uncertainty = float(numpy.linalg.norm(tips[fine, step] - tips[fine - 1, step]) / self.LENGTH)
        self.answer = ("run of `tet10` with %d elements over the depth and steps of %g ms, `trbdf2`, extrapolated in "
                       "the step: its end down by %.4f m; %.1e of the length from the same on the next coarser mesh"
                       % (fine, 1e3 * step, 0.5 * self.DEPTH - self.truth[2], self.uncertainty))
        return True

    def error(self, outcome, model):
        return float(numpy.linalg.norm(numpy.array(outcome.figure("bodies", 0, "tip")) - self.truth) / self.LENGTH)


class Swing(Problem):
    """The seed's catheter let go as a horizontal cantilever; where its tip is after 1 s."""
    LENGTH, limit, solvers = 1.0, 100, ()

    def __init__(self, study):
        super().__init__(
            "swing", "Free swing of the 1 m catheter: tip after 1 s", "",
            {"scene": "swing", "step": 0.01, "time_limit": 1.0, "gravity": [0, 0, -GRAVITY],
             "contact": {"method": "none"},
             "bodies": [catheter(self.LENGTH, 455, fixed={"box": HELD})]})
        self.steps = (0.04, 0.02) if study.quick else (0.033, 0.01, 0.003, 0.001)
        self.truth = None

    def steps_of(self, model):  # small steps of second-order tetrahedra take minutes
        return self.steps if model != "tet10" else self.steps[-1:] if len(self.steps) < 3 else self.steps[:2]

    def settings(self, model, quick):
        counts = {"rod": (51, 101) if quick else (51, 101, 201, 401),
                  "tet10": (15,) if quick else (15, 29, 58, 115),
                  "tet4": (29, 58) if quick else (58, 115, 229, 455)}
        return stations(counts[model])

    def converge(self, study):
        """The answer: the best model there is, extrapolated in step (first order: twice the fine run's tip minus
        the coarse one's); how far apart two such answers are on meshes of ratio 2 is its uncertainty."""
        model = [m for m in ("rod", "tet10", "tet4") if m in study.models][0]
        second = [i for i in ("trbdf2", "midpoint") if i in study.integrators]
        fine, tips = (201, 0.004) if study.quick else (401, 0.0005), {}
        file = study.write_scene(self.name, self.scene)
        for count in (fine[0] // 2 + 1, fine[0]):
            for step in (2 * fine[1], fine[1]):
                settings = {"bodies.0.model": model, "bodies.0.shape.catheter.stations": count, "step": step,
                            "solver.tolerance": 1e-5}
                if second:
                    settings["solver.integrator"] = second[0]
                outcome = study.run(file, settings, limit=4 * self.limit)
                if outcome.status != "ran":
                    study.note("Free swing: no converged run (%s: %s)" % (outcome.command, outcome.message))
                    return False
                tips[count, step] = numpy.array(outcome.figure("bodies", 0, "tip"))
        weight = 1 / 3 if second else 1
        answers = [tips[count, fine[1]] + weight * (tips[count, fine[1]] - tips[count, 2 * fine[1]])
                   for count in (fine[0] // 2 + 1, fine[0])]
        self.truth = answers[1]
        self.uncertainty = float(numpy.linalg.norm(answers[1] - answers[0]) / self.LENGTH)
        self.answer = ("run of the `%s` with %d stations and steps of %g and %g ms, `%s`, extrapolated in the step: "
                       "tip displaced by (%.4f, %.4f) m; %.1e of the length from the same on half the stations"
                       % (model, fine[0], 2e3 * fine[1], 1e3 * fine[1], second[0] if second else "euler",
                          self.truth[0] - self.LENGTH, self.truth[2], self.uncertainty))
        return True

    def error(self, outcome, model):
        return float(numpy.linalg.norm(numpy.array(outcome.figure("bodies", 0, "tip")) - self.truth) / self.LENGTH)


class Liver(Problem):
    """The demo, a catheter from the groin to the liver: where the device lies when its tip has arrived."""
    limit, points, finished, fair, solvers = 200, True, ("reached",), math.inf, ()
    DIRECTION = numpy.array([0, 0, 1.0])

    def __init__(self, study):
        file = os.path.join(study.root, "launch", "scenes", "liver.yaml")
        with open(file) as scene:
            text = scene.read().replace("../../", os.path.join(study.root, ""))
        text += "planner: {replans: 2}\n"  # a mesh too stiff for the way is so on every path
        super().__init__("liver", "Catheter scene (`liver.yaml`): the device's line when its tip is there", "", text)

    def settings(self, model, quick):
        return stations({"rod": (58, 115, 229, 455), "tet10": (115,), "tet4": (115, 229, 455)}[model])

    def converge(self, study):
        """The answer: the finest mesh of the best model."""
        model = [m for m in ("rod", "tet10", "tet4") if m in study.models][0]
        count = {"rod": 909, "tet10": 455, "tet4": 909}[model]
        outcome = study.run(study.write_scene(self.name, self.scene), {
            "bodies.0.model": model, "bodies.0.shape.catheter.stations": count}, limit=2 * self.limit, points=True)
        if outcome.status != "reached":
            study.note("Problem `liver` is left out: its finer run (%s) ended with: %s" % (
                outcome.command, outcome.message))
            return False
        self.truth = self.line(outcome)
        self.answer = "run of the `%s` with %d stations (`%s`)" % (model, count, outcome.command)
        return True

    def line(self, outcome):
        """Centres of 101 sections equally spaced along the device [m] (101 x 3)."""
        along = outcome.rest @ self.DIRECTION
        length = numpy.ptp(along)
        _, section = numpy.unique(numpy.round((along - along.min()) / length * 1e6), return_inverse=True)
        count = numpy.bincount(section)
        centres = [numpy.bincount(section, outcome.last[:, k]) / count for k in range(3)]
        s = numpy.bincount(section, along - along.min()) / count / length
        return numpy.array([numpy.interp(numpy.linspace(0, 1, 101), s, centre) for centre in centres]).T

    def error(self, outcome, model):
        return float(numpy.linalg.norm(self.line(outcome) - self.truth, axis=1).max())  # the device is 1 m long
