#!/usr/bin/python3
"""Waypoints by mouse as rviz sends it, saved and loaded; settings between plans; diagnostics; frames by tf2."""
import glob
import json
import os
import sys
import threading
import unittest

import dynamic_reconfigure.client
import genpy.dynamic
import numpy as np
import rospy
import rostest
import yaml
from catnav.msg import Verdict
from catnav.srv import WaypointsFile
from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import Point, PointStamped, TransformStamped
from nav_msgs.msg import Path
from std_msgs.msg import Header
from visualization_msgs.msg import InteractiveMarkerFeedback, InteractiveMarkerInit, InteractiveMarkerUpdate

from shapes import PATIENCE, ActionClient, Client, along, arc, isosurface, name_of, tube

# tf2_msgs' own Python module need not be there
TFMessage = genpy.dynamic.generate_dynamic('tf2_msgs/TFMessage', 'geometry_msgs/TransformStamped[] transforms\n' + 80 * '='
                                           + '\nMSG: geometry_msgs/TransformStamped\n'
                                           + TransformStamped._full_text)['tf2_msgs/TFMessage']
HERE = os.path.dirname(os.path.abspath(__file__))
TUBE = tube([0, 0, 0], [0, 0, 0.08], 0.004)
ROUTE = [(0, 0, 0.01), (0, 0, 0.02)]
WAIT = 30 * PATIENCE  # [s]


class Hand:
    """rviz's side of the interactive markers."""

    def __init__(self):
        self.marks, self.news = {}, threading.Condition()
        rospy.Subscriber('/catnav/waypoints/update', InteractiveMarkerUpdate, self.on_update, queue_size=64)
        rospy.Subscriber('/catnav/waypoints/update_full', InteractiveMarkerInit, self.on_update, queue_size=64)
        self.click = rospy.Publisher('/clicked_point', PointStamped, queue_size=8)
        self.feedback = rospy.Publisher('/catnav/waypoints/feedback', InteractiveMarkerFeedback, queue_size=8)
        while not (self.click.get_num_connections() and self.feedback.get_num_connections()):
            rospy.sleep(0.02)

    def on_update(self, update):
        with self.news:
            for mark in update.markers:
                self.marks[mark.name] = mark
            for name in getattr(update, 'erases', []):
                self.marks.pop(name, None)
            self.news.notify_all()

    def until(self, wanted):
        with self.news:
            return self.news.wait_for(wanted, WAIT)

    def places(self):
        with self.news:
            return [(m.pose.position.x, m.pose.position.y, m.pose.position.z)
                    for _, m in sorted(self.marks.items(), key=lambda entry: int(entry[0].split()[1]))]

    def press(self, point, frame='map'):
        self.click.publish(PointStamped(Header(frame_id=frame), Point(*point)))

    def drag(self, index, point, frame='map'):
        for event in InteractiveMarkerFeedback.POSE_UPDATE, InteractiveMarkerFeedback.MOUSE_UP:
            message = InteractiveMarkerFeedback(header=Header(frame_id=frame), client_id='hand',
                                                marker_name=f'waypoint {index}', event_type=event)
            message.pose.position = Point(*point)
            self.feedback.publish(message)

    def choose(self, index, title):
        entry = [e for e in self.marks[f'waypoint {index}'].menu_entries if e.title.startswith(title)][0]
        self.feedback.publish(InteractiveMarkerFeedback(
            header=Header(frame_id='map'), client_id='hand', marker_name=f'waypoint {index}',
            event_type=InteractiveMarkerFeedback.MENU_SELECT, menu_entry_id=entry.id))


