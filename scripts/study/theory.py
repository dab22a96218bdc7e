"""Contact beside theory: wall forces in a bend, push, friction, buckling in a tube, pressed bodies, bounces.

Each problem is a function of the study that yields rows: what was measured, what theory says, how far apart they
are over the theory's size, and the tolerance the reference states. Answers come from the reference folder; a
problem whose file is not there is left out."""
import json
import math
import os

import numpy

import stability


PI = math.pi
SECTION = PI / 64  # second moment of a round section over diameter^4


def cases(study, name):
    with open(os.path.join(study.reference, "data", name + ".json")) as file:
        return json.load(file)["cases"]


def row(problem, case, quantity, outcome, ours, theory, tolerance, scale=None):
    """scale: what the error is taken over where it is not the theory's own size."""
    error = None if ours is None else abs(ours - theory) / abs(scale or theory)
    return {"problem": problem, "case": case, "quantity": quantity, "ours": ours, "theory": theory, "error": error,
            "tolerance": tolerance, "within": error is not None and error <= tolerance, "time_s": outcome.wall,
            "status": outcome.status, "message": outcome.message, "command": outcome.command}


# --- friction ---

def incline(study):
    """A block on a floor, gravity inclined, downhill along +x."""
    step, settle = 0.005, 40
    for i, case in enumerate(cases(study, "incline_friction")):
        angle, mu, v0, g = math.radians(case["incline_deg"]), case["mu"], case["v0"], case["g"]
        label = "mu %g, %g degrees%s" % (mu, case["incline_deg"], ", %g m/s" % v0 if v0 else "")
        file = study.write_scene("incline_%d" % i, {
            "scene": "incline", "step": step, "gravity": [g * math.sin(angle), 0, -g * math.cos(angle)],
            "contact": {"friction": mu},
            "obstacles": [{"name": "floor", "shape": {"plane": {"point": [0, 0, -0.00248], "normal": [0, 0, 1]}}}],
            "bodies": [{"name": "block", "shape": {"beam": {"size": [0.1, 0.1, 0.05], "cells": [3, 3, 2]}},
                        "model": "tet4", "material": {"young": 1e7, "poisson": 0.3, "density": 1000},
                        "start": {"velocity": [v0, 0, 0]}}]})

        def at(steps):
            outcome = study.run(file, {"time_limit": steps * step})
            return outcome, outcome.figure("bodies", 0, "com", 0), outcome.figure("bodies", 0, "momentum", 0)
        mass, slides = 0.1 * 0.1 * 0.05 * 1000, case["acceleration_sliding_down"]
        before, x, p = at(settle)
        if v0 > 0 or not case["sticks_from_rest"]:
            outcome, _, q = at(settle + 20)
            ours = None if None in (p, q) else (q - p) / mass / (20 * step)
            yield row("block on an incline", label, "acceleration [m/s^2]", outcome, ours, slides, 0.01)
        if v0 > 0 and case["stop_distance"] is not None:
            outcome, end, _ = at(int(v0 / abs(slides) / step) + 20)
            start = 0.05
            yield row("block on an incline", label, "stopping distance [m]", outcome, end and end - start,
                      case["stop_distance"], 0.01 + v0 * step / case["stop_distance"])
        if v0 == 0 and case["sticks_from_rest"]:
            outcome, end, _ = at(settle + 200)
            yield row("block on an incline", label, "creep in 1 s [m]", outcome, end and end - x, 0.0, 1e-6, scale=1.0)


