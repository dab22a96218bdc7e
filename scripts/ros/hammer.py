#!/usr/bin/python3
"""Treats a node of its own badly and says how it took it; starts a master where there is none.

    python3 hammer.py stop  [--times 20]                SIGTERM while it plans or maps: exit 0 within 1 s, no file half-written
    python3 hammer.py kill  [--times 200]               SIGKILL at random moments: back soon, nothing corrupt
    python3 hammer.py flood [--seconds 60]              meshes, goals and cancels as fast as they can be sent, beside a plan
    python3 hammer.py crowd [--seconds 60 --clients 64] clients that plan, cancel, save, load, set: one answer to every call
    python3 hammer.py soak  [--seconds 7200 --out DIR]  random plans, replans, cancels, bad requests: memory, handles, step time

Needs the package's environment (`. build/devel/setup.bash`); CATNAV_NODE: another build of the node. Ends with 1 when a
promise was broken."""
import argparse
import atexit
import json
import os
import random
import re
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

HERE = os.path.dirname(os.path.realpath(__file__))
sys.path[:0] = os.path.join(HERE, '../../test/ros'), os.path.join(HERE, '../study')
import soak as study  # noqa: E402
import roslib.packages  # noqa: E402
from actionlib import CommState  # noqa: E402
from actionlib_msgs.msg import GoalID  # noqa: E402
from catnav.msg import Limit, PlanCatheterActionGoal, PlanCatheterFeedback, Verdict  # noqa: E402
from catnav.srv import WaypointsFile  # noqa: E402
from diagnostic_msgs.msg import DiagnosticArray  # noqa: E402
from dynamic_reconfigure.msg import DoubleParameter  # noqa: E402
from dynamic_reconfigure.srv import Reconfigure  # noqa: E402
from geometry_msgs.msg import Point  # noqa: E402
from shapes import PATIENCE, ActionClient, Client, message, name_of, tube  # noqa: E402

TUBE = tube([0, 0, 0], [0, 0, 0.08], 0.004)
ROUTE = [(0, 0, 0.01), (0, 0, 0.06)]
SHORT = [(0, 0, 0.01), (0, 0, 0.024)]  # the tip begins 10 mm past the entry
THROUGH_FORK = [(0, 0, 0.005), (0, 0, 0.19)]
REPEATED = [(0, 0, 0.01), (0, 0, 0.04)]
CLOSED = 'services closed by roscpp before their answer was read (ros_comm issue 1976)'
LONG = 60  # [s] or times: short forms are judged by what does not depend on a shared machine
WAIT = 120 * PATIENCE  # [s]: what takes longer never comes


class Node:
    """catnav_node as a process, its scenes in a folder of its own."""

    made = 0

    def __init__(self, **parameters):
        Node.made += 1  # a name of its own: rospy keeps connections to the last of that name for a while
        self.name, self.parameters = f'/hammered_{Node.made}', {'step': 1e-4, **parameters}
        self.folder = tempfile.mkdtemp(prefix='catnav_')
        for file in 'tube.yaml', 'tube.obj':
            shutil.copy(os.path.join(HERE, '../../test/ros', file), self.folder)
        with open(os.path.join(self.folder, 'tube.yaml')) as tube, open(os.path.join(self.folder, 'fine.yaml'), 'w') as fine:
            fine.write(tube.read() + 'planner: {resolution: 8.0e-5}\n')  # millions of cells: a map that takes a while
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

    def mapping(self):
        goal = self.action.send(ROUTE, scene='fine.yaml')
        if not goal.until(lambda f: f.stage == PlanCatheterFeedback.MAP, WAIT):
            raise RuntimeError(f'nothing is mapped: {goal.result}')
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

    def stepping(self):
        """Processor time [s] of the thread that plans run in: the first of its name, others are its pool."""
        threads = f'/proc/{self.process.pid}/task/'
        for thread in sorted(map(int, os.listdir(threads))):
            with open(f'{threads}{thread}/comm') as name, open(f'{threads}{thread}/schedstat') as spent:
                if name.read().strip() == 'plan':
                    return 1e-9 * int(spent.read().split()[0])

    def worked(self):
        """Processor time [s] of all its threads so far, of those that have ended too."""
        return time.clock_gettime(~self.process.pid << 3 | 2)  # Linux: the processor-time clock of a process

    def diagnostics(self):
        while True:
            for status in rospy.wait_for_message('/diagnostics', DiagnosticArray, WAIT).status:
                if status.name.lstrip('/').startswith(self.name[1:] + ':') and status.values:
                    return {v.key: v.value for v in status.values}

    def received(self):
        """Messages that it was sent and took."""
        return int(self.diagnostics()['messages received'])


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


