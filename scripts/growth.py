#!/usr/bin/env python3
"""Measures load, build, rays and memory of one scene at growing numbers of triangles, and draws them.

usage: growth.py [--program target/release/lightpath] [--rounds 3] [--embree-up-to N] [--charts FOLDER] MESH.ply...

Each mesh is rendered alone under a point light, 1024 x 1024, 1 sample, by each backend in turns (A B B A). The
tables have the medians. Meshes of more than 50 million triangles are rendered once, and those of more than
--embree-up-to by `bvh` alone. Closed meshes of any size: scripts/make_torus.py. Prints the table of an entry
in docs/notebook/scaling.md. --charts writes scale-time.svg and scale-memory.svg; it needs matplotlib.
"""
import argparse
import json
import math
import os
import statistics
import subprocess
import sys
import tempfile

PHASES = ("load", "build", "render", "write", "total")


def scene(path):
    """The mesh under a point light, framed from above its side. It lies within 2 units."""
    look = {"position": [0.0, 2.6, 3.4], "target": [0.0, 0.0, 0.0], "up": [0.0, 1.0, 0.0]}
    camera = {"type": "pinhole", "width": 1024, "height": 1024, "fov": 40.0, **look}
    light = {"type": "pointlight", "position": [2.0, 5.0, 4.0], "id": [40.0, 40.0, 40.0], "is": [0.0, 0.0, 0.0]}
    mesh = {"type": "trimesh", "path": os.path.abspath(path), "material": {"kd": 1.0, "diffusecolor": [0.7, 0.7, 0.7]}}
    return {"nbounces": 0, "camera": camera, "scene": {"lightsources": [light], "shapes": [mesh]}}


def render(program, path, backend, folder):
    """Renders once and returns the statistics."""
    stats = os.path.join(folder, "stats.json")
    command = [program, "render", os.path.join(folder, "scene.json"), "-o", os.path.join(folder, "x"), "--spp", "1"]
    command += ["--backend", backend, "--stats", stats, "--quiet"]
    with open(os.path.join(folder, "scene.json"), "w") as file:
        json.dump(scene(path), file)
    subprocess.run(command, check=True, stdout=subprocess.DEVNULL)
    with open(stats) as file:
        return json.load(file)


def measure(args, folder):
    """Returns a list of (triangles, {backend: row}), a row being what `summary` returns."""
    rows = []
    for path in args.meshes:
        runs = {"bvh": [render(args.program, path, "bvh", folder)]}
        triangles = runs["bvh"][0]["triangles"]
        if triangles <= args.embree_up_to:
            runs["embree"] = []
        rounds = 1 if triangles > 50_000_000 else args.rounds
        # The first run has read the file into the page cache.
        runs["bvh"].clear()
        for i in range(rounds):
            for backend in list(runs)[:: 1 if i % 2 == 0 else -1]:
                runs[backend].append(render(args.program, path, backend, folder))
                print(path, backend, runs[backend][-1]["seconds"], file=sys.stderr)
        rows.append((triangles, {backend: summary(all_runs, triangles) for backend, all_runs in runs.items()}))
    return rows


def summary(runs, triangles):
    """Returns the median seconds of each phase, the accelerator's bytes a triangle, and the process's peak in bytes."""
    row = {phase: statistics.median(run["seconds"][phase] for run in runs) for phase in PHASES}
    memory = runs[0]["memory"]
    row["held"] = memory["accelerator_bytes"] / triangles
    row["build peak"] = memory["accelerator_peak_bytes"] / triangles
    row["peak"] = max(run["memory"]["peak_bytes"] for run in runs)
    return row


def exponent(points):
    """Returns e of n^e by least squares of logarithms, over meshes of at least a million triangles; None without two."""
    logs = [(math.log(n), math.log(value)) for n, value in points if n >= 1_000_000]
    if len({n for n, _ in logs}) < 2:
        return None
    x, y = statistics.mean(p[0] for p in logs), statistics.mean(p[1] for p in logs)
    return sum((a - x) * (b - y) for a, b in logs) / sum((a - x) ** 2 for a, _ in logs)


def table(rows):
    print("| triangles | backend | load, s | build | render | write | all | held, B/triangle | build's peak | process, GiB |")
    print("|---|---|---|---|---|---|---|---|---|---|")
    for triangles, backends in rows:
        for backend, row in backends.items():
            seconds = " | ".join(f"{row[phase]:.3g}" for phase in PHASES)
            print(f"| {triangles:,} | {backend} | {seconds} | {row['held']:.1f} | {row['build peak']:.1f} "
                  f"| {row['peak'] / 2**30:.2f} |")
    for backend in ("bvh", "embree"):
        fits = [(phase, exponent([(n, r[backend][phase]) for n, r in rows if backend in r]))
                for phase in ("load", "build", "total")]
        if all(fit is not None for _, fit in fits):
            shown = ", ".join(f"{phase} n^{fit:.2f}" for phase, fit in fits)
            print(f"\n{backend}, from a million triangles on: {shown}.")


def charts(rows, folder):
    from matplotlib import pyplot

    pyplot.rcParams.update({"svg.fonttype": "none", "svg.hashsalt": "growth"})

    def draw(name, unit, lines):
        figure, axes = pyplot.subplots(figsize=(6, 4))
        for label, backend, value in lines:
            points = [(n, value(r[backend])) for n, r in rows if backend in r]
            style = "o-" if backend == "bvh" else "s--"
            axes.loglog(*zip(*points), style, label=f"{label}, {backend}")
        axes.set(xlabel="triangles", ylabel=unit)
        axes.grid(True, alpha=0.3)
        axes.legend(fontsize=8)
        figure.tight_layout()
        figure.savefig(os.path.join(folder, name), metadata={"Date": None})

    seconds = [(phase, backend, lambda row, phase=phase: row[phase])
               for phase in ("load", "build", "render") for backend in ("bvh", "embree")]
    draw("scale-time.svg", "seconds", [line for line in seconds if line[:2] != ("load", "embree")])
    draw("scale-memory.svg", "GiB", [("process", b, lambda row: row["peak"] / 2**30) for b in ("bvh", "embree")])


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--program", default="target/release/lightpath")
    parser.add_argument("--rounds", type=int, default=3)
    parser.add_argument("--embree-up-to", type=int, default=100_000_000, metavar="N")
    parser.add_argument("--charts", metavar="FOLDER")
    parser.add_argument("meshes", nargs="+")
    args = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        rows = measure(args, folder)
    table(rows)
    if args.charts:
        charts(rows, args.charts)


if __name__ == "__main__":
    main()