def capstan(study):
    """A thin rod wound over a drum: the pull at which it slides, over the pull that holds it, by bisection."""
    drum, thick, arc, tail, gap = 0.1, 0.002, 60, 4, 2e-4
    radius = drum + 0.5 * thick + 0.95 * gap
    for i, case in enumerate(cases(study, "capstan")):
        wrap, low = case["wrap_rad"], case["T_low"]
        segment = radius * wrap / arc
        length = segment * (arc + 2 * tail)
        points, ends = [], []
        for node in range(arc + 2 * tail + 1):
            on = min(max(node - tail, 0), arc)
            angle, ahead = wrap * (on / arc - 0.5), segment * (node - tail - on)
            points.append([radius * math.sin(angle) + ahead * math.cos(angle), 0,
                           radius * math.cos(angle) - ahead * math.sin(angle)])
            if node in (0, arc + 2 * tail):
                ends.append(numpy.array([math.cos(angle), 0, -math.sin(angle)]))
        name = "capstan_%d" % i
        numpy.savetxt(study.path("scenes/%s.txt" % name), points, "%.17g")

        def scene(high):
            load = []
            for part in range(30):  # pulled ever harder, then evenly
                for box, force in ((((-1, -1, -9), (1e-9, 1, 9)), -low * ends[0]),
                                   (((length - 1e-9, -1, -9), (length + 1, 1, 9)), high * ends[1])):
                    load.append({"box": [list(box[0]), list(box[1])], "force": list(force / 30), "from": 1e-3 * part})
            return {"scene": name, "step": 1e-3, "time_limit": 0.06,
                    "contact": {"friction": case["mu"], "gap": gap, "self": "off"},
                    "obstacles": [{"name": "drum", "shape": {"tube": {
                        "axis": [[0, -0.05, 0], [0, 0.05, 0]], "radius": 0.8 * drum, "thickness": 0.2 * drum}}}],
                    "bodies": [{"name": "rope", "shape": {"beam": {"size": [length, thick, thick], "cells":
                                                                   [arc + 2 * tail, 1, 1]}}, "model": "rod",
                                "material": {"young": 0.01 * drum**2 * low * 12 / thick**4, "poisson": 0.3,
                                             "density": 1000, "damping": 50},
                                "start": {"positions": name + ".txt"}, "load": load}]}
        holds, slides = 1.0, case["T_high"] / low * 1.3
        for _ in range(5):
            middle = 0.5 * (holds + slides)
            outcome = study.run(study.write_scene(name, scene(middle * low)))
            energy, speed = outcome.figure("bodies", 0, "kinetic"), outcome.figure("bodies", 0, "momentum")
            if energy is None:
                break
            mass = 1000 * length * thick**2
            if math.sqrt(2 * energy / mass) > 0.01:
                slides = middle
            else:
                holds = middle
        ratio = None if energy is None else 0.5 * (holds + slides)
        yield row("capstan", "mu %g, %.0f degrees" % (case["mu"], math.degrees(wrap)), "pull held, ratio [-]", outcome,
                  ratio, case["T_high"] / low, 0.05)


# --- rods in tubes ---

def write_tube(study, name, axis, normals, binormals, radius, sides=48):
    """An open tube of triangles along `axis` (n x 3) as scenes/NAME.obj, its corners on the radius."""
    angle = 2 * PI * numpy.arange(sides) / sides
    ring = (axis[:, None] + radius * (numpy.cos(angle)[None, :, None] * normals[:, None] +
                                      numpy.sin(angle)[None, :, None] * binormals[:, None])).reshape(-1, 3)
    with open(study.path("scenes/%s.obj" % name), "w") as file:
        file.writelines("v %.17g %.17g %.17g\n" % tuple(x) for x in ring)
        for i in range(len(axis) - 1):
            for k in range(sides):
                a, b = i * sides + k + 1, i * sides + (k + 1) % sides + 1
                c, d = a + sides, b + sides
                file.write("f %d %d %d\nf %d %d %d\n" % (a, b, d, a, d, c))


def arc(radius, angles):
    """Points, normals (away from the middle) and binormals of an arc in the plane y = 0, from the origin along z."""
    c, s = numpy.cos(angles), numpy.sin(angles)
    zero = numpy.zeros_like(c)
    return (numpy.array([radius * (1 - c), zero, radius * s]).T, numpy.array([-c, zero, s]).T,
            numpy.array([zero, zero + 1, zero]).T)


