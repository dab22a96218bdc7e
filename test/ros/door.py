#!/usr/bin/python3
"""The node's doors: every refusal in words, the node alive after each, good calls served between them."""
import json
import subprocess
import sys
import threading
import unittest

import numpy as np
import rospy
import rostest
from catnav.msg import Limit, MeshState, MeshTopology, Verdict
from diagnostic_msgs.msg import DiagnosticArray
from nav_msgs.msg import Path
from std_msgs.msg import Header

from shapes import Client, name_of, tube

GOOD = tube([0, 0, 0], [0, 0, 0.08], 0.004)
ROUTE = [(0, 0, 0.01), (0, 0, 0.06)]


class Door(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.client = Client()

    def expect(self, answer, code, *words):
        self.assertEqual(answer.verdict.code, code, f'{name_of(answer.verdict)}: {answer.verdict.message}')
        for word in words:
            self.assertIn(word, answer.verdict.message)
        return answer

    def refused(self, vertices, triangles, *words):
        """Sent as the only mesh so far or after a good one: never in force."""
        self.assertFalse(self.client.send(vertices, triangles, wait=1))
        return words

    # Run in the order of their names: the first ones need a node that has had no good mesh.
    def test_0_a_call_before_any_mesh_says_so(self):
        answer = self.expect(self.client.plan(ROUTE), Verdict.NO_ARTERY, 'mesh')
        self.assertEqual(json.loads(answer.report_json)['verdict']['code'], 'NO_ARTERY')

    def test_1_a_bad_first_mesh_is_refused_with_its_reason(self):
        vertices, triangles = GOOD
        bad = np.array(vertices)
        bad[7, 1] = np.nan
        self.refused(bad, triangles)
        answer = self.expect(self.client.plan(ROUTE), Verdict.BAD_INPUT, 'refused', 'vertex 7')
        self.assertEqual(answer.verdict.fault, 'NOT_FINITE')

    def test_2_a_good_mesh_and_a_good_call(self):
        states, topologies, paths = [], [], []
        subscribers = [rospy.Subscriber('/catnav/catheter_mesh', MeshState, states.append),
                       rospy.Subscriber('/catnav/catheter_topology', MeshTopology, topologies.append),
                       rospy.Subscriber('/catnav/path', Path, paths.append)]
        self.assertTrue(self.client.send(*GOOD))
        while not all(s.get_num_connections() for s in subscribers):
            rospy.sleep(0.02)
        answer = self.expect(self.client.plan(ROUTE), Verdict.REACHED)
        rospy.sleep(0.5)
        for subscriber in subscribers:
            subscriber.unregister()
        report = json.loads(answer.report_json)
        self.assertEqual(answer.gap_min, report['contact']['gap_min'] or 0)
        self.assertGreaterEqual(answer.gap_min, 0)
        self.assertEqual(report['contact']['outside_nodes'], 0)
        self.assertGreater(answer.steps, 10)
        self.assertEqual(answer.verdict.waypoint, len(ROUTE) - 1)
        self.assertEqual(report['status'], 'reached')
        self.assertEqual(report['seed'], 1)
        self.assertEqual(report['steps'], answer.steps)
        ends = [p.pose.position for p in (answer.path.poses[0], answer.path.poses[-1])]
        for end, waypoint in zip(ends, (ROUTE[0], ROUTE[-1])):
            self.assertLess(np.linalg.norm([end.x - waypoint[0], end.y - waypoint[1], end.z - waypoint[2]]), 2e-3)
        self.assertTrue(paths)
        self.assertTrue(states)
        self.assertEqual(len(topologies), 1)  # once a plan
        self.assertEqual(topologies[-1].id, states[-1].topology)
        self.assertEqual(len(states[-1].vertices), max(topologies[-1].tetrahedra) + 1)
        self.assertEqual(len(states[-1].stress), len(states[-1].vertices))
        for state in states:
            self.assertTrue(np.isfinite([(v.x, v.y, v.z) for v in state.vertices]).all())
            self.assertTrue(np.isfinite(state.stress).all())
            self.assertEqual(state.header.frame_id, 'map')
        stamps = [s.header.stamp.to_sec() for s in states]
        self.assertLess(len(stamps), 2 + 20.5 * (stamps[-1] - stamps[0] + 0.05))  # ~frame_rate is 20 Hz

    def test_3_a_late_subscriber_sees_everything(self):
        for topic in ('catheter_topology', 'catheter_marker', 'artery_marker', 'roadmap_marker', 'medial_axis',
                      'path'):  # each by a process of its own
            echo = ['rostopic', 'echo', '-n', '1', f'/catnav/{topic}/header/frame_id']
            said = subprocess.run(echo, capture_output=True, text=True, timeout=20).stdout
            self.assertIn('map', said, topic)

    def test_3_diagnostics_name_the_last_verdict(self):
        for _ in range(20):
            status = rospy.wait_for_message('/diagnostics', DiagnosticArray, 5).status[0]
            if status.name.startswith('/catnav'):
                break
        values = {v.key: v.value for v in status.values}
        self.assertEqual(values['last verdict'], 'REACHED')
        self.assertGreaterEqual(int(values['frames dropped']), 0)

    def test_4_bad_meshes_leave_the_old_one_in_force(self):
        vertices, triangles = GOOD
        cases = {
            'empty': ([], []),
            'no triangle': (vertices, []),
            'infinite': (np.where(np.arange(len(vertices))[:, None] == 3, np.inf, vertices), triangles),
            'index out of range': (vertices, triangles[:-1] + [(0, 1, len(vertices))]),
            'index near 2^32': (vertices, triangles[:-1] + [(0, 1, 2**32 - 1)]),
            'mixed orientation': (vertices, [t if i % 2 else t[::-1] for i, t in enumerate(triangles)]),
            'millimetres as metres': (np.array(vertices) * 1000, triangles),
        }
        for what, mesh in cases.items():
            with self.subTest(what):
                self.client.send(*mesh, wait=1)
                answer = self.client.plan([ROUTE[0], (0, 0, 0.02)])
                self.expect(answer, Verdict.REACHED, 'refused')
        self.assertTrue(self.client.send(*GOOD))
        self.assertNotIn('refused', self.client.plan([ROUTE[0], (0, 0, 0.02)]).verdict.message)

    def test_4_a_mesh_for_a_vessel_that_the_scene_lacks_is_refused(self):
        self.assertFalse(self.client.send(*GOOD, name='vein', wait=1))
        self.assertTrue(self.client.send(*GOOD, name='artery'))

    def test_4_inward_normals_are_turned(self):
        vertices, triangles = GOOD
        self.assertTrue(self.client.send(vertices, [t[::-1] for t in triangles]))
        self.expect(self.client.plan([ROUTE[0], (0, 0, 0.02)]), Verdict.REACHED)

    def test_5_bad_requests_are_refused_in_words(self):
        nan, inf = float('nan'), float('inf')
        route = ROUTE
        for points, fields, word, fault in [
                ([], {}, 'waypoint', 'TOO_FEW'),
                (ROUTE[:1], {}, 'waypoint', 'TOO_FEW'),
                ([ROUTE[0], (nan, 0, 0.05)], {}, 'waypoint 1', 'VALUE'),
                ([ROUTE[0], (0, inf, 0.05)], {}, 'waypoint 1', 'VALUE'),
                ([ROUTE[0], (0.02, 0, 0.05)], {}, 'waypoint 1', 'PLACE'),
                ([(0.02, 0, 0.01), ROUTE[1]], {}, 'entry', 'PLACE'),
                (route, {'sampling': 'guess'}, 'guess', 'OPTION'),
                (route, {'budget': nan}, 'budget', 'VALUE'),
                (route, {'budget': -1.0}, 'budget', 'VALUE'),
                (route, {'limits': [Limit('', 'heat', 'max', 1)]}, 'heat', 'OPTION'),
                (route, {'limits': [Limit('', 'stress', 'sum', 1)]}, 'sum', 'OPTION'),
                (route, {'limits': [Limit('', 'stress', 'max', nan)]}, 'stress', 'VALUE'),
                (route, {'limits': [Limit('', 'stress', 'max', -1)]}, 'stress', 'VALUE'),
                (route, {'limits': [Limit('stent', 'stress', 'max', 1)]}, 'stent', 'OPTION'),
                (route, {'scene': 'missing.yaml'}, 'missing.yaml', 'MISSING_FILE'),
                (route, {'scene': '../../package.xml'}, 'outside', 'OUTSIDE'),
                (route, {'scene': 'door.test'}, 'door.test', 'SYNTAX')]:
            with self.subTest(word):
                answer = self.expect(self.client.plan(points, **fields), Verdict.BAD_INPUT, word)
                self.assertEqual((answer.verdict.fault, json.loads(answer.report_json)['verdict']['fault']), (fault, fault))
        self.expect(self.client.plan([ROUTE[0], (0, 0, 0.02)]), Verdict.REACHED)

    def test_5_a_scene_in_its_folder_brings_its_own_vessel(self):
        self.expect(self.client.plan([ROUTE[0], (0, 0, 0.02)], scene='tube.yaml'), Verdict.REACHED)

    def test_5_the_answer_comes_in_the_frame_of_the_request(self):
        answer = self.client.plan([ROUTE[0], (0, 0, 0.02)], header=Header(frame_id='ct'))
        self.expect(answer, Verdict.REACHED)
        self.assertEqual(answer.path.header.frame_id, 'ct')

    def test_6_calls_at_once_are_served_or_refused_never_mixed(self):
        answers = {}

        def call(i):
            answers[i] = self.client.plan([ROUTE[0], (0, 0, 0.03 + 0.01 * i)])

        callers = [threading.Thread(target=call, args=(i,)) for i in range(4)]
        for caller in callers:
            caller.start()
        for caller in callers:
            caller.join()
        served = [i for i in answers if answers[i].verdict.code == Verdict.REACHED]
        self.assertTrue(served)
        for i, answer in answers.items():
            if i in served:
                self.assertAlmostEqual(answer.path.poses[-1].pose.position.z, 0.03 + 0.01 * i, delta=1e-3)
            else:
                self.expect(answer, Verdict.BUSY, 'another plan')

    def test_7_a_mesh_sent_while_planning_waits_for_the_next_plan(self):
        answers, moving = [], threading.Event()
        rospy.Subscriber('/catnav/catheter_mesh', MeshState, lambda state: moving.set())
        for _ in range(100):  # a plan lasts 0.1 s: until the node sends to this subscriber, too
            self.client.plan(ROUTE)
            if moving.wait(0.2):
                break
        rospy.sleep(0.5)  # the last states of that plan
        moving.clear()
        caller = threading.Thread(target=lambda: answers.append(self.client.plan(ROUTE)))
        caller.start()
        self.assertTrue(moving.wait(20))
        vertices, triangles = GOOD
        self.assertTrue(self.client.send(np.array(vertices) + [0.1, 0, 0], triangles))
        caller.join()
        self.expect(answers[0], Verdict.REACHED)
        self.expect(self.client.plan(ROUTE), Verdict.BAD_INPUT, 'entry')
        moved = [(x + 0.1, y, z) for x, y, z in ROUTE]
        self.expect(self.client.plan(moved), Verdict.REACHED)
        self.assertTrue(self.client.send(*GOOD))

    def test_8_the_same_request_gives_the_same_plan(self):
        first, second = (self.client.plan(ROUTE) for _ in range(2))
        self.assertEqual(first.steps, second.steps)
        self.assertEqual([p.pose for p in first.path.poses], [p.pose for p in second.path.poses])
        self.assertEqual(first.gap_min, second.gap_min)


if __name__ == '__main__':
    rospy.init_node('door')
    rostest.rosrun('catnav', 'door', Door, sys.argv)
