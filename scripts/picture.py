#!/usr/bin/python3
"""A picture of a run: the vessel translucent, the bodies inside coloured by stress, and the tip close up.

    picture.py SCENE.yaml FOLDER     reads FOLDER/report.json and FOLDER/frames, writes FOLDER/picture.png

Needs an X display (xvfb-run will do)."""
import json
import os
import sys
import xml.etree.ElementTree

import numpy as np
import vtk
import yaml
from vtk.util.numpy_support import vtk_to_numpy

SIZE = (1500, 1300)
INSET = (0.60, 0.03, 0.985, 0.475)  # of the window: left, bottom, right, top


def read_surface(folder, spec):
    """A surface of the scene in metres: x = R(rotate) (scale X) + translate."""
    path = os.path.join(folder, spec['file'])
    reader = {'.stl': vtk.vtkSTLReader, '.obj': vtk.vtkOBJReader, '.ply': vtk.vtkPLYReader}[path[-4:].lower()]()
    reader.SetFileName(path)
    move = vtk.vtkTransform()
    move.PostMultiply()
    move.Scale(*[float(spec.get('scale', 1))] * 3)
    turn = np.array(spec.get('rotate', [0, 0, 0]), float)
    if np.linalg.norm(turn) > 0:
        move.RotateWXYZ(np.degrees(np.linalg.norm(turn)), *turn)
    move.Translate(*map(float, spec.get('translate', [0, 0, 0])))
    placed = vtk.vtkTransformPolyDataFilter()
    placed.SetInputConnection(reader.GetOutputPort())
    placed.SetTransform(move)
    smooth = vtk.vtkPolyDataNormals()
    smooth.SetInputConnection(placed.GetOutputPort())
    smooth.Update()
    return smooth.GetOutput()


def last_pieces(folder):
    """Paths of the pieces of the last frame in frames.pvd; a skin stands for the body that wears it."""
    sets = list(xml.etree.ElementTree.parse(os.path.join(folder, 'frames.pvd')).iter('DataSet'))
    last = max(float(s.get('timestep')) for s in sets)
    names = [s.get('file') for s in sets if float(s.get('timestep')) == last]
    worn = {'_'.join(name.rsplit('_skin_', 1))[:-4] for name in names if name.endswith('.vtp')}
    return [os.path.join(folder, name) for name in names if name.endswith('.vtp') or name[:-4] not in worn]


def read_body(path):
    reader = vtk.vtkXMLUnstructuredGridReader() if path.endswith('vtu') else vtk.vtkXMLPolyDataReader()
    reader.SetFileName(path)
    to_points = vtk.vtkCellDataToPointData()
    to_points.SetInputConnection(reader.GetOutputPort())
    surface = vtk.vtkGeometryFilter()
    surface.SetInputConnection(to_points.GetOutputPort())
    surface.Update()
    return surface.GetOutput()


def stress_limit(report):
    limits = [l['limit'] for l in report['limits'] if l['quantity'] == 'stress']
    return min(limits) if limits else None


def actor(data, colour=None, opacity=1.0):
    mapper = vtk.vtkPolyDataMapper()
    mapper.SetInputData(data)
    made = vtk.vtkActor()
    made.SetMapper(mapper)
    if colour:
        mapper.ScalarVisibilityOff()
        made.GetProperty().SetColor(*colour)
    made.GetProperty().SetOpacity(opacity)
    return made


def colours(high):
    table = vtk.vtkLookupTable()
    table.SetHueRange(0.66, 0.0)
    table.SetRange(0, high / 1e6)
    table.Build()
    return table


def scene_of(vessels, bodies, table, background):
    renderer = vtk.vtkRenderer()
    renderer.SetBackground(*background)
    for body in bodies:
        shown = actor(body)
        shown.GetMapper().SetLookupTable(table)
        shown.GetMapper().UseLookupTableScalarRangeOn()
        renderer.AddActor(shown)
    for vessel in vessels:
        renderer.AddActor(actor(vessel, (0.80, 0.30, 0.26), 0.22))
    return renderer


