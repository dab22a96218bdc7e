#!/usr/bin/python3
"""Short forms of what scripts/ros/hammer.py does for as long as one likes."""
import os
import sys
import unittest

import rospy
import rostest

sys.path.insert(0, os.path.join(os.path.dirname(os.path.realpath(__file__)), '../../scripts/ros'))
import hammer  # noqa: E402


class Hammered(unittest.TestCase):
    def test_sigterm_while_planning_ends_it_with_0_and_no_torn_file(self):
        self.assertTrue(hammer.stop(times=2))

    def test_sigkill_leaves_nothing_corrupt(self):
        self.assertTrue(hammer.kill(times=2))

    def test_a_flood_is_bounded_counted_and_leaves_the_plan_running(self):
        self.assertTrue(hammer.flood(seconds=4))

    def test_eight_clients_get_one_answer_to_every_call(self):
        self.assertTrue(hammer.crowd(seconds=6, clients=8))


if __name__ == '__main__':
    rospy.init_node('hammered', disable_signals=True)
    rostest.rosrun('catnav', 'hammered', Hammered, sys.argv)
