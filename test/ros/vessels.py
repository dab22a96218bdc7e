#!/usr/bin/python3
"""Every route that index.json of CATNAV_DATA lists is driven to its target; every route is forced there, so a limit
below its peak must end the plan, with the quantity, the value and the place."""
import json
import os
import sys
import unittest

import numpy as np
import rospy
import rostest
from catnav.msg import Limit, Verdict

from shapes import DATA, PATIENCE, Client, name_of, read_surface

with open(os.path.join(DATA, 'index.json')) as file:
    VESSELS = json.load(file)['vessels']


class Vessels(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.client = Client()

    def drive(self, vessel):
        scale = vessel['scale']
        vertices, triangles = read_surface(os.path.join(DATA, vessel['file']))
        vertices = np.array(vertices) * scale
        self.assertTrue(self.client.send(vertices, triangles, wait=60 * PATIENCE), 'the mesh is not in force')
        for route in vessel['routes']:
            with self.subTest(target=route['target']):
                points = np.array([route['entry'], route['target']]) * scale
                answer = self.client.plan(points)
                verdict = answer.verdict
                self.assertEqual(name_of(verdict), route['expect'], verdict.message)
                report = json.loads(answer.report_json)
                self.assertEqual(report['contact']['intersections'], 0)
                self.assertEqual(report['contact']['outside_nodes'], 0)
                self.assertGreater(answer.gap_min, 0)
                if verdict.code == Verdict.REACHED:
                    tip = report['bodies'][0]['tip']
                    self.assertLessEqual(np.linalg.norm(np.array(tip) - points[-1]), 2e-3)
                    peak = [l['worst'] for l in report['limits'] if l['quantity'] == 'stress'][0]
                    self.stopped_by(points, peak / 4, vertices)

    def stopped_by(self, points, limit, vertices):
        answer = self.client.plan(points, limits=[Limit('', 'stress', 'max', limit)])
        verdict = answer.verdict
        self.assertEqual(verdict.code, Verdict.LIMIT_BROKEN, f'{name_of(verdict)}: {verdict.message}')
        self.assertEqual((verdict.quantity, verdict.body, verdict.limit), ('stress', 'catheter', limit))
        self.assertGreater(verdict.value, limit)
        where = [verdict.position.x, verdict.position.y, verdict.position.z]
        self.assertTrue(np.all(where >= vertices.min(0) - 0.01) and np.all(where <= vertices.max(0) + 0.01), where)
        self.assertGreater(verdict.time, 0)
        self.assertGreaterEqual(verdict.element, 0)
        kept = [l for l in json.loads(answer.report_json)['limits'] if l['quantity'] == 'stress'][0]
        self.assertLessEqual(kept['worst'], limit)  # the last valid state is what is left


def case(vessel):
    return lambda self: self.drive(vessel)


for entry in VESSELS:
    if entry.get('routes'):
        name = os.path.splitext(os.path.basename(entry['file']))[0]
        setattr(Vessels, 'test_routes_through_' + name, case(entry))

if __name__ == '__main__':
    rospy.init_node('vessels')
    rostest.rosrun('catnav', 'vessels', Vessels, sys.argv)
