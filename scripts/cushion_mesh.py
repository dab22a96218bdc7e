#!/usr/bin/python3
"""Makes the cushion of the molecules scene: cushion_mesh.py FOLDER writes cushion.obj [m], the same each time."""
import os
import sys

import numpy as np

from snake_meshes import icosphere, write_obj

HALF = np.array([0.16, 0.16, 0.05])
ROUND = 4                  # power of the rounded box |x/a|^4 + |y/b|^4 + |z/c|^4 = 1
HOLLOW, WIDE = 0.045, 0.09  # of its upper side, in which something can lie


def main():
    ball, triangles = icosphere(3)
    points = HALF * ball / (np.abs(ball) ** ROUND).sum(1)[:, None] ** (1 / ROUND)
    hollow = HOLLOW * np.exp(-(points[:, 0] ** 2 + points[:, 1] ** 2) / WIDE ** 2)
    points[:, 2] -= hollow * (points[:, 2] > 0) * points[:, 2] / HALF[2]
    write_obj(os.path.join(sys.argv[1], 'cushion.obj'), 'a hollow cushion of 32 x 32 x 10 cm about the origin', points,
              triangles)


if __name__ == '__main__':
    main()
