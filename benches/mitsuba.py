#!/usr/bin/env python3
"""Compares time and error of lightpath and Mitsuba 3 on the same scene.

usage: mitsuba.py [--lightpath PROGRAM] [--json STATE.json] [--size N] [--sky IMAGE] STEP... MESH.ply
   pip install mitsuba==3.9.1 numpy; its LLVM variant needs libLLVM (Debian: apt-get install libllvm15)

Both scene files are written from the description in plain_scene.py: a diffuse mesh on a ground plane, under a square
area light, with a black background; 1024 x 1024, box filter. Mitsuba renders it with `llvm_ad_rgb`, `direct` with one
emitter sample and no BSDF sample; lightpath with `lambertian` emission, `quadratic` attenuation, id = radiance area / pi
and one light sample. `--sky` replaces the light by an equirectangular image, which cameras do not see; Mitsuba then also
renders with one BSDF sample (`mis`). Each step adds to the state file, so the steps can be run one by one:
  check   both at 4096 spp, 128 x 128: relmse must be below 1e-4 (of a sky: 1e-3), else exit 1
  wall    wall time of the whole process at 1, 16, 64 spp, in turns A B B A (--rounds)
  refer   a reference of 1024 spp by lightpath at full size, with another seed; with --sky, also one by Mitsuba
  error   time of the render phase, in turns, and RMSE at 1, 4, 16, 64 spp, for lightpath and both series of Mitsuba; at
          16 and 64 spp also lightpath with `--noise-of picture`, for which Mitsuba has no counterpart (not with --sky)
  table   prints everything as Markdown; --into FILE replaces the text between the marks of the backend
relmse: mean d^2 / (r^2 + 0.01). Both programs use all threads that this process may use.
"""
import argparse
import datetime
import json
import math
import os
import platform
import statistics
import subprocess
import sys
import tempfile
import time

from plain_scene import describe, for_lightpath

HERE = os.path.dirname(os.path.abspath(__file__))
# This file has the same name as the package.
sys.path = [path for path in sys.path if os.path.abspath(path) != HERE]
SPP = [1, 16, 64]
CURVE = [1, 4, 16, 64]
# Sampler and number of BSDF samples.
SERIES = {'independent': ('independent', 0), 'multijitter': ('multijitter', 0)}
SKY_SERIES = {'multijitter': ('multijitter', 0), 'multijitter, mis': ('multijitter', 1)}
# Targets of `--noise T --noise-of picture`. Their errors span the errors at these numbers of
# samples.
TARGETS = {16: ['0.2', '0.1'], 64: ['0.05', '0.02', '0.015']}
ADAPTIVE = 'lightpath, adaptive'
MARKS = ['<!-- mitsuba, {}: begin -->', '<!-- mitsuba, {}: end -->']
# Required ratios lightpath / Mitsuba by samples: bar, goal.
BARS = {'wall': {1: (0.3, 0.2), 16: (0.4, 0.25), 64: (0.45, 0.3)},
        'independent': {1: (0.15, 0.05), 4: (0.15, 0.05), 16: (0.12, 0.05), 64: (0.1, 0.05)},
        'multijitter': dict.fromkeys(CURVE, (0.5, 0.3)), 'sky': dict.fromkeys(CURVE, (0.5, 0.25))}


def for_mitsuba(d, size, sampler, bsdf_samples=0):
    import mitsuba as mi
    t = mi.ScalarTransform4f()
    plain = {'type': 'twosided', 'bsdf': {'type': 'diffuse',
             'reflectance': {'type': 'rgb', 'value': [d['albedo']] * 3}}}
    # Mitsuba's middle column lies along +z, lightpath's along -z.
    sky = {'type': 'envmap', 'filename': d['sky'], 'to_world': t.rotate([0, 1, 0], 180)}
    return {
        'type': 'scene',
        'integrator': {'type': 'direct', 'emitter_samples': 1, 'bsdf_samples': bsdf_samples, 'hide_emitters': True},
        'sensor': {
            'type': 'perspective', 'fov': d['fov'], 'fov_axis': 'y', 'near_clip': 1e-3,
            'to_world': mi.ScalarTransform4f().look_at(origin=d['camera'], target=d['target'], up=[0, 1, 0]),
            'film': {'type': 'hdrfilm', 'width': size, 'height': size, 'pixel_format': 'rgb',
                     'component_format': 'float32', 'rfilter': {'type': 'box'}},
            'sampler': {'type': sampler}},
        'mesh': {'type': 'ply', 'filename': d['mesh'], 'face_normals': True, 'bsdf': plain,
                 'to_world': t.scale(d['scale']).translate([-v for v in d['middle']])},
        'floor': {'type': 'rectangle', 'bsdf': plain,
                  'to_world': t.translate([0, d['floor'], 0]).rotate([1, 0, 0], -90).scale(d['half_floor'])},
        'light': sky if d['sky'] else {'type': 'rectangle',
                  'to_world': t.translate(d['light']).rotate([1, 0, 0], 90).scale(d['half_light']),
                  'emitter': {'type': 'area', 'radiance': {'type': 'rgb', 'value': [d['radiance']] * 3}}},
    }