def without_waypoints(path):
    """A scene's text but for where it says how its device goes."""
    with open(path) as file:
        return re.sub(r'(entry|waypoints): \[.*?\](?=[,}\n])', r'\1:', file.read())


def left_over(node):
    """What lies in the node's folder and is no whole scene."""
    wrong = [f for f in os.listdir(node.folder) if f not in ('tube.yaml', 'tube.obj', 'fine.yaml', 'saved.yaml')]
    saved, whole = (os.path.join(node.folder, name) for name in ('saved.yaml', 'tube.yaml'))
    if os.path.exists(saved) and without_waypoints(saved) != without_waypoints(whole):
        wrong.append('saved.yaml, torn')
    return wrong


def stop(times=20, **_):
    delays, wrong = [], []
    for turn in range(times):
        node = Node()
        if turn % 2:  # what cannot be cut short
            saver, _ = Saver(node), node.mapping()
        else:
            node.moving()
            saver = Saver(node)
            time.sleep(random.uniform(0.1, 0.5))
        code, delay = node.end(signal.SIGTERM)
        saver.over = True
        saver.join(WAIT)
        delays.append(delay)
        wrong += left_over(node) + ([] if code == 0 else [f'exit {code}'])
        node.close()
    print(f'SIGTERM: {times} times, ended after {max(delays[::2]):.2f} s at most while planning, {max(delays[1::2], default=0):.2f} '
          f'while a map was made; wrong: {wrong or "nothing"}')
    return not wrong and max(delays) <= (1 if times >= 20 else 4 * PATIENCE)  # where others share the machine


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
    return not wrong and (times < LONG or max(back) <= 2)