def line(outcome):
    """Axis of a catheter-shaped rod at the end, its first station first (n x 3), and the same at rest."""
    along = outcome.rest[:, 2]
    _, section = numpy.unique(numpy.round(along / numpy.ptp(along) * 1e6), return_inverse=True)
    count = numpy.bincount(section)
    ends = [numpy.array([numpy.bincount(section, x[:, k]) / count for k in range(3)]).T
            for x in (outcome.last, outcome.rest)]
    order = slice(None, None, -1) if section[0] else slice(None)  # stations go from the tip backwards
    return ends[0][order], ends[1][order]


def rested(study, file, name):
    """The run that begins where a run of the scene has come to rest: its largest force is that of the rest."""
    outcome = study.run(file, points=True)
    if outcome.last is None:
        return outcome
    numpy.savetxt(study.path("scenes/%s_rested.txt" % name), line(outcome)[0], "%.17g")
    return study.run(file, {"bodies.0.start.positions": name + "_rested.txt", "step": 0.1, "time_limit": 0.5},
                     points=True)


def bend(study):
    """A straight rod lies in a circular bend: both ends on the outer wall, its middle on the inner one."""
    radius, young, nodes = 0.1, 1e9, 81
    for i, case in enumerate(cases(study, "rod_in_bend_three_contacts")):
        if not case["valid"]:
            continue
        play, length = case["c_over_R"] * radius, case["L_over_R"] * radius
        outer = radius + play  # what a straight rod between the outer wall and the inner one is short of
        short = outer - math.sqrt(outer**2 - 0.25 * length**2) - 2 * play
        diameter, gap, name = 0.1 * play, min(0.005 * play, 0.005 * short), "bend_%d" % i
        half = 0.5 * length / radius
        # an end is a disc that meets the outer wall with its edge: the axis is to have the play, not the edge
        edge = 0.5 * diameter * (1 - math.cos(case["tip_angle_rad"] - case["tip_slope_rad"]))
        points, normals, binormals = arc(radius, numpy.linspace(-half - 0.2, half + 0.2, 161))
        write_tube(study, name, points - 0.5 * edge * normals, normals, binormals, play + 0.5 * (diameter - edge))
        numpy.savetxt(study.path("scenes/%s.txt" % name), arc(radius, numpy.linspace(-half, half, nodes))[0], "%.17g")
        file = study.write_scene(name, {
            "scene": name, "step": 0.002, "time_limit": 0.15, "contact": {"gap": gap, "self": "off"},
            "solver": {"tolerance": 1e-6}, "planner": {"resolution": diameter},  # of a map that nothing here asks
            "vessels": [{"name": "channel", "surface": {"file": name + ".obj"}}],
            "bodies": [{"name": "rod", "shape": {"catheter": {
                "length": length, "diameter": diameter, "entry": [0, 0, 0], "direction": [0, 0, 1], "inserted": length,
                "stations": nodes, "sides": 24, "sheath": "off"}}, "model": "rod",
                "material": {"young": young, "poisson": 0.3, "density": 1000}, "start": {"positions": name + ".txt"}}]})
        outcome = rested(study, file, name)
        unit = young * SECTION * diameter**4 / radius**2
        label = "L %g R, play %g R" % (case["L_over_R"], case["c_over_R"])
        force, energy = outcome.figure("contact", "force_max"), outcome.figure("bodies", 0, "energy")
        yield row("rod in a bend", label, "force of the middle on the wall [EI/R^2]", outcome, force and force / unit,
                  case["mid_force"], 0.03)
        yield row("rod in a bend", label, "bending energy [EI/R]", outcome, energy and energy / unit / radius,
                  case["bending_energy"], 0.03)


