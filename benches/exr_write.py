#!/usr/bin/env python3
"""Compares how fast lightpath and OpenEXR's own library write the same channels to an EXR, in turns.

    pip install OpenEXR numpy
    cargo bench --bench exr_write --no-run
    benches/exr_write.py target/release/deps/exr_write-HASH FRAME.exr [--threads 2] [--times 5]

FRAME.exr comes from lightpath, best without compression so that reading it is quick:

    lightpath render scan.ply --size 4096x4096 --aov Z,P,N,albedo --compression none -o FRAME
"""
import argparse
import os
import statistics
import subprocess
import tempfile
import time

import OpenEXR

parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
parser.add_argument("bench")
parser.add_argument("frame")
parser.add_argument("--threads", type=int, default=2)
parser.add_argument("--times", type=int, default=5)
arguments = parser.parse_args()

part = OpenEXR.File(arguments.frame, separate_channels=True).parts[0]
channels = {name: channel.pixels for name, channel in part.channels.items()}
height, width = next(iter(channels.values())).shape
header = dict(part.header) | {"compression": OpenEXR.ZIP_COMPRESSION}
OpenEXR.set_global_thread_count(arguments.threads)
seconds = {"OpenEXR": [], "OpenEXR, processor time": [], "lightpath": []}
sizes = {}
with tempfile.TemporaryDirectory(dir=os.path.dirname(os.path.abspath(arguments.frame))) as folder:
    theirs, ours = (os.path.join(folder, name) for name in ("theirs.exr", "ours.exr"))
    command = [arguments.bench, arguments.frame, ours, str(arguments.threads), "1"]
    for turn in range(arguments.times):
        began = time.monotonic(), time.process_time()
        OpenEXR.File(header, channels).write(theirs)
        seconds["OpenEXR"].append(time.monotonic() - began[0])
        seconds["OpenEXR, processor time"].append(time.process_time() - began[1])
        done = subprocess.run(command, check=True, capture_output=True, text=True)
        seconds["lightpath"].append(float(done.stdout))
    sizes = {"OpenEXR": os.path.getsize(theirs), "lightpath": os.path.getsize(ours)}
    same = subprocess.run(["oiiotool", theirs, ours, "--diff"], capture_output=True).returncode == 0

print(f"{width} x {height}, {len(channels)} channels, ZIP, {arguments.threads} threads, OpenEXR {OpenEXR.__version__}")
for name, times in seconds.items():
    print(f"{name}: median {statistics.median(times):.2f} s, " + " ".join(f"{t:.2f}" for t in times))
print(f"ratio of the medians: {statistics.median(seconds['lightpath']) / statistics.median(seconds['OpenEXR']):.2f}")
print(f"bytes: {sizes['lightpath']} / {sizes['OpenEXR']}; the same pixels: {same}")
