#!/usr/bin/python3
"""Random insertions: a vessel, an entry, a device, a step and a stiffness drawn from a seed, 10 to 30 steps each,
judged by the report and by the oracle on every accepted step. `make test-insertions COUNT=N SEED=S`."""
import argparse
import collections
import concurrent.futures
import json
import math
import os
import random
import shutil
import sys
import tempfile

import numpy as np

import oracle_runs

REAL = [("meshes/fork.stl", 4), ("vessels/beamadapter/beamadapter_phantom.obj", 2),
        ("vessels/beamadapter/beamadapter_carotids.stl", 2), ("vessels/steve/steve_vessel_architecture_collision.obj", 1),
        ("vessels/bp3d/bp3d_leg_to_liver_coarse.stl", 1)]  # in millimetres; how often


# --- vectors ---
def unit(v):
    return np.asarray(v, float) / np.linalg.norm(v)


def any_unit(rng):
    return unit([rng.gauss(0, 1) for _ in range(3)])


def across(t, rng):
    return unit(np.cross(t, any_unit(rng)))


def log_uniform(rng, low, high):
    return math.exp(rng.uniform(math.log(low), math.log(high)))


# --- vessels: a file's triangles [m], and where a device may enter: place, direction, room about it, way ahead ---
def write_obj(file, vert, tri):
    with open(file, "w") as out:
        out.writelines("v %r %r %r\n" % tuple(map(float, v)) for v in vert)
        out.writelines("f %d %d %d\n" % tuple(t + 1) for t in np.asarray(tri, int))


def read_mesh(file):
    """Corners of triangles (n x 3 x 3) of an .obj or .stl."""
    if file.endswith(".obj"):
        vert, tri = [], []
        with open(file) as text:
            for line in text:
                words = line.split()
                if words[:1] == ["v"]:
                    vert.append([float(w) for w in words[1:4]])
                elif words[:1] == ["f"]:
                    ring = [int(w.split("/")[0]) - 1 for w in words[1:]]
                    tri += [[ring[0], ring[k], ring[k + 1]] for k in range(1, len(ring) - 1)]
        return np.array(vert)[np.array(tri)]
    with open(file, "rb") as data:
        data.seek(80)
        count = int(np.frombuffer(data.read(4), "<u4")[0])
        if os.path.getsize(file) == 84 + 50 * count:
            record = np.dtype([("normal", "<f4", 3), ("corner", "<f4", (3, 3)), ("rest", "<u2")])
            return np.frombuffer(data.read(), record)["corner"].astype(float)
    with open(file) as text:
        found = [[float(w) for w in line.split()[1:4]] for line in text if line.split()[:1] == ["vertex"]]
    return np.array(found).reshape(-1, 3, 3)


def sight(corner, p, d):
    """Distance from p along d to the first triangle, and how many lie there: Moeller and Trumbore 1997."""
    e, f = corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0]
    h = np.cross(d, f)
    with np.errstate(divide="ignore", invalid="ignore"):
        inverse = 1 / np.einsum("ij,ij->i", e, h)
        s = p - corner[:, 0]
        u = inverse * np.einsum("ij,ij->i", s, h)
        q = np.cross(s, e)
        v = inverse * (q @ d)
        t = inverse * np.einsum("ij,ij->i", f, q)
        t = t[(u >= 0) & (v >= 0) & (u + v <= 1) & (t > 1e-9 * np.ptp(corner))]
    return (t.min() if len(t) else math.inf), len(t)


def place_in(corner, rng):
    """A place amid the lumen of a mesh, looking where it sees farthest."""
    least = 0.003 * np.ptp(corner, axis=(0, 1)).max()
    for _ in range(200):
        abc = corner[rng.randrange(len(corner))]
        normal = np.cross(abc[1] - abc[0], abc[2] - abc[0])
        if not np.linalg.norm(normal) > 0:
            continue
        weight = np.array([rng.random() + 0.1 for _ in range(3)])
        p, d = weight @ abc / weight.sum(), unit(normal)
        ahead, count = sight(corner, p, d)
        if count % 2 == 0:
            d = -d
            ahead, count = sight(corner, p, d)
        if count % 2 == 0:
            continue
        p = p + d * ahead / 2
        for axis in (across(d, rng), across(d, rng)):
            fore, back = sight(corner, p, axis)[0], sight(corner, p, -axis)[0]
            if fore + back < 4 * ahead:
                p = p + axis * (fore - back) / 2
        looks = [any_unit(rng) for _ in range(40)]
        seen = [sight(corner, p, look)[0] for look in looks]
        room, far = min(seen), max((s, i) for i, s in enumerate(seen) if s < math.inf)
        if room > max(0.1 * ahead, least) and far[0] > 3 * room:
            return p, looks[far[1]], room, [p + looks[far[1]] * min(0.7 * far[0], 12 * room)]
    raise RuntimeError("no place in that mesh")


