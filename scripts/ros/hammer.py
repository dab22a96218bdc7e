#!/usr/bin/python3
"""Treats a node of its own badly and says how it took it; starts a master where there is none.

    hammer.py stop  [--times 20]                SIGTERM while it plans: exit 0, soon, no file half-written
    hammer.py kill  [--times 200]               SIGKILL at random moments: back soon, nothing corrupt
    hammer.py flood [--seconds 60]              meshes, goals and cancels as fast as they can be sent, beside a plan
    hammer.py crowd [--seconds 60 --clients 64] clients that plan, cancel, save, load, set: one answer to every call
    hammer.py soak  [--seconds 7200 --out DIR]  random plans, cancels and bad requests: memory, handles, step time

Needs the package's environment (`. build/devel/setup.bash`); CATNAV_NODE: another build of the node. Ends with 1 when a
promise was broken."""
import argparse
import atexit
import json
import os
import random
import shutil
import signal
import socket
import subprocess
import sys
import tempfile
import threading
import time

import rosgraph
import rospy

sys.path.insert(0, os.path.join(os.path.dirname(os.path.realpath(__file__)), '../../test/ros'))
import roslib.packages  # noqa: E402
from actionlib import CommState  # noqa: E402
from actionlib_msgs.msg import GoalID  # noqa: E402
from catnav.msg import PlanCatheterActionGoal, PlanCatheterFeedback, Verdict  # noqa: E402
from catnav.srv import WaypointsFile  # noqa: E402
from diagnostic_msgs.msg import DiagnosticArray  # noqa: E402
from dynamic_reconfigure.msg import DoubleParameter  # noqa: E402
from dynamic_reconfigure.srv import Reconfigure  # noqa: E402
from geometry_msgs.msg import Point  # noqa: E402
from shapes import ActionClient, Client, message, name_of, tube  # noqa: E402

HERE = os.path.dirname(os.path.realpath(__file__))
TUBE = tube([0, 0, 0], [0, 0, 0.08], 0.004)
ROUTE = [(0, 0, 0.01), (0, 0, 0.06)]
SHORT = [(0, 0, 0.01), (0, 0, 0.014)]
WAIT = 120  # [s]: what takes longer never comes


class Node:
    """catnav_node as a process, its scenes in a folder of its own."""

    made = 0

    def __init__(self, **parameters):
        Node.made += 1  # a name of its own: rospy keeps connections to the last of that name for a while
        self.name, self.parameters = f'/hammered_{Node.made}', {'step': 1e-4, **parameters}
        self.folder = tempfile.mkdtemp(prefix='catnav_')
        for file in 'tube.yaml', 'tube.obj':
            shutil.copy(os.path.join(HERE, '../../test/ros', file), self.folder)
        self.process = None
        atexit.register(self.close)
        self.start()

    def start(self):
        program = os.environ.get('CATNAV_NODE') or roslib.packages.find_node('catnav', 'catnav_node')[0]
        values = {'scene': os.path.join(self.folder, 'tube.yaml'), 'scene_dir': self.folder, **self.parameters}
        self.process = subprocess.Popen([program, f'__name:={self.name[1:]}', *(f'_{k}:={v}' for k, v in values.items())],
                                        stdout=subprocess.DEVNULL, stderr=sys.stderr if 'CATNAV_NODE' in os.environ else subprocess.DEVNULL)
        self.client = Client(self.name)
        self.action = ActionClient(self.name)
        self.mesh_in_force = self.client.send(*TUBE)

    def moving(self):
        goal = self.action.send(ROUTE)
        if not goal.until(lambda f: f.stage == PlanCatheterFeedback.MOTION and f.step > 0, WAIT):
            raise RuntimeError(f'nothing moves: {goal.result}')
        return goal

    def end(self, how, wait=WAIT):
        """(exit code, seconds until it had ended)"""
        start = time.monotonic()
        self.process.send_signal(how)
        return self.process.wait(wait), time.monotonic() - start

    def close(self):
        if self.process and self.process.poll() is None:
            self.end(signal.SIGTERM)
        shutil.rmtree(self.folder, ignore_errors=True)

    def memory(self):
        """Resident [bytes]."""
        with open(f'/proc/{self.process.pid}/statm') as file:
            return int(file.read().split()[1]) * os.sysconf('SC_PAGESIZE')

    def peak(self):
        """Most that has been resident [bytes]."""
        with open(f'/proc/{self.process.pid}/status') as file:
            return next(1024 * int(line.split()[1]) for line in file if line.startswith('VmHWM'))

    def handles(self):
        return len(os.listdir(f'/proc/{self.process.pid}/fd'))

    def diagnostics(self):
        while True:
            for status in rospy.wait_for_message('/diagnostics', DiagnosticArray, WAIT).status:
                if status.name.lstrip('/').startswith(self.name[1:] + ':') and status.values:
                    return {v.key: v.value for v in status.values}