def push(study):
    """A rod pushed through a right-angled bend by its base: stored energy and the work that stored it."""
    radius, young, diameter, before = 0.1, 1e9, 1e-3, 0.3
    for i, case in enumerate(cases(study, "push_through_bend")):
        turn, play = math.radians(case["angle_deg"]), case["c_over_R"] * radius
        last = min(case["insert_over_R"], case["L_over_R"] - 2) * radius  # further, its clamp lies in the bend
        name, n = "push_%d" % i, int(math.ceil(turn * 90 / PI))
        exit_length = last - turn * radius + radius
        points, normals, binormals = arc(radius, numpy.linspace(0, turn, n + 1))
        end = numpy.array([math.sin(turn), 0, math.cos(turn)])
        ahead = numpy.linspace(0, exit_length, 9)[1:, None] * end
        axis = numpy.vstack([[[0, 0, -before - 0.05 * radius]], points, points[-1] + ahead])
        write_tube(study, name, axis, numpy.vstack([normals[:1], normals, [normals[-1]] * 8]),
                   numpy.vstack([binormals[:1], binormals, [binormals[-1]] * 8]), play + 0.5 * diameter)
        target = points[-1] + (exit_length - 0.5 * radius) * end  # not reached: the time ends with the insertion
        length = before + last + radius
        file = study.write_scene(name, {
            "scene": name, "step": 1.0, "time_limit": last / (0.02 * radius), "contact": {"gap": 0.02 * play},
            "planner": {"resolution": 5e-4},
            "vessels": [{"name": "tube", "surface": {"file": name + ".obj"}}],
            "bodies": [{"name": "rod", "shape": {"catheter": {
                "length": length, "diameter": diameter, "entry": [0, 0, -before], "direction": [0, 0, 1],
                "inserted": before, "stations": int(24 * length / radius) + 1, "sides": 6}}, "model": "rod",
                "material": {"young": young, "poisson": 0.3, "density": 0},
                "drive": {"mode": "push", "speed": 0.02 * radius, "advance_max": 0.02 * radius},
                "waypoint_tolerance": 2e-3, "waypoints": [list(target)]}]})
        outcome = study.run(file)
        unit = young * SECTION * diameter**4 / radius  # of energy
        label = "%g degrees, play %g R" % (case["angle_deg"], case["c_over_R"])
        energy, work = outcome.figure("bodies", 0, "energy"), outcome.figure("drive", "work")
        base = outcome.figure("drive", "insertion")
        if not base:
            yield row("push through a bend", label, "stored energy [EI/R]", outcome, None, 1.0, 0.03)
            continue
        inserted = base[-1]["advance"] - before
        path = case["path"]
        theory = numpy.interp(inserted / radius, [p["inserted_over_R"] for p in path], [p["energy"] for p in path])
        most = max(p["energy"] for p in path)
        yield row("push through a bend", label, "stored energy [EI/R]", outcome, energy / unit, float(theory), 0.03,
                  scale=most)
        yield row("push through a bend", label, "work of the push [EI/R]", outcome, work / unit, energy / unit, 0.03,
                  scale=most)


