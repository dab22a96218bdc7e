"""What is left out, measured: every entry of leave_out forced on and off on a scene that could need it."""
import numpy

import problems

ENTRIES = ("self_contact", "refit", "refactor", "wall_solve", "inertia", "stress")

# A wire through a bent tube, drawn along a path: walls, drive and contact at work, in a few seconds.
BEND = [[0, 0, 0], [0, 0, 0.02], [0.002, 0, 0.035], [0.008, 0, 0.048], [0.018, 0, 0.058]]


def tube_scene(end):
    return {"scene": "bend", "step": 0.01, "time_limit": end, "contact": {"self": "auto"},
            "planner": {"resolution": 1.0e-3},
            "vessels": [{"name": "vessel", "shape": {"tube": {"axis": BEND, "radius": 0.004}}}],
            "bodies": [{"name": "body", "shape": {"catheter": {
                "length": 0.06, "diameter": 2.0e-3, "entry": [0, 0, 0.001], "direction": [0, 0, 1], "stations": 21}},
                "model": "tet4", "material": {"young": 1.0e7, "poisson": 0.3, "density": 1100},
                "waypoints": [[0.006, 0, 0.045]], "limits": [{"quantity": "volume", "limit": 0.5}]}]}


def soft_scene(end):
    """The same with a wall that gives way, and in places turns by more than a tenth."""
    scene = tube_scene(end)
    scene["vessels"][0]["wall"] = {"model": "membrane", "thickness": 1e-4, "young": 1e5, "poisson": 0.4,
                                   "density": 1000, "foundation": 1e6}
    return scene


def swing_scene(end):
    return {"scene": "swing", "step": 0.01, "time_limit": end, "gravity": [0, 0, -problems.GRAVITY],
            "contact": {"method": "none"},
            "bodies": [dict(problems.catheter(0.2, 91, fixed={"box": problems.HELD}), name="body")]}


def run(study):
    end = 0.3 if study.quick else 4.0
    scenes = {"bend": tube_scene(end), "soft": soft_scene(end), "swing": swing_scene(0.2 if study.quick else 1.0)}
    files = {name: study.write_scene("left_out_" + name, scene) for name, scene in scenes.items()}
    rows = []
    for model in study.models[:1] if study.quick else study.models:
        for what in ENTRIES:
            for name, file in files.items():
                if name == "soft" and what != "wall_solve":
                    continue
                rows.append(measure(study, model, what, name, file))
    study.table("left_out", rows)
    return rows


def measure(study, model, what, name, file):
    """One entry on and off: how far apart the last frames are, and the time between. A wall that gives way would be
    rigid with it on: left to itself it shows from when on it has to turn."""
    key, runs = "leave_out." + what, 1 if study.quick else 3
    left_out = "auto" if name == "soft" else "on"
    both = {}
    for word in (left_out, "off"):
        outcomes = [study.run(file, {"bodies.0.model": model, key: word}, points=True) for _ in range(runs)]
        both[word] = min(outcomes, key=lambda outcome: outcome.solve_s if outcome.solve_s is not None else 1e9)
    on, off = both[left_out], both["off"]
    row = {"what": what, "scene": name, "model": model, "status_on": on.status, "status_off": off.status,
           "time_on_s": on.solve_s, "time_off_s": off.solve_s, "command_on": on.command, "command_off": off.command}
    if on.solve_s and off.solve_s:
        row["time_saved_s"] = off.solve_s - on.solve_s
    if on.last is not None and off.last is not None and on.figure("steps") == off.figure("steps"):
        size = numpy.linalg.norm(numpy.ptp(off.rest, 0))
        row["difference"] = float(numpy.linalg.norm(on.last - off.last, axis=1).max() / size)
    entry = next((e for e in on.figure("left_out") or [] if e["what"] == what), None)
    if entry:
        row.update(reported_error=entry["error"], reported_time_saved_s=entry["time_saved_s"], why=entry["why"])
    row["message"] = next((o.message for o in (on, off) if o.status not in ("ran", "reached", "time_limit")), None)
    return row
