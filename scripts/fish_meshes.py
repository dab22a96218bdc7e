#!/usr/bin/python3
"""Makes the surroundings of the fish scene: fish_meshes.py FOLDER writes stones.obj and plants.obj [m], the same
each time, and prints the waypoints of the fish: through the field, then along their letters."""
import os
import sys

import numpy as np

from snake_meshes import icosphere, lumpy, write_obj

LANES = (4.8, 1.6, -1.6, -4.8)    # y of each fish's way
MIDDLE = 0.5                      # height at which they swim
FIELD = (1.8, 3.3, 4.8)           # x of each lane's stones
BESIDE = 0.45                     # how far a fish swings out beside a stone
LETTER = 6.9                      # x of the letters' feet
SIDES, RINGS, HEIGHT, FOOT, TIP = 6, 22, 0.9, 0.04, 0.012

# strokes in a letter's own frame: right of its middle, above its foot; each begins where a fish comes from below
LETTERS = {
    'C': [(1.05, -0.6), (0.65, 0.0), (0.0, 0.0), (-0.62, 0.4), (-0.8, 1.2), (-0.62, 2.0), (0.0, 2.4), (0.75, 2.2)],
    'A': [(-0.9, 0.0), (-0.55, 1.0), (-0.3, 1.8), (0.0, 2.25), (0.3, 1.8), (0.55, 1.0), (0.85, 0.2), (1.3, 0.1),
          (1.3, 0.75), (0.55, 0.9), (0.0, 0.9), (-0.6, 0.9)],
    'S': [(-1.1, -0.6), (-0.65, 0.0), (0.0, 0.0), (0.65, 0.45), (0.45, 1.0), (0.0, 1.2), (-0.45, 1.4),
          (-0.65, 1.95), (0.0, 2.4), (0.75, 2.2)]}


def sides():
    return [1 if lane % 2 else -1 for lane in range(len(LANES))]


def stones(random):
    """Three upright stones a lane, in turn on either side of the fish's way."""
    ball, triangles = icosphere(2)
    vertices, faces = [], []
    for y, side in zip(LANES, sides()):
        for k, x in enumerate(FIELD):
            at = np.array([x, y - (-1) ** k * side * 0.35, 0])
            faces += [tuple(len(vertices) + i for i in t) for t in triangles]
            vertices += (lumpy(random, ball) * np.array([0.5, 0.5, 0.9]) + at).tolist()
    return vertices, faces


def plant():
    """A slender cone on the ground."""
    vertices, faces = [(0.0, 0.0, 0.0)], []
    for ring in range(RINGS):
        share = ring / RINGS
        for k in range(SIDES):
            a = 2 * np.pi * (k + 0.5 * (ring % 2)) / SIDES
            r = FOOT + (TIP - FOOT) * share
            vertices.append((r * np.cos(a), r * np.sin(a), HEIGHT * share))
    vertices.append((0.0, 0.0, HEIGHT))
    at = lambda ring, k: 1 + ring * SIDES + k % SIDES
    for k in range(SIDES):
        faces.append((0, at(0, k + 1), at(0, k)))
        faces.append((at(RINGS - 1, k), at(RINGS - 1, k + 1), len(vertices) - 1))
        for ring in range(RINGS - 1):
            a, b = at(ring, k), at(ring, k + 1)
            c, d = at(ring + 1, k), at(ring + 1, k + 1)  # turned by half a side from ring to ring
            faces += [(a, b, c), (b, d, c)] if ring % 2 == 0 else [(a, d, c), (a, b, d)]
    return np.array(vertices), faces


def plants():
    """Five plants a lane, each so near the fish's way that it must bend."""
    stem, triangles = plant()
    vertices, faces = [], []
    for y, side in zip(LANES, sides()):
        beside = [(1.2, 0.1), (FIELD[0], BESIDE + 0.12), ((FIELD[0] + FIELD[1]) / 2, -0.1),
                  (FIELD[1], -BESIDE - 0.12), ((FIELD[1] + FIELD[2]) / 2, 0.1)]
        for x, off in beside:
            faces += [tuple(len(vertices) + i for i in t) for t in triangles]
            vertices += (stem + np.array([x, y + side * off, 0])).tolist()
    return vertices, faces


def waypoints():
    for name, y, side in zip('CASA', LANES, sides()):
        through = [(0.75, y)] + [(x, y + (-1) ** k * side * BESIDE) for k, x in enumerate(FIELD)]
        letter = [(LETTER + up, y - right) for right, up in LETTERS[name]]
        yield name, [(round(x, 3), round(v, 3), MIDDLE) for x, v in through + letter]


def main():
    folder = sys.argv[1]
    write_obj(os.path.join(folder, 'stones.obj'), f'{3 * len(LANES)} stones, half in the ground',
              *stones(np.random.RandomState(3)))
    write_obj(os.path.join(folder, 'plants.obj'), f'{5 * len(LANES)} plants on the ground', *plants())
    for name, points in waypoints():
        print(name, ', '.join('[%g, %g, %g]' % p for p in points))


if __name__ == '__main__':
    main()
