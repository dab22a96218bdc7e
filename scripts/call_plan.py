#!/usr/bin/python3
"""Calls ~plan with a scene's waypoints, once the artery has arrived, and prints the verdict.

    rosrun catnav call_plan.py SCENE.yaml
"""
import argparse
import os
import sys

import rospy
import yaml
from catnav.msg import Verdict
from catnav.srv import PlanCatheter, PlanCatheterRequest
from geometry_msgs.msg import Point
from visualization_msgs.msg import Marker

NAMES = {value: name for name, value in vars(Verdict).items() if name.isupper()}


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument('scene')
    parser.add_argument('--stay', action='store_true', help='do not end after the answer')
    options = parser.parse_args(rospy.myargv()[1:])
    with open(options.scene) as file:
        scene = yaml.safe_load(file)

    rospy.init_node('call_plan')
    rospy.wait_for_service('/catnav/plan')
    vessels = scene.get('vessels') or []
    sent = bool(vessels) and 'surface' in vessels[0]  # by send_mesh.py; else the scene makes its walls itself
    if sent:
        rospy.wait_for_message('/catnav/artery_marker', Marker)  # the mesh is in force

    body = scene['bodies'][0]
    points = list(body.get('waypoints') or [])
    if 'catheter' in body['shape']:
        points.insert(0, body['shape']['catheter'].get('entry', [0, 0, 0]))
    elif points:
        points.insert(0, points[0])  # stands for where the body lies
    request = PlanCatheterRequest(seed=scene.get('seed', 1), waypoints=[Point(*map(float, p)) for p in points])
    request.scene = '' if sent else os.path.basename(options.scene)
    answer = rospy.ServiceProxy('/catnav/plan', PlanCatheter)(request)
    verdict = answer.verdict
    rospy.loginfo('%s: %s (%d steps, %d replans, least gap %.3g m)', NAMES.get(verdict.code, verdict.code),
                  verdict.message, answer.steps, answer.replans, answer.gap_min)
    if options.stay:
        rospy.spin()
    return 0 if verdict.code in (Verdict.REACHED, Verdict.RAN) else 2


if __name__ == '__main__':
    sys.exit(main())
