"""The scene for comparisons of lightpath with other renderers: a diffuse mesh on a ground plane, under a square area light
or a sky, with a black background."""
import math
import os
import sys


def describe(mesh, sky=None):
    """Returns the description from which each program's scene is made: lengths in world units, y up. `sky` is an
    equirectangular image that lights the scene instead of the area light."""
    import numpy as np
    with open(mesh, 'rb') as file:
        count = 0
        while (line := file.readline().strip()) != b'end_header':
            words = line.split()
            if words[:2] == [b'element', b'vertex']:
                count = int(words[2])
            if words[:2] == [b'format', b'ascii']:
                sys.exit(f'{mesh}: expected a binary PLY whose vertices are x y z floats')
        points = np.frombuffer(file.read(12 * count), '<f4').reshape(-1, 3).astype(float)
    low, high = points.min(0), points.max(0)
    scale = float(2 / (high - low).max())
    return {
        'mesh': os.path.abspath(mesh), 'middle': [float(v) for v in (low + high) / 2], 'scale': scale,
        'floor': float(-(high - low)[1] * scale / 2), 'half_floor': 6.0,
        'camera': [0.6, 1.0, 4.2], 'target': [0, -0.1, 0], 'fov': 40.0, 'albedo': 0.7,
        # Centre, half side, radiance. The light points down.
        'light': [1.0, 3.0, 1.0], 'half_light': 0.5, 'radiance': 20.0,
        'sky': sky and os.path.abspath(sky),
    }


def for_lightpath(d, size):
    (x, y, z), h, g = d['light'], d['half_light'], d['half_floor']
    power = d['radiance'] * (2 * h) ** 2 / math.pi
    plain = {'kd': 1, 'diffusecolor': [d['albedo']] * 3}
    # (v1 - v0) x (v2 - v0) = -y
    lamp = {'type': 'arealight', 'v0': [x - h, y, z - h], 'v1': [x + h, y, z - h], 'v2': [x - h, y, z + h],
            'id': [power] * 3, 'samples': 1, 'emission': 'lambertian'}
    sky = {'type': 'environment', 'image': d['sky'], 'samples': 1, 'visible': False}
    return {
        'nbounces': 0,
        'camera': {'type': 'pinhole', 'width': size, 'height': size, 'fov': d['fov'],
                   'position': d['camera'], 'target': d['target'], 'up': [0, 1, 0]},
        'scene': {
            'attenuation': 'quadratic',
            'lightsources': [sky if d['sky'] else lamp],
            'shapes': [
                {'type': 'trimesh', 'path': d['mesh'], 'fit': 2, 'material': plain},
                {'type': 'plane', 'v0': [-g, d['floor'], g], 'v1': [g, d['floor'], g],
                 'v2': [g, d['floor'], -g], 'v3': [-g, d['floor'], -g], 'material': plain}]},
    }
