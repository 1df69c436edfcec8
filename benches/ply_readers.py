#!/usr/bin/env python3
"""Measures how long PLY readers take from a file in the page cache to ready arrays.

usage: ply_readers.py [--rounds N] [--json OUT.json] [--only NAME,...] [--make] FILE.ply...

--make writes the files of these names first: sheet-N.ply of N triangles, sheet-N-ascii.ply, and mixed-N.ply of N
faces with three to eight corners (N as 70k or 10M).

Each reader is its own process, which reads the file on request and times itself. Readers take turns, forwards and
backwards (A B C C B A), so that other load on the machine affects all of them. The output has median and minimum,
the ratio of each median to lightpath's, MB/s, and the peak memory of the process in its first read, without mapped
files, sampled every millisecond. Readers that are not installed are left out and named.
  lightpath          src/mesh/ply, with a mapped file: also checks, drops and counts (docs/guide/meshes.md)
  lightpath-no-mmap  the same through a window
  floor              mapped records copied into typed arrays by all threads; binary triangles only
  ply-rs-bw          3.0.2, the newest that Rust 1.85 compiles
  trimesh, open3d, meshio, numpy (numpy.fromfile, binary triangles only): pip install them
"""
import argparse
import json
import os
import platform
import statistics
import subprocess
import sys
import threading
import time

HERE = os.path.dirname(os.path.abspath(__file__))
RUST = ['lightpath', 'lightpath-no-mmap', 'floor', 'ply-rs-bw']
PYTHON = ['numpy', 'trimesh', 'open3d', 'meshio']


def reader(name):
    """Returns a function from a path to the number of triangles; raises if the reader is not installed."""
    import numpy as np
    if name == 'numpy':
        def read(path):
            with open(path, 'rb') as file:
                counts = {}
                while (line := file.readline()) != b'end_header\n':
                    words = line.split()
                    if words[0] == b'element':
                        counts[words[1]] = int(words[2])
                size = file.tell() + 12 * counts[b'vertex'] + 13 * counts[b'face']
                if os.path.getsize(path) != size:
                    raise ValueError('only for binary triangles')
                vertices = np.fromfile(file, np.dtype((np.float32, 3)), counts[b'vertex'])
                faces = np.fromfile(file, np.dtype([('n', 'u1'), ('i', '<i4', 3)]), counts[b'face'])
                return len(np.ascontiguousarray(faces['i'])) + 0 * len(vertices)
        return read
    if name == 'trimesh':
        import trimesh
        return lambda path: len(trimesh.load(path, process=False, force='mesh').faces)
    if name == 'open3d':
        import open3d
        return lambda path: len(open3d.io.read_triangle_mesh(path).triangles)
    import meshio
    return lambda path: sum(len(block.data) for block in meshio.read(path).cells)


def serve(name, path):
    """Reads the file for each line on stdin, and prints seconds and triangles, as ply-readers does for Rust readers."""
    read = reader(name)
    for _ in sys.stdin:
        begun = time.perf_counter()
        triangles = read(path)
        print(time.perf_counter() - begun, triangles, flush=True)


class Worker:
    def __init__(self, name, path, program):
        command = [program, name, path] if name in RUST else [sys.executable, __file__, '--serve', name, path]
        self.name = name
        self.process = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE,
                                        stderr=subprocess.PIPE, text=True)

    def read(self):
        """Reads the file once. Returns the seconds and the number of triangles, or None if the reader fails."""
        try:
            self.process.stdin.write('go\n')
            self.process.stdin.flush()
            line = self.process.stdout.readline().split()
        except BrokenPipeError:
            return None
        return (float(line[0]), int(line[1])) if line else None

    def first_read(self):
        """Like `read`. Keeps the most memory meanwhile, without mapped files: VmHWM would count their pages."""
        self.memory, done = 0, threading.Event()

        def watch():
            while not done.wait(0.001):
                self.memory = max(self.memory, self.anonymous())

        watcher = threading.Thread(target=watch)
        watcher.start()
        try:
            return self.read()
        finally:
            done.set()
            watcher.join()

    def anonymous(self):
        """Returns the process's memory without mapped files; 0 after its end."""
        with open(f'/proc/{self.process.pid}/status') as status:
            return next((int(l.split()[1]) * 1024 for l in status if l.startswith('RssAnon')), 0)

    def end(self):
        """Ends the process. Returns the last line that it wrote to stderr."""
        self.process.stdin.close()
        said = self.process.stderr.read().strip().splitlines()
        self.process.wait()
        return said[-1][:120] if said else ''


def measure(path, names, rounds, program):
    workers, left_out = [], {}
    for name in names:
        worker = Worker(name, path, program)
        first = worker.first_read()
        if first is None:
            left_out[name] = worker.end()
        else:
            worker.triangles, worker.samples = first[1], []
            workers.append(worker)
    for _ in range(rounds):
        for worker in workers + workers[::-1]:
            worker.samples.append(worker.read()[0])
    result = {}
    for worker in workers:
        worker.end()
        result[worker.name] = {
            'median': statistics.median(worker.samples), 'minimum': min(worker.samples),
            'triangles': worker.triangles, 'memory': worker.memory, 'samples': worker.samples,
        }
    return {'file': os.path.basename(path), 'bytes': os.path.getsize(path), 'readers': result, 'left_out': left_out}


