#!/usr/bin/python3
"""A catheter's skin as rviz and clients see it."""
import sys
import unittest

import numpy as np
import rospy
import rostest
from catnav.msg import MeshState, MeshTopology, Verdict
from diagnostic_msgs.msg import DiagnosticArray
from visualization_msgs.msg import Marker

from shapes import Client, name_of, tube


class Skin(unittest.TestCase):
    def test_the_skin_is_published_beside_the_body_and_shown_in_its_place(self):
        client = Client()
        topologies, states, markers = {}, {}, []
        subscribers = [
            rospy.Subscriber('/catnav/catheter_topology', MeshTopology, lambda m: topologies.update({m.name: m})),
            rospy.Subscriber('/catnav/catheter_mesh', MeshState,
                             lambda m: states.setdefault(m.topology, []).append(m)),
            rospy.Subscriber('/catnav/catheter_marker', Marker, markers.append)]
        self.assertTrue(client.send(*tube([0, 0, 0], [0, 0, 0.08], 0.004)))
        while not all(s.get_num_connections() for s in subscribers):
            rospy.sleep(0.02)
        answer = client.plan([(0, 0, 0.01), (0, 0, 0.06)])
        self.assertEqual(answer.verdict.code, Verdict.REACHED, f'{name_of(answer.verdict)}: {answer.verdict.message}')
        rospy.sleep(0.5)
        self.assertEqual(set(topologies), {'catheter', 'catheter_skin'})
        body, skin = topologies['catheter'], topologies['catheter_skin']
        self.assertGreater(len(body.tetrahedra), 0)
        self.assertEqual(len(skin.tetrahedra), 0)
        last = states[skin.id][-1]
        self.assertEqual(len(last.vertices) % 20, 0)
        self.assertEqual(len(last.stress), len(last.vertices))
        self.assertEqual(last.step, states[body.id][-1].step)
        x = np.array([(p.x, p.y, p.z) for p in last.vertices])
        self.assertTrue(np.isfinite(x).all())
        self.assertLess(np.hypot(x[:, 0], x[:, 1]).max(), 0.004)  # inside the tube
        tip = np.array([(p.x, p.y, p.z) for p in states[body.id][-1].vertices])[:, 2].max()
        self.assertAlmostEqual(x[:, 2].max(), tip, delta=2e-5)
        # rviz: triangles of the skin alone, and none of those still in the sheath
        self.assertTrue(markers)
        first, end = markers[0], markers[-1]
        self.assertEqual(len({m.ns for m in markers if m.points}), 1)
        self.assertGreater(len(end.points), len(first.points))
        self.assertLess(len(end.points), 3 * len(skin.triangles))
        shown = np.array([(p.x, p.y, p.z) for p in end.points])
        self.assertGreater(shown[:, 2].min(), 0.01 - 2 * 0.06 / 40)

    def test_markers_are_thinned_to_the_triangles_that_they_may_have_and_the_rest_is_counted(self):
        client, markers, topologies = Client('/thin'), {'artery': [], 'catheter': []}, []
        subscribers = [rospy.Subscriber(f'/thin/{what}_marker', Marker, markers[what].append) for what in markers]
        subscribers.append(rospy.Subscriber('/thin/catheter_topology', MeshTopology, topologies.append))
        while not all(s.get_num_connections() for s in subscribers):
            rospy.sleep(0.02)
        vertices, triangles = tube([0, 0, 0], [0, 0, 0.08], 0.004)
        self.assertTrue(client.send(vertices, triangles))
        answer = client.plan([(0, 0, 0.01), (0, 0, 0.06)])
        self.assertEqual(answer.verdict.code, Verdict.REACHED, answer.verdict.message)
        rospy.sleep(0.5)
        self.assertGreater(min(len(triangles), len(topologies[0].triangles)), 100)
        for what, seen in markers.items():
            most = max(len(m.points) for m in seen)
            self.assertLessEqual(most, 150, what)
            self.assertGreater(most, 0, what)
        while True:
            for status in rospy.wait_for_message('/diagnostics', DiagnosticArray, 30).status:
                if 'thin' in status.name and status.values:
                    left_out = {v.key: v.value for v in status.values}['triangles left out of markers']
                    self.assertGreaterEqual(int(left_out), len(triangles) - 50)
                    return


if __name__ == '__main__':
    rospy.init_node('skin')
    rostest.rosrun('catnav', 'skin', Skin, sys.argv)
