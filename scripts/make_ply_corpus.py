#!/usr/bin/env python3
"""Makes the PLY files of tests/ply/, each with its expected result beside it.

usage: make_ply_corpus.py [FOLDER]        (default: tests/ply)

Each writer runs in its own process, because their libraries conflict. A writer that is not installed is left
out with a note: pip install numpy trimesh open3d meshio pymeshlab bpy plyfile zstandard.
The expected results come from the arrays that the writers get, not from lightpath:
  valid/NAME.ply[.gz|.zst] and valid/NAME.json: vertices, triangles, area, bounds, which attributes;
  invalid/NAME.ply[.gz|.zst] and invalid/NAME.txt: kind of the error, then its first line.
"""
import gzip
import json
import os
import struct
import subprocess
import sys


# --- shapes: lists of points and of faces ---------------------------------------------------------

def ball(rings=5, sectors=8):
    """A lumpy ball of triangles."""
    from math import cos, pi, sin
    points = [[0.0, 0.0, 1.0], [0.0, 0.0, -1.0]]
    for i in range(1, rings):
        for k in range(sectors):
            a, b = pi * i / rings, 2 * pi * k / sectors
            r = 1 + 0.1 * sin(3 * b) * sin(2 * a)
            points.append([r * sin(a) * cos(b), r * sin(a) * sin(b), r * cos(a)])
    at = lambda i, k: 2 + (i - 1) * sectors + k % sectors
    faces = []
    for k in range(sectors):
        faces.append([0, at(1, k), at(1, k + 1)])
        faces.append([1, at(rings - 1, k + 1), at(rings - 1, k)])
        for i in range(1, rings - 1):
            faces.append([at(i, k), at(i + 1, k), at(i + 1, k + 1)])
            faces.append([at(i, k), at(i + 1, k + 1), at(i, k + 1)])
    return single(points), faces


def cube():
    """Six quads."""
    points = [[x, y, z] for z in (0.0, 1.0) for y in (0.0, 2.0) for x in (0.0, 3.0)]
    return points, [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [1, 3, 7, 5], [3, 2, 6, 7], [2, 0, 4, 6]]


def house():
    """An L-shaped prism (concave hexagons), with a convex pentagon and a triangle beside it."""
    flat = [(0, 0), (2, 0), (2, 1), (1, 1), (1, 2), (0, 2)]
    points = [[float(x), float(y), float(z)] for z in (0, 1) for x, y in flat]
    faces = [[5, 4, 3, 2, 1, 0], [6, 7, 8, 9, 10, 11]]
    faces += [[i, (i + 1) % 6, 6 + (i + 1) % 6, 6 + i] for i in range(6)]
    points += [[4.0, 0.0, 0.0], [6.0, 0.0, 0.0], [6.5, 1.0, 0.0], [5.0, 2.0, 0.0], [3.5, 1.0, 0.0]]
    points += [[7.0, 0.0, 0.0], [8.0, 0.0, 0.0], [7.0, 1.0, 0.0]]
    faces += [[12, 13, 14, 15, 16], [17, 18, 19]]
    return points, faces


def single(points):
    """The points rounded to single precision."""
    return [list(struct.unpack('<3f', struct.pack('<3f', *p))) for p in points]


def grid(points):
    """One texture coordinate per point."""
    return [[(i % 7) / 8, (i % 5) / 8] for i in range(len(points))]


def shades(points):
    return [[(40 * i) % 256, (7 * i) % 256, 255 - i % 256] for i in range(len(points))]


# --- what is expected -----------------------------------------------------------------------------

def cross(a, b):
    return [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]


def area(points, faces):
    """Area of planar polygons, convex or not: half the length of the sum of cross products."""
    total = 0.0
    for face in faces:
        at = [[c - o for c, o in zip(points[i], points[face[0]])] for i in face]
        sums = [sum(c) for c in zip(*(cross(a, b) for a, b in zip(at, at[1:] + at[:1])))]
        total += sum(c * c for c in sums) ** 0.5 / 2
    return total