def made_tube(file, rng):
    """A tube along a random line, of few or many sides, smooth or rough, open or closed."""
    radius, sides, rings = log_uniform(rng, 1e-3, 1e-2), rng.choice([3, 4, 6, 8, 12, 20]), rng.choice([4, 8, 16, 40])
    length = radius * rng.uniform(10, 30)
    kind = rng.choice(["straight", "bend", "s", "helix", "kink"])
    t, n = np.array([0.0, 0, 1]), np.array([1.0, 0, 0])
    p, axis, tangents, normals = np.zeros(3), [], [], []
    turn = rng.uniform(0.5, 2.6) / rings  # [rad] a ring
    for i in range(rings + 1):
        axis.append(p), tangents.append(t), normals.append(n)
        if kind == "bend":
            turned, about = turn, np.cross(t, n)
        elif kind == "s":
            turned, about = (turn if i < rings / 2 else -turn), np.array([0.0, 1, 0])
        elif kind == "helix":
            turned, about = 2 * turn, np.array([0, math.sin(0.3), math.cos(0.3)])
        else:
            turned, about = (rng.uniform(0.4, 1.0) if kind == "kink" and i == rings // 2 else 0), np.array([0.0, 1, 0])
        turned = min(turned, 0.7 * length / rings / radius)  # no ring reaches through the next
        t = t + math.sin(turned) * np.cross(about, t) + (1 - math.cos(turned)) * np.cross(about, np.cross(about, t))
        t = unit(t)
        n = unit(n - (n @ t) * t)
        p = p + t * length / rings
    rough, phase = rng.choice([0, 0, 0.1, 0.25]), rng.uniform(0, 1)
    taper = rng.choice([1, 1, 0.5, 0.3])
    vert = []
    for i in range(rings + 1):
        b = np.cross(tangents[i], normals[i])
        for k in range(sides):
            a = 2 * math.pi * (k + phase) / sides
            r = radius * (1 + (taper - 1) * i / rings) * (1 - rough * rng.random())
            vert.append(axis[i] + r * (math.cos(a) * normals[i] + math.sin(a) * b))
    tri = []
    for i in range(rings):
        for k in range(sides):
            a, b = i * sides + k, i * sides + (k + 1) % sides
            tri += [[a, b, b + sides], [a, b + sides, a + sides]]
    closed = rng.random() < 0.3, rng.random() < 0.3
    for end, shut in zip((0, rings), closed):
        if shut:
            vert.append(axis[end])
            for k in range(sides):
                a, b = end * sides + k, end * sides + (k + 1) % sides
                tri.append([len(vert) - 1, b, a] if end == 0 else [len(vert) - 1, a, b])
    write_obj(file, vert, tri)
    room = radius * (1 - rough) * math.cos(math.pi / sides) * min(1, (1 + 2 * taper) / 3)
    first = 0
    if closed[0] or rng.random() < 0.3:
        while first < rings - 2 and np.linalg.norm(axis[first] - axis[0]) < room:
            first += 1
    return axis[first], unit(axis[first + 1] - axis[first]) if first else tangents[0], room, axis[first + 1:]


def made_fork(file, rng):
    """Three arms of a rectangular section about a triangle: a handful of large triangles, sharp edges."""
    half, cells = log_uniform(rng, 1e-3, 8e-3), rng.choice([1, 2, 5])
    corners = [half * 1.2 * np.array([math.cos(a), math.sin(a)]) for a in (-math.pi / 2 - 1.05, -math.pi / 2 + 1.05,
                                                                         math.pi / 2 + rng.uniform(-0.4, 0.4))]
    plan, cell2d, outline, ends = list(corners), [[0, 1, 2]], [], []
    for k in range(3):
        a, b = k, (k + 1) % 3
        out = np.array([corners[b][1] - corners[a][1], corners[a][0] - corners[b][0]])
        out, long = out / np.linalg.norm(out), half * rng.uniform(4, 12)
        for i in range(cells):
            plan += [plan[a] + out * long / cells, plan[b] + out * long / cells]
            c, d = len(plan) - 2, len(plan) - 1
            cell2d += [[a, c, d], [a, d, b]]
            outline += [(a, c), (d, b)]
            a, b = c, d
        ends.append((a, b, out, long))
        if rng.random() < 0.5:
            outline.append((a, b))
    n = len(plan)
    vert = [[*p, -half] for p in plan] + [[*p, half] for p in plan]
    tri = [[a, c, b] for a, b, c in cell2d] + [[a + n, b + n, c + n] for a, b, c in cell2d]
    for a, b in outline:
        tri += [[a, b, b + n], [a, b + n, a + n]]
    write_obj(file, vert, tri)
    a, b, out, long = ends[0]
    entry = np.append((plan[a] + plan[b]) / 2, 0)
    direction = np.append(-out, 0)
    target = rng.choice(ends[1:])
    room = 0.9 * min(half, np.linalg.norm(plan[a] - plan[b]) / 2)
    return (entry + 1.2 * room * direction, direction, room,
            [np.zeros(3), np.append(target[2], 0) * target[3] * 0.6])


# --- scenes ---
def list_of(v):
    return [float(x) for x in v]


def straight(corner, p, d, radius):
    """How far a straight device of that radius can go from p along d."""
    n = unit(np.cross(d, [1, 0, 0] if abs(d[0]) < 0.7 else [0, 1, 0]))
    b = np.cross(d, n)
    ring = [1.3 * radius * (math.cos(a) * n + math.sin(a) * b) for a in np.arange(8) * math.pi / 4]
    return min(sight(corner, p + r, d)[0] for r in [0 * d] + ring) - 2 * radius


def pull(rng, wall, body, room, length, time, fast):
    """Gravity that bends a device of this length in this time onto the wall, or is some of what drives it (fast);
    elastic walls give way to it by part of their room."""
    catheter, material = body["shape"]["catheter"], body["material"]
    radius, sag = catheter["diameter"] / 2, room * rng.uniform(1.5, 6)
    g = sag * (2 / time ** 2 + 2 * material["young"] * radius ** 2 / material["density"] / length ** 4)
    g = max(g, rng.choice([0, 0.3, 1]) * fast)
    if wall["model"] != "rigid":
        g = min(g, 0.2 * wall["foundation"] * room / material["density"] / radius)
    g = min(g, 0.02 * material["young"] / material["density"] / catheter["length"])  # that it is not crushed by itself
    return g * any_unit(rng)


def draw(folder, rng):
    """A scene as a dictionary, its made walls written into the folder."""
    kind, wall = rng.random(), {"model": "rigid"}
    if kind < 0.35:
        surface = rng.choices([f for f, _ in REAL], [w for _, w in REAL])[0]
        surface = {"file": os.path.join(oracle_runs.DATA, surface), "scale": 0.001}
        corner = 0.001 * read_mesh(surface["file"])
        entry, direction, room, way = place_in(corner, rng)
    else:
        surface, file = {"file": "wall.obj"}, os.path.join(folder, "wall.obj")
        entry, direction, room, way = (made_tube if kind < 0.85 else made_fork)(file, rng)
        corner = read_mesh(file)
        if rng.random() < 0.35:
            wall = {"model": rng.choice(["membrane", "shell"]), "thickness": room * rng.uniform(0.03, 0.3),
                    "young": log_uniform(rng, 2e4, 1e7), "poisson": rng.uniform(0.2, 0.45), "density": 1000,
                    "foundation": log_uniform(rng, 1e5, 1e8), "rims": rng.choice(["free", "held"])}
    radius, extent = room * rng.uniform(0.08, 0.6), np.ptp(corner, axis=(0, 1)).max()
    model = rng.choice(["rod", "rod", "tet4", "tet4", "tet10"])
    length_of = [np.linalg.norm(b - a) for a, b in zip([entry] + way, way)]
    most = min(rng.uniform(0.4, 1.0) * sum(length_of), 16 * room)
    while len(way) > 1 and sum(length_of) > most:
        way, length_of = way[:-1], length_of[:-1]
    length = 1.4 * sum(length_of) + 6 * radius
    stations = max(4, min({"rod": 40, "tet4": 24, "tet10": 10}[model],
                          int(length / radius / rng.uniform(1, 5))))
    aside = across(way[-1] - entry, rng)
    target = way[-1] + aside * min(room * rng.choice([0, 0.3, 0.6, 0.85]), 0.7 * sight(corner, way[-1], aside)[0])
    steps, step = rng.randint(10, 30), log_uniform(rng, 1e-3, 5e-2)
    speed = sum(length_of) / (steps * step) * rng.choice([0.5, 1, 2, 3, 20])
    ahead = max(0, min(straight(corner, entry, direction, radius), 0.7 * length))
    inserted = ahead * rng.choice([0, 0.5, 0.9])
    body = {"name": "device", "model": model,
            "shape": {"catheter": {"length": float(length), "diameter": 2 * radius, "entry": list_of(entry),
                                   "direction": list_of(direction), "stations": stations, "sides": rng.choice([3, 4, 6, 8]),
                                   "inserted": float(inserted)}},
            "material": {"young": log_uniform(rng, 1e6, 160e9), "poisson": rng.uniform(0.2, 0.45),
                         "density": rng.uniform(1000, 8000)},
            "waypoints": [list_of(target)], "waypoint_tolerance": 0.3 * room,
            "drive": {"speed": float(speed), "nodes": rng.choice(["each", "each", "uniform"]),
                      "path_distance": float(room * rng.choice([0.05, 1, 2]))}, "path": {"max_turn_deg": 180}}
    gravity = np.zeros(3)
    if rng.random() < 0.9:
        gravity = pull(rng, wall, body, room, max(inserted, 0.5 * length), steps * step, speed / step)
    how = rng.random()
    if how < 0.2:
        body["drive"] = {"mode": "push", "speed": float(speed), "advance_max": float(speed)}
        if rng.random() < 0.5:
            curvature = min(0.1 / radius, 0.4 * (stations - 1) / length)
            body["drive"]["tip_bend"] = {"length": float(4 * radius), "curvature": float(curvature)}
    elif how < 0.3:  # nobody leads it
        del body["waypoints"], body["drive"]
        body["shape"]["catheter"]["sheath"] = "on"
        body["shape"]["catheter"]["inserted"] = float(max(inserted, 0.5 * ahead))
        fast = room / (steps * step) * log_uniform(rng, 3, 300)
        body["start"] = {"velocity": list_of(any_unit(rng) * fast)}
    if model == "rod" and rng.random() < 0.3:
        body["shape"]["catheter"]["core"] = {"diameter": radius, "young": 160e9, "poisson": 0.3, "density": 8000}
    scene = {"scene": "insertion", "seed": rng.randrange(1000), "step": step, "time_limit": steps * step,
             "gravity": list_of(gravity),
             "vessels": [{"name": "artery", "surface": surface, "wall": wall}], "bodies": [body],
             "contact": {"friction": rng.choice([0, 0, 0, 0.1, 0.5])},
             "planner": {"replans": 1, "budget": 20, "resolution": min(1.9 * radius, max(room / rng.choice([3, 5]), extent / 300))}}
    if rng.random() < 0.2:
        scene["contact"].update(response="elastic", restitution=rng.choice([0.3, 1.0]))
    elif not scene["contact"]["friction"] and rng.random() < 0.3:
        scene["solver"] = {"integrator": "trbdf2"}
    if rng.random() < 0.1:
        at = way[len(way) // 2] + 0.6 * room * across(direction, rng)
        rock = {"name": "clot", "shape": {"sphere": {"centre": list_of(at), "radius": 0.25 * room}}}
        if rng.random() < 0.3:
            rock["body"] = {"model": "tet4", "material": {"young": 1e5, "poisson": 0.4, "density": 1000}}
            most = min(room / step ** 2, 20 / room)  # it falls freely, and not to a crumb
            scene["gravity"] = list_of(gravity * min(1, most / (np.linalg.norm(gravity) or 1)))
        scene["obstacles"] = [rock]
    return scene


def not_finite(value):
    if isinstance(value, dict):
        return any(map(not_finite, value.values()))
    if isinstance(value, list):
        return any(map(not_finite, value))
    return isinstance(value, float) and not math.isfinite(value)


def faults(run):
    """What must never be, in words."""
    report = run.report
    if report is None:
        return ["exit %d without a report: %s" % (run.status, run.said.strip())]
    found, contact = [], report["contact"]
    if oracle_runs.STATUS.get(report["status"]) != run.status:
        found.append("exit %d with status %s" % (run.status, report["status"]))
    if not_finite(report):
        found.append("a figure of the report is not finite")
    if contact["intersections"] or contact["outside_nodes"]:
        found.append("the report has %d intersections and %d outside" % (contact["intersections"],
                                                                          contact["outside_nodes"]))
    if report["steps"] and contact["gap_min"] is not None and not contact["gap_min"] > 0:
        found.append("gap_min %r" % contact["gap_min"])
    if run.crossings or run.outside:
        found.append("the oracle: " + run.places.strip())
    if report["steps"] and not run.frames:
        found.append("no frames")
    return found


def insertion(seed, case, keep=None, timeout=60):
    """Runs one; returns its report (None if there is none), what is wrong with it, and its scene's file if kept."""
    with tempfile.TemporaryDirectory() as folder:
        file = os.path.join(folder, "scene.yaml")
        scene = draw(folder, random.Random("%d:%d" % (seed, case)))
        with open(file, "w") as out:
            json.dump(scene, out, indent=1)
        run = oracle_runs.judged(folder, file, scene, timeout=timeout)
        wrong = faults(run)
        kept = None
        if keep and wrong:
            kept = os.path.join(keep, "seed_%d_case_%d" % (seed, case))
            shutil.rmtree(kept, ignore_errors=True)
            shutil.copytree(folder, kept, ignore=shutil.ignore_patterns("frames"))
        return run.report, run.frames, wrong, kept


def main():
    words = argparse.ArgumentParser(description=__doc__)
    words.add_argument("--count", type=int, default=10000)
    words.add_argument("--seed", type=int, default=1)
    words.add_argument("--first", type=int, default=0, help="number of the first case, to run one again")
    words.add_argument("--jobs", type=int, default=os.cpu_count())
    words.add_argument("--keep", default=os.path.join(oracle_runs.BUILD, "insertions"), help="folder for failed scenes")
    words = words.parse_args()
    verdicts, failed, frames, steps, touched = collections.Counter(), 0, 0, 0, 0
    print("seed %d, %d insertions from number %d" % (words.seed, words.count, words.first), flush=True)
    with concurrent.futures.ThreadPoolExecutor(words.jobs) as pool:
        cases = range(words.first, words.first + words.count)
        for case, (report, judged, wrong, kept) in zip(cases, pool.map(
                lambda i: insertion(words.seed, i, words.keep), cases)):
            verdicts[report["verdict"]["code"] if report else "NO_REPORT"] += 1
            frames += judged
            if report:
                steps += report["steps"]
                touched += bool(report["contact"]["force_max"])
            if report and report["status"] in ("failed", "interrupted"):
                print("seed %d case %d: %s" % (words.seed, case, report["verdict"]["message"]), flush=True)
            if wrong:
                failed += 1
                print("seed %d case %d: %s\n  scene: %s" % (words.seed, case, "\n  ".join(wrong), kept), flush=True)
            if (case - words.first + 1) % 100 == 0:
                print("%d run, %d with wall contact, %d failed" % (case - words.first + 1, touched, failed), flush=True)
    print("%d insertions, %d steps, %d frames judged, %d with wall contact, %d failed" %
          (words.count, steps, frames, touched, failed))
    print("  " + ", ".join("%s %d" % pair for pair in verdicts.most_common()))
    return failed > 0


if __name__ == "__main__":
    sys.exit(main())
