#!/usr/bin/python3
"""The launch file of the molecules scene: it plans by itself, both bodies and their skins are published."""
import json
import subprocess
import sys
import unittest

import numpy as np
import rospy
import rostest
from catnav.msg import MeshState, MeshTopology, Verdict

from shapes import Client, name_of


class Molecules(unittest.TestCase):
    def test_two_bodies_with_skins_fall_and_nothing_crosses(self):
        topologies, states = {}, {}
        rospy.Subscriber('/catnav/catheter_topology', MeshTopology, lambda m: topologies.update({m.name: m}))
        rospy.Subscriber('/catnav/catheter_mesh', MeshState, lambda m: states.setdefault(m.topology, []).append(m))
        client = Client()
        answer = client.plan([], scene='molecules.yaml')
        while answer.verdict.code == Verdict.BUSY:  # with the launch file's own call
            rospy.sleep(0.5)
            answer = client.plan([], scene='molecules.yaml')
        self.assertEqual(answer.verdict.code, Verdict.RAN, f'{name_of(answer.verdict)}: {answer.verdict.message}')
        report = json.loads(answer.report_json)
        self.assertEqual(answer.steps, 16)
        self.assertEqual((report['contact']['intersections'], report['contact']['outside_nodes']), (0, 0))
        self.assertEqual([body['model'] for body in report['bodies']], ['molecules', 'molecules'])
        rospy.sleep(1)
        self.assertEqual(set(topologies), {'bear', 'cushion', 'bear_skin', 'cushion_skin'})
        echo = ['rostopic', 'echo', '-n', '4', '/catnav/catheter_topology/name']  # late, by a process of its own
        said = subprocess.run(echo, capture_output=True, text=True, timeout=60).stdout
        self.assertEqual({word.strip('"') for word in said.split()} - {'---'}, set(topologies))
        for name in ('bear_skin', 'cushion_skin'):
            seen = states[topologies[name].id]
            low = [np.array([p.z for p in state.vertices]).min() for state in (seen[0], seen[-1])]
            self.assertLess(low[1], low[0])  # it has fallen
            self.assertGreater(low[1], 0)    # and not through the plate
            self.assertEqual(len(seen[-1].stress), len(seen[-1].vertices))


if __name__ == '__main__':
    rospy.init_node('molecules')
    rostest.rosrun('catnav', 'molecules', Molecules, sys.argv)
