#!/usr/bin/env python3
"""Compares time and error of lightpath and Blender's Cycles on the same scene.

usage: cycles.py [--lightpath PROGRAM] [--size N] [--sky IMAGE] [--rounds N] STEP... MESH.ply
   pip install bpy==5.0.1 numpy, with the Python that this wheel names

The scene of plain_scene.py, direct light only. Cycles renders on the CPU with its adaptive sampling and without a denoiser.
  check   both at many samples, 128 x 128: relmse must be below 1e-3, else exit 1
  error   time and RMSE, in turns: Cycles at several noise thresholds, lightpath at several numbers of samples. The reference
          is by lightpath; with --sky, each program has its own. It is the mean of two pictures with seeds of their own.
          A quarter of their mean squared difference is the expected squared error of that mean, and is subtracted from
          the measured one. Prints the time to the same RMSE.
Times of lightpath are of the whole process. Times of Cycles are of the whole process without the start of Python and the
import of bpy: from the empty scene to the written file. relmse: mean d^2 / (r^2 + 0.01).
"""
import argparse
import json
import math
import os
import statistics
import subprocess
import sys
import tempfile
import time

from plain_scene import describe, for_lightpath

HERE = os.path.dirname(os.path.abspath(__file__))
# Blender's add-on has the same name as this file.
sys.path = [path for path in sys.path if os.path.abspath(path) != HERE]
THRESHOLDS = [0.2, 0.1, 0.05, 0.02]
CURVE = [1, 2, 4, 8, 16, 32, 64, 128, 256]
# Samples of each of the two pictures of a reference.
REFERENCE = {'lightpath': 512, 'Cycles': 128}
# Required ratios lightpath / Cycles of the time to the same RMSE.
BAR, GOAL = 0.2, 0.1


def build(d, size):
    """Fills Blender's scene. Blender's z is up: (x, y, z) of the description is (x, -z, y) there."""
    import addon_utils
    import bpy
    from mathutils import Matrix, Vector
    addon_utils.enable('cycles')
    scene = bpy.context.scene
    for thing in list(bpy.data.objects):
        bpy.data.objects.remove(thing)
    place = lambda p: Vector((p[0], -p[2], p[1]))
    material = bpy.data.materials.new('plain')
    material.use_nodes = True
    nodes, links = material.node_tree.nodes, material.node_tree.links
    nodes.clear()
    diffuse, out = nodes.new('ShaderNodeBsdfDiffuse'), nodes.new('ShaderNodeOutputMaterial')
    diffuse.inputs['Color'].default_value = [d['albedo']] * 3 + [1]
    diffuse.inputs['Roughness'].default_value = 0
    links.new(diffuse.outputs[0], out.inputs['Surface'])

    bpy.ops.wm.ply_import(filepath=d['mesh'], forward_axis='Y', up_axis='Z')
    mesh = bpy.context.object
    turn = Matrix(((1, 0, 0, 0), (0, 0, -1, 0), (0, 1, 0, 0), (0, 0, 0, 1)))
    mesh.matrix_world = turn @ Matrix.Scale(d['scale'], 4) @ Matrix.Translation([-v for v in d['middle']])
    g = d['half_floor']
    floor = bpy.data.meshes.new('floor')
    corners = [(-g, d['floor'], g), (g, d['floor'], g), (g, d['floor'], -g), (-g, d['floor'], -g)]
    floor.from_pydata([place(c) for c in corners], [], [(0, 1, 2, 3)])
    ground = bpy.data.objects.new('floor', floor)
    scene.collection.objects.link(ground)
    for thing in (mesh, ground):
        thing.data.materials.clear()
        thing.data.materials.append(material)
    mesh.data.shade_flat()

    world = bpy.data.worlds.new('world')
    scene.world = world
    world.use_nodes = True
    background = world.node_tree.nodes['Background']
    background.inputs['Color'].default_value = (0, 0, 0, 1)
    if d['sky']:
        image = world.node_tree.nodes.new('ShaderNodeTexEnvironment')
        image.image = bpy.data.images.load(d['sky'])
        turned = world.node_tree.nodes.new('ShaderNodeMapping')
        turned.inputs['Rotation'].default_value = (0, 0, -math.pi / 2)
        at = world.node_tree.nodes.new('ShaderNodeTexCoord')
        for a, b in [(at.outputs['Generated'], turned.inputs['Vector']),
                     (turned.outputs['Vector'], image.inputs['Vector']),
                     (image.outputs['Color'], background.inputs['Color'])]:
            world.node_tree.links.new(a, b)
        world.cycles_visibility.camera = False
    else:
        lamp = bpy.data.lights.new('lamp', 'AREA')
        lamp.shape, lamp.size = 'SQUARE', 2 * d['half_light']
        # Blender's energy is the radiant flux: pi x radiance x area.
        lamp.energy = math.pi * d['radiance'] * lamp.size ** 2
        lamp.spread = math.pi
        light = bpy.data.objects.new('lamp', lamp)
        light.location = place(d['light'])
        light.visible_camera = False
        scene.collection.objects.link(light)

    camera = bpy.data.cameras.new('camera')
    camera.sensor_fit, camera.angle = 'VERTICAL', math.radians(d['fov'])
    eye = bpy.data.objects.new('camera', camera)
    eye.location = place(d['camera'])
    eye.rotation_mode = 'QUATERNION'
    eye.rotation_quaternion = (place(d['target']) - place(d['camera'])).to_track_quat('-Z', 'Y')
    scene.collection.objects.link(eye)
    scene.camera = eye

    render, cycles = scene.render, scene.cycles
    render.engine = 'CYCLES'
    render.resolution_x = render.resolution_y = size
    render.resolution_percentage = 100
    render.image_settings.file_format = 'OPEN_EXR'
    render.image_settings.color_depth = '32'
    scene.view_settings.view_transform = 'Raw'
    cycles.device = 'CPU'
    cycles.use_denoising = False
    cycles.pixel_filter_type = 'BOX'
    cycles.max_bounces = cycles.diffuse_bounces = cycles.glossy_bounces = 0
    cycles.sample_clamp_direct = cycles.sample_clamp_indirect = 0
    return scene


