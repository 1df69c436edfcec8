#!/usr/bin/env python3
"""Measures the time of a frame by triangles, pixels, samples and threads, fits a model, and predicts a farm.

    scripts/scaling.py [--program target/release/lightpath] [--rounds 3] > entry.md

Renders generated meshes with `lightpath render --stats` on an otherwise idle machine, takes the minimum over the
rounds for each phase, fits one line per phase by least squares of relative errors, and prints an entry for
docs/notebook/scaling.md. Needs only Python's standard library.
"""

import argparse
import array
import datetime
import json
import math
import os
import subprocess
import sys
import tempfile

MESHES, FRAMES, NODES = 40_000, 72, 100


def sphere(path, rows):
    """Writes a bumpy sphere of 4 rows^2 triangles as binary PLY."""
    columns = 2 * rows
    points, faces = array.array("f"), bytearray()
    for i in range(rows + 1):
        theta = math.pi * i / rows
        for j in range(columns):
            phi = 2 * math.pi * j / columns
            r = 1 + 0.05 * math.sin(9 * theta) * math.sin(11 * phi)
            points.extend((r * math.sin(theta) * math.cos(phi), r * math.cos(theta), r * math.sin(theta) * math.sin(phi)))
    corners = array.array("i")
    for i in range(rows):
        for j in range(columns):
            a, b = i * columns + j, i * columns + (j + 1) % columns
            corners.extend((a, b, a + columns, b, b + columns, a + columns))
    raw = corners.tobytes()
    for at in range(0, len(raw), 12):
        faces += b"\x03" + raw[at : at + 12]
    header = (
        "ply\nformat binary_little_endian 1.0\n"
        f"element vertex {len(points) // 3}\nproperty float x\nproperty float y\nproperty float z\n"
        f"element face {len(corners) // 3}\nproperty list uchar int vertex_indices\nend_header\n"
    )
    with open(path, "wb") as file:
        file.write(header.encode() + points.tobytes() + bytes(faces))


def run(program, mesh, size, spp, threads, backend, rounds, folder):
    """Returns the statistics of a render, with the minimum seconds of each phase over the rounds."""
    best = None
    for _ in range(rounds):
        stats = os.path.join(folder, "stats.json")
        command = [program, "render", mesh, "-o", os.path.join(folder, "x"), "--quiet", "--stats", stats]
        command += ["--size", size, "--spp", str(spp), "--threads", str(threads), "--backend", backend]
        subprocess.run(command, check=True, stdout=subprocess.DEVNULL)
        with open(stats) as file:
            one = json.load(file)
        if best is None:
            best = one
        for phase, seconds in one["seconds"].items():
            best["seconds"][phase] = min(best["seconds"][phase], seconds)
    return best