def goal_of(route, name='goal'):
    goal = PlanCatheterActionGoal()
    goal.goal_id.id, goal.goal_id.stamp = name, rospy.Time.now()
    goal.goal.waypoints = [Point(*p) for p in route]
    return goal


class Saver(threading.Thread):
    """Saves waypoints again and again until stopped; a node that ends amid one is no error."""

    def __init__(self, node):
        super().__init__(daemon=True)
        self.save = rospy.ServiceProxy(node.name + '/save_waypoints', WaypointsFile)
        self.load = rospy.ServiceProxy(node.name + '/load_waypoints', WaypointsFile)
        self.over = False
        self.start()

    def run(self):
        try:
            self.load('tube.yaml')
            while not self.over:
                self.save('saved.yaml')
        except (rospy.ServiceException, rospy.ROSException):
            pass


def left_over(node):
    """What lies in the node's folder and is no whole scene."""
    wrong = [f for f in os.listdir(node.folder) if f not in ('tube.yaml', 'tube.obj', 'saved.yaml')]
    saved = os.path.join(node.folder, 'saved.yaml')
    if os.path.exists(saved):
        with open(saved) as one, open(os.path.join(node.folder, 'tube.yaml')) as other:
            wrong += [] if len(one.readlines()) == len(other.readlines()) else ['saved.yaml, torn']
    return wrong


def stop(times=20, **_):
    delays, wrong = [], []
    for _ in range(times):
        node = Node()
        node.moving()
        saver = Saver(node)
        time.sleep(random.uniform(0.1, 0.5))
        code, delay = node.end(signal.SIGTERM)
        saver.over = True
        saver.join(WAIT)
        delays.append(delay)
        wrong += left_over(node) + ([] if code == 0 else [f'exit {code}'])
        node.close()
    print(f'SIGTERM while planning: {times} times, ended after {max(delays):.2f} s at most; wrong: {wrong or "nothing"}')
    return not wrong


def kill(times=200, **_):
    wrong, back = [], []
    node = Node()
    for _ in range(times):
        node.action.send(ROUTE)
        saver = Saver(node)
        time.sleep(random.uniform(0, 0.5))
        node.end(signal.SIGKILL)
        saver.over = True
        saver.join(WAIT)
        for name in os.listdir(node.folder):  # a file that was being written has another name
            if name.endswith('.tmp'):
                os.remove(os.path.join(node.folder, name))
        wrong += left_over(node)
        start = time.monotonic()
        node.start()
        back.append(time.monotonic() - start)
        answer = node.client.plan(SHORT)
        if answer.verdict.code != Verdict.REACHED:
            wrong.append(answer.verdict.message)
    node.close()
    print(f'SIGKILL: {times} times, back with its mesh after {sorted(back)[times // 2]:.2f} s (median), {max(back):.2f} s '
          f'at most; wrong: {wrong or "nothing"}')
    return not wrong