def write(name, writer, shape, **more):
    """Writes the expected result of the valid file `name`, which holds `shape`."""
    points, faces = shape
    used = [points[i] for face in faces for i in face]
    expected = {
        'writer': writer, 'vertices': len(points), 'faces': len(faces),
        'triangles': sum(len(f) - 2 for f in faces), 'area': area(points, faces),
        'bounds': [[f(p[k] for p in used) for k in range(3)] for f in (min, max)],
        'normals': False, 'uvs': None, 'colors': None, 'texture': None,
    }
    assert set(more) <= set(expected), more
    expected.update(more)
    stem = name.removesuffix('.gz').removesuffix('.zst').removesuffix('.ply')
    with open(f'valid/{stem}.json', 'w') as out:
        json.dump(expected, out, indent=1)
        out.write('\n')


# --- writers --------------------------------------------------------------------------------------

def with_trimesh():
    import numpy as np
    import trimesh
    from trimesh.exchange.ply import export_ply
    from PIL import Image
    writer = f'trimesh {trimesh.__version__}'
    points, faces = ball()
    mesh = trimesh.Trimesh(points, faces, process=False)
    for encoding in ('ascii', 'binary'):
        name = f'trimesh-{encoding}'
        open(f'valid/{name}.ply', 'wb').write(export_ply(mesh, encoding=encoding, vertex_normal=True))
        write(name, writer, (points, faces), normals=True)
    colours = np.array([c + [255] for c in shades(points)], np.uint8)
    mesh = trimesh.Trimesh(points, faces, vertex_colors=colours, process=False)
    open('valid/trimesh-colours.ply', 'wb').write(export_ply(mesh, vertex_normal=False))
    write('trimesh-colours', writer, (points, faces), colors='uchar')
    visual = trimesh.visual.TextureVisuals(uv=np.array(grid(points)), image=Image.new('RGB', (2, 2)))
    mesh = trimesh.Trimesh(points, faces, visual=visual, process=False)
    open('valid/trimesh-uv.ply', 'wb').write(export_ply(mesh, vertex_normal=False))
    text = open('valid/trimesh-uv.ply', 'rb').read()[:1000]
    texture = [l.split(None, 2)[2].decode() for l in text.split(b'\n') if l.startswith(b'comment TextureFile')]
    write('trimesh-uv', writer, (points, faces), uvs='vertex' if b' s\n' in text or b' u\n' in text else None,
          texture=texture[0] if texture else None)


def with_open3d():
    import numpy as np
    import open3d as o3d
    writer = f'Open3D {o3d.__version__}'
    points, faces = ball()
    mesh = o3d.geometry.TriangleMesh(o3d.utility.Vector3dVector(np.array(points)),
                                     o3d.utility.Vector3iVector(np.array(faces)))
    for ascii in (True, False):
        name = 'open3d-ascii' if ascii else 'open3d-binary'
        o3d.io.write_triangle_mesh(f'valid/{name}.ply', mesh, write_ascii=ascii)
        write(name, writer, (points, faces))
    mesh.compute_vertex_normals()
    mesh.vertex_colors = o3d.utility.Vector3dVector(np.array(shades(points)) / 255)
    o3d.io.write_triangle_mesh('valid/open3d-normals-colours.ply', mesh)
    write('open3d-normals-colours', writer, (points, faces), normals=True, colors='uchar')
    cloud = o3d.geometry.PointCloud(o3d.utility.Vector3dVector(np.array(points)))
    o3d.io.write_point_cloud('invalid/open3d-cloud.ply', cloud)
    refuse('open3d-cloud', f'has no faces: it is a point cloud of {len(points)} points')


def with_meshio():
    import meshio
    import numpy as np
    writer = f'meshio {meshio.__version__}'
    for binary in (False, True):
        points, faces = ball()
        name = 'meshio-binary' if binary else 'meshio-ascii'
        meshio.Mesh(np.array(points), [('triangle', np.array(faces))]).write(f'valid/{name}.ply', binary=binary)
        write(name, writer, (points, faces))
        points, faces = cube()
        halves = faces[:3] + [f for q in faces[3:] for f in (q[:3], [q[0], q[2], q[3]])]
        cells = [('quad', np.array(halves[:3])), ('triangle', np.array(halves[3:]))]
        data = {'nx': np.array(points)[:, 0], 'ny': np.array(points)[:, 1], 'nz': np.array(points)[:, 2]}
        mesh = meshio.Mesh(np.array(points), cells, point_data=data)
        mesh.write(f'valid/{name}-mixed.ply', binary=binary)
        write(f'{name}-mixed', writer, (points, halves), normals=True)