def helix(study):
    """A rod pressed in a straight tube until it coils: pitch of the coil in its middle, wall force from its bending
    (fourth derivative along it) and thrust."""
    for i, case in enumerate(cases(study, "helical_buckling")):
        thrust, clearance, pitch = case["P"], case["clearance"], case["pitch"]
        diameter, turns, per = 1.35e-3, 7, 24
        young = case["EI"] / (SECTION * diameter**4)
        # a coil grows at thrust^2 / (4 EI c m) of damping c and mass m per length: so that all cases come to rest
        damping = thrust**2 / (4 * case["EI"] * 1100 * PI / 4 * diameter**2) / 1.4e4
        length, n, name = turns * pitch, turns * per + 1, "helix_%d" % i
        z = numpy.linspace(0, length, n)
        angle = 2 * PI * z / (1.15 * pitch)  # another pitch than theory's to begin with
        amplitude = 0.9 * clearance * numpy.clip(z / pitch, 0, 1)
        numpy.savetxt(study.path("scenes/%s.txt" % name), numpy.array(
            [amplitude * numpy.cos(angle), amplitude * numpy.sin(angle), z]).T, "%.17g")
        along = numpy.linspace(-0.2 * length, 1.2 * length, 8)
        zero = numpy.zeros_like(along)
        write_tube(study, name, numpy.array([zero, zero, along]).T, numpy.array([zero + 1, zero, zero]).T,
                   numpy.array([zero, zero + 1, zero]).T, clearance + 0.5 * diameter, sides=96)  # fewer corners would hold the coil like teeth
        file = study.write_scene(name, {
            "scene": name, "step": 0.02, "time_limit": 3.0, "contact": {"gap": 0.02 * clearance, "self": "off"},
            "planner": {"resolution": 5e-4}, "solver": {"tolerance": 1e-5},
            "vessels": [{"name": "tube", "surface": {"file": name + ".obj"}}],
            "bodies": [{"name": "rod", "shape": {"catheter": {
                "length": length, "diameter": diameter, "entry": [0, 0, length], "direction": [0, 0, -1],
                "inserted": length, "stations": n, "sides": 24, "sheath": "off"}}, "model": "rod",
                "material": {"young": young, "poisson": 0.33, "density": 1100, "damping": damping},
                "start": {"positions": name + ".txt"},
                "fixed": {"box": [[-1, -1, -1e-6], [1, 1, 1e-6]]},
                "load": [{"box": [[-1, -1, length - 1e-6], [1, 1, length + 1e-6]], "force": [0, 0, -thrust]}]}]})
        outcome = study.run(file, points=True)
        label = "P %g N, clearance %g mm" % (thrust, 1e3 * clearance)
        ours = None
        if outcome.last is not None:
            axis = line(outcome)[0]
            axis = axis[numpy.argsort(axis[:, 2])]
            turned = numpy.unwrap(numpy.arctan2(axis[:, 1], axis[:, 0]))
            middle = slice(2 * per, -2 * per)
            slope = numpy.polyfit(axis[middle, 2], turned[middle], 1)[0]
            ours = float(abs(2 * PI / slope))
        yield row("helical buckling", label, "pitch [m]", outcome, ours, pitch, 0.1)


# --- pressed and bouncing bodies ---

def grid_mesh(cells, place):
    """Nodes and tetrahedra of a grid of cells whose corner (i, j, k) lies at place(i, j, k). Corners at one place
    are one node, and tetrahedra that have one twice are left out: a grid may close on itself or meet in an axis."""
    corners, tets = stability.beam_mesh(cells, length=cells[0], depth=1)
    index = numpy.rint(corners * [1, cells[1], cells[2]]).astype(int)
    placed = numpy.array([place(*c) for c in index], float)
    _, first, same = numpy.unique(numpy.round(placed / numpy.ptp(placed) * 1e9), axis=0, return_index=True,
                                  return_inverse=True)
    tets = same.reshape(-1)[tets]
    tets = tets[[len(set(t)) == 4 for t in tets]]
    return placed[first], stability.turned_right(placed[first], tets)


def lame(study):
    """A ring of a thick tube with open ends under inner pressure, a load on each facet of its bore."""
    around, layers = 48, 4
    for i, case in enumerate(cases(study, "thick_cylinder")):
        a, b, pressure, name = case["a"], case["b"], case["p"], "lame_%d" % i
        high = (b - a) / layers

        def place(m, j, k):
            r, angle = a + (b - a) * j / layers, 2 * PI * m / around
            return r * math.cos(angle), r * math.sin(angle), k * high
        nodes, tets = grid_mesh((around, layers, 1), place)
        stability.write_mesh(study.path("scenes/" + name), nodes, tets)
        load = []
        for m in range(around):
            ends = numpy.array([place(m, 0, 0), place(m + 1, 0, 1)])
            across = ends[1, :2] - ends[0, :2]
            # a facet's force is that on its arc: the ring's inner edge is a polygon
            force = pressure * high * a * 2 * PI / around * numpy.array([across[1], -across[0]]) / numpy.hypot(*across)
            load.append({"box": [list(ends.min(0) - 1e-9 * a), list(ends.max(0) + 1e-9 * a)],
                         "force": [force[0], force[1], 0]})
        file = study.write_scene(name, {
            "scene": name, "step": 1.0, "time_limit": 4.0, "contact": {"method": "none"}, "solver": {"tolerance": 1e-6},
            "bodies": [{"name": "ring", "shape": {"file": name + ".node"}, "model": "tet10",
                        "material": {"young": case["E"], "poisson": case["nu"], "density": 1000, "damping": 5.0},
                        "load": load}]})
        for model, tolerance in (("tet10", 0.01), ("tet4", 0.03)):
            if model == "tet4" and case["nu"] > 0.45:
                continue
            outcome = study.run(file, {"bodies.0.model": model}, points=True)
            ours = None
            if outcome.last is not None:
                inner = numpy.abs(numpy.hypot(outcome.rest[:, 0], outcome.rest[:, 1]) / a - 1) < 1e-6
                ours = float(numpy.mean(numpy.hypot(*outcome.last[inner, :2].T) - numpy.hypot(*outcome.rest[inner, :2].T)))
            yield row("thick tube under pressure (Lame)", "%s, nu %g, b/a %.3g" % (model, case["nu"], b / a),
                      "widening of the bore [m]", outcome, ours, case["ends"]["open_ends"]["u_inner"], tolerance)


