#!/usr/bin/python3
"""Writes fork.stl beside this file: a closed vessel of 2.5 mm radius [mm] whose two arms part and rejoin, one
short with a tight corner, one long and wide. The zero surface of a distance field, decimated, normals outwards."""
import os

import numpy as np
import vtk
from vtk.util.numpy_support import numpy_to_vtk

RADIUS, CELL = 2.5, 0.6


def arc(centre, radius, start, end, n=16):
    """Points on an arc in the x-z plane, angles in degrees from +x towards +z."""
    angle = np.radians(np.linspace(start, end, n))
    return np.stack([centre[0] + radius * np.cos(angle), 0 * angle, centre[1] + radius * np.sin(angle)], 1)


def distance(x, axis):
    """From points to a polyline."""
    best = np.full(len(x), np.inf)
    for a, b in zip(axis[:-1], axis[1:]):
        t = np.clip((x - a) @ (b - a) / ((b - a) @ (b - a)), 0, 1)
        best = np.minimum(best, np.linalg.norm(x - a - t[:, None] * (b - a), axis=1))
    return best


def arms():
    t = np.linspace(0, 1, 60)
    wide = np.stack([-30 * np.sin(np.pi * t) ** 2, 0 * t, 20 + 120 * t], 1)
    corner = arc((17 - 6 * np.sqrt(2), 80), 6, -45, 45)  # a right angle, its apex 14.5 mm off the trunk
    tight = np.concatenate([[[0, 0, 20], [0, 0, 63]], corner, [[0, 0, 97], [0, 0, 140]]])
    trunk = np.array([[0.0, 0, 0], [0, 0, 20]])
    return wide, tight, trunk, trunk + [0, 0, 140]


def main():
    low, high = np.array([-35.0, -4, -4]), np.array([21.0, 4, 164])
    size = np.ceil((high - low) / CELL).astype(int) + 1
    z, y, x = np.meshgrid(*[low[k] + CELL * np.arange(size[k]) for k in (2, 1, 0)], indexing="ij")
    points = np.stack([x, y, z], -1).reshape(-1, 3)
    field = np.min([distance(points, a) for a in arms()], 0)

    grid = vtk.vtkImageData()
    grid.SetDimensions(*map(int, size))
    grid.SetOrigin(*low)
    grid.SetSpacing(CELL, CELL, CELL)
    grid.GetPointData().SetScalars(numpy_to_vtk(field, deep=1))
    surface = vtk.vtkContourFilter()
    surface.SetInputData(grid)
    surface.SetValue(0, RADIUS)
    fewer = vtk.vtkQuadricDecimation()
    fewer.SetInputConnection(surface.GetOutputPort())
    fewer.SetTargetReduction(0.9)
    outwards = vtk.vtkPolyDataNormals()
    outwards.SetInputConnection(fewer.GetOutputPort())
    outwards.AutoOrientNormalsOn()
    outwards.SplittingOff()
    stl = vtk.vtkSTLWriter()
    stl.SetInputConnection(outwards.GetOutputPort())
    stl.SetFileTypeToBinary()
    stl.SetFileName(os.path.join(os.path.dirname(os.path.abspath(__file__)), "fork.stl"))
    stl.Write()


if __name__ == "__main__":
    main()
