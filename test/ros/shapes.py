"""Meshes and helpers for the node's tests; lengths in metres."""
import os
import sys
import threading
import time

import actionlib
import numpy as np
import rospy
from catnav.msg import PlanCatheterAction, PlanCatheterGoal, SurfaceMesh, Verdict
from catnav.srv import PlanCatheter, PlanCatheterRequest
from geometry_msgs.msg import Point
from visualization_msgs.msg import Marker

sys.path.insert(0, os.path.join(os.path.dirname(os.path.abspath(__file__)), '../../scripts'))
from send_mesh import message, read_surface  # noqa: E402,F401

PATIENCE = float(os.environ.get('CATNAV_PATIENCE', 1))  # a node under sanitizers takes that much longer
DATA = os.environ.get('CATNAV_DATA', os.path.join(os.path.dirname(os.path.abspath(__file__)), '../data'))


def tube(start, end, radius, rings=11, sides=16):
    """An open straight tube, its normals outwards."""
    start, end = np.asarray(start, float), np.asarray(end, float)
    axis = (end - start) / np.linalg.norm(end - start)
    u = np.cross(axis, [0, 1, 0] if abs(axis[1]) < 0.9 else [1, 0, 0])
    u /= np.linalg.norm(u)
    v = np.cross(axis, u)
    angle = 2 * np.pi * np.arange(sides) / sides
    ring = radius * (np.outer(np.cos(angle), u) + np.outer(np.sin(angle), v))
    vertices = np.concatenate([start + (end - start) * t + ring for t in np.linspace(0, 1, rings)])
    triangles = []
    for r in range(rings - 1):
        for k in range(sides):
            a, b = r * sides + k, r * sides + (k + 1) % sides
            triangles += [(a, b, b + sides), (a, b + sides, a + sides)]
    return vertices, triangles


def isosurface(distance, low, high, cell):
    """The zero surface of a signed distance (negative inside) on a grid, by marching tetrahedra: closed, outwards."""
    size = [int(np.ceil((h - l) / cell)) + 1 for l, h in zip(low, high)]
    grid = np.stack(np.meshgrid(*[l + cell * np.arange(n) for l, n in zip(low, size)], indexing='ij'), -1)
    value = distance(grid.reshape(-1, 3)).reshape(size)
    value[np.abs(value) < 0.02 * cell] = 0.02 * cell  # no sliver at a corner of the grid
    flat, points = value.ravel(), grid.reshape(-1, 3)
    stride = np.array([size[1] * size[2], size[2], 1])
    corner = np.array([[i & 1, i >> 1 & 1, i >> 2 & 1] for i in range(8)]) @ stride
    tets = [(0, 1, 3, 7), (0, 3, 2, 7), (0, 2, 6, 7), (0, 6, 4, 7), (0, 4, 5, 7), (0, 5, 1, 7)]
    base = (np.stack(np.meshgrid(*[np.arange(n - 1) for n in size], indexing='ij'), -1).reshape(-1, 3) @ stride)
    inside = np.stack([flat[base + c] < 0 for c in corner])
    index, vertices, triangles = {}, [], []

    def cut(a, b):
        key = (min(a, b), max(a, b))
        if key not in index:
            t = flat[key[0]] / (flat[key[0]] - flat[key[1]])
            index[key] = len(vertices)
            vertices.append(points[key[0]] * (1 - t) + points[key[1]] * t)
        return index[key]

    for cube in base[inside.any(0) & ~inside.all(0)]:
        for tet in tets:
            node = [cube + corner[c] for c in tet]
            into = [n for n in node if flat[n] < 0]
            out = [n for n in node if flat[n] >= 0]
            if not into or not out:
                continue
            if len(into) == 2:
                a, b, c, d = (cut(into[i], out[j]) for i, j in ((0, 0), (0, 1), (1, 1), (1, 0)))
                new = [(a, b, c), (a, c, d)]
            else:
                lone, rest = (into[0], out) if len(into) == 1 else (out[0], into)
                new = [tuple(cut(lone, n) for n in rest)]
            away = points[out].mean(0) - points[into].mean(0)
            for a, b, c in new:
                normal = np.cross(vertices[b] - vertices[a], vertices[c] - vertices[a])
                triangles.append((a, b, c) if normal @ away > 0 else (a, c, b))
    return np.array(vertices), triangles