def fit(rows, values):
    """Fits by least squares of relative errors. Returns the coefficients and the largest relative error."""
    n = len(rows[0])
    a = [[0.0] * (n + 1) for _ in range(n)]
    for row, value in zip(rows, values):
        for i in range(n):
            for j in range(n):
                a[i][j] += row[i] * row[j] / value**2
            a[i][n] += row[i] / value
    for i in range(n):
        pivot = max(range(i, n), key=lambda k: abs(a[k][i]))
        a[i], a[pivot] = a[pivot], a[i]
        for k in range(n):
            if k != i:
                factor = a[k][i] / a[i][i]
                a[k] = [x - factor * y for x, y in zip(a[k], a[i])]
    found = [a[i][n] / a[i][i] for i in range(n)]
    errors = [abs(sum(c * x for c, x in zip(found, row)) / value - 1) for row, value in zip(rows, values)]
    return found, max(errors)


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--program", default="target/release/lightpath")
    parser.add_argument("--rounds", type=int, default=3)
    parser.add_argument("--backend", default="bvh")
    parser.add_argument("--cores", type=int, default=32, help="cores per node of the farm")
    args = parser.parse_args()
    program = os.path.abspath(args.program)
    out = []
    say = out.append
    with tempfile.TemporaryDirectory() as folder:
        meshes = {}
        for rows in (50, 160, 500):
            path = os.path.join(folder, f"m{rows}.ply")
            sphere(path, rows)
            meshes[4 * rows * rows] = path
        measured = []
        cases = [(t, 320, 240, s) for t in meshes for s in (1, 4, 16)] + [(t, 640, 480, 1) for t in meshes]
        for triangles, width, height, spp in cases:
            stats = run(program, meshes[triangles], f"{width}x{height}", spp, 1, args.backend, args.rounds, folder)
            measured.append((triangles, width * height, spp, stats))
            print(f"{triangles} triangles, {width}x{height}, {spp} spp: {stats['seconds']}", file=sys.stderr)
        largest = max(meshes)
        threads = os.cpu_count() or 1
        counts = sorted({*(2**k for k in range(threads.bit_length())), threads})
        runs = {n: [] for n in counts}
        # In turns, so that a slow minute affects all of them.
        for _ in range(2 * args.rounds):
            for n in counts:
                runs[n].append(run(program, meshes[largest], "320x240", 4, n, args.backend, 1, folder)["seconds"])
        scaling = [(n, {k: min(one[k] for one in runs[n]) for k in runs[n][0]}) for n in counts]
        print(scaling, file=sys.stderr)
        bytes_per_triangle = os.path.getsize(meshes[largest]) / largest

    cpu = measured[0][3]["cpu"]
    rays = lambda stats: sum(stats["rays"][k] for k in ("primary", "shadow", "reflection"))
    load, load_error = fit([(1, m[0]) for m in measured], [m[3]["seconds"]["load"] for m in measured])
    build, build_error = fit([(1, m[0]) for m in measured], [m[3]["seconds"]["build"] for m in measured])
    samples = [(m[1] * m[2], m[1] * m[2] * math.log2(m[0])) for m in measured]
    render, render_error = fit(samples, [m[3]["seconds"]["render"] for m in measured])
    write, write_error = fit([(1, m[1]) for m in measured], [m[3]["seconds"]["write"] for m in measured])

    say(f"## {datetime.date.today()}: what does a frame cost?\n")
    say(f"**Method.** `scripts/scaling.py --backend {args.backend}` measures, fits and writes this entry. {cpu}, the built-in studio;")
    say(f"the least of {args.rounds} rounds; one thread unless a table says otherwise. Seconds by phase:\n")
    say("| triangles | pixels | samples | rays | load | build | render | write |")
    say("|---|---|---|---|---|---|---|---|")
    for triangles, pixels, spp, stats in measured:
        s = stats["seconds"]
        say(
            f"| {triangles:,} | {pixels:,} | {spp} | {rays(stats):,} | {s['load']:.3f} | {s['build']:.3f} "
            f"| {s['render']:.3f} | {s['write']:.3f} |"
        )
    say("\n### Fits\n")
    say("T triangles, P pixels, S samples a pixel; seconds of one thread. The error is the largest relative one of any run.\n")
    say("| phase | seconds | error |")
    say("|---|---|---|")
    line = lambda c, x: f"{c[0]:.4f} + {c[1] * 1e9:.1f}e-9 {x}"
    say(f"| load, with framing | {line(load, 'T')} | {100 * load_error:.0f}% |")
    say(f"| build | {line(build, 'T')} | {100 * build_error:.0f}% |")
    say(f"| render | P S ({render[0] * 1e9:.0f} + {render[1] * 1e9:.0f} log2 T) e-9 | {100 * render_error:.0f}% |")
    say(f"| write | {line(write, 'P')} | {100 * write_error:.0f}% |")
    say("\nLoad and build are linear in T and happen once a mesh. The render depends on T by the depth of the tree. From some 10^5")
    say("triangles on, caches no longer hold the tree.")

    say("\n### Threads\n")
    say(f"{largest:,} triangles, 320 x 240, 4 samples. The serial fraction f is Amdahl's: T(n) = T(1) (f + (1 - f) / n).\n")
    say("| threads | load | build | render | write | f of the render | f of all |")
    say("|---|---|---|---|---|---|---|")
    one = scaling[0][1]
    whole = lambda s: sum(s[k] for k in ("load", "build", "render", "write"))
    serial = serial_render = 0.0
    for n, s in scaling:
        fraction = lambda t1, tn: "" if n == 1 else f"{max(0.0, (n * tn / t1 - 1) / (n - 1)):.3f}"
        say(
            f"| {n} | {s['load']:.3f} | {s['build']:.3f} | {s['render']:.3f} | {s['write']:.3f} "
            f"| {fraction(one['render'], s['render'])} | {fraction(whole(one), whole(s))} |"
        )
        if n > 1:
            serial = max(0.0, (n * whole(s) / whole(one) - 1) / (n - 1))
            serial_render = max(0.0, (n * s["render"] / one["render"] - 1) / (n - 1))
    say(f"\nMeasured on {threads} processors; more threads are an extrapolation. In a batch the next mesh loads while this one renders,")
    say("and small frames render side by side. So f of the render is what counts there.")

    triangles, width, height, spp = 1_000_000, 1920, 1080, 16
    pixels = width * height
    per_mesh = load[0] + load[1] * triangles + build[0] + build[1] * triangles
    per_frame = pixels * spp * (render[0] + render[1] * math.log2(triangles)) + write[0] + write[1] * pixels
    core_seconds = MESHES * (per_mesh + FRAMES * per_frame)
    speed = lambda f: 1 / (f + (1 - f) / args.cores)
    hours = lambda seconds: f"{seconds / 3600:,.0f} h" if seconds < 72 * 3600 else f"{seconds / 86400:,.1f} days"
    mesh_bytes = bytes_per_triangle * triangles
    say(f"\n### {MESHES:,} meshes x {FRAMES} frames on {NODES} nodes\n")
    say(f"Meshes of {triangles:,} triangles ({mesh_bytes / 1e6:.0f} MB), {width} x {height}, {spp} samples:\n")
    say("| | |")
    say("|---|---|")
    say(f"| a mesh, once: load and build, one core | {per_mesh:.2f} s |")
    say(f"| a frame, one core | {per_frame:.1f} s |")
    say(f"| share of load and build | {100 * per_mesh / (per_mesh + FRAMES * per_frame):.2f}% |")
    say(f"| everything | {core_seconds / 3600:,.0f} core hours |")
    ideal = core_seconds / NODES / args.cores
    say(f"| on {NODES} nodes of {args.cores} cores, nothing lost | {hours(ideal)} |")
    real = core_seconds / NODES / speed(serial_render)
    say(f"| the same, one task of {args.cores} threads a node, f of the render as above | {hours(real)} |")
    say("\n### Limits\n")
    per_task = 10 * 60 * args.cores / per_frame
    tasks_of_mesh = max(1, math.ceil(FRAMES / per_task))
    duration = real
    say("**Reading meshes.** Frames are numbered mesh by mesh, and tasks end where meshes do.")
    say(f"A task of ten minutes on {args.cores} cores has {per_task:.0f} frames. Numbered frame by frame, every task would read its own mesh for each frame.\n")
    say("| frames numbered | tasks that read a mesh | read from the shared file system | on average | building |")
    say("|---|---|---|---|---|")
    for name, tasks, builds in (("mesh by mesh", tasks_of_mesh, 1), ("frame by frame", FRAMES, FRAMES)):
        size = MESHES * mesh_bytes * tasks
        say(
            f"| {name} | {tasks} | {size / 1e12:.1f} TB | {size / duration / 1e6:.1f} MB/s "
            f"| {MESHES * builds * per_mesh / 3600:,.0f} core hours |"
        )
    say("")
    say("- **Memory.** A node holds the mesh that renders and the next one. `lightpath info FILE.ply` predicts the peak.")
    say("  `submit slurm` requests 2.5 times the largest prediction. Several tasks a node multiply that, threads do not.")
    say("- **Number of tasks.** A Slurm array has at most `MaxArraySize` - 1 tasks (1000 by default). For so many frames that is")
    say(f"  {math.ceil(MESHES * FRAMES / 1000 / FRAMES) * FRAMES:,} frames a task. A lost node loses one frame, not one task: `--resume` keeps the finished ones.")
    say("- **Threads.** The serial fraction f keeps one frame from using many cores. Two tasks of half the cores each lose half of it.")
    say("- **Writing.** Every frame is two files of its own, with an fsync each. A folder holds the frames of one mesh.")
    print("\n".join(out))


if __name__ == "__main__":
    main()
