#!/usr/bin/python3
"""Branches that rejoin: with a limit between the measured peaks of the two ways the node must give up the one it
tried first and arrive by the other, every limit kept."""
import json
import os
import sys
import unittest

import numpy as np
import rospy
import rostest
from catnav.msg import Limit, Verdict

from shapes import DATA, Client, along, isosurface, name_of, read_surface


def fork():
    """A trunk that parts into a winding, shorter arm and a wide, longer one, and joins again; radius 3 mm."""
    t = np.linspace(0, 1, 60)
    fade = np.clip(6 * np.minimum(t, 1 - t), 0, 1)
    fade = fade * fade * (3 - 2 * fade)
    z = 0.03 + 0.14 * t
    winding = np.stack([0.006 * np.sin(6 * np.pi * t) * fade, 0 * t, z], 1)
    wide = np.stack([-0.04 * np.sin(np.pi * t) ** 2, 0 * t, z], 1)
    ways = [along(a, 0.003) for a in (winding, wide, [[0, 0, 0], [0, 0, 0.03]], [[0, 0, 0.17], [0, 0, 0.2]])]
    return isosurface(lambda x: np.min([way(x) for way in ways], 0), (-0.046, -0.005, -0.004), (0.012, 0.005, 0.206),
                      0.002)


class Fork(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.client = Client()

    def peak(self, points):
        answer = self.client.plan(points)
        self.assertEqual(answer.verdict.code, Verdict.REACHED, answer.verdict.message)
        self.assertEqual(answer.replans, 0)
        stress = [l for l in json.loads(answer.report_json)['limits'] if l['quantity'] == 'stress']
        return stress[0]['worst'], [p.pose.position for p in answer.path.poses]

    def goes_the_other_way(self, entry, target, other):
        first, path = self.peak([entry, target])
        second, _ = self.peak([entry, other, target])
        away = min(np.linalg.norm([p.x - other[0], p.y - other[1], p.z - other[2]]) for p in path)
        self.assertGreater(away, 0.01, 'the first plan goes the other way already')
        self.assertLess(second, 0.95 * first)

        limit = (first + second) / 2
        answer = self.client.plan([entry, target], limits=[Limit('', 'stress', 'max', limit)])
        self.assertEqual(answer.verdict.code, Verdict.REACHED, answer.verdict.message)
        self.assertGreaterEqual(answer.replans, 1)
        for kept in json.loads(answer.report_json)['limits']:
            self.assertLessEqual(kept['worst'], kept['limit'])
        by = min(np.linalg.norm([p.pose.position.x - other[0], p.pose.position.y - other[1],
                                 p.pose.position.z - other[2]]) for p in answer.path.poses)
        self.assertLess(by, 0.004)
        return second

    def impossible(self, entry, target, limit):
        answer = self.client.plan([entry, target], limits=[Limit('', 'stress', 'max', limit)])
        verdict = answer.verdict
        self.assertIn(verdict.code, (Verdict.LIMIT_BROKEN, Verdict.NO_PATH), name_of(verdict))
        self.assertEqual(verdict.quantity, 'stress')
        self.assertEqual(verdict.body, 'catheter')
        self.assertEqual(verdict.limit, limit)
        self.assertGreater(verdict.value, limit)
        self.assertGreaterEqual(verdict.element, 0)
        where = np.array([verdict.position.x, verdict.position.y, verdict.position.z])
        self.assertLess(np.linalg.norm(where - entry), 0.3)
        self.assertTrue(np.any(where != 0))
        self.assertEqual(json.loads(answer.report_json)['status'], 'infeasible')

    def test_a_fork_made_in_code(self):
        self.assertTrue(self.client.send(*fork()))
        entry, target = (0, 0, 0.005), (0, 0, 0.19)
        least = self.goes_the_other_way(entry, target, (-0.04, 0, 0.1))
        self.impossible(entry, target, least / 20)

    def test_the_phantom_whose_branches_rejoin(self):
        file = os.path.join(DATA, 'vessels/beamadapter/beamadapter_phantom.obj')
        if not os.path.exists(file):
            self.skipTest('no phantom in this folder')
        vertices, triangles = read_surface(file)
        self.assertTrue(self.client.send(np.array(vertices) * 1e-3, triangles))
        self.goes_the_other_way((-0.001, 0, 0), (-0.2058, 0.011, 0.0019), (-0.1, -0.025, 0.009))


if __name__ == '__main__':
    rospy.init_node('fork')
    rostest.rosrun('catnav', 'fork', Fork, sys.argv)