def mitsuba():
    import mitsuba as mi
    mi.set_variant('llvm_ad_rgb')
    return mi


def process(arguments):
    """Runs Mitsuba in its own process, which `wall` times."""
    mesh, size, spp, out = arguments[0], int(arguments[1]), int(arguments[2]), arguments[3]
    mi = mitsuba()
    scene = mi.load_dict(for_mitsuba(json.load(open(mesh)), size, 'independent'))
    image = mi.render(scene, spp=spp, seed=0)
    mi.util.write_bitmap(out, image)


class Bench:
    def __init__(self, args):
        self.args, self.state, self.description = args, {}, describe(args.mesh, args.sky)
        if os.path.exists(args.json):
            self.state = json.load(open(args.json))
        self.folder = tempfile.mkdtemp()
        self.series = SKY_SERIES if args.sky else SERIES
        self.scene = self.write('scene.json', for_lightpath(self.description, args.size))
        self.env = dict(os.environ)

    def write(self, name, value):
        path = os.path.join(self.folder, name)
        with open(path, 'w') as file:
            json.dump(value, file)
        return path

    def save(self):
        version = [self.args.lightpath, '--version', '--verbose']
        shown = subprocess.run(version, capture_output=True, text=True, check=True).stdout
        import mitsuba as mi
        model = [line.split(':')[1].strip() for line in open('/proc/cpuinfo') if line.startswith('model name')]
        self.state['machine'] = {
            'cpu': model[0] if model else platform.processor(), 'threads': len(os.sched_getaffinity(0)),
            'mitsuba': mi.__version__, 'lightpath': shown.splitlines(),
            'date': datetime.date.today().isoformat(), 'mesh': os.path.basename(self.args.mesh)}
        with open(self.args.json, 'w') as file:
            json.dump(self.state, file, indent=1)

    def lightpath(self, scene, prefix, spp, *more):
        """Renders to prefix.exr and returns the program's statistics."""
        command = [self.args.lightpath, 'render', scene, '-o', os.path.join(self.folder, prefix),
                   '--spp', str(spp), '--backend', self.args.backend, '--quiet', '--json', *more]
        return json.loads(subprocess.run(command, capture_output=True, text=True, check=True).stdout)

    def pixels(self, path):
        import mitsuba as mi
        import numpy as np
        image = np.array(mi.Bitmap(path).convert(mi.Bitmap.PixelFormat.RGB, mi.Struct.Type.Float32, False))
        return image.astype(float)

    def check(self):
        mi = mitsuba()
        import numpy as np
        size = 128
        scene = self.write('small.json', for_lightpath(self.description, size))
        self.lightpath(scene, 'check', 4096, '--float')
        ours = self.pixels(os.path.join(self.folder, 'check.exr'))
        other = mi.load_dict(for_mitsuba(self.description, size, 'independent'))
        # In parts, because a wavefront of all samples does not fit into memory.
        parts = [np.array(mi.render(other, spp=256, seed=seed), dtype=float) for seed in range(16)]
        theirs = sum(parts) / len(parts)
        relmse = float(np.mean((ours - theirs) ** 2 / (theirs ** 2 + 0.01)))
        ratio = float(ours.mean() / theirs.mean())
        self.state['check'] = {'relmse': relmse, 'mean_ratio': ratio, 'size': size, 'spp': 4096}
        print(f'relmse {relmse:.2e}, ratio of the means {ratio:.6f}')
        os.makedirs(self.args.pictures or self.folder, exist_ok=True)
        for name, image in [('lightpath', ours), ('mitsuba', theirs)]:
            mi.util.write_bitmap(os.path.join(self.args.pictures or self.folder, f'{name}.png'), image)
        return relmse < (1e-3 if self.args.sky else 1e-4)

    def wall(self):
        mesh = self.write('description.json', self.description)
        size = str(self.args.size)

        def run(which, spp):
            out = os.path.join(self.folder, 'm.exr')
            started = time.perf_counter()
            if which == 'lightpath':
                self.lightpath(self.scene, 'l', spp)
            else:
                command = [sys.executable, os.path.abspath(__file__), '--process', mesh, size, str(spp), out]
                subprocess.run(command, check=True, capture_output=True)
            return time.perf_counter() - started

        wall = self.state.setdefault('wall', {})
        self.state['wall_size'] = self.args.size
        for spp in self.args.spp or SPP:
            samples = wall.setdefault(str(spp), {'lightpath': [], 'mitsuba': []})
            if not samples['mitsuba']:
                # Compiles the kernels into the cache on the disk.
                run('mitsuba', spp)
                run('lightpath', spp)
            for _ in range(self.args.rounds):
                for which in ['lightpath', 'mitsuba', 'mitsuba', 'lightpath']:
                    samples[which].append(run(which, spp))
            a, b = (statistics.median(samples[which]) for which in ['lightpath', 'mitsuba'])
            print(f'{spp} spp: lightpath {a:.3f} s, mitsuba {b:.3f} s, ratio {a / b:.3f}', flush=True)
            self.save()
        return True

    def refer(self):
        os.makedirs(self.args.pictures or self.folder, exist_ok=True)
        prefix = os.path.abspath(os.path.join(self.args.pictures or self.folder, 'reference'))
        self.lightpath(self.scene, prefix, 1024, '--float', '--seed', '777')
        self.state['reference'] = prefix + '.exr'
        if self.args.sky:
            # The programs place texels differently, so each has its own reference.
            mi = mitsuba()
            scene = mi.load_dict(for_mitsuba(self.description, self.args.size, 'multijitter'))
            parts = (mi.render(scene, spp=36, seed=1000 + seed) for seed in range(28))
            mi.util.write_bitmap(prefix + '-mitsuba.exr', sum(parts) / 28, write_async=False)
        return True

    def error(self):
        mi = mitsuba()
        import numpy as np
        reference = self.pixels(self.state['reference'])
        theirs = self.pixels(self.state['reference'].replace('.exr', '-mitsuba.exr')) if self.args.sky else reference
        curve = self.state.setdefault('error', {})
        self.state['error_size'] = self.args.size
        scenes = {name: mi.load_dict(for_mitsuba(self.description, self.args.size, *how))
                  for name, how in self.series.items()}
        # Each sampler must compile, and allocate memory, once for each number of samples.
        for spp in self.args.spp or CURVE:
            for name, scene in scenes.items():
                np.array(mi.render(scene, spp=spp, seed=99))
            for round in range(self.args.rounds):
                targets = [] if self.args.sky else TARGETS.get(spp, [])
                order = [('lightpath', spp), *((ADAPTIVE, target) for target in targets),
                         *((name, spp) for name in self.series)]
                for which, point in order + order[::-1]:
                    entry = curve.setdefault(which, {}).setdefault(str(point), {'seconds': [], 'rmse': []})
                    seed = len(entry['seconds']) + 1
                    if which not in scenes:
                        more = ['--float', '--seed', str(seed)]
                        if which == ADAPTIVE:
                            more += ['--noise', point, '--noise-of', 'picture']
                        stats = self.lightpath(self.scene, 'e', 16 if which == ADAPTIVE else spp, *more)
                        seconds = stats['seconds']['render']
                        image = self.pixels(os.path.join(self.folder, 'e.exr'))
                    else:
                        started = time.perf_counter()
                        image = np.array(mi.render(scenes[which], spp=spp, seed=seed), dtype=float)
                        seconds = time.perf_counter() - started
                    entry['seconds'].append(seconds)
                    truth = theirs if which in scenes else reference
                    entry['rmse'].append(float(np.sqrt(np.mean((image - truth) ** 2))))
            shown = [f"{w} {p} {statistics.median(curve[w][str(p)]['seconds']):.3f} s "
                     f"{statistics.median(curve[w][str(p)]['rmse']):.2e}" for w, p in order]
            print(f'{spp} spp: ' + ', '.join(shown), flush=True)
        self.state['mean'] = float(reference.mean())
        return True

    def points(self, which):
        entries = self.state['error'].get(which, {}).items()
        return sorted((statistics.median(e['rmse']), statistics.median(e['seconds']), point)
                      for point, e in entries)

    def ours_at(self, rmse, which):
        """Returns the seconds of lightpath at an RMSE, interpolated on logarithmic axes; None beyond the measured errors.
        A larger error than at 1 spp costs as much as 1 spp, because there is no picture below 1 spp."""
        points = self.points(which)
        if which == 'lightpath' and rmse >= points[-1][0]:
            return points[-1][1]
        for (e0, t0, _), (e1, t1, _) in zip(points, points[1:]):
            if e0 <= rmse <= e1:
                part = math.log(rmse / e0) / math.log(e1 / e0)
                return t0 * (t1 / t0) ** part
        return None

    def table(self):
        m, lines = self.state['machine'], []
        version = ', '.join(line.strip() for line in m['lightpath'])
        sky = f"{os.path.basename(self.args.sky)}; " if self.args.sky else ''
        lines.append(f"{sky}`--backend {self.args.backend}`; {m['cpu']}, {m['threads']} threads, {m['date']}; Mitsuba {m['mitsuba']} (`llvm_ad_rgb`, "
                     f"`direct`); {version}; {m['mesh']}.")
        if 'check' in self.state:
            c = self.state['check']
            lines += ['', f"The same picture: relmse {c['relmse']:.1e} between the two at {c['spp']} spp "
                      f"({c['size']} x {c['size']}), ratio of the means {c['mean_ratio']:.5f}."]

        def verdict(what, spp, ratio):
            if int(spp) not in BARS[what]:
                return 'none'
            bar, goal = BARS[what][int(spp)]
            return f"{bar}, goal {goal}: {'goal met' if ratio <= goal else 'met' if ratio <= bar else 'MISSED'}"
        if 'wall' in self.state:
            size = self.state['wall_size']
            lines += ['', f'| whole process, {size} x {size} | lightpath | Mitsuba | ratio | n | bar |', '|---|---|---|---|---|---|']
            for spp, s in sorted(self.state['wall'].items(), key=lambda item: int(item[0])):
                a, b = statistics.median(s['lightpath']), statistics.median(s['mitsuba'])
                n = len(s['mitsuba'])
                lines.append(f"| {spp} spp | {a:.2f} s | {b:.2f} s | {a / b:.2f} | {n} | {verdict('wall', spp, a / b)} |")
        if 'error' in self.state:
            mean, size = self.state['mean'], self.state['error_size']
            lines += ['', f'| render phase, {size} x {size} | spp, or target | seconds | RMSE / mean |', '|---|---|---|---|']
            shown = [which for which in ['lightpath', ADAPTIVE, *self.series] if self.points(which)]
            for which in shown:
                for rmse, seconds, point in reversed(self.points(which)):
                    lines.append(f'| {which} | {point} | {seconds:.3f} | {rmse / mean:.4f} |')
            lines += ['', '| time to the same RMSE as | Mitsuba | lightpath | ratio | `--noise-of picture` | ratio | bar, for the lesser |',
                      '|---|---|---|---|---|---|---|']
            for which in self.series:
                for rmse, seconds, spp in reversed(self.points(which)):
                    cells, ratios = [], []
                    for series in ['lightpath', ADAPTIVE]:
                        ours = self.ours_at(rmse, series)
                        cells.append('| |' if ours is None else f'{ours:.3f} s | {ours / seconds:.2f} |')
                        ratios += [] if ours is None else [ours / seconds]
                    said = verdict('sky' if self.args.sky else which, spp, min(ratios)) if ratios else 'beyond what was measured'
                    lines.append(f'| {which}, {spp} spp | {seconds:.3f} s | ' + ' '.join(cells) + f' {said} |')
        text = '\n'.join(lines) + '\n'
        if self.args.into:
            page = open(self.args.into).read()
            marks = [mark.format(self.args.backend) for mark in MARKS]
            before, rest = page.split(marks[0])
            _, after = rest.split(marks[1])
            with open(self.args.into, 'w') as file:
                file.write(f'{before}{marks[0]}\n{text}{marks[1]}{after}')
        print(text)
        return True


def main():
    if sys.argv[1:2] == ['--process']:
        return process(sys.argv[2:])
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument('steps', nargs='+', choices=['check', 'wall', 'refer', 'error', 'table'], metavar='STEP')
    parser.add_argument('mesh', metavar='MESH.ply')
    parser.add_argument('--lightpath', default=os.path.join(HERE, '..', 'target', 'release', 'lightpath'))
    parser.add_argument('--json', default='mitsuba.json')
    parser.add_argument('--size', type=int, default=1024)
    parser.add_argument('--backend', default='bvh', help='backend of lightpath; each has its own state file')
    parser.add_argument('--sky', metavar='IMAGE', help='lights the scene; each has its own state file')
    parser.add_argument('--rounds', type=int, default=2)
    parser.add_argument('--spp', type=int, nargs='+', help='only these')
    parser.add_argument('--pictures', help='folder for the pictures of `check` and the reference')
    parser.add_argument('--into', metavar='FILE.md')
    args = parser.parse_args()
    bench = Bench(args)
    ok = True
    for step in args.steps:
        ok &= getattr(bench, step)()
        if step != 'table':
            bench.save()
    return 0 if ok else 1


if __name__ == '__main__':
    sys.exit(main())
