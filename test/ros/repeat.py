#!/usr/bin/python3
"""A bag of the inputs (mesh and goal) played to another node gives the same plan bit for bit."""
import json
import os
import subprocess
import sys
import tempfile
import threading
import unittest

import rosbag
import rospy
import rostest
from catnav.msg import Limit, PlanCatheterActionGoal, PlanCatheterActionResult, SurfaceMesh, Verdict

from shapes import PATIENCE, ActionClient, Client, tube

NOT_THE_PLANS = {'time', 'left_out', 'memory_peak_bytes'}  # of a report: what the clock says


class Repeat(unittest.TestCase):
    def test_a_bag_of_the_inputs_gives_the_same_plan_bit_for_bit(self):
        client, action = Client(), ActionClient()
        ActionClient('/again')  # it is there
        with tempfile.TemporaryDirectory() as folder:
            path, lock = os.path.join(folder, 'inputs.bag'), threading.Lock()
            with rosbag.Bag(path, 'w') as bag:
                heard = []

                def record(topic):
                    def write(message):
                        with lock:
                            bag.write(topic, message, rospy.Time.now())
                            heard.append(topic)
                    return write

                recorders = [rospy.Subscriber(topic, kind, record(topic)) for topic, kind in
                             (('/catnav/artery_mesh', SurfaceMesh), ('/catnav/plan_action/goal', PlanCatheterActionGoal))]
                while client.mesh.get_num_connections() < 2 or not recorders[1].get_num_connections():
                    rospy.sleep(0.02)
                self.assertTrue(client.send(*tube([0, 0, 0], [0, 0, 0.08], 0.004)))
                rospy.sleep(0.5)
                goal = action.send([(0, 0, 0.01), (0.001, 0, 0.04), (0, 0, 0.06)], seed=5,
                                   limits=[Limit('', 'stress', 'max', 4e6)])
                self.assertTrue(goal.done.wait(60 * PATIENCE))
                for recorder in recorders:
                    recorder.unregister()
                self.assertEqual(sorted(heard), ['/catnav/artery_mesh', '/catnav/plan_action/goal'])
            self.assertEqual(goal.result.verdict.code, Verdict.REACHED, goal.result.verdict.message)

            results, came = [], threading.Event()
            rospy.Subscriber('/again/plan_action/result', PlanCatheterActionResult,
                             lambda message: (results.append(message.result), came.set()))
            subprocess.run(['rosbag', 'play', '--quiet', '--wait-for-subscribers', path,
                            '/catnav/artery_mesh:=/again/artery_mesh',
                            '/catnav/plan_action/goal:=/again/plan_action/goal'], check=True, timeout=120 * PATIENCE,
                           stdin=subprocess.DEVNULL)
            self.assertTrue(came.wait(60 * PATIENCE), 'no result')
        first, second = goal.result, results[0]
        self.assertEqual(first.verdict, second.verdict)
        for field in 'steps', 'replans', 'gap_min':
            self.assertEqual(getattr(first, field), getattr(second, field))
        self.assertEqual([p.pose for p in first.path.poses], [p.pose for p in second.path.poses])
        reports = [json.loads(result.report_json) for result in (first, second)]
        for report in reports:
            self.assertTrue(report['repeat']['walls'][0]['fnv1a'])
            self.assertEqual([body['name'] for body in report['repeat']['bodies']], ['catheter'])
            self.assertEqual(len(report['repeat']['bodies'][0]['fnv1a']), 16)
        for key in reports[0]:
            if key not in NOT_THE_PLANS:
                self.assertEqual(reports[0][key], reports[1][key], key)


if __name__ == '__main__':
    rospy.init_node('repeat')
    rostest.rosrun('catnav', 'repeat', Repeat, sys.argv)
