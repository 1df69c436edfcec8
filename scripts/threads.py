#!/usr/bin/env python3
"""Measures how a render and a batch become faster with threads.

    scripts/threads.py [--program target/release/lightpath] [--threads 1 2 4 8 16] [--rounds 3] INPUT... > entry.md

An INPUT is a mesh or a scene, with options of `render` after it: "room.ply --spp 16". Each is rendered at 1024 x 1024
with every number of threads in turns, up and down, and so is a turntable of the first input. The tables, for
docs/notebook/scaling.md, have the medians. Checks that every number of threads writes the same bytes. Needs only
Python's standard library.
"""
import argparse
import hashlib
import json
import os
import resource
import shlex
import statistics
import subprocess
import sys
import tempfile
import time

PHASES = ("load", "build", "render", "write", "total")


def call(command):
    """Runs a command; returns its output, seconds, and seconds in the kernel."""
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    began = time.perf_counter()
    done = subprocess.run(command, stdout=subprocess.PIPE, check=True)
    seconds = time.perf_counter() - began
    return done.stdout, seconds, resource.getrusage(resource.RUSAGE_CHILDREN).ru_stime - before.ru_stime


def turns(counts, rounds):
    """The numbers of threads in the order in which they are measured."""
    for i in range(rounds):
        yield from counts if i % 2 == 0 else counts[::-1]


def sized(given):
    return given if "--size" in given else [*given, "--size", "1024x1024"]


def digest(path):
    with open(path, "rb") as file:
        return hashlib.sha256(file.read()).hexdigest()


def renders(args, given, backend, folder):
    """Returns {threads: [seconds by phase]}, with `kernel` and `process` added to the phases."""
    runs, written = {n: [] for n in args.threads}, set()
    for n in turns(args.threads, args.rounds):
        command = [args.program, "render", *sized(given), "-o", os.path.join(folder, "x"), "--backend", backend]
        output, process, kernel = call([*command, "--quiet", "--json", "--threads", str(n)])
        runs[n].append({**json.loads(output)["seconds"], "kernel": kernel, "process": process})
        written.add(digest(os.path.join(folder, "x.exr")))
        print(given, backend, n, runs[n][-1], file=sys.stderr)
    if len(written) != 1:
        sys.exit(f"{given}: the pictures differ with the number of threads")
    return runs


def table(runs):
    """Prints the medians by phase, and the render's speed-up and Amdahl's serial fraction."""
    middle = {n: {k: statistics.median(one[k] for one in all_runs) for k in all_runs[0]} for n, all_runs in runs.items()}
    first, *_ = middle
    print("| threads | " + " | ".join(PHASES) + " | process | in the kernel | render x | serial part | process x |")
    print("|---" * (len(PHASES) + 6) + "|")
    for n, row in middle.items():
        cells = [f"{row[k]:.3f}" for k in (*PHASES, "process", "kernel")]
        gain = middle[first]["render"] / row["render"]
        more = n / first
        cells += [f"{gain:.2f}", f"{(more / gain - 1) / (more - 1):.4f}" if more > 1 else ""]
        cells.append(f"{middle[first]['process'] / row['process']:.2f}")
        print(f"| {n} | " + " | ".join(cells) + " |")


def turntable(args, given, folder):
    """Prints frames a minute of a turntable of the input."""
    seconds = {n: [] for n in args.threads}
    for n in turns(args.threads, args.rounds):
        command = [args.program, "batch", *sized(given), "--turntable", str(args.frames), "-o", os.path.join(folder, f"turn{n}")]
        command += ["--backend", "bvh", "--threads", str(n), "--no-sheet", "--quiet"]
        seconds[n].append(call(command)[1])
        print("turntable", n, seconds[n][-1], file=sys.stderr)
    middle = {n: statistics.median(all_runs) for n, all_runs in seconds.items()}
    first = args.threads[0]
    print("| threads | seconds | frames a minute | x |")
    print("|---|---|---|---|")
    for n, one in middle.items():
        print(f"| {n} | {one:.2f} | {60 * args.frames / one:.0f} | {middle[first] / one:.2f} |")


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("inputs", nargs="+", metavar="INPUT")
    parser.add_argument("--program", default="target/release/lightpath")
    parser.add_argument("--threads", type=int, nargs="+", default=[1, 2, 4, 8, 16])
    parser.add_argument("--rounds", type=int, default=3)
    parser.add_argument("--backends", nargs="+", default=["bvh"])
    parser.add_argument("--frames", type=int, default=36, help="frames of the turntable; 0: none")
    args = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        for text in args.inputs:
            given = shlex.split(text)
            for backend in args.backends:
                runs = renders(args, given, backend, folder)
                print(f"\n**{os.path.basename(given[0])} {shlex.join(given[1:])}**, `{backend}`\n")
                table(runs)
                sys.stdout.flush()
        if args.frames:
            given = shlex.split(args.inputs[0])
            print(f"\n**Turntable of {args.frames} frames of {os.path.basename(given[0])}**\n")
            turntable(args, given, folder)


if __name__ == "__main__":
    main()
