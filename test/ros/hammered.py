#!/usr/bin/python3
"""Short forms of what scripts/ros/hammer.py does for as long as one likes."""
import contextlib
import io
import os
import struct
import sys
import tempfile
import time
import unittest

import rospy
import rostest
from catnav.msg import Verdict

sys.path.insert(0, os.path.join(os.path.dirname(os.path.realpath(__file__)), '../../scripts/ros'))
import hammer  # noqa: E402


@contextlib.contextmanager
def sender(topic, kind):
    """Sends bytes as they are as messages of that kind."""
    forger = type('Forged', (kind,), {'__slots__': ('forged',), 'serialize': lambda self, buff: buff.write(self.forged)})
    publisher = rospy.Publisher(topic, forger, queue_size=100)
    while not publisher.get_num_connections():
        time.sleep(0.02)

    def send(forged):
        message = forger()
        message.forged = forged
        publisher.publish(message)
    yield send
    publisher.unregister()


class Hammered(unittest.TestCase):
    def test_sigterm_while_planning_ends_it_with_0_and_no_torn_file(self):
        self.assertTrue(hammer.stop(times=2))

    def test_sigkill_leaves_nothing_corrupt(self):
        self.assertTrue(hammer.kill(times=2))

    def test_a_flood_is_bounded_counted_and_leaves_the_plan_running(self):
        self.assertTrue(hammer.flood(seconds=4))

    def test_half_a_minute_of_everything_crosses_nothing_and_keeps_its_memory_and_handles(self):
        with tempfile.TemporaryDirectory() as folder:
            self.assertTrue(hammer.soak(seconds=25, out=folder))
            self.assertEqual(sorted(os.listdir(folder)), ['soak.csv', 'soak.png', 'soak.svg'])

    def test_a_list_longer_than_its_message_is_not_made(self):
        node = hammer.Node()
        highest = node.peak()
        for kind, message, count in (('plan_action/goal', hammer.goal_of(hammer.ROUTE), len(hammer.ROUTE)),
                                     ('artery_mesh', hammer.message(*hammer.TUBE), len(hammer.TUBE[0]))):
            bytes_ = io.BytesIO()
            message.serialize(bytes_)
            first = (message.goal.waypoints if kind != 'artery_mesh' else message.surface.vertices)[0]
            point = struct.pack('<3d', first.x, first.y, first.z)
            forged = bytes_.getvalue().replace(struct.pack('<I', count) + point, struct.pack('<I', 2**27) + point, 1)
            self.assertNotEqual(forged, bytes_.getvalue())
            with sender(f'{node.name}/{kind}', type(message)) as send:
                for _ in range(20):
                    send(forged)
                time.sleep(1)
        self.assertEqual(node.client.plan(hammer.SHORT).verdict.code, Verdict.REACHED)
        self.assertLess(node.peak() - highest, 32 * 2**20 * hammer.PATIENCE)  # 2^27 points would be 3 GiB
        node.close()

    def test_what_is_sent_and_never_looked_at_is_counted_by_its_number(self):
        node, missing = hammer.Node(), 'messages missing by their numbers'
        self.assertEqual(node.diagnostics()[missing], '0')
        for kind, message, numbers, expected in (  # its mesh had the number 1
                ('artery_mesh', hammer.message(*hammer.TUBE), [1, 2, 5, 5, 3, 4], 2),
                ('plan_action/goal', hammer.goal_of([]), [2**32 - 2, 1, 0, 1], 2 + 2)):
            with sender(f'{node.name}/{kind}', type(message)) as send:
                for message.header.seq in numbers:
                    bytes_ = io.BytesIO()
                    message.serialize(bytes_)
                    send(bytes_.getvalue())
                    time.sleep(0.1)
            until = time.monotonic() + hammer.WAIT
            while int(node.diagnostics()[missing]) < expected and time.monotonic() < until:
                pass
            self.assertEqual(node.diagnostics()[missing], str(expected), kind)
        node.close()

    def test_eight_clients_get_one_answer_to_every_call(self):
        self.assertTrue(hammer.crowd(seconds=6, clients=8))


if __name__ == '__main__':
    rospy.init_node('hammered', disable_signals=True)
    rostest.rosrun('catnav', 'hammered', Hammered, sys.argv)