def process(arguments):
    """Renders with Cycles in this process, and prints the seconds."""
    import bpy
    d, size, threshold, samples, seed, out = json.load(open(arguments[0])), *arguments[1:]
    started = time.perf_counter()
    scene = build(d, int(size))
    scene.cycles.samples, scene.cycles.seed = int(samples), int(seed)
    scene.cycles.use_adaptive_sampling = float(threshold) > 0
    if scene.cycles.use_adaptive_sampling:
        scene.cycles.adaptive_threshold = float(threshold)
    scene.render.filepath = out
    bpy.ops.render.render(write_still=True)
    print(json.dumps({'seconds': time.perf_counter() - started}))


class Bench:
    def __init__(self, args):
        self.args, self.description, self.folder = args, describe(args.mesh, args.sky), args.folder or tempfile.mkdtemp()
        os.makedirs(self.folder, exist_ok=True)
        self.file = self.write('description.json', self.description)

    def write(self, name, value):
        path = os.path.join(self.folder, name)
        with open(path, 'w') as file:
            json.dump(value, file)
        return path

    def pixels(self, name):
        """Returns the RGB of an EXR file, as Blender reads it."""
        import bpy
        import numpy as np
        image = bpy.data.images.load(os.path.join(self.folder, name + '.exr'))
        image.colorspace_settings.name = 'Non-Color'
        flat = np.empty(len(image.pixels), np.float32)
        image.pixels.foreach_get(flat)
        bpy.data.images.remove(image)
        return flat.reshape(-1, 4)[:, :3].astype(float)

    def lightpath(self, name, size, spp, seed=0):
        scene = self.write(f'{size}.json', for_lightpath(self.description, size))
        command = [self.args.lightpath, 'render', scene, '-o', os.path.join(self.folder, name), '--spp', str(spp),
                   '--quiet', '--float', '--seed', str(seed)]
        started = time.perf_counter()
        subprocess.run(command, check=True, capture_output=True)
        return time.perf_counter() - started

    def cycles(self, name, size, threshold, samples, seed=0):
        command = [sys.executable, os.path.abspath(__file__), '--process', self.file, str(size), str(threshold),
                   str(samples), str(seed), os.path.join(self.folder, name + '.exr')]
        shown = subprocess.run(command, check=True, capture_output=True, text=True).stdout
        return json.loads(next(line for line in shown.splitlines() if line.startswith('{"seconds"')))['seconds']

    def check(self):
        import numpy as np
        self.lightpath('ours', 128, 4096)
        self.cycles('theirs', 128, 0, 2048)
        ours, theirs = self.pixels('ours'), self.pixels('theirs')
        relmse = float(np.mean((ours - theirs) ** 2 / (theirs ** 2 + 0.01)))
        print(f'The same picture: relmse {relmse:.1e}, ratio of the means {ours.mean() / theirs.mean():.5f}.', flush=True)
        return relmse < 1e-3

    def reference(self, who):
        """Returns the mean of two pictures, and the expected squared error of that mean."""
        import numpy as np
        halves = []
        for seed in (777, 778):
            if who == 'Cycles':
                self.cycles('reference', self.args.size, 0, REFERENCE[who], seed)
            else:
                self.lightpath('reference', self.args.size, REFERENCE[who], seed)
            halves.append(self.pixels('reference'))
        return sum(halves) / 2, float(np.mean((halves[0] - halves[1]) ** 2)) / 4

    def error(self):
        import numpy as np
        size, points = self.args.size, {}
        reference = theirs = self.reference('lightpath')
        if self.args.sky:
            # The programs place texels differently, so each has its own reference.
            theirs = self.reference('Cycles')
        runs = [('Cycles', t) for t in THRESHOLDS] + [('lightpath', n) for n in CURVE]
        for round in range(self.args.rounds):
            for who, point in runs if round % 2 == 0 else runs[::-1]:
                if who == 'Cycles':
                    seconds = self.cycles('picture', size, point, 4096, round + 1)
                else:
                    seconds = self.lightpath('picture', size, point, round + 1)
                truth, noise = theirs if who == 'Cycles' else reference
                mse = float(np.mean((self.pixels('picture') - truth) ** 2)) - noise
                rmse = math.sqrt(max(mse, 0))
                points.setdefault((who, point), []).append((seconds, rmse))
        median = {key: [statistics.median(v) for v in zip(*values)] for key, values in points.items()}
        ours, mean = [median['lightpath', n] for n in CURVE], reference[0].mean()
        print(f'\n| Cycles, threshold | seconds | RMSE / mean | lightpath to the same RMSE | ratio | bar {BAR}, goal {GOAL} |')
        print('|---|---|---|---|---|---|')
        for t in THRESHOLDS:
            seconds, rmse = median['Cycles', t]
            mine = self.to_reach(rmse, ours)
            cells = '| | beyond what was measured'
            if mine:
                ratio = mine / seconds
                said = 'goal met' if ratio <= GOAL else 'met' if ratio <= BAR else 'MISSED'
                cells = f'{mine:.2f} | {ratio:.3f} | {said}'
            print(f'| {t} | {seconds:.2f} | {rmse / mean:.4f} | {cells} |')
        print('\n| lightpath, spp | seconds | RMSE / mean |\n|---|---|---|')
        for n in CURVE:
            seconds, rmse = median['lightpath', n]
            print(f'| {n} | {seconds:.2f} | {rmse / mean:.4f} |')
        return True

    @staticmethod
    def to_reach(rmse, ours):
        """Returns the seconds of lightpath at an RMSE, interpolated on logarithmic axes. Returns None below the measured errors.
        A larger error than at 1 spp costs as much as 1 spp."""
        if rmse >= ours[0][1]:
            return ours[0][0]
        for (t0, e0), (t1, e1) in zip(ours, ours[1:]):
            if e1 <= rmse <= e0:
                return t0 * (t1 / t0) ** (math.log(rmse / e0) / math.log(e1 / e0))
        return None


def main():
    if sys.argv[1:2] == ['--process']:
        return process(sys.argv[2:])
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument('steps', nargs='+', choices=['check', 'error'], metavar='STEP')
    parser.add_argument('mesh', metavar='MESH.ply')
    parser.add_argument('--lightpath', default=os.path.join(HERE, '..', 'target', 'release', 'lightpath'))
    parser.add_argument('--size', type=int, default=1024)
    parser.add_argument('--sky', metavar='IMAGE')
    parser.add_argument('--rounds', type=int, default=4)
    parser.add_argument('--folder', help='keeps the pictures')
    bench = Bench(parser.parse_args())
    return 0 if all([getattr(bench, step)() for step in bench.args.steps]) else 1


if __name__ == '__main__':
    sys.exit(main())