def arc(centre, radius, start, end, n=40):
    """Points on an arc in the x-z plane, angles from +x towards +z."""
    angle = np.linspace(start, end, n)
    return np.stack([centre[0] + radius * np.cos(angle), 0 * angle, centre[1] + radius * np.sin(angle)], 1)


def along(axis, radius):
    """Signed distance to a round vessel along a polyline."""
    axis = np.asarray(axis, float)

    def distance(x):
        best = np.full(len(x), np.inf)
        for a, b in zip(axis[:-1], axis[1:]):
            t = np.clip((x - a) @ (b - a) / ((b - a) @ (b - a)), 0, 1)
            best = np.minimum(best, np.linalg.norm(x - a - t[:, None] * (b - a), axis=1))
        return best - radius
    return distance


class Client:
    """Talks to the node as a user's node does."""

    def __init__(self, node='/catnav'):
        rospy.wait_for_service(node + '/plan', 20)
        self.mesh = rospy.Publisher(node + '/artery_mesh', SurfaceMesh, queue_size=4)
        self.plan_service = rospy.ServiceProxy(node + '/plan', PlanCatheter)
        self.arteries = 0
        self.arrived = threading.Condition()
        rospy.Subscriber(node + '/artery_marker', Marker, self.on_artery, queue_size=16)

    def on_artery(self, marker):
        with self.arrived:
            self.arteries += marker.action == Marker.ADD
            self.arrived.notify_all()

    def send(self, vertices, triangles, name='', frame='', wait=20):
        """Sends a mesh; true once it is in force, false when it was not within `wait` seconds."""
        while self.mesh.get_num_connections() == 0:
            rospy.sleep(0.02)
        with self.arrived:
            before = self.arteries
            self.mesh.publish(message(vertices, triangles, name, frame))
            return self.arrived.wait_for(lambda: self.arteries > before, wait)

    def plan(self, points, **fields):
        fields.setdefault('seed', 1)
        return self.plan_service(PlanCatheterRequest(waypoints=[Point(*map(float, p)) for p in points], **fields))


class Goal:
    """A goal on its way: its feedback, its result, how often it was answered."""

    def __init__(self, client, goal):
        self.feedback, self.heard, self.results = [], [], 0
        self.result = self.status = None
        self.done, self.news = threading.Event(), threading.Condition()
        self.handle = client.send_goal(goal, self.on_transition, self.on_feedback)

    def on_feedback(self, handle, feedback):
        with self.news:
            self.feedback.append(feedback)
            self.heard.append(time.monotonic())
            self.news.notify_all()

    def on_transition(self, handle):
        if handle.get_comm_state() != actionlib.CommState.DONE:
            return
        self.result, self.status = handle.get_result(), handle.get_goal_status()
        self.results += 1
        self.done.set()
        with self.news:
            self.news.notify_all()

    def until(self, wanted, wait):
        """True once a feedback is as wanted."""
        with self.news:
            self.news.wait_for(lambda: self.done.is_set() or any(map(wanted, self.feedback)), wait)
            return any(map(wanted, self.feedback))

    def cancel(self):
        self.handle.cancel()


class ActionClient:
    def __init__(self, node='/catnav'):
        self.client = actionlib.ActionClient(node + '/plan_action', PlanCatheterAction)
        self.client.wait_for_server()

    def send(self, points, **fields):
        fields.setdefault('seed', 1)
        return Goal(self.client, PlanCatheterGoal(waypoints=[Point(*map(float, p)) for p in points], **fields))


def name_of(verdict):
    return {v: k for k, v in vars(Verdict).items() if k.isupper()}[verdict.code]