def flood(seconds=60, **_):
    node = Node(**{'time_limit': 1e6, 'bodies/0/drive/speed': 1e-3})  # a plan that lasts
    goal = node.moving()
    mesh = message(*TUBE)
    goals = rospy.Publisher(node.name + '/plan_action/goal', PlanCatheterActionGoal, queue_size=100)
    cancels = rospy.Publisher(node.name + '/plan_action/cancel', GoalID, queue_size=100)
    sent = {'meshes': 0, 'goals': 0, 'cancels': 0}
    over, slowly = threading.Event(), threading.Event()

    def rates(start, end):
        return sorted(f.steps_per_second for f, t in zip(goal.feedback, goal.heard) if start <= t <= end and f.steps_per_second)

    def pour(what, send):
        os.setpriority(os.PRIO_PROCESS, threading.get_native_id(), 10)  # as if it came from another machine
        while not over.is_set():
            send(sent[what])
            sent[what] += 1
            time.sleep(0.2 if slowly.is_set() else 0.001 if sent[what] % 20 == 0 else 0)

    def one_goal(i):
        goals.publish(goal_of(ROUTE, f'flood {i}'))

    pourers = [threading.Thread(target=pour, args=a) for a in
               (('meshes', lambda i: node.client.mesh.publish(mesh)), ('goals', one_goal),
                ('cancels', lambda i: cancels.publish(GoalID(rospy.Time(), f'flood {i}'))))]
    def highest_until(end):
        highest = 0
        while time.monotonic() < end:
            time.sleep(0.02)
            highest = max(highest, node.memory())
        return highest

    slowly.set()  # first five of each a second: what a mesh that is checked beside a plan takes is no growth
    for thread in pourers:
        thread.start()
    time.sleep(2)
    calm = time.monotonic()
    memory = highest_until(calm + min(6, seconds))
    slowly.clear()
    start = time.monotonic()
    sent.update(dict.fromkeys(sent, 0))
    before = rates(calm, start)
    highest = highest_until(start + seconds)
    over.set()
    for thread in pourers:
        thread.join()
    during = rates(start, time.monotonic())
    time.sleep(7)  # the status list forgets ended goals after 5 s
    after = node.memory()
    figures = node.diagnostics()
    alive = not goal.done.is_set()
    goal.cancel()
    ended = goal.done.wait(WAIT) and goal.result.verdict.code == Verdict.CANCELLED
    served = node.client.plan(SHORT).verdict.code in (Verdict.REACHED, Verdict.BUSY)
    node.close()
    total = sum(sent.values())
    print(f'flood of {seconds} s: {sent}, {total / seconds:.0f} a second; memory {memory / 2**20:.1f} MiB, at most '
          f'{(highest - memory) / 2**20:+.1f}, afterwards {(after - memory) / 2**20:+.1f} MiB; meshes dropped '
          f'{figures["meshes dropped"]}, calls refused {figures["calls refused as busy"]}; steps a second, median: {before[len(before) // 2] if before else 0:.0f} before, '
          f'{during[len(during) // 2] if during else 0:.0f} during; the plan {"lived and " if alive else "DIED, "}'
          f'{"was cancelled" if ended else "DID NOT END"}')
    dropped = int(figures['meshes dropped']) + int(figures['calls refused as busy'])
    return bool(alive and ended and served and dropped > 0 and highest - memory < 32 * 2**20)


def crowd(seconds=60, clients=64, **_):
    rospy.set_param('actionlib_client_pub_queue_size', 1000)  # its clients share a publisher that keeps but 10 goals
    node = Node(on_busy='queue', queue_size=16, **{'settings/frame_rate': 5})
    rospy.ServiceProxy(node.name + '/load_waypoints', WaypointsFile)('tube.yaml')
    counts, errors, lock = {}, [], threading.Lock()
    until = time.monotonic() + seconds

    def count(what):
        with lock:
            counts[what] = counts.get(what, 0) + 1

    def work(seed):
        dice = random.Random(seed)
        client, action = Client(node.name), ActionClient(node.name)
        save = rospy.ServiceProxy(node.name + '/save_waypoints', WaypointsFile)
        load = rospy.ServiceProxy(node.name + '/load_waypoints', WaypointsFile)
        configure = rospy.ServiceProxy(node.name + '/set_parameters', Reconfigure)
        while time.monotonic() < until:
            what = dice.choice(['plan', 'plan', 'goal', 'cancel', 'cancel', 'bad', 'save', 'load', 'set', 'mesh'])
            try:
                if what in ('plan', 'bad'):
                    answer = client.plan(SHORT if what == 'plan' else SHORT[:1])
                    count(f'{what}: {name_of(answer.verdict)}')
                elif what in ('goal', 'cancel'):
                    goal = action.send(SHORT if what == 'goal' else ROUTE)
                    if what == 'cancel':
                        while goal.handle.get_comm_state() == CommState.WAITING_FOR_GOAL_ACK:
                            time.sleep(0.01)  # rospy takes a goal for lost whose cancel comes before that
                        time.sleep(dice.uniform(0, 0.2))
                        goal.cancel()
                    if not goal.done.wait(WAIT):
                        raise RuntimeError(f'{what}: no result')
                    count(f'{what}: {name_of(goal.result.verdict)}')
                    if goal.results != 1:
                        raise RuntimeError(f'{what}: {goal.results} results')
                elif what in ('save', 'load'):
                    count(f'{what}: {(save if what == "save" else load)("tube.yaml").success}')
                elif what == 'set':
                    request = Reconfigure._request_class()
                    request.config.doubles = [DoubleParameter('frame_rate', dice.uniform(1, 30))]
                    configure(request)
                    count(what)
                else:
                    client.mesh.publish(message(*TUBE))
                    count(what)
            except Exception as error:  # every call has an answer: whatever else comes is a broken promise
                with lock:
                    errors.append(f'{what}: {error}')

    workers = [threading.Thread(target=work, args=(seed,)) for seed in range(clients)]
    for worker in workers:
        worker.start()
    for worker in workers:
        worker.join()
    alive = node.process.poll() is None
    code, _ = node.end(signal.SIGTERM) if alive else (node.process.returncode, 0)
    node.close()
    unknown = [what for what in counts if 'UNKNOWN' in what]
    print(f'{clients} clients for {seconds} s: {sum(counts.values())} calls answered, {dict(sorted(counts.items()))}; '
          f'exit {code}; wrong: {(errors + unknown)[:5] or "nothing"}')
    return not errors and not unknown and alive and code == 0