def graded(first, growth, end):
    """Places from 0 to `end`: six of them `first` apart, then growing."""
    at, step = [0.0], first
    while at[-1] < end:
        step *= growth if len(at) > 6 else 1
        at.append(at[-1] + step)
    return numpy.array(at) * numpy.append(numpy.ones(7), numpy.linspace(1, end / at[-1], len(at) - 7))


def under_hertz(case, z):
    """How far a place on the axis at height z moves towards the contact, for the case's force: Boussinesq's
    displacement under the elliptic pressure, at the surface less that at z."""
    a, nu, young = case["contact_radius"], case["nu1"], case["E1"]
    s = (numpy.arange(20000) + 0.5) / 20000  # r = a sin(pi s / 2): the pressure's root is smooth in it
    r, pressure = a * numpy.sin(PI * s / 2), case["peak_pressure"] * numpy.cos(PI * s / 2)
    area = 2 * PI * r * a * numpy.cos(PI * s / 2) * (PI / 2) / len(s)
    far = numpy.hypot(r, z)
    down = (pressure * area * (1 + nu) / (2 * PI * young) * (z * z / far**3 + 2 * (1 - nu) / far)).sum()
    return case["approach"] - float(down)


def hertz(study):
    """A round body is pressed on a rigid flat: a block of 16 contact radii with a spherical underside under a load
    on its top. Compared is how much nearer its lowest point comes to the place six contact radii above it."""
    sectors = 12
    for i, case in enumerate(cases(study, "hertz")):
        radius, a, force, name = case["radius"], case["contact_radius"], case["force"], "hertz_%d" % i
        if case["E2"] != 0:
            study.note("Hertz, case %d, is left out: both bodies give way." % i)
            continue
        size = 16 * a
        at = graded(a / 5, 1.5, size)
        n = len(at) - 1

        def place(m, j, k):
            r, angle = at[j], 2 * PI * (m % sectors) / sectors
            low = r * r / (2 * radius)
            return r * math.cos(angle), r * math.sin(angle), low + at[k] * (1 - low / size)
        nodes, tets = grid_mesh((sectors, n, n), place)
        stability.write_mesh(study.path("scenes/" + name), nodes, tets)
        gap, density = 0.2 * case["approach"], 1000
        mass = density * PI * size**3
        rate = math.sqrt(1.5 * force / case["approach"] / mass)  # of the block on the contact's spring [1/s]
        file = study.write_scene(name, {
            "scene": name, "step": 0.5 / rate, "time_limit": 12 / rate, "contact": {"gap": gap, "self": "off"},
            "obstacles": [{"name": "flat", "shape": {"plane": {"point": [0, 0, -0.6 * gap], "normal": [0, 0, 1]}}}],
            "bodies": [{"name": "cap", "shape": {"file": name + ".node"}, "model": "tet4",
                        "material": {"young": case["E1"], "poisson": case["nu1"], "density": density,
                                     "damping": 2 * rate},
                        "load": [{"box": [[-2 * size, -2 * size, 0.999 * size], [2 * size, 2 * size, 1.001 * size]],
                                  "force": [0, 0, -force]}]}]})
        outcome = study.run(file, points=True)
        ours, theory = None, case["approach"]
        if outcome.last is not None:
            on_axis = numpy.nonzero(numpy.hypot(outcome.rest[:, 0], outcome.rest[:, 1]) < 1e-6 * a)[0]
            lowest = on_axis[numpy.argmin(outcome.rest[on_axis, 2])]
            inside = on_axis[numpy.argmin(numpy.abs(outcome.rest[on_axis, 2] - 6 * a))]
            down = outcome.rest[:, 2] - outcome.last[:, 2]
            ours = float(down[inside] - down[lowest])  # strict contact leaves a gap under the lowest
            theory = under_hertz(case, outcome.rest[inside, 2])
        yield row("sphere pressed on a flat (Hertz)", "R %g mm, a/R %.3g, nu %g" % (1e3 * radius, a / radius, case["nu1"]),
                  "approach six contact radii inside [m]", outcome, ours, theory, 0.05)


