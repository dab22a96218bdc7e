#!/usr/bin/python3
"""A strip of pictures of a run: its start, the moment of highest mean stress, its end.

    strip.py FRAMES OUT.png [--from X,Y,Z] [--up X,Y,Z] [--times T,T,...] [--across N]
             [--wall OPACITY] [--clear BODY ...] [--tight] [--trail BODY,FROM,TO ...]

FRAMES is a folder that `catnav run --frames` wrote. --from: the direction the camera looks from. --times: other
moments than those three. --across: pictures in a row. --clear: a body (a wall that gives way) drawn as walls are, its
stress left out of the scale. --tight: the walls fill the picture, whatever of the bodies lies beside. --trail: the way
of a body's middle between two moments, as far as it has come. Needs an X display (xvfb-run will do)."""
import argparse
import glob
import os
import xml.etree.ElementTree

import numpy as np
import vtk
from vtk.util.numpy_support import vtk_to_numpy

from picture import actor, colours, read_body


def numbers(text):
    return [float(t) for t in text.split(',')]


def walls(folder):
    """The vessels and obstacles that the run wrote beside its frames."""
    for path in sorted(glob.glob(os.path.join(folder, 'wall_*.vtp'))):
        reader = vtk.vtkXMLPolyDataReader()
        reader.SetFileName(path)
        smooth = vtk.vtkPolyDataNormals()
        smooth.SetInputConnection(reader.GetOutputPort())
        smooth.Update()
        yield smooth.GetOutput()


def frames(folder):
    """{time: [files]} of a run's bodies."""
    found = {}
    for s in xml.etree.ElementTree.parse(os.path.join(folder, 'frames.pvd')).iter('DataSet'):
        found.setdefault(float(s.get('timestep')), []).append(os.path.join(folder, s.get('file')))
    return found


def way_of(found, body, begin, end):
    """[(time, middle of the body)] from one moment to another."""
    return [(t, vtk_to_numpy(read_body(path).GetPoints().GetData()).mean(0))
            for t in sorted(found) if begin <= t <= end for path in found[t]
            if body_of(path) == body]


def body_of(path):
    return os.path.basename(path).rsplit('_', 1)[0]


def tube(points, thick):
    line = vtk.vtkLineSource()
    corners = vtk.vtkPoints()
    for p in points:
        corners.InsertNextPoint(p)
    line.SetPoints(corners)
    round_line = vtk.vtkTubeFilter()
    round_line.SetInputConnection(line.GetOutputPort())
    round_line.SetRadius(thick)
    round_line.SetNumberOfSides(12)
    round_line.CappingOn()
    round_line.Update()
    return round_line.GetOutput()


def stress_of(bodies):
    return max([vtk_to_numpy(b.GetPointData().GetArray('stress')) for b in bodies], key=np.mean)