def with_pymeshlab():
    import importlib.metadata
    import numpy as np
    import pymeshlab
    writer = f'pymeshlab {importlib.metadata.version("pymeshlab")}'
    points, faces = ball()
    mesh = pymeshlab.Mesh(np.array(points), np.array(faces))
    for binary in (False, True):
        name = 'meshlab-binary' if binary else 'meshlab-ascii'
        ms = pymeshlab.MeshSet()
        ms.add_mesh(mesh)
        ms.compute_scalar_by_function_per_vertex(q='x')
        ms.compute_color_by_function_per_vertex(x='200', y='x*20+50', z='9', a='255')
        ms.save_current_mesh(f'valid/{name}.ply', binary=binary, save_vertex_color=True, save_vertex_quality=True,
                             save_vertex_normal=True, save_face_color=True)
        write(name, writer, (points, faces), colors='uchar', normals=True)
        ms = pymeshlab.MeshSet()
        ms.add_mesh(mesh)
        ms.compute_texcoord_parametrization_triangle_trivial_per_wedge(textdim=64)
        ms.save_current_mesh(f'valid/{name}-wedge.ply', binary=binary, save_wedge_texcoord=True,
                             save_vertex_color=False, save_vertex_quality=False, save_vertex_normal=False)
        write(f'{name}-wedge', writer, (points, faces), uvs='corner')
    points, faces = house()
    ms = pymeshlab.MeshSet()
    ms.add_mesh(pymeshlab.Mesh(np.array(points), face_list_of_indices=[np.array(f) for f in faces]))
    ms.save_current_mesh('valid/meshlab-polygons.ply', save_vertex_color=False, save_vertex_quality=False,
                         save_vertex_normal=False)
    # MeshLab splits polygons itself if it does not keep them.
    write('meshlab-polygons', writer, (points, faces), faces=None)


def with_bpy():
    import bpy
    writer = f'Blender {bpy.app.version_string}'

    def export(name, shape, uvs=False, colours=False, **how):
        bpy.ops.wm.read_factory_settings(use_empty=True)
        points, faces = shape
        mesh = bpy.data.meshes.new('mesh')
        mesh.from_pydata(points, [], faces)
        if uvs:
            layer = mesh.uv_layers.new(name='uv')
            coordinates = grid(points)
            for loop in mesh.loops:
                layer.data[loop.index].uv = coordinates[loop.vertex_index]
        if colours:
            layer = mesh.color_attributes.new(name='c', type='BYTE_COLOR', domain='POINT')
            for value, shade in zip(layer.data, shades(points)):
                value.color_srgb = [c / 255 for c in shade] + [1.0]
        ob = bpy.data.objects.new('mesh', mesh)
        bpy.context.scene.collection.objects.link(ob)
        bpy.ops.wm.ply_export(filepath=os.path.abspath(f'valid/{name}.ply'), forward_axis='Y', up_axis='Z', **how)

    plain = {'export_uv': False, 'export_normals': False, 'export_colors': 'NONE'}
    for ascii in (True, False):
        name = 'blender-ascii' if ascii else 'blender-binary'
        export(f'{name}-house', house(), ascii_format=ascii, **plain)
        write(f'{name}-house', writer, house())
        export(f'{name}-cube', cube(), ascii_format=ascii, **plain)
        write(f'{name}-cube', writer, cube())
        export(f'{name}-ball', ball(), uvs=True, colours=True, ascii_format=ascii, export_uv=True,
               export_normals=True, export_colors='SRGB')
        write(f'{name}-ball', writer, ball(), uvs='vertex', colors='uchar', normals=True)


