#!/usr/bin/python3
"""Sends a surface mesh on ~artery_mesh, latched, and stays until shut down.

    rosrun catnav send_mesh.py SCENE.yaml                the scene's first vessel, placed as the scene says
    rosrun catnav send_mesh.py MESH.stl --scale 0.001    any STL or OBJ file; scale: metres per file unit
"""
import argparse
import gzip
import os
import struct

import rospy
import yaml
from catnav.msg import SurfaceMesh
from geometry_msgs.msg import Point
from shape_msgs.msg import MeshTriangle


def read_surface(path):
    """Vertices and triangles of an STL or OBJ file; equal STL corners are merged, nothing else is touched."""
    with (gzip.open if path.endswith('.gz') else open)(path, 'rb') as file:
        data = file.read()
    if '.obj' in path.lower():
        vertices, triangles = [], []
        for line in data.decode(errors='replace').splitlines():
            words = line.split()
            if words[:1] == ['v']:
                vertices.append(tuple(map(float, words[1:4])))
            elif words[:1] == ['f']:
                index = [int(w.split('/')[0]) for w in words[1:]]
                index = [i - 1 if i > 0 else len(vertices) + i for i in index]
                triangles += [(index[0], index[k], index[k + 1]) for k in range(1, len(index) - 1)]
        return vertices, triangles
    count = struct.unpack_from('<I', data, 80)[0] if len(data) >= 84 else -1
    if len(data) == 84 + 50 * count:
        corners = [struct.unpack_from('<3f', data, 84 + 50 * i + 12 * k) for i in range(count) for k in (1, 2, 3)]
    else:
        lines = (line.split() for line in data.decode(errors='replace').splitlines())
        corners = [tuple(map(float, w[1:4])) for w in lines if w[:1] == ['vertex']]
    index = {}
    order = [index.setdefault(c, len(index)) for c in corners]
    return list(index), [tuple(order[i:i + 3]) for i in range(0, len(order) - 2, 3)]


def place(placement, vertices):
    """x = R(rotate) (scale X) + translate, rotate a rotation vector [rad]."""
    import numpy
    x = numpy.array(vertices, dtype=float) * float(placement.get('scale', 1))
    w = numpy.array(placement.get('rotate', [0, 0, 0]), dtype=float)
    angle = numpy.linalg.norm(w)
    if angle > 0:
        a, b, c = w / angle
        k = numpy.array([[0, -c, b], [c, 0, -a], [-b, a, 0]])
        x = x @ (numpy.eye(3) + numpy.sin(angle) * k + (1 - numpy.cos(angle)) * k @ k).T
    return x + numpy.array(placement.get('translate', [0, 0, 0]), dtype=float)


def message(vertices, triangles, name='', frame='map'):
    mesh = SurfaceMesh(name=name)
    mesh.header.frame_id = frame
    mesh.surface.vertices = [Point(*map(float, v)) for v in vertices]
    mesh.surface.triangles = [MeshTriangle(vertex_indices=t) for t in triangles]
    return mesh


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument('file', help='scene (.yaml) or mesh (.stl, .obj)')
    parser.add_argument('--scale', type=float, default=1.0, help='metres per file unit, for a mesh')
    parser.add_argument('--name', default='', help="the scene's vessel whose place it takes; empty: its only one")
    parser.add_argument('--frame', default='map')
    options = parser.parse_args(rospy.myargv()[1:])

    rospy.init_node('send_mesh')
    path, name, placement = options.file, options.name, {'scale': options.scale}
    if path.endswith(('.yaml', '.yml')):
        with open(path) as file:
            vessels = yaml.safe_load(file).get('vessels') or []
        if not vessels or 'surface' not in vessels[0]:
            rospy.loginfo('%s: no vessel comes from a file, nothing to send', path)
            return
        placement = vessels[0]['surface']
        name = name or vessels[0]['name']
        path = os.path.join(os.path.dirname(path), placement['file'])
    vertices, triangles = read_surface(path)
    sender = rospy.Publisher('/catnav/artery_mesh', SurfaceMesh, queue_size=1, latch=True)
    sender.publish(message(place(placement, vertices), triangles, name, options.frame))
    rospy.loginfo('sent %s: %d vertices, %d triangles', path, len(vertices), len(triangles))
    rospy.spin()


if __name__ == '__main__':
    main()
