#!/usr/bin/python3
"""A catheter swings for a second by each model, each step solved, also where single solves end in wrong states:
large steps, stiff and heavy wires. The figures of the linear mesh are those of an independent Newton solver."""
import math
import os
import unittest

from control_runs import DATA, Runs

SWING = os.path.join(DATA, "scenes", "swing.yaml")
ROD = "bodies.0.model=rod"
HARD = {"large steps": ("step=0.0333333333333",),
        "ten times as stiff and heavy": ("bodies.0.material.young=8.7e7", "gravity=[0, 0, -98.1]"),
        "a thousand times": ("bodies.0.material.young=8.7e9", "gravity=[0, 0, -9810]")}


def stations(n):
    return "bodies.0.shape.catheter.stations=%d" % n


class Swing(Runs):
    def swing(self, *settings):
        """Displacement of the tip after a run whose steps were all solved."""
        report = self.run_it(SWING, *settings, status=0)
        self.assertEqual(report["status"], "ran")
        self.assertLessEqual(report["solver"]["residual_max"], 1e-3)
        self.assertEqual(report["solver"]["inverted_max"], 0)
        self.assertGreater(report["solver"]["newton_max"], 1)
        tip = report["bodies"][0]["tip"]
        return (tip[0] - 1, tip[1], tip[2])

    def near(self, a, b, within):
        self.assertLess(math.dist(a, b), within, "%s, %s" % (a, b))

    def test_the_papers_mesh_swings_as_a_solved_step_says(self):
        self.near(self.swing(), (-1.84, 0, -0.28), 0.03)

    def test_one_linear_solve_a_step_swings_otherwise_and_its_residual_says_so(self):
        report = self.run_it(SWING, "solver.newton=1", status=0)
        self.assertGreater(report["solver"]["residual_max"], 0.5)
        self.assertGreater(report["bodies"][0]["tip"][2], -0.15)

    def test_a_rod_and_second_order_tetrahedra_swing_alike(self):
        rod = self.swing(ROD)
        self.near(rod, self.swing(ROD, stations(909)), 1e-3)
        self.near(rod, self.swing(ROD, stations(114)), 1e-2)
        self.near(rod, self.swing("bodies.0.model=tet10", stations(101)), 3e-2)

    def test_hard_cases_end_where_exact_solves_end(self):
        for name, settings in HARD.items():
            for model in ("tet4", "rod"):
                with self.subTest(name, model=model):
                    chosen = settings + ("bodies.0.model=" + model,)
                    self.near(self.swing(*chosen), self.swing(*chosen, "solver.tolerance=1e-8"), 1e-2)

    def test_second_order_in_time_needs_fewer_steps(self):
        fine = self.swing(ROD, "solver.integrator=trbdf2", "step=1.25e-3")

        def error(scheme, step):
            return math.dist(self.swing(ROD, "solver.integrator=" + scheme, "step=%g" % step), fine)
        self.assertLess(error("trbdf2", 0.01), 0.5 * error("euler", 0.0025))
        self.assertLess(error("midpoint", 0.0025), 0.5 * error("euler", 0.0025))


if __name__ == "__main__":
    unittest.main()
