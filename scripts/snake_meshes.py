#!/usr/bin/python3
"""Makes the meshes of the snake scene: snake_meshes.py FOLDER writes snake.node, snake.ele and rocks.obj [m], the same
each time."""
import os
import sys

import numpy as np

LENGTH, SECTIONS = 6.0, 526
ROCKS, FIELD = 33, ((2.0, 11.0), (-4.2, 4.2))  # on the ground: x, y from, to
ROCK_RADIUS, BETWEEN = (0.25, 0.50), 0.4


ABOUT = f'# %s; made by scripts/{os.path.basename(sys.argv[0])} of catnav, BSD-3-Clause\n'


def write_obj(path, about, vertices, triangles):
    with open(path, 'w') as file:
        file.write(ABOUT % about)
        for v in vertices:
            file.write('v %.5g %.5g %.5g\n' % tuple(v))
        for t in triangles:
            file.write('f %d %d %d\n' % tuple(i + 1 for i in t))


def write_tetgen(path, about, nodes, tets):
    for end, head, rows, form in (('.node', '3 0 0', nodes, '%d %.5g %.5g %.5g\n'),
                                  ('.ele', '4 0', tets, '%d %d %d %d %d\n')):
        with open(path + end, 'w') as file:
            file.write(ABOUT % about + f'{len(rows)} {head}\n')
            for i, row in enumerate(rows):
                file.write(form % (i, *row))


def section():
    """Points and triangles of a unit disk: the middle, 4 points half way, 8 on the rim."""
    points, first = [(0.0, 0.0)], [0]
    for radius, n in ((0.5, 4), (1.0, 8)):
        first.append(len(points))
        points += [(radius * np.cos(2 * np.pi * k / n), radius * np.sin(2 * np.pi * k / n)) for k in range(n)]
    triangles = []
    for k in range(4):
        a, b = first[1] + k, first[1] + (k + 1) % 4
        rim = [first[2] + (2 * k + j) % 8 for j in range(3)]
        triangles += [(0, a, b), (a, rim[0], rim[1]), (a, rim[1], b), (b, rim[1], rim[2])]
    return np.array(points), triangles


def snake():
    """Nodes and tetrahedra of a straight snake, snout at the origin, tail along -x: section after section."""
    disk, triangles = section()
    s = np.linspace(0, LENGTH, SECTIONS)
    radius = np.interp(s, [0, 0.06, 0.2, 0.38, 0.9, 3.6, 5.2, LENGTH],
                       [0.03, 0.065, 0.095, 0.06, 0.08, 0.08, 0.045, 0.015])
    radius = np.convolve(np.pad(radius, 8, mode='edge'), np.ones(17) / 17, mode='valid')
    nodes = np.concatenate([np.column_stack([np.full(len(disk), -s[i]), r * disk]) for i, r in enumerate(radius)])
    tets = []
    for i in range(SECTIONS - 1):
        for triangle in triangles:  # a prism in three: diagonals by the nodes' order, so that neighbours fit
            a, b, c = (i * len(disk) + k for k in sorted(triangle))
            d, e, f = (k + len(disk) for k in (a, b, c))
            for tet in ((a, b, c, f), (a, b, e, f), (a, d, e, f)):
                x = nodes[list(tet)]
                volume = np.dot(np.cross(x[1] - x[0], x[2] - x[0]), x[3] - x[0])
                tets.append(tet if volume > 0 else (tet[1], tet[0], tet[2], tet[3]))
    return nodes, tets


def icosphere(times):
    g = (1 + 5 ** 0.5) / 2
    vertices = [np.array(v, float) for v in
                [(-1, g, 0), (1, g, 0), (-1, -g, 0), (1, -g, 0), (0, -1, g), (0, 1, g), (0, -1, -g), (0, 1, -g),
                 (g, 0, -1), (g, 0, 1), (-g, 0, -1), (-g, 0, 1)]]
    triangles = [(0, 11, 5), (0, 5, 1), (0, 1, 7), (0, 7, 10), (0, 10, 11), (1, 5, 9), (5, 11, 4), (11, 10, 2),
                 (10, 7, 6), (7, 1, 8), (3, 9, 4), (3, 4, 2), (3, 2, 6), (3, 6, 8), (3, 8, 9), (4, 9, 5), (2, 4, 11),
                 (6, 2, 10), (8, 6, 7), (9, 8, 1)]
    for _ in range(times):
        middle, finer = {}, []
        for a, b, c in triangles:
            mid = []
            for edge in ((a, b), (b, c), (c, a)):
                key = tuple(sorted(edge))
                if key not in middle:
                    middle[key] = len(vertices)
                    vertices.append(0.5 * (vertices[edge[0]] + vertices[edge[1]]))
                mid.append(middle[key])
            finer += [(a, mid[0], mid[2]), (b, mid[1], mid[0]), (c, mid[2], mid[1]), tuple(mid)]
        triangles = finer
    return np.array([v / np.linalg.norm(v) for v in vertices]), triangles


def lumpy(random, ball):
    """The unit ball's points moved in to those of a lumpy stone."""
    lumps = np.ones(len(ball))
    for _ in range(6):
        wave = random.normal(size=3)
        lumps += 0.05 * np.cos(2.2 * ball @ wave + random.uniform(0, 2 * np.pi))
    return ball * np.minimum(lumps, 1.1)[:, None] / 1.1


def rocks(random):
    """Lumpy stones, their middles on the ground, at least BETWEEN apart."""
    ball, ball_triangles = icosphere(2)
    placed = []
    while len(placed) < ROCKS:
        x, y, r = (random.uniform(*span) for span in (*FIELD, ROCK_RADIUS))
        if all(np.hypot(x - p, y - q) > r + t + BETWEEN for p, q, t in placed):
            placed.append((x, y, r))
    vertices, triangles = [], []
    for x, y, r in placed:
        first = len(vertices)
        vertices += (lumpy(random, ball) * np.array([r, r, 0.8 * r]) + np.array([x, y, 0])).tolist()
        triangles += [tuple(first + i for i in t) for t in ball_triangles]
    return vertices, triangles


def main():
    folder = sys.argv[1]
    write_tetgen(os.path.join(folder, 'snake'), 'a straight snake of 6 m, snout at the origin', *snake())
    write_obj(os.path.join(folder, 'rocks.obj'), f'{ROCKS} rocks, half in the ground', *rocks(np.random.RandomState(5)))


if __name__ == '__main__':
    main()
