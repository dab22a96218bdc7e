#!/usr/bin/python3
"""~plan_action: the service's answer with progress on the way; a cancel ends a plan within a step and the next goal is
taken at once; further calls are refused or wait, as ~on_busy says."""
import json
import os
import sys
import threading
import time
import unittest

import rospy
import rostest
from actionlib_msgs.msg import GoalID, GoalStatus, GoalStatusArray
from catnav.msg import Limit, PlanCatheterActionGoal, PlanCatheterActionResult, PlanCatheterFeedback, Verdict

from shapes import PATIENCE, ActionClient, Client, name_of, tube

ROUTE = [(0, 0, 0.01), (0, 0, 0.06)]  # seconds at this step; the short one a fraction of one
SHORT = [(0, 0, 0.01), (0, 0, 0.014)]
IN_LIVER = [(0.04681, -0.13758, 0.70557), (0.0496, -0.1298, 0.8051)]  # a lumen whose map takes seconds
WAIT = 60 * PATIENCE  # [s]: an end that never comes is an error, a slow one is not
CANCELS = int(os.environ.get('CATNAV_CANCELS', 0))  # the long form: so many cancels, each in time
SHARED = 4  # times longer may a wait be where others share the machine


class Action(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.client, cls.patient = Client(), Client('/patient')
        cls.action, cls.patient_action = ActionClient(), ActionClient('/patient')
        for client in cls.client, cls.patient:
            assert client.send(*tube([0, 0, 0], [0, 0, 0.08], 0.004))

    def expect(self, answer, code, *words):
        self.assertEqual(answer.verdict.code, code, f'{name_of(answer.verdict)}: {answer.verdict.message}')
        for word in words:
            self.assertIn(word, answer.verdict.message)

    def ended(self, goal, status, code, *words):
        self.assertTrue(goal.done.wait(WAIT), 'no result')
        self.expect(goal.result, code, *words)
        self.assertEqual(goal.status, status)
        self.assertEqual(goal.results, 1)

    def moving(self, goal):
        self.assertTrue(goal.until(lambda f: f.stage == PlanCatheterFeedback.MOTION and f.step > 0, WAIT), 'no motion')

    def test_a_goal_gives_the_answer_of_the_service_and_progress_on_the_way(self):
        limit = Limit('', 'stress', 'max', 4e6)
        served = self.client.plan(ROUTE, limits=[limit])
        goal = self.action.send(ROUTE, limits=[limit])
        self.ended(goal, GoalStatus.SUCCEEDED, Verdict.REACHED)
        for field in 'steps', 'replans', 'gap_min':
            self.assertEqual(getattr(goal.result, field), getattr(served, field))
        self.assertEqual([p.pose for p in goal.result.path.poses], [p.pose for p in served.path.poses])

        last = goal.feedback[-1]
        self.assertEqual((last.stage, last.stage_name, last.waypoints), (PlanCatheterFeedback.MOTION, 'motion', 1))
        self.assertGreater(last.steps_per_second, 0)
        self.assertGreater(last.time, 0)
        self.assertEqual(last.time_limit, 60)
        margins = {m.quantity: m for m in last.margins}
        self.assertEqual(set(margins), {'stress', 'volume'})
        self.assertEqual(margins['stress'].limit, 4e6)
        self.assertAlmostEqual(margins['stress'].margin, 1 - margins['stress'].worst / 4e6)
        self.assertAlmostEqual(last.margin, min(m.margin for m in margins.values()))
        times = [f.time for f in goal.feedback]
        self.assertEqual(times, sorted(times))
        rate = (len(goal.feedback) - 1) / (goal.heard[-1] - goal.heard[0])
        print(f'feedback: {len(times)} messages, {rate:.1f} a second, motion at {last.steps_per_second:.0f} steps/s')
        self.assertGreaterEqual(rate, 5)

    def test_b_a_scene_of_a_goals_own_is_mapped_planned_and_driven_in_and_each_is_told(self):
        goal = self.patient_action.send(IN_LIVER, scene='liver.yaml')
        self.assertTrue(goal.until(lambda f: f.stage == PlanCatheterFeedback.MOTION, 4 * WAIT), goal.result)
        goal.cancel()
        self.ended(goal, GoalStatus.PREEMPTED, Verdict.CANCELLED)
        stages = [f.stage for f in goal.feedback]
        self.assertEqual(stages, sorted(stages))
        self.assertLessEqual({PlanCatheterFeedback.MAP, PlanCatheterFeedback.ROADMAP, PlanCatheterFeedback.MOTION}, set(stages))
        self.assertEqual({f.stage_name for f in goal.feedback if f.stage == PlanCatheterFeedback.MAP}, {'map'})

    def test_a_cancel_while_a_map_is_made_does_not_wait_for_it(self):
        goal = self.patient_action.send(IN_LIVER, scene='liver.yaml')
        self.assertTrue(goal.until(lambda f: f.stage == PlanCatheterFeedback.MAP, WAIT), goal.result)
        start = time.monotonic()
        goal.cancel()
        self.ended(goal, GoalStatus.PREEMPTED, Verdict.CANCELLED, 'before the first step')
        print(f'a cancel while the map is made answered after {1000 * (time.monotonic() - start):.0f} ms')
        self.ended(self.patient_action.send(SHORT), GoalStatus.SUCCEEDED, Verdict.REACHED)

    def test_a_report_says_what_the_same_plan_takes(self):
        report = json.loads(self.client.plan(SHORT, seed=7).report_json)
        repeat = report['repeat']
        self.assertEqual(repeat['seed'], 7)
        self.assertEqual(repeat['request']['waypoints'], [list(p) for p in SHORT])
        self.assertEqual(repeat['options']['step'], '0.0001')
        self.assertEqual(repeat['walls'][0]['name'], 'artery')
        self.assertEqual(len(repeat['walls'][0]['fnv1a']), 16)
        body = repeat['bodies'][0]
        self.assertEqual(body['name'], 'catheter')
        self.assertGreater(body['tetrahedra'], body['vertices'])
        self.assertLessEqual({'ompl', 'catnav'}, set(repeat['versions']))

    def test_a_call_that_is_refused_says_what_it_asked_too(self):
        goal = self.action.send(ROUTE)
        self.moving(goal)
        refused = self.action.send(SHORT, seed=9)
        self.ended(refused, GoalStatus.REJECTED, Verdict.BUSY)
        repeat = json.loads(refused.result.report_json)['repeat']
        self.assertEqual((repeat['request']['seed'], repeat['frame'], repeat['walls']), (9, 'map', []))
        self.assertEqual(repeat['request']['waypoints'], [list(p) for p in SHORT])
        self.assertIn('catnav', repeat['versions'])
        goal.cancel()
        self.ended(goal, GoalStatus.PREEMPTED, Verdict.CANCELLED)

    def test_a_cancel_ends_a_plan_with_what_was_reached_and_the_next_goal_is_taken_at_once(self):
        delays, steps = [], []
        for _ in range(CANCELS or 9):
            goal = self.action.send(ROUTE)
            self.moving(goal)
            start = time.monotonic()
            goal.cancel()
            self.ended(goal, GoalStatus.PREEMPTED, Verdict.CANCELLED)
            delays.append(time.monotonic() - start)
            steps.append(1 / goal.feedback[-1].steps_per_second)
            self.assertGreater(goal.result.steps, 0)
            self.assertTrue(goal.result.path.poses)
            self.assertEqual(json.loads(goal.result.report_json)['status'], 'interrupted')
            following = self.action.send(SHORT)
            self.ended(following, GoalStatus.SUCCEEDED, Verdict.REACHED)
        late = sorted(delay - step for delay, step in zip(delays, steps))  # [s] beyond the step under way
        print(f'{len(late)} cancels answered after {1000 * sorted(delays)[len(late) // 2]:.0f} ms (median), '
              f'{1000 * max(delays):.0f} ms at most; a step takes {1000 * sorted(steps)[len(late) // 2]:.1f} ms')
        if CANCELS:
            self.assertLess(late[-1], 0.05)
        self.assertLess(late[len(late) // 2], SHARED * 0.05)

    def test_a_second_call_is_refused_while_one_is_open(self):
        goal = self.action.send(ROUTE)
        self.moving(goal)
        self.ended(self.action.send(ROUTE), GoalStatus.REJECTED, Verdict.BUSY, 'another plan')
        self.expect(self.client.plan(ROUTE), Verdict.BUSY, 'another plan', '~on_busy')
        goal.cancel()
        self.ended(goal, GoalStatus.PREEMPTED, Verdict.CANCELLED)

    def test_calls_wait_for_their_turn_up_to_the_queues_size(self):
        first = self.patient_action.send(ROUTE)
        self.moving(first)
        second, third = self.patient_action.send(SHORT), self.patient_action.send(SHORT)
        self.ended(self.patient_action.send(SHORT), GoalStatus.REJECTED, Verdict.BUSY, '2 wait')
        self.expect(self.patient.plan(SHORT), Verdict.BUSY, '2 wait')
        third.cancel()
        self.ended(third, GoalStatus.RECALLED, Verdict.CANCELLED, 'waited')
        answers = []
        caller = threading.Thread(target=lambda: answers.append(self.patient.plan(SHORT)))
        caller.start()
        first.cancel()
        self.ended(first, GoalStatus.PREEMPTED, Verdict.CANCELLED)
        self.ended(second, GoalStatus.SUCCEEDED, Verdict.REACHED)
        caller.join(WAIT)
        self.expect(answers[0], Verdict.REACHED)

    def test_a_goal_that_waits_can_be_cancelled(self):
        first = self.patient_action.send(ROUTE)
        self.moving(first)
        second = self.patient_action.send(ROUTE)
        self.assertFalse(second.done.wait(0.3))
        second.cancel()
        self.ended(second, GoalStatus.RECALLED, Verdict.CANCELLED, 'waited')
        self.assertFalse(first.done.is_set())
        first.cancel()
        self.ended(first, GoalStatus.PREEMPTED, Verdict.CANCELLED)

    def test_a_goal_that_waited_while_many_were_refused_stays_listed_when_it_has_ended(self):
        first = self.patient_action.send(ROUTE)
        self.moving(first)
        second, third = self.patient_action.send(SHORT), self.patient_action.send(ROUTE)

        def refuse(times):
            for _ in range(times):
                self.ended(self.patient_action.send(SHORT), GoalStatus.REJECTED, Verdict.BUSY)

        refuse(140)
        self.assertFalse(first.done.is_set())
        first.cancel()
        self.ended(second, GoalStatus.SUCCEEDED, Verdict.REACHED)
        open_ = [third, self.patient_action.send(ROUTE), self.patient_action.send(ROUTE)]  # the queue is full again
        refuse(3)
        listed = rospy.wait_for_message('/patient/plan_action/status', GoalStatusArray, WAIT).status_list
        for goal in open_:
            goal.cancel()
        # a client that has not read its result yet would take it for lost
        self.assertIn((second.handle.comm_state_machine.action_goal.goal_id.id, GoalStatus.SUCCEEDED),
                      [(s.goal_id.id, s.status) for s in listed])
        for goal in open_:
            self.assertTrue(goal.done.wait(WAIT))

    def test_a_goal_whose_cancel_overtook_it_is_answered_as_cancelled(self):
        results = []
        listener = rospy.Subscriber('/catnav/plan_action/result', PlanCatheterActionResult, results.append)
        cancels = rospy.Publisher('/catnav/plan_action/cancel', GoalID, queue_size=1)
        goals = rospy.Publisher('/catnav/plan_action/goal', PlanCatheterActionGoal, queue_size=1)
        while not all(c.get_num_connections() for c in (listener, cancels, goals)):
            rospy.sleep(0.02)
        goal = PlanCatheterActionGoal()
        goal.goal_id.id, goal.goal_id.stamp = 'overtaken', rospy.Time.now()
        cancels.publish(GoalID(rospy.Time.now(), 'overtaken'))
        rospy.sleep(0.5)
        goals.publish(goal)
        end = time.monotonic() + WAIT
        while not [r for r in results if r.status.goal_id.id == 'overtaken'] and time.monotonic() < end:
            rospy.sleep(0.05)
        answer = [r for r in results if r.status.goal_id.id == 'overtaken'][0]
        self.expect(answer.result, Verdict.CANCELLED)
        self.assertEqual(answer.status.status, GoalStatus.RECALLED)

    def test_a_bad_goal_is_refused_in_words(self):
        self.ended(self.action.send([]), GoalStatus.ABORTED, Verdict.BAD_INPUT, 'waypoint')
        self.ended(self.action.send(ROUTE, scene='missing.yaml'), GoalStatus.ABORTED, Verdict.BAD_INPUT, 'missing.yaml')


if __name__ == '__main__':
    rospy.init_node('action')
    rostest.rosrun('catnav', 'action', Action, sys.argv)
