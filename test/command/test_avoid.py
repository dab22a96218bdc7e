#!/usr/bin/python3
"""A fish and a predator on a way of its own: whole runs keep them apart, by waiting where that helps, on another way
where it does not."""
import os
import unittest

from control_runs import Runs, distance, points, scene

PREDATOR = scene("predator")
RADIUS, GAP, STEP = 0.2, 0.01, 0.02  # of the scene [m], [m], [s]


class Avoid(Runs):
    def swim(self, begin, end, speed, **others):
        """Report of a run, and the least distance of any node from the predator in any frame."""
        way, frames = distance(begin, end), "frames_%d" % len(os.listdir(self.folder.name))
        report = self.run_it(PREDATOR, "obstacles.predator.shape.sphere.centre=[%g,%g,0]" % begin,
                             "obstacles.predator.path.waypoints=[[%g,%g,0]]" % end,
                             "obstacles.predator.path.speed=%g" % speed, frames=frames, **others)
        self.assertEqual((report["contact"]["intersections"], report["contact"]["outside_nodes"]), (0, 0))
        folder, least = self.path(frames), float("inf")
        for piece in sorted(os.listdir(folder)):
            if not piece.endswith(".vtu"):
                continue
            time = STEP * int(piece[len("fish_"):-len(".vtu")])
            done = min(1, time * speed / way)
            at = [a + done * (b - a) for a, b in zip(begin, end)] + [0]
            least = min(least, min(distance(p, at) for p in points(folder, piece)) - RADIUS)
        return report, least

    def test_it_waits_for_a_predator_that_crosses_its_way(self):
        calm, _ = self.swim((1, -9), (1, -8.9), 0.01, status=0)
        report, least = self.swim((1, -1.4), (1, 1.4), 0.7, status=0)
        self.assertEqual(report["replans"], 0)
        self.assertGreaterEqual(least, GAP)
        self.assertGreater(report["steps"], calm["steps"] + 10)  # it has waited
        again, same = self.swim((1, -1.4), (1, 1.4), 0.7, status=0, threads=2)
        self.assertEqual((report["bodies"], report["drive"], least), (again["bodies"], again["drive"], same))

    def test_it_takes_another_way_where_one_comes_along_its_own(self):
        report, least = self.swim((2.6, 0), (-1.5, 0), 0.4, status=0)
        self.assertGreaterEqual(report["replans"], 1)
        self.assertGreaterEqual(least, GAP)

    def test_one_that_stays_at_its_goal_is_named(self):
        report, least = self.swim((2, -1), (2, 0), 0.3, status=2)
        self.assertEqual((report["verdict"]["code"], report["verdict"]["quantity"]), ("LIMIT_BROKEN", "clearance"))
        self.assertIn("predator", report["verdict"]["message"])
        self.assertGreaterEqual(least, GAP)


if __name__ == "__main__":
    unittest.main()