class Rviz(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.client = Client()
        assert cls.client.send(*TUBE, frame='map')
        cls.hand = Hand()
        cls.save = rospy.ServiceProxy('/catnav/save_waypoints', WaypointsFile)
        cls.load = rospy.ServiceProxy('/catnav/load_waypoints', WaypointsFile)
        cls.transforms = rospy.Publisher('/tf_static', TFMessage, queue_size=4, latch=True)

    def tearDown(self):
        for path in glob.glob(os.path.join(HERE, 'saved*')):
            os.remove(path)

    def expect(self, answer, code, *words):
        self.assertEqual(answer.verdict.code, code, f'{name_of(answer.verdict)}: {answer.verdict.message}')
        for word in words:
            self.assertIn(word, answer.verdict.message)

    def near(self, places, expected, apart=5e-4):
        self.assertEqual(len(places), len(expected))
        self.assertLess(np.max(np.linalg.norm(np.array(places) - expected, axis=1)), apart, places)

    def fresh(self, *clicks):
        """Only these waypoints, each from a click on the wall beside it."""
        if self.hand.marks:
            self.hand.choose(0, 'Delete all')
            self.assertTrue(self.hand.until(lambda: not self.hand.marks))
        for n, z in enumerate(clicks):
            self.hand.press((0.004, 0, z))
            self.assertTrue(self.hand.until(lambda: len(self.hand.marks) == n + 1))

    def test_a_click_on_the_wall_adds_a_waypoint_on_the_medial_axis(self):
        self.fresh(0.01, 0.05)
        self.near(self.hand.places(), [(0, 0, 0.01), (0, 0, 0.05)])
        self.assertEqual(self.hand.marks['waypoint 1'].description, 'target')

    def test_waypoints_are_moved_inserted_and_deleted(self):
        self.fresh(0.01, 0.03, 0.05)
        self.hand.drag(2, (0.001, 0, 0.06))
        self.assertTrue(self.hand.until(lambda: self.hand.places()[2][2] > 0.055))
        self.near(self.hand.places()[2:], [(0.001, 0, 0.06)], 1e-9)  # where it was dropped, not snapped
        self.hand.choose(2, 'Onto')
        self.assertTrue(self.hand.until(lambda: abs(self.hand.places()[2][0]) < 5e-4))
        self.hand.choose(0, 'Insert')
        self.assertTrue(self.hand.until(lambda: len(self.hand.marks) == 4))
        self.near(self.hand.places(), [(0, 0, z) for z in (0.01, 0.02, 0.03, 0.06)])
        self.hand.choose(2, 'Delete')
        self.assertTrue(self.hand.until(lambda: len(self.hand.marks) == 3))
        self.near(self.hand.places(), [(0, 0, z) for z in (0.01, 0.02, 0.06)])

    def test_a_waypoint_outside_the_lumen_is_red_and_says_why(self):
        self.fresh(0.01, 0.05)

        def ball(i):
            return self.hand.marks[f'waypoint {i}'].controls[0].markers[0].color

        self.assertGreater(ball(1).g, ball(1).r)
        self.hand.drag(1, (0.01, 0, 0.05))
        self.assertTrue(self.hand.until(lambda: 'outside' in self.hand.marks['waypoint 1'].description))
        self.assertIn('6 mm', self.hand.marks['waypoint 1'].description)
        self.assertGreater(ball(1).r, ball(1).g)
        self.assertGreater(ball(0).g, ball(0).r)

    def test_a_menu_entry_plans_through_the_waypoints(self):
        self.fresh(0.012, 0.02)
        heard, came = [], threading.Event()
        subscriber = rospy.Subscriber('/catnav/path', Path, lambda path: path.poses and (heard.append(path), came.set()))
        while subscriber.get_num_connections() == 0:
            rospy.sleep(0.02)
        rospy.sleep(0.5)
        heard.clear(), came.clear()
        self.hand.choose(0, 'Plan')
        self.assertTrue(came.wait(WAIT))
        ends = [heard[0].poses[i].pose.position.z for i in (0, -1)]
        self.near([ends], [[0.012, 0.02]], 1e-3)
        subscriber.unregister()

    def test_waypoints_are_saved_to_a_scene_file_and_loaded_from_it(self):
        self.fresh(0.012, 0.03, 0.05)
        saved = self.save('saved.yaml')
        self.assertTrue(saved.success, saved.message)
        with open(os.path.join(HERE, 'saved.yaml')) as file:
            text = file.read()
        body = yaml.safe_load(text)['bodies'][0]
        places = [body['shape']['catheter']['entry']] + body['waypoints']
        self.assertEqual(places, [[p.x, p.y, p.z] for p in saved.waypoints])
        self.near(places, [(0, 0, z) for z in (0.012, 0.03, 0.05)])
        self.assertIn('# A short catheter', text)
        self.fresh(0.02)
        loaded = self.load('saved.yaml')
        self.assertTrue(loaded.success, loaded.message)
        self.assertEqual(loaded.waypoints, saved.waypoints)
        self.assertTrue(self.hand.until(lambda: len(self.hand.marks) == 3))
        self.assertEqual([list(p) for p in self.hand.places()], places)
        self.assertTrue(self.save('saved.yaml').success)  # over itself

    def test_files_outside_the_scene_folder_are_refused(self):
        self.fresh(0.012, 0.03)
        os.symlink('/tmp', os.path.join(HERE, 'saved_link'))
        try:
            for name in ('../saved.yaml', '/tmp/saved.yaml', 'saved_link/saved.yaml', 'nowhere/saved.yaml', '', 'saved.obj',
                         'tube.obj', '.yaml', '../../package.xml', 'saved\n.sh', 'x' * 5000 + '.yaml'):
                for service in self.save, self.load:
                    reply = service(name)
                    self.assertFalse(reply.success, name)
                    self.assertTrue(reply.message, name)
            self.assertFalse(os.path.exists('/tmp/saved.yaml'))
        finally:
            os.remove(os.path.join(HERE, 'saved_link'))
        self.fresh(0.012)
        self.assertIn('two', self.save('saved.yaml').message)  # one waypoint is no way
        self.assertFalse(os.path.exists(os.path.join(HERE, 'saved.yaml')))

    def test_settings_are_in_force_from_the_next_plan_on(self):
        settings = dynamic_reconfigure.client.Client('catnav', timeout=WAIT)
        before = self.client.plan(ROUTE)
        settings.update_configuration({'step': 0.01, 'limit_stress_max': 1e-3})
        broken = self.client.plan(ROUTE)
        self.expect(broken, Verdict.LIMIT_BROKEN, 'stress')
        self.assertEqual(json.loads(broken.report_json)['repeat']['settings'], {'step': 0.01, 'limit_stress_max': 1e-3})
        settings.update_configuration({'limit_stress_max': -1})
        finer = self.client.plan(ROUTE)
        self.expect(finer, Verdict.REACHED)
        self.assertGreater(finer.steps, 1.3 * before.steps)
        settings.update_configuration({'step': -1, 'time_limit': 0.1})
        self.expect(self.client.plan(ROUTE), Verdict.TIMEOUT, '0.1 s')
        settings.update_configuration({'step': float('nan'), 'time_limit': float('inf')})
        settings.update_configuration({'step': -1, 'time_limit': -1})
        self.assertEqual(self.client.plan(ROUTE).steps, before.steps)
        settings.close()

    def test_diagnostics_hold_rate_verdict_dropped_frames_and_memory(self):
        self.expect(self.client.plan(ROUTE), Verdict.REACHED)
        rospy.sleep(1.5)
        values = self.figures()
        self.assertEqual(values['last verdict'], 'REACHED')
        self.assertGreater(float(values['memory [MB]']), 1)
        for key in 'steps per second', 'real-time factor', 'meshes dropped':
            self.assertEqual(float(values[key]), 0, key)  # nothing moves

    def test_diagnostics_say_how_fast_a_plan_moves_and_what_it_does_not_show(self):
        settings = dynamic_reconfigure.client.Client('catnav', timeout=WAIT)
        settings.update_configuration({'step': 1e-4, 'frame_rate': 1})
        before = self.figures()
        goal = ActionClient().send([ROUTE[0], (0, 0, 0.06)])
        self.assertTrue(goal.until(lambda f: f.stage == f.MOTION and f.step > 0, WAIT))
        while not goal.done.is_set():
            during = self.figures()
            if during['step'] != '0' and float(during['real-time factor']) > 0:
                break
        self.assertTrue(goal.done.wait(WAIT))
        settings.update_configuration({'step': -1, 'frame_rate': -1})
        self.assertGreater(float(during['steps per second']), 0)
        self.assertGreater(float(during['real-time factor']), 0)
        rospy.sleep(0.5)
        after = self.figures()
        sent, dropped = (int(after[key]) - int(before[key]) for key in ('frames sent', 'frames dropped'))
        self.assertGreater(dropped, 0)
        self.assertLessEqual(sent, 2 + (goal.heard[-1] - goal.heard[0] + 1))  # one a second
        self.assertGreaterEqual(sent + dropped, goal.result.steps)
        settings.close()

    def test_the_budget_is_a_setting(self):
        settings = dynamic_reconfigure.client.Client('catnav', timeout=WAIT)
        settings.update_configuration({'planner_budget': 12.5})
        self.assertEqual(json.loads(self.client.plan(ROUTE).report_json)['repeat']['settings'], {'planner_budget': 12.5})
        bend = arc((0.03, 0.01), 0.03, np.pi, np.pi / 2)  # no straight way leads through it
        self.assertTrue(self.client.send(*isosurface(along(bend, 0.004), (-0.006, -0.006, 0.002), (0.036, 0.006, 0.046), 1e-3),
                                         frame='map'))
        settings.update_configuration({'planner_budget': 1e-9})
        self.expect(self.client.plan(bend[[2, -3]]), Verdict.TIMEOUT, 'planner.budget (1e-09 s')
        settings.update_configuration({'planner_budget': -1})
        self.assertNotEqual(self.client.plan(bend[[2, -3]]).verdict.code, Verdict.TIMEOUT)
        self.assertTrue(self.client.send(*TUBE, frame='map'))
        settings.close()

    def figures(self):
        while True:
            for status in rospy.wait_for_message('/diagnostics', DiagnosticArray, WAIT).status:
                if 'catnav' in status.name and status.values:
                    return {v.key: v.value for v in status.values}

    def lay(self, frame, translation, rotation=(0, 0, 0, 1)):
        """`frame` in map."""
        transform = TransformStamped(Header(frame_id='map'), frame, None)
        transform.transform.translation.x, transform.transform.translation.y, transform.transform.translation.z = translation
        r = transform.transform.rotation
        r.x, r.y, r.z, r.w = rotation
        self.transforms.publish(TFMessage([transform]))

    def test_waypoints_in_a_frame_that_tf_knows_are_brought_into_the_nodes(self):
        half = 0.5 ** 0.5
        self.lay('table', (0.1, 0.2, 0.3), (0, half, 0, half))  # a quarter turn about y: table's -x is map's z
        rospy.sleep(0.5)
        plain = self.client.plan(ROUTE)
        moved = self.client.plan([(0.3 - z, -0.2 - y, -0.1 + x) for x, y, z in ROUTE], header=Header(frame_id='table'))
        self.expect(moved, Verdict.REACHED)
        self.assertEqual(moved.path.header.frame_id, 'table')
        for a, b in zip(plain.path.poses, moved.path.poses):
            a, b = a.pose.position, b.pose.position
            self.assertLess(np.linalg.norm([0.3 - a.z - b.x, -0.2 - a.y - b.y, -0.1 + a.x - b.z]), 1e-4)
        outside = self.client.plan([(9, 9, 9), (9, 9, 8)], header=Header(frame_id='table'))
        self.expect(outside, Verdict.BAD_INPUT, 'entry')

    def test_clicks_and_drags_in_a_frame_that_tf_knows_are_brought_into_the_nodes(self):
        self.lay('couch', (0, 0, 0.02))
        rospy.sleep(0.5)
        self.fresh(0.01)
        self.hand.press((0.004, 0, 0.03), 'couch')
        self.assertTrue(self.hand.until(lambda: len(self.hand.marks) == 2))
        self.near(self.hand.places(), [(0, 0, 0.01), (0, 0, 0.05)])
        self.hand.drag(1, (0.001, 0, 0.04), 'couch')
        self.assertTrue(self.hand.until(lambda: self.hand.places()[1][2] > 0.055))
        self.near(self.hand.places()[1:], [(0.001, 0, 0.06)], 1e-9)
        self.hand.press((0, 0, 0.03), 'moon')  # said in the log, and nothing is added
        rospy.sleep(0.5)
        self.assertEqual(len(self.hand.marks), 2)

    def test_a_frame_that_tf_does_not_know_is_an_error_in_words(self):
        self.expect(self.client.plan(ROUTE, header=Header(frame_id='moon')), Verdict.BAD_INPUT, 'moon', 'transform')
        self.assertFalse(self.client.send(*TUBE, frame='moon', wait=1.5))
        self.expect(self.client.plan(ROUTE), Verdict.REACHED, 'moon', 'transform')  # the last good mesh is in force
        self.expect(self.client.plan(ROUTE, header=Header(frame_id='moon')), Verdict.REACHED)  # both in one frame
        self.assertTrue(self.client.send(*TUBE, frame='map'))
        self.expect(self.client.plan(ROUTE, header=Header(frame_id='moon')), Verdict.BAD_INPUT, 'moon')

    def test_a_mesh_in_a_frame_that_tf_knows_is_brought_into_the_nodes(self):
        self.lay('scanner', (0, 0, 0.02))
        rospy.sleep(0.5)
        self.assertTrue(self.client.send(np.array(TUBE[0]) - [0, 0, 0.02], TUBE[1], frame='scanner'))
        answer = self.client.plan([(0, 0, 0.06), (0, 0, 0.07)])
        self.expect(answer, Verdict.REACHED)
        self.assertEqual(answer.path.header.frame_id, 'map')
        self.assertTrue(self.client.send(*TUBE, frame='map'))


if __name__ == '__main__':
    rospy.init_node('hand')
    rostest.rosrun('catnav', 'hand', Rviz, sys.argv)