def median(values):
    values = sorted(values)
    return values[len(values) // 2] if values else float('nan')


def in_mib(sizes):
    return ' and '.join(f'{size / 2**20:.1f}' for size in sizes)


class Window:
    """A stretch of a plan: what its steps take."""

    def __init__(self, node, goal):
        self.node, self.goal = node, goal
        self.begin = self.now()

    def now(self):
        """wall clock, processor time of the thread that steps [s], its steps"""
        return time.monotonic(), self.node.stepping(), self.goal.feedback[-1].step

    def end(self):
        """(wall clock, processor time) a step [ms]"""
        wall, busy, steps = (b - a for a, b in zip(self.begin, self.now()))
        return 1e3 * wall / max(steps, 1), 1e3 * busy / max(steps, 1)


def flood(seconds=60, **_):
    node = Node(**{'time_limit': 1e6, 'bodies/0/drive/speed': 1e-3})  # a plan that lasts
    goal = node.moving()
    sender = roslib.packages.find_node('catnav', 'catnav_flood')[0]
    for thread in os.listdir('/proc/self/task'):  # who looks on does not disturb
        os.setpriority(os.PRIO_PROCESS, int(thread), 19)

    def pour(seconds, rate):
        """How many meshes, goals and cancels were sent; memory kept and most meanwhile; what a step took."""
        memory, window = [], Window(node, goal)
        child = subprocess.Popen([sender, node.name, str(seconds), str(rate)], stdout=subprocess.PIPE, text=True)
        while child.poll() is None:
            time.sleep(0.05)
            memory.append(node.memory())
        kept = sorted(memory)[len(memory) // 10]  # not what checks of meshes, which never rest, take for a moment
        return [int(n) for n in child.stdout.read().split()], (kept, max(memory)), window.end()

    pour(min(20, seconds), 15)  # what meshes that are checked beside a plan take is no growth
    _, memory, calm = pour(seconds, 15)
    received = node.received()
    sent, higher, flooded = pour(seconds, 10000)
    arrived = node.received() - received
    time.sleep(7)  # the status list forgets ended goals after 5 s
    _, after, _ = pour(seconds, 15)
    figures = node.diagnostics()
    alive = not goal.done.is_set()
    goal.cancel()
    ended = goal.done.wait(WAIT) and goal.result.verdict.code == Verdict.CANCELLED
    verdict = node.client.plan(SHORT).verdict
    node.close()
    print(f'flood of {seconds} s: {sent} meshes, goals, cancels, {sum(sent) / seconds:.0f} a second, '
          f'{arrived / seconds:.0f} of them arrived (the senders\' own queues of 100 dropped the rest); memory, kept and most, '
          f'{in_mib(memory)} before, {in_mib(higher)} during, {in_mib(after)} MiB after; a step '
          f'{calm[0]:.2f} ms before, {flooded[0]:.2f} during, {flooded[0] / calm[0]:.2f} times (processor time {calm[1]:.3f} and '
          f'{flooded[1]:.3f} ms, {flooded[1] / calm[1]:.2f} times); {", ".join(f"{k} {v}" for k, v in figures.items() if "messages" in k or "refused" in k)}'
          f'; the plan {"lived and " if alive else "DIED, "}{"was cancelled" if ended else "DID NOT END"}, the next: {verdict.message}')
    growth, slower = max(higher[0], after[0]) - memory[0], flooded[0] / calm[0]
    if seconds >= LONG and (sum(sent) < 9900 * seconds or arrived < 9000 * seconds):
        print('no flood: 10000 a second were to be sent and to arrive')
        return False
    served = verdict.code in (Verdict.REACHED, Verdict.BUSY)
    counted = int(figures['messages dropped']) > 0 and int(figures['messages missing by their numbers']) > 0
    return bool(alive and ended and served and counted and max(growth, max(higher[1], after[1]) - memory[1]) < 32 * 2**20 * PATIENCE and
                (seconds < LONG or (growth <= 2**20 and slower <= 2)))


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
                    if not goal.done.wait(WAIT) or goal.result is None:
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
                if 'unable to receive data from sender' in str(error):
                    count(CLOSED)
                    continue
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
    if counts.get(CLOSED, 0) > 1e-3 * sum(counts.values()) + 1:
        errors.append(f'{counts[CLOSED]} {CLOSED}')
    print(f'{clients} clients for {seconds} s: {sum(counts.values())} calls answered, {dict(sorted(counts.items()))}; '
          f'exit {code}; wrong: {(errors + unknown)[:5] or "nothing"}')
    return not errors and not unknown and alive and code == 0


class Newborn:
    """The same plan by the command, in a process that lives no longer: what the machine gives a step at that moment."""

    def __init__(self, node):
        program = roslib.packages.find_node('catnav', 'catnav')[0]
        self.report = os.path.join(node.folder, 'newborn.json')
        self.command = [program, 'run', os.path.join(node.folder, 'tube.yaml'), '--quiet', '--report', self.report,
                        '--set', f'step={node.parameters["step"]}', '--set', 'bodies.0.waypoints=' + str([list(REPEATED[-1])])]

    def cpu_a_step(self):
        """[s]"""
        child = subprocess.Popen(self.command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        _, status, used = os.wait4(child.pid, 0)
        child.returncode = os.waitstatus_to_exitcode(status)
        with open(self.report) as file:
            return (used.ru_utime + used.ru_stime) / json.load(file)['steps']


def lay_fork(node):
    """fork.yaml into the node's folder: two ways that rejoin, for a rod that bends least on the longer one."""
    from fork import fork
    vertices, triangles = fork()
    with open(os.path.join(node.folder, 'fork.obj'), 'w') as file:
        file.writelines('v {:.9g} {:.9g} {:.9g}\n'.format(*v) for v in vertices)
        file.writelines('f {} {} {}\n'.format(*(i + 1 for i in t)) for t in triangles)
    with open(os.path.join(HERE, '../../test/ros/fork.yaml')) as scene, open(os.path.join(node.folder, 'fork.yaml'), 'w') as file:
        file.write(scene.read().replace('tube.obj', 'fork.obj').replace('tet4', 'rod').replace('131', '66'))


def soaked(rows, replans, alive):
    """Says what the rows show; True where every promise was kept."""
    f = study.figures(rows)
    print(f'{study.sentence(f)}; {replans} replans', flush=True)
    growth, handles, drift, crossings = (f[k] for k in ('memory_growth_bytes', 'handles_growth', 'step_drift_percent', 'crossings'))
    if rows[-1][0] < 600:  # nothing has settled yet
        return alive and growth < 32 * 2**20 * PATIENCE and handles <= 16 and crossings == 0
    return alive and growth < 2**20 and handles <= 0 and drift < 5 and crossings == 0 and replans > 0


def soak(seconds=7200, out=None, **_):
    node = Node(step=1e-3)
    lay_fork(node)
    newborn = Newborn(node)
    dice, start, told, rows, replans, same = random.Random(1), time.monotonic(), time.monotonic(), [], 0, None
    folder = out or tempfile.mkdtemp(prefix='catnav_soak_')
    os.makedirs(folder, exist_ok=True)
    log = open(os.path.join(folder, 'soak.csv'), 'w', buffering=1)
    print(*study.COLUMNS, sep=',', file=log)
    while time.monotonic() - start < seconds or len(rows) < 3:
        what = dice.random()
        if what < 0.2:
            goal = node.moving()
            time.sleep(dice.uniform(0, 0.3))
            goal.cancel()
            if not goal.done.wait(WAIT):
                print('a cancel was not answered')
                return False
        elif what < 0.3:
            if node.client.plan(SHORT, sampling='guess').verdict.code != Verdict.BAD_INPUT:
                print('a bad request was not refused')
                return False
        elif what < 0.35:
            replans += node.client.plan(THROUGH_FORK, scene='fork.yaml', limits=[Limit('', 'stress', 'max', 4e4)]).replans
        elif what < 0.8:
            node.client.plan([(0, 0, 0.01), (0, 0, dice.uniform(0.012, 0.03))], seed=dice.randrange(1000))
        else:
            expected = newborn.cpu_a_step()
            worked, begun = node.worked(), time.monotonic()
            answer = node.client.plan(REPEATED)
            worked, took = node.worked() - worked, time.monotonic() - begun
            report = json.loads(answer.report_json)
            same = same or report['bodies']
            if answer.verdict.code != Verdict.REACHED or report['bodies'] != same:
                print('the same request had another answer:', answer.verdict.message)
                return False
            contact = report['contact']
            rows.append((time.monotonic() - start, node.memory(), node.handles(), 1e3 * worked / report['steps'], 1e3 * expected,
                         1e3 * took / report['steps'], contact['intersections'] + contact['outside_nodes']))
            print(*(f'{v:.9g}' for v in rows[-1]), sep=',', file=log)
        if time.monotonic() - told > 600 and len(rows) > 9:
            soaked(rows, replans, True)
            told = time.monotonic()
    alive = node.process.poll() is None
    node.close()
    study.plot(rows, folder)
    return soaked(rows, replans, alive)


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