def plot(rows, folder):
    """soak.csv and soak.svg: memory, handles and step time of every plan."""
    import matplotlib
    matplotlib.use('Agg')
    from matplotlib import pyplot
    os.makedirs(folder, exist_ok=True)
    with open(os.path.join(folder, 'soak.csv'), 'w') as file:
        file.write('time_s,memory_bytes,handles,step_ms,crossings\n')
        file.writelines(','.join(f'{v:.9g}' for v in row) + '\n' for row in rows)
    _, axes = pyplot.subplots(3, 1, sharex=True, figsize=(8, 6))
    for axis, at, scale, name in zip(axes, (1, 2, 3), (2**20, 1, 1), ('memory [MiB]', 'handles', 'step, median [ms]')):
        axis.plot([r[0] / 60 for r in rows], [r[at] / scale for r in rows], '.', markersize=2)
        axis.set_ylabel(name)
    axes[-1].set_xlabel('time [min]')
    pyplot.savefig(os.path.join(folder, 'soak.svg'))


def soak(seconds=7200, out=None, **_):
    node = Node()
    dice, start, rows = random.Random(1), time.monotonic(), []
    while time.monotonic() - start < seconds:
        what = dice.random()
        if what < 0.2:
            goal = node.moving()
            time.sleep(dice.uniform(0, 0.3))
            goal.cancel()
            if not goal.done.wait(WAIT):
                print('a cancel was not answered')
                return False
        elif what < 0.3:
            node.client.plan(SHORT, sampling='guess')
        else:
            answer = node.client.plan([(0, 0, 0.01), (0, 0, dice.uniform(0.012, 0.02))], seed=dice.randrange(1000))
            report = json.loads(answer.report_json)
            if answer.verdict.code == Verdict.REACHED:
                rows.append((time.monotonic() - start, node.memory(), node.handles(), report['time']['step_ms']['median'],
                             report['contact']['intersections'] + report['contact']['outside_nodes']))
    alive = node.process.poll() is None
    node.close()
    third = len(rows) // 3
    middle = [sorted(r[3] for r in part)[len(part) // 2] for part in (rows[third:2 * third], rows[2 * third:])]
    print(f'soak of {seconds} s: {len(rows)} plans; from a third on memory {(rows[-1][1] - rows[third][1]) / 2**20:+.2f} MiB, '
          f'handles {rows[-1][2] - rows[third][2]:+d}, step {100 * (middle[1] / middle[0] - 1):+.1f} %; crossings '
          f'{sum(r[4] for r in rows)}')
    if out:
        plot(rows, out)
    settled = [r for r in rows if r[0] > min(600, seconds / 3)]
    growth = (settled[-1][1] - settled[0][1]) / 2**20
    return alive and growth < 1 and settled[-1][2] <= settled[0][2] and sum(r[4] for r in rows) == 0


def master():
    """A master's process where none runs."""
    if rosgraph.is_master_online():
        return None
    with socket.socket() as probe:
        probe.bind(('localhost', 0))
        port = probe.getsockname()[1]
    os.environ['ROS_MASTER_URI'] = f'http://localhost:{port}'
    os.environ['ROS_HOSTNAME'] = 'localhost'
    process = subprocess.Popen(['roscore', '-p', str(port)], stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    while not rosgraph.is_master_online():
        time.sleep(0.1)
    return process


if __name__ == '__main__':
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument('what', choices=['stop', 'kill', 'flood', 'crowd', 'soak'])
    for option in 'seconds', 'times', 'clients':
        parser.add_argument('--' + option, type=int)
    parser.add_argument('--out', help='a folder for the log and plot of soak')
    options = parser.parse_args()
    own = master()
    try:
        rospy.init_node('hammer', disable_signals=True)
        given = {k: v for k, v in vars(options).items() if v is not None and k != 'what'}
        good = globals()[options.what](**given)
    finally:
        if own:
            own.terminate()
            own.wait()
    sys.exit(0 if good else 1)
