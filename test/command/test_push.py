#!/usr/bin/python3
"""The push drive in a vessel that forks: the tip takes the arm of its path by steering alone, and what the base
did, and may do, stands in the report."""
import unittest

from control_runs import Runs, distance, scene

FORK, BEND = scene("fork"), scene("bend")
PUSH = ("bodies.0.drive.mode=push", "bodies.0.model=rod", "bodies.0.drive.tip_bend.length=0.01",
        "bodies.0.drive.tip_bend.curvature=80", "time_limit=40")
TIGHT = "bodies.0.waypoints=[[0.0145, 0, 0.08], [0, 0, 0.155]]"
WIDE = "bodies.0.waypoints=[[-0.03, 0, 0.08], [0, 0, 0.155]]"
STEP, ADVANCE, TWIST = 0.02, 0.05, 3.14  # of the scene, and the drive's default limits


class Push(Runs):
    def pushed(self, *settings, **others):
        report = self.run_it(FORK, *PUSH, *settings, **others)
        self.never_in_the_wall(report)
        self.within_its_limits(report)
        return report

    def within_its_limits(self, report):
        """In every step, also in those that drew it back: the list is not thinned out below 1,000 steps."""
        notes = report["drive"]["insertion"]
        self.assertEqual(len(notes), report["steps"] + 1)
        for a, b in zip(notes, notes[1:]):
            self.assertAlmostEqual(b["time"] - a["time"], STEP, delta=1e-9)
            self.assertLessEqual(abs(b["advance"] - a["advance"]), ADVANCE * STEP * (1 + 1e-9))
            self.assertLessEqual(abs(b["twist"] - a["twist"]), TWIST * STEP * (1 + 1e-9))
        self.assertEqual((notes[0]["advance"], notes[0]["twist"]), (0, 0))

    def reached(self, report):
        self.assertEqual(report["verdict"]["code"], "REACHED", report["verdict"]["message"])
        self.assertLessEqual(distance(report["bodies"][0]["tip"], (0, 0, 0.155)), 2e-3)

    def energy(self, report):
        return [limit["worst"] for limit in report["limits"] if limit["quantity"] == "energy"][0]

    def test_the_tip_takes_the_arm_of_its_path_and_a_limit_drives_it_back_into_the_other(self):
        tight, wide, again = self.pushed(TIGHT), self.pushed(WIDE), self.pushed(WIDE, threads=2)
        self.assertEqual(wide["drive"], again["drive"])  # bit for bit
        self.assertEqual(wide["bodies"], again["bodies"])
        for report in (tight, wide):  # each by its own waypoint
            self.reached(report)
            self.assertEqual(report["replans"], 0)
        self.assertLess(self.energy(wide), 0.6 * self.energy(tight))
        other = self.pushed("bodies.0.limits.2.limit=%.17g" % (0.65 * self.energy(tight)))
        self.reached(other)
        self.assertGreaterEqual(other["replans"], 1)
        advance = [note["advance"] for note in other["drive"]["insertion"]]
        farthest = max(range(len(advance)), key=lambda i: max(advance[:i + 1]) - advance[i])
        self.assertGreater(max(advance[:farthest + 1]) - advance[farthest], 0.05)  # drawn back, not put back

    def test_a_steered_end_takes_either_arm_and_is_bent_no_faster_than_it_can(self):
        for way in (TIGHT, WIDE):
            report = self.pushed(way, "bodies.0.drive.tip_bend.steered=on", "bodies.0.drive.tip_bend.length=0.02")
            self.reached(report)
            notes = report["drive"]["insertion"]
            self.assertEqual(notes[0]["curvature"], 0)
            self.assertGreater(max(abs(note["curvature"]) for note in notes), 20)
            for a, b in zip(notes, notes[1:]):  # half a second from straight to 80 1/m
                self.assertLessEqual(abs(b["curvature"] - a["curvature"]), 80 * STEP / 0.5 * (1 + 1e-9))

    def test_what_it_is_not_made_for_is_said_in_words(self):
        for setting, word in (("bodies.0.shape.catheter.sheath=off", "sheath: on"),
                              ("bodies.0.drive.tip_bend.length=0", "tip_bend"),
                              ("bodies.0.drive.tip_bend.curvature=1000", "half a circle")):
            report = self.run_it(BEND, *PUSH, setting, status=1)
            self.assertEqual(report["verdict"]["code"], "BAD_INPUT")
            self.assertIn(report["verdict"]["fault"], ("UNSUITED", "NEEDED", "AT_ODDS"))
            self.assertIn(word, report["verdict"]["message"])
            self.assertEqual(report["drive"]["insertion"], [])


if __name__ == "__main__":
    unittest.main()