def ball_mesh(cuts=4):
    """A ball of radius 1: the faces of an octahedron cut, pressed out to the sphere, each with the centre."""
    corner = numpy.array([[0, 0, 1], [1, 0, 0], [0, 1, 0], [-1, 0, 0], [0, -1, 0], [0, 0, -1]], float)
    nodes, index, tets = [numpy.zeros(3)], {}, []

    def node(p):
        p = p / numpy.linalg.norm(p)
        key = tuple(numpy.round(p, 9))
        if key not in index:
            index[key] = len(nodes)
            nodes.append(p)
        return index[key]
    for face in range(8):
        a, b, c = corner[0 if face < 4 else 5], corner[1 + face % 4], corner[1 + (face + 1) % 4]
        at = {(i, j): node((cuts - i - j) * a + i * b + j * c) for i in range(cuts + 1) for j in range(cuts + 1 - i)}
        for i in range(cuts):
            for j in range(cuts - i):
                tets.append([0, at[i, j], at[i + 1, j], at[i, j + 1]])
                if i + j + 1 < cuts:
                    tets.append([0, at[i + 1, j + 1], at[i + 1, j], at[i, j + 1]])
    nodes = numpy.array(nodes)
    return nodes, stability.turned_right(nodes, numpy.array(tets))


def bounce(study):
    """A stiff ball comes down on a floor with 1 m/s: what it leaves with, over that."""
    radius, step = 0.05, 1e-3
    stability.write_mesh(study.path("scenes/ball"), *ball_mesh())
    for restitution in (0.0, 0.25, 0.5, 0.75, 1.0):
        file = study.write_scene("bounce", {
            "scene": "bounce", "step": step, "time_limit": 12 * step,
            "contact": {"response": "elastic", "restitution": restitution, "gap": 1e-4},
            "obstacles": [{"name": "floor", "shape": {"plane": {"point": [0, 0, 0], "normal": [0, 0, 1]}}}],
            "bodies": [{"name": "ball", "shape": {"file": "ball.node", "scale": radius,
                                                  "translate": [0, 0, radius + 5.3e-3]}, "model": "tet4",
                        "material": {"young": 1e11, "poisson": 0.3, "density": 1000},
                        "start": {"velocity": [0, 0, -1.0]}}]})
        outcome = study.run(file, {"contact.restitution": restitution})
        momentum, volume = outcome.figure("bodies", 0, "momentum", 2), outcome.figure("bodies", 0, "rest_volume")
        yield row("bounce of a ball", "e = %g" % restitution, "speed after over before [-]", outcome,
                  None if momentum is None else momentum / (1000 * volume), restitution,
                  0.1 if restitution == 0 else 2e-3, scale=1.0)


PROBLEMS = (bend, push, capstan, incline, helix, lame, hertz, bounce)


def run(study):
    rows = []
    for problem in (incline, capstan, lame, bounce) if study.quick else PROBLEMS:
        try:
            found = list(problem(study))
        except (OSError, KeyError, ValueError) as error:
            study.note("Theory `%s` is left out: its reference cannot be read (%s)" % (problem.__name__, error))
            continue
        rows += found
        study.say("theory: %s, %d rows" % (problem.__name__, len(found)))
        study.table("theory", rows)
    return rows