def table(found):
    size = found['bytes']
    print(f'\n{found["file"]}: {size / 1e6:.1f} MB')
    print(f'{"":18} {"median s":>9} {"min s":>8} {"/lightpath":>10} {"MB/s":>7} {"triangles":>10} {"memory MB":>9}')
    ours = found['readers'].get('lightpath', {}).get('median')
    for name, of in sorted(found['readers'].items(), key=lambda item: item[1]['median']):
        ratio = f'{of["median"] / ours:10.2f}' if ours else ' ' * 10
        print(f'{name:18} {of["median"]:9.4f} {of["minimum"]:8.4f} {ratio} {size / 1e6 / of["median"]:7.0f} '
              f'{of["triangles"]:10} {of["memory"] / 1e6:9.0f}')
    for name, why in found['left_out'].items():
        print(f'{name:18} left out: {why}')


def make(path):
    """Writes a rippled sheet in the layout that the name gives."""
    import numpy as np
    words = os.path.basename(path).removesuffix('.ply').split('-')
    count = int(float(words[1].replace('k', 'e3').replace('M', 'e6')))
    mixed = words[0] == 'mixed'
    side = int((count if mixed else count / 2) ** 0.5)
    x, y = np.meshgrid(np.arange(side + 1, dtype=np.float32), np.arange(side + 1, dtype=np.float32))
    points = np.stack([x, y, np.sin(x / 9) * np.cos(y / 7)], 2).reshape(-1, 3).astype('<f4')
    a = (np.arange(side)[:, None] * (side + 1) + np.arange(side)).ravel()
    if mixed:
        # One regular polygon in each cell.
        sizes = np.resize([3, 4, 5, 4, 6, 4, 3, 8, 4, 4], len(a))
        t = np.arange(8)[None, :] * 2 * np.pi / sizes[:, None]
        centre = points[a] + np.float32(0.5)
        ring = np.stack([np.cos(t), np.sin(t), 0 * t], 2) * 0.45 + centre[:, None, :]
        used = np.arange(8)[None, :] < sizes[:, None]
        points = ring[used].astype('<f4')
        starts = np.concatenate([[0], np.cumsum(sizes)[:-1]])
        faces = b''.join(np.uint8(n).tobytes() + np.arange(s, s + n, dtype='<i4').tobytes()
                         for n, s in zip(sizes, starts))
        number = len(sizes)
    else:
        cells = np.stack([a, a + 1, a + side + 2, a, a + side + 2, a + side + 1], 1).reshape(-1, 3)
        rows = np.empty(len(cells), [('n', 'u1'), ('i', '<i4', 3)])
        rows['n'], rows['i'] = 3, cells
        faces, number = rows.tobytes(), len(cells)
    text = words[-1] == 'ascii'
    form = 'ascii' if text else 'binary_little_endian'
    with open(path, 'wb') as out:
        out.write(f'ply\nformat {form} 1.0\nelement vertex {len(points)}\nproperty float x\nproperty float y\n'
                  f'property float z\nelement face {number}\nproperty list uchar int vertex_indices\n'
                  'end_header\n'.encode())
        if text:
            np.savetxt(out, points, '%.7g')
            np.savetxt(out, np.insert(cells, 0, 3, 1), '%d')
        else:
            out.write(points.tobytes())
            out.write(faces)


def main():
    if sys.argv[1:2] == ['--serve']:
        return serve(*sys.argv[2:])
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument('files', nargs='+', metavar='FILE.ply')
    parser.add_argument('--rounds', type=int, default=5, help='turns of A B .. B A')
    parser.add_argument('--json', metavar='OUT.json', help='every sample')
    parser.add_argument('--only', metavar='NAME,...', default=','.join(RUST + PYTHON))
    parser.add_argument('--make', action='store_true', help='write the files first')
    arguments = parser.parse_args()
    for path in arguments.files:
        if arguments.make:
            make(path)
    build = ['cargo', 'build', '--release', '--quiet', '--manifest-path', f'{HERE}/ply_readers/Cargo.toml']
    os.environ.get("PLY_READERS_BUILT") or subprocess.run(build, check=True)
    target = os.environ.get('CARGO_TARGET_DIR', f'{HERE}/ply_readers/target')
    results = []
    for path in arguments.files:
        names = arguments.only.split(',')
        results.append(measure(path, names, arguments.rounds, f'{target}/release/ply-readers'))
        table(results[-1])
    if arguments.json:
        with open(arguments.json, 'w') as out:
            json.dump({'machine': platform.processor() or platform.machine(), 'threads': os.cpu_count(),
                       'results': results}, out, indent=1)


if __name__ == '__main__':
    main()
