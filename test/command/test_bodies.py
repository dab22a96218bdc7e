#!/usr/bin/python3
"""Bodies among each other, with obstacles that move or give way, and with themselves: physics from the report."""
import unittest
import control_runs
from control_runs import Runs


def scene(name):
    return control_runs.scene(name).replace("control_", "bodies_")


class Bodies(Runs):
    def free(self, name, *settings, code=0):
        report = self.run_it(scene(name), *settings, status=code)
        contact = report["contact"]
        self.assertEqual((contact["intersections"], contact["outside_nodes"]), (0, 0), name)
        self.assertGreater(contact["gap_min"], 0)
        return report

    def body(self, report, name):
        return next(b for b in report["bodies"] if b["name"] == name)

    def test_the_lower_of_two_boxes_carries_the_upper(self):
        report = self.free("stack")
        low, high = self.body(report, "low"), self.body(report, "high")
        self.assertGreater(high["com"][2] - low["com"][2], 0.085)
        self.assertLess(high["kinetic"] + low["kinetic"], 1e-4)
        weight = 9.81 * 1000 * (0.1 ** 3 + 0.08 ** 3)
        self.assertLess(abs(report["solver"]["residual_max"]), 1.01e-3)
        self.assertGreater(report["contact"]["force_max"], weight)

    def test_a_moving_ball_gives_a_free_box_its_speed_and_more(self):
        report = self.free("push")
        box = self.body(report, "box")
        mass = 1000 * 0.1 ** 3
        speed = box["momentum"][0] / mass
        self.assertGreaterEqual(speed, 0.499)  # pushed at 0.5 m/s, at most thrown off at twice that
        self.assertLessEqual(speed, 1.0)
        for k in 1, 2:
            self.assertLess(abs(box["momentum"][k]), 1e-3 * mass)

    def test_a_soft_bed_sinks_under_a_box_by_what_its_stiffness_allows(self):
        report = self.free("soft")
        box, bed = self.body(report, "box"), self.body(report, "bed")
        self.assertLess(box["com"][2], 0.05)
        self.assertGreater(box["com"][2], 0.04)
        self.assertGreater(bed["energy"], 1e-3)

    def test_a_wire_that_falls_on_itself_never_crosses_itself(self):
        report = self.free("coil")
        self.assertLess(self.body(report, "wire")["com"][2], -0.8)
        crossed = self.run_it(scene("coil"), "contact.self=off", status=0)
        self.assertEqual(crossed["contact"]["outside_nodes"], 0)

    def test_an_artery_that_gives_way_is_pressed_less_than_a_rigid_one(self):
        soft = self.free("tube")
        rigid = self.free("tube", "leave_out.wall_solve=on")
        for report in soft, rigid:
            self.assertEqual(report["status"], "reached")
        self.assertGreater(self.body(soft, "artery")["energy"], 0)
        self.assertLess(soft["contact"]["force_max"], rigid["contact"]["force_max"])
        self.assertTrue(any(entry["what"] == "wall_solve" for entry in rigid["left_out"]))

    def test_a_shell_gives_way_too(self):
        report = self.free("tube", "vessels.artery.wall.model=shell")
        self.assertEqual(report["status"], "reached")
        self.assertGreater(self.body(report, "artery")["energy"], 0)


if __name__ == "__main__":
    unittest.main()