def main():
    ask = argparse.ArgumentParser(description=__doc__.split('\n')[0])
    ask.add_argument('frames')
    ask.add_argument('out')
    ask.add_argument('--from', dest='side', type=numbers, default=[1, 0, 0])
    ask.add_argument('--up', type=numbers, default=[0, 0, 1])
    ask.add_argument('--times', type=numbers)
    ask.add_argument('--across', type=int, default=1)
    ask.add_argument('--wall', type=float, default=1)
    ask.add_argument('--width', type=int, default=1200)
    ask.add_argument('--clear', action='append', default=[])
    ask.add_argument('--tight', action='store_true')
    ask.add_argument('--trail', action='append', default=[])
    given = ask.parse_args()
    found = frames(given.frames)
    solid_of = lambda paths: [p for p in paths if body_of(p) not in given.clear]
    times = sorted(found)
    if given.times:
        chosen = [min(times, key=lambda t: abs(t - wish)) for wish in given.times]
    else:
        hardest = max(times, key=lambda t: float(np.mean(stress_of([read_body(p) for p in solid_of(found[t])]))))
        chosen = [times[0], hardest, times[-1]]
    surfaces = list(walls(given.frames))
    trails = [way_of(found, body, float(begin), min(float(end), chosen[-1]))
              for body, begin, end in (t.split(',') for t in given.trail)]
    shown = [[read_body(p) for p in solid_of(found[t])] for t in chosen]
    clear = [[read_body(p) for p in found[t] if p not in solid_of(found[t])] for t in chosen]
    high = max(float(np.percentile(stress_of(bodies), 98)) for bodies in shown)

    side, up = (np.array(v, float) / np.linalg.norm(v) for v in (given.side, given.up))
    across = np.cross(up, side) / np.linalg.norm(np.cross(up, side))
    up = np.cross(side, across)
    corners = []
    for data in surfaces + [body for bodies in clear + ([] if given.tight else shown) for body in bodies]:
        points = vtk_to_numpy(data.GetPoints().GetData())
        corners += [points @ np.array([across, up, side]).T]
    corners += [np.array([p for _, p in way]) @ np.array([across, up, side]).T for way in trails]
    corners = np.vstack(corners)
    low, top = corners.min(0), corners.max(0)
    middle = 0.5 * (low + top)
    focus = middle[0] * across + middle[1] * up + middle[2] * side
    size = 1.06 * (top - low)

    rows = -(-len(chosen) // given.across)
    wide = given.width // given.across
    tall = int(wide * size[1] / size[0])
    window = vtk.vtkRenderWindow()
    window.SetOffScreenRendering(1)
    window.SetSize(wide * given.across, tall * rows)
    window.SetMultiSamples(8)
    for i, (time, bodies, gives_way) in enumerate(zip(chosen, shown, clear)):
        renderer = vtk.vtkRenderer()
        renderer.SetBackground(1, 1, 1)
        column, row = i % given.across, i // given.across
        renderer.SetViewport(column / given.across, 1 - (row + 1) / rows, (column + 1) / given.across,
                             1 - row / rows)
        for body in bodies:
            values = vtk_to_numpy(body.GetPointData().GetArray('stress'))
            values /= 1e6
            body.GetPointData().SetActiveScalars('stress')
            solid = actor(body)
            solid.GetMapper().SetLookupTable(colours(high))
            solid.GetMapper().UseLookupTableScalarRangeOn()
            renderer.AddActor(solid)
        for surface in surfaces + gives_way:
            renderer.AddActor(actor(surface, (0.62, 0.60, 0.56), given.wall))
        for way in trails:
            done = [p for t, p in way if t <= time]
            if len(done) > 1:
                renderer.AddActor(actor(tube(done, 4e-3 * size[0]), (0.80, 0.15, 0.10)))
        camera = renderer.GetActiveCamera()
        camera.ParallelProjectionOn()
        camera.SetFocalPoint(*focus)
        camera.SetPosition(*(focus + 2 * np.linalg.norm(size) * side))
        camera.SetViewUp(*up)
        camera.SetParallelScale(0.5 * size[1])
        renderer.ResetCameraClippingRange()
        text = vtk.vtkTextActor()
        text.SetInput(f'{time:.2f} s')
        text.GetTextProperty().SetColor(0.1, 0.1, 0.1)
        text.GetTextProperty().SetFontSize(20)
        text.SetPosition(10, 8)
        renderer.AddActor2D(text)
        window.AddRenderer(renderer)
    window.Render()
    grab = vtk.vtkWindowToImageFilter()
    grab.SetInput(window)
    grab.ReadFrontBufferOff()
    writer = vtk.vtkPNGWriter()
    writer.SetFileName(given.out)
    writer.SetInputConnection(grab.GetOutputPort())
    writer.Write()
    print(f'{given.out}: {", ".join(f"{t:g} s" for t in chosen)}; red is {high / 1e6:.3g} MPa')


if __name__ == '__main__':
    main()