def main():
    scene_file, folder = sys.argv[1:3]
    with open(scene_file) as file:
        scene = yaml.safe_load(file)
    with open(os.path.join(folder, 'report.json')) as file:
        report = json.load(file)
    here = os.path.dirname(scene_file)
    vessels = [read_surface(here, v['surface']) for v in scene.get('vessels', []) if 'surface' in v]
    vessels += [read_surface(here, s) for s in scene.get('shown', []) if 'file' in s]
    bodies = [read_body(p) for p in last_pieces(os.path.join(folder, 'frames'))]

    highest = 0.0
    for body in bodies:  # stress in MPa from here on
        stress = body.GetPointData().GetArray('stress')
        if stress:
            values = vtk_to_numpy(stress)
            values /= 1e6
            highest = max(highest, float(values.max()))
            body.GetPointData().SetActiveScalars('stress')
    table = colours(stress_limit(report) or max(highest * 1e6, 1.0))

    box = vtk.vtkBoundingBox()
    for data in vessels or bodies:
        box.AddBounds(data.GetBounds())
    centre = [0.0] * 3
    box.GetCenter(centre)
    length = [box.GetLength(i) for i in range(3)]
    up = int(np.argmax(length))
    side = int(np.argmin(length))
    window = vtk.vtkRenderWindow()
    window.SetOffScreenRendering(1)
    window.SetSize(*SIZE)
    window.SetMultiSamples(0)

    def look(renderer, at, half_height, distance):
        camera = renderer.GetActiveCamera()
        camera.ParallelProjectionOn()
        camera.SetFocalPoint(*at)
        eye = list(at)
        eye[side] -= distance
        camera.SetPosition(*eye)
        camera.SetViewUp(*[float(i == up) for i in range(3)])
        camera.SetParallelScale(half_height)
        renderer.ResetCameraClippingRange()
        renderer.SetUseDepthPeeling(1)
        renderer.SetMaximumNumberOfPeels(8)

    whole = scene_of(vessels, bodies, table, (1, 1, 1))
    shifted = list(centre)
    across = 3 - up - side
    sign = 1.0 if np.cross(np.eye(3)[side], np.eye(3)[up])[across] > 0 else -1.0
    shifted[across] += sign * 0.24 * length[up]  # the vessel left of the middle: the inset is on the right
    window.AddRenderer(whole)
    look(whole, shifted, 0.53 * length[up], 3 * max(length))

    bar = vtk.vtkScalarBarActor()
    bar.SetLookupTable(table)
    bar.SetTitle('von Mises [MPa]')
    bar.SetNumberOfLabels(5)
    bar.GetLabelTextProperty().SetColor(0.1, 0.1, 0.1)
    bar.GetTitleTextProperty().SetColor(0.1, 0.1, 0.1)
    bar.SetPosition(0.85, 0.53)
    bar.SetWidth(0.09)
    bar.SetHeight(0.38)
    bar.UnconstrainedFontSizeOn()
    for text in bar.GetLabelTextProperty(), bar.GetTitleTextProperty():
        text.SetFontSize(18)
        text.ItalicOff()
        text.ShadowOff()
    whole.AddActor2D(bar)

    verdict = report['verdict']
    text = vtk.vtkTextActor()
    text.SetInput(f"{scene.get('scene', '')}: {verdict['code']}\n{report['steps']} steps, "
                  f"{report['time']['simulated_s'] or 0:.1f} s simulated\n"
                  f"least gap {1e3 * (report['contact']['gap_min'] or 0):.3f} mm\n"
                  f"highest stress now {highest:.2f} MPa")
    text.GetTextProperty().SetColor(0.1, 0.1, 0.1)
    text.GetTextProperty().SetFontSize(24)
    text.GetPositionCoordinate().SetCoordinateSystemToNormalizedViewport()
    text.SetPosition(0.60, 0.80)
    whole.AddActor2D(text)

    if bodies:
        close = scene_of(vessels, bodies, table, (0.97, 0.97, 0.98))
        close.SetViewport(*INSET)
        window.AddRenderer(close)
        look(close, report['bodies'][0]['tip'], 0.03 * length[up], 0.5 * max(length))
        frame = vtk.vtkTextActor()
        frame.SetInput('tip')
        frame.GetTextProperty().SetColor(0.1, 0.1, 0.1)
        frame.GetTextProperty().SetFontSize(22)
        frame.SetPosition(12, 12)
        close.AddActor2D(frame)

    window.Render()
    grab = vtk.vtkWindowToImageFilter()
    grab.SetInput(window)
    grab.ReadFrontBufferOff()
    writer = vtk.vtkPNGWriter()
    writer.SetFileName(os.path.join(folder, 'picture.png'))
    writer.SetInputConnection(grab.GetOutputPort())
    writer.Write()


if __name__ == '__main__':
    main()
