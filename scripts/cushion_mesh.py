#!/usr/bin/python3
"""Makes the cushion of the molecules scene: cushion_mesh.py FOLDER writes cushion.obj [m], the same each time."""
import os
import sys

import numpy as np

from snake_meshes import icosphere, write_obj

HALF = np.array([0.15, 0.15, 0.04])
ROUND = 4  # power of the rounded box |x/a|^4 + |y/b|^4 + |z/c|^4 = 1


def main():
    ball, triangles = icosphere(3)
    points = HALF * ball / (np.abs(ball) ** ROUND).sum(1)[:, None] ** (1 / ROUND)
    write_obj(os.path.join(sys.argv[1], 'cushion.obj'), 'a cushion of 30 x 30 x 8 cm about the origin', points,
              triangles)


if __name__ == '__main__':
    main()