def with_plyfile():
    import importlib.metadata
    import numpy as np
    from plyfile import PlyData, PlyElement
    writer = f'plyfile {importlib.metadata.version("plyfile")}'

    def vertices(points, dtype='f4', more=()):
        kinds = [(n, dtype) for n in 'xyz'] + [(n, k) for n, k, _ in more]
        columns = [v for _, _, v in more]
        rows = [tuple(p) + tuple(c[i] for c in columns) for i, p in enumerate(points)]
        return PlyElement.describe(np.array(rows, kinds), 'vertex')

    def lists(rows, columns, name='face', kinds=None, counts=None):
        table = np.empty(len(rows), [(n, k) for n, k in columns])
        for i, row in enumerate(rows):
            table[i] = row
        return PlyElement.describe(table, name, val_types=kinds or {}, len_types=counts or {})

    def faces_of(faces, item='i4', count='u1', name='vertex_indices'):
        rows = [(np.array(f, item),) for f in faces]
        return lists(rows, [(name, 'O')], kinds={name: item}, counts={name: count})

    def save(name, elements, text=False, order='<', **more):
        PlyData(elements, text=text, byte_order=order, **more).write(f'valid/{name}.ply')

    points, faces = ball()
    small = [[round(50 * c) for c in p] for p in points]
    for order, tag in (('<', 'le'), ('>', 'be')):
        save(f'plyfile-{tag}-house', [vertices(house()[0]), faces_of(house()[1])], order=order)
        write(f'plyfile-{tag}-house', writer, house())
        save(f'plyfile-{tag}-short', [vertices(small, 'i2'), faces_of(faces, 'u2', 'i4', 'vertex_index')], order=order)
        write(f'plyfile-{tag}-short', writer, (small, faces))
        far = [[c + o for c, o in zip(p, (4.5e6, 5e5, 100.0))] for p in points]
        save(f'plyfile-{tag}-far', [vertices(far, 'f8'), faces_of(faces, 'u4', 'u2')], order=order)
        write(f'plyfile-{tag}-far', writer, (far, faces))
        strip = [np.array([0, 1, 2, 3, -1, 4, 5, 6, 7], 'i4')]
        corners = [[float(i % 2), float(i // 2), 0.25 * (i % 3)] for i in range(8)]
        strips = [[0, 1, 2], [2, 1, 3], [4, 5, 6], [6, 5, 7]]
        element = lists([(s,) for s in strip], [('vertex_indices', 'O')], 'tristrips', {'vertex_indices': 'i4'},
                        {'vertex_indices': 'i4'})
        save(f'plyfile-{tag}-strips', [vertices(corners), element], order=order)
        write(f'plyfile-{tag}-strips', writer, (corners, strips))
        cameras = PlyElement.describe(np.array([(1.0, 2)], [('view_px', 'f4'), ('id', 'i1')]), 'camera')
        edges = lists([(1, np.array([1.0, 2.0], 'f8')), (2, np.array([], 'f8'))], [('a', 'i4'), ('b', 'O')], 'edge',
                      {'b': 'f8'}, {'b': 'u4'})
        more = [('diffuse_red', 'u2', [7 * i for i in range(len(points))]),
                ('diffuse_green', 'u2', [9 * i for i in range(len(points))]),
                ('diffuse_blue', 'u2', [i for i in range(len(points))]),
                ('confidence', 'f8', [0.5] * len(points)),
                ('texture_u', 'f4', [0.5] * len(points)), ('texture_v', 'f8', [0.25] * len(points))]
        elements = [cameras, faces_of(faces), edges, vertices(points, more=more)]
        save(f'plyfile-{tag}-extra', elements, order=order, comments=['TextureFile  my picture.png', 'x'],
             obj_info=['num_cols 512'])
        write(f'plyfile-{tag}-extra', writer, (points, faces), colors='ushort', uvs='vertex',
              texture='my picture.png')
        # One byte: plyfile writes single numbers next to lists in the machine's byte order.
        rows = [(np.array(f, 'i4'), np.array([0.5, 0.25] * len(f), 'f4'), 1) for f in faces]
        element = lists(rows, [('vertex_indices', 'O'), ('texcoord', 'O'), ('texnumber', 'u1')],
                        kinds={'vertex_indices': 'i4', 'texcoord': 'f4'})
        save(f'plyfile-{tag}-texnumber', [vertices(points), element], order=order,
             comments=['TextureFile a.png', 'TextureFile b.png'])
        write(f'plyfile-{tag}-texnumber', writer, (points, faces), uvs='corner', texture='b.png')
    save('plyfile-text-double', [vertices(points, 'f8'), faces_of(faces)], text=True)
    write('plyfile-text-double', writer, (points, faces))


def by_hand():
    """Files that no library writes: odd line ends, junk in comments, packed files, invalid files."""
    writer = 'by hand'
    points, faces = ball()
    data = b''.join(struct.pack('<3f', *p) for p in points)
    data += b''.join(struct.pack('<B3i', 3, *f) for f in faces)

    def header(form, v=len(points), f=len(faces), end='\n', comment=b'', kind='float'):
        lines = ['ply', f'format {form} 1.0', f'element vertex {v}']
        lines += [f'property {kind} {c}' for c in 'xyz']
        lines += [f'element face {f}', 'property list uchar int vertex_indices', 'end_header']
        text = end.join(lines).encode() + end.encode()
        return text.replace(b'element vertex', comment + b'element vertex', 1)

    little = 'binary_little_endian'
    text = ''.join(f'{x:.9g} {y:.9g} {z:.9g}\r\n' for x, y, z in points)
    text += ''.join(f'3 {a} {b} {c}\r\n' for a, b, c in faces)
    good = header(little) + data

    def valid(name, content, **more):
        open(f'valid/{name}.ply' if '.ply' not in name else f'valid/{name}', 'wb').write(content)
        write(name, writer, (points, faces), **more)

    valid('crlf-text', header('ascii', end='\r\n') + text.encode())
    valid('crlf-binary', header(little, end='\r\n') + data)
    junk = b'comment \x80\xff\x00\x01 junk\nobj_info \xfe\xff\n'
    valid('junk-in-comments', header(little, comment=junk) + data)
    valid('one-line-end-missing', header('ascii') + text.replace('\r', '').rstrip('\n').encode())
    valid('blank-lines', header('ascii') + ('\n \n' + text.replace('\r\n', '\n\n')).encode())
    valid('tail', good + b'more than the header declares')
    valid('packed.ply.gz', gzip.compress(good, mtime=0))
    half = len(good) // 2
    valid('packed-in-parts.ply.gz', gzip.compress(good[:half], mtime=0) + gzip.compress(good[half:], mtime=0))
    valid('packed-text.ply.gz', gzip.compress(header('ascii') + text.encode(), mtime=0))
    try:
        import zstandard
        zstd = zstandard.ZstdCompressor(level=19, write_checksum=True).compress
        valid('packed.ply.zst', zstd(good))
        valid('packed-in-frames.ply.zst', zstd(good[:half]) + zstd(good[half:]))
        open('invalid/cut.ply.zst', 'wb').write(zstd(good)[:-9])
        refuse('cut', 'cannot unpack the zstd data: *', file='cut.ply.zst')
    except ImportError:
        print('left out: zstd (pip install zstandard)')
    twice = faces + [faces[3][1:] + faces[3][:1], faces[5]]
    repeated = header(little, f=len(twice)) + data + b''.join(struct.pack('<B3i', 3, *f) for f in twice[-2:])
    open('valid/duplicates.ply', 'wb').write(repeated)
    write('duplicates', writer, (points, faces), faces=len(twice))

    def bad(name, content, message, kind='Invalid'):
        file = name if '.ply' in name else f'{name}.ply'
        open(f'invalid/{file}', 'wb').write(content)
        refuse(name.split('.')[0], message, kind, file)

    bad('packed-cut.ply.gz', gzip.compress(good, mtime=0)[:-20], 'cannot unpack the gzip data: *')
    wrong = bytearray(gzip.compress(good, mtime=0))
    wrong[-6] ^= 1
    bad('packed-checksum.ply.gz', bytes(wrong), 'cannot unpack the gzip data: *')
    bad('packed-text.ply.gz', gzip.compress(b'hello\n', mtime=0), "is not a PLY file: its first line is not 'ply'")
    bad('stl', b'solid ball\nfacet normal 0 0 1\n', "is not a PLY file: its first line is not 'ply'")
    bad('no-end', good[:60], 'the header has no end_header; the file ends after its line 3')
    bad('lie-vertices', header(little, v=4_000_000_000) + data,
        f'the header declares 4000000000 vertices, but only {len(data) // 12} are in the file: they need '
        f'48000000000 bytes, {len(data)} are left')
    bad('lie-faces', header(little, f=10 ** 19) + data,
        f'the header declares 10000000000000000000 faces, but only {len(faces)} are in the file: '
        f'{len(faces) * 13} bytes of data were left for them')
    bad('too-many-vertices', header(little, v=2 ** 32) + data, 'has 4294967296 vertices; the most is 4294967295')
    bad('cut-in-faces', good[:-1],
        f'the header declares {len(faces)} faces, but only {len(faces) - 1} are in the file: '
        f'{len(faces) * 13 - 1} bytes of data were left for them')
    index = bytearray(good)
    index[-4:] = struct.pack('<i', 1000)
    bad('index', bytes(index), f'invalid/index.ply: face {len(faces) - 1}: vertex index 1000 is out of range: the '
        f'file has {len(points)} vertices (0 to {len(points) - 1}); indices out of range in all: 1')
    nan = bytearray(good)
    at = len(header(little)) + 12 * 3
    nan[at:at + 4] = struct.pack('<f', float('nan'))
    first = next(i for i, f in enumerate(faces) if 3 in f)
    y, z = points[3][1], points[3][2]
    bad('nan', bytes(nan), f'invalid/nan.ply: vertex 3: (NaN, * is not finite, and face {first} uses it; '
        'such vertices in all: 1')
    lines = (header('ascii') + text.replace('\r', '').encode()).split(b'\n')
    lines[12] = b'0.5 zero 1'
    bad('word', b'\n'.join(lines), "invalid/word.ply:13: vertex 3: 'zero' is not a number")
    lines[12] = b'0.5 1'
    bad('too-few-values', b'\n'.join(lines), 'invalid/too-few-values.ply:13: vertex 3: the line has too few values')
    bad('unknown-type', header(little, kind='half') + data, "invalid/unknown-type.ply:4: unknown type 'half'")
    bad('unknown-format', header('binary') + data, "invalid/unknown-format.ply:2: unknown format 'binary'")
    bad('only-flat', header('ascii', v=3, f=1) + b'0 0 0\n1 1 1\n2 2 2\n3 0 1 2\n',
        'no triangle is left of 1 face: 0 have fewer than 3 corners, 1 triangle has no area or repeats a vertex, '
        '0 use missing or non-finite vertices')


def refuse(name, message, kind='Invalid', file=None):
    """Writes the expected error of an invalid file; `*` stands for any text."""
    file = file or f'{name}.ply'
    prefix = '' if message.startswith('invalid/') else f'invalid/{file}: '
    stem = file.split('.ply')[0]
    with open(f'invalid/{stem}.txt', 'w') as out:
        out.write(f'{kind}\n{prefix}{message}\n')


WRITERS = [with_trimesh, with_open3d, with_meshio, with_pymeshlab, with_bpy, with_plyfile, by_hand]


def main():
    if len(sys.argv) == 3:
        os.chdir(sys.argv[1])
        next(w for w in WRITERS if w.__name__ == sys.argv[2])()
        return
    here = os.path.dirname(os.path.abspath(__file__))
    folder = sys.argv[1] if len(sys.argv) > 1 else os.path.join(here, '..', 'tests', 'ply')
    for part in ('valid', 'invalid'):
        os.makedirs(os.path.join(folder, part), exist_ok=True)
    for writer in WRITERS:
        run = subprocess.run([sys.executable, os.path.abspath(__file__), folder, writer.__name__],
                             capture_output=True, text=True)
        last = (run.stderr.strip().splitlines() or [''])[-1]
        print(writer.__name__, 'done' if run.returncode == 0 else f'LEFT OUT: {last}', run.stdout.strip()[-200:])


if __name__ == '__main__':
    main()
