#!/usr/bin/python3
"""The hard cases of Incremental Potential Contact (Li et al. 2020), short, each step judged by the oracle: a mat and a
bunny on a spike, a rod wound up at its clamp, a dolphin in a funnel. With CATNAV_LONG 100 steps of each, with
CATNAV_HARD=N as many as it says. argv[1] or CATNAV is the command."""
import json
import math
import os
import tempfile
import unittest

from oracle_runs import DATA, ORACLE, judged

TETS = os.path.join(os.path.abspath(os.environ.get("CATNAV_DATA", DATA)), "tets")
STEPS = int(os.environ.get("CATNAV_HARD", "100" if os.environ.get("CATNAV_LONG") else "0"))
SPIKE = """v 0.5 0 -0.5
v 0.5 0 0.5
v -0.5 0 0.5
v -0.5 0 -0.5
v 0 3 0
f 1 5 2
f 2 5 3
f 3 5 4
f 4 5 1
f 3 4 1
f 3 1 2
"""  # the boundary of ipc_spike.msh


def soft(name, file, young, **more):
    """A body from a file of tetrahedra."""
    shape = {"file": os.path.join(TETS, file)}
    shape.update(more.pop("shape", {}))
    return dict({"name": name, "shape": shape, "model": "tet4",
                 "material": {"young": young, "poisson": 0.4, "density": 1000}}, **more)


@unittest.skipUnless(os.access(ORACLE, os.X_OK), "the oracle is not built")
class Hard(unittest.TestCase):
    def run_scene(self, steps, step, touches=True, **scene):
        steps = STEPS or steps
        scene.update(scene="hard", step=step, time_limit=step * (steps - 0.5))
        for body in scene["bodies"]:
            if not os.path.exists(body["shape"]["file"]):
                self.skipTest("no " + body["shape"]["file"])
        with tempfile.TemporaryDirectory() as folder:
            file = os.path.join(folder, "scene.yaml")
            with open(os.path.join(folder, "spike.obj"), "w") as out:
                out.write(SPIKE)
            with open(file, "w") as out:
                json.dump(scene, out)
            run = judged(folder, file, scene, timeout=36000)
        self.assertEqual((run.crossings, run.outside), (0, 0), run.places)
        self.assertIn(run.report["status"], ("ran", "reached", "time_limit"), run.said)
        self.assertEqual(run.frames, run.report["steps"] + 1)
        self.assertEqual(run.report["contact"]["intersections"] + run.report["contact"]["outside_nodes"], 0)
        if touches:
            self.assertGreater(run.report["contact"]["force_max"], 0)
            self.assertGreater(run.report["contact"]["gap_min"], 0)
        return run

    def spike_under(self, body, scale, steps=12):
        return self.run_scene(steps, 0.02, gravity=[0, -9.81, 0], bodies=[body], contact={"self": "on"}, obstacles=[
            {"name": "spike", "surface": {"file": "spike.obj", "scale": scale}}])

    def test_a_mat_falls_on_a_spike(self):
        body = soft("mat", "ipc_mat20x20.msh", 2e4, shape={"translate": [0, 0.32, 0]}, start={"velocity": [0, -2, 0]})
        self.spike_under(body, 0.1)

    def test_a_bunny_falls_on_a_spike(self):
        body = soft("bunny", "ipc_bunny.msh", 5e4, shape={"scale": 0.1, "translate": [0.05, 0.35, 0]},
                    start={"velocity": [0, -2, 0]})
        self.spike_under(body, 0.1, steps=4)

    def test_a_rod_winds_itself_up_at_its_clamp(self):
        self.run_scene(20, 0.01, touches=STEPS > 100, contact={"self": "on"}, bodies=[
            soft("rod", "ipc_rod.msh", 1e6, fixed={"box": [[-0.51, -1, -1], [-0.45, 1, 1]]},
                 start={"spin": [150, 0, 0]})])

    def dolphin(self, steps, height, speed, gravity, touches=True):
        along, middle, scale = (0.6818, -0.5777, 0.4488), (28.42, 28.78, 44.35), 0.003  # of its file; 0.4 m long
        angle, sine = math.acos(-along[1]), math.hypot(along[0], along[2])  # turns its length to -y
        turn = [angle * along[2] / sine, 0, -angle * along[0] / sine]
        k, p, dot = [w / angle for w in turn], [scale * m for m in middle], 0
        dot = sum(a * b for a, b in zip(k, p))
        cross = [k[1] * p[2] - k[2] * p[1], k[2] * p[0] - k[0] * p[2], k[0] * p[1] - k[1] * p[0]]
        at = [p[i] * math.cos(angle) + cross[i] * math.sin(angle) + k[i] * dot * (1 - math.cos(angle)) for i in range(3)]
        self.run_scene(steps, 0.01, touches=touches, gravity=[0, -gravity, 0], contact={"self": "on"}, obstacles=[
            {"name": "funnel", "surface": {"file": os.path.join(DATA, "tets", "ipc_obstacle_funnel.obj")}}],
            bodies=[soft("dolphin", "ipc_dolphin5K.msh", 1e4, start={"velocity": [0, -speed, 0]},
                         shape={"scale": scale, "rotate": turn, "translate": [-at[0], height - at[1], -at[2]]})])

    def test_a_dolphin_falls_into_a_funnel(self):
        self.dolphin(4, 0.652, 0.5, 9.81)

    @unittest.skipUnless(STEPS, "minutes a step: CATNAV_HARD=N")
    def test_a_dolphin_is_pressed_into_a_funnel(self):
        self.dolphin(3, 0.72, 2, 100, touches=STEPS > 20)


if __name__ == "__main__":
    unittest.main()
