#!/usr/bin/python3
"""Makes bp3d_leg_to_liver_coarse.stl, the artery with about as many nodes as in Moss et al. 2008 (8,330), from
bp3d_leg_to_liver_merged.stl: a little smoothing, then quadric decimation to the first count from there up at which our
mesh doctor takes it as a wall (no edge of three triangles) and sees no crossing pair.

    scripts/coarse_artery.py CATNAV IN.stl OUT.stl
"""
import json
import subprocess
import sys
import vtk

PASS_BAND = 0.03


def decimated(mesh, nodes, path):
    d = vtk.vtkQuadricDecimation()
    d.SetInputData(mesh)
    d.SetTargetReduction(1 - 2 * nodes / mesh.GetNumberOfPolys())
    d.VolumePreservationOn()
    writer = vtk.vtkSTLWriter()
    writer.SetInputConnection(d.GetOutputPort())
    writer.SetFileName(path)
    writer.SetFileTypeToBinary()
    writer.Write()


def main():
    catnav, source, target = sys.argv[1:4]
    reader = vtk.vtkSTLReader()
    reader.SetFileName(source)
    clean = vtk.vtkCleanPolyData()
    clean.SetInputConnection(reader.GetOutputPort())
    smooth = vtk.vtkWindowedSincPolyDataFilter()
    smooth.SetInputConnection(clean.GetOutputPort())
    smooth.SetNumberOfIterations(20)
    smooth.SetPassBand(PASS_BAND)
    smooth.NormalizeCoordinatesOn()
    smooth.Update()
    for nodes in range(8330, 9000, 10):
        decimated(smooth.GetOutput(), nodes, target)
        said = subprocess.run([catnav, "check", target, "--scale", "0.001", "--json"], capture_output=True, text=True)
        doctor = json.loads(said.stdout)
        if doctor["wall"] == "usable" and not doctor["crossing_pairs"]:
            print(nodes, "nodes")
            return 0
    return 1


if __name__ == "__main__":
    sys.exit(main())
