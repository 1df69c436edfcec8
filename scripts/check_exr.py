#!/usr/bin/env python3
"""Renders a small scene with many settings and reads the files as compositors do.

    check_exr.py LIGHTPATH      with `pip install OpenEXR numpy`; uses exrinfo, exrmaketiled and oiiotool

Decodes every file completely with OpenEXR's own library. Exit code 1 and a line for each mistake.
"""
import json
import os
import shutil
import signal
import subprocess
import sys
import tempfile

import numpy as np
import OpenEXR

from check_cryptomatte import check as check_mattes

HERE = os.path.dirname(os.path.abspath(__file__))
PROGRAM = os.path.abspath(sys.argv[1])
WIDTH, HEIGHT = 90, 61  # neither is a multiple of a packet's pixels or of a block's lines

SCENE = {
    "spp": 4,
    "nbounces": 2,
    "seed": 11,
    "camera": {
        "type": "pinhole", "width": WIDTH, "height": HEIGHT, "fov": 40,
        "position": [0.3, 1.5, 7], "lookat": [0.02, -0.1, -1], "up": [0.1, 1, 0],
    },
    "scene": {
        "accelerator": "bvh",
        "backgroundcolor": [0.2, 0.3, 0.5],
        "ambient": [0.2, 0.2, 0.2],
        "lightsources": [
            {"type": "pointlight", "position": [3, 5, 4], "id": [9, 9, 8], "group": "key"},
            {"type": "arealight", "v0": [-2, 4, 1], "v1": [0, 4, 1], "v2": [-2, 4, 3], "id": [4, 4, 6],
             "samples": 4, "name": "sky"},
        ],
        "materials": {
            "floor": {"kd": 0.8, "ka": 0.4, "kr": 0.2},
            "gloss": {"kd": 0.6, "ks": 0.6, "specularexponent": 30, "ka": 0.2, "diffusecolor": [0.8, 0.2, 0.1]},
        },
        "shapes": [
            {"type": "plane", "v0": [-4, 0, -4], "v1": [4, 0, -4], "v2": [4, 0, 4], "v3": [-4, 0, 4],
             "material": "floor"},
            {"type": "sphere", "name": "ball", "center": [-1, 1, 0], "radius": 1, "material": "gloss"},
            {"type": "sphere", "center": [1.2, 1, 0.4], "radius": 1, "material": {"kd": 0.1, "kr": 0.8}},
        ],
    },
}  # fmt: skip

HALF, FLOAT, UINT = np.float16, np.float32, np.uint32
TYPES = {c: HALF for c in "RGBA"}
TYPES |= {"Z": FLOAT, "distance.Y": FLOAT, "facing.Y": HALF, "primid.id": UINT, "objectid.id": UINT, "samples.Y": FLOAT}
TYPES |= {f"{layer}.{c}": HALF for layer in ("N", "Ng", "Ncam") for c in "XYZ"}
TYPES |= {f"{layer}.{c}": HALF for c in "RGB" for layer in (
    "albedo", "diffuse", "specular", "ambient", "reflection", "background", "light_key", "light_sky",
    "light_ambient", "light_background")}  # fmt: skip
TYPES |= {"P.X": FLOAT, "P.Y": FLOAT, "P.Z": FLOAT, "uv.U": FLOAT, "uv.V": FLOAT, "uv.A": FLOAT}
TYPES |= {f"variance.{c}": FLOAT for c in "RGB"}
TYPES |= {"shadow_key.Y": HALF, "shadow_sky.Y": HALF}
TYPES |= {f"Crypto{of}{i:02}.{c}": FLOAT for of in ("Object", "Material") for i in range(3) for c in "RGBA"}

wrong = []


def expect(true, message):
    if not true:
        wrong.append(message)


def lightpath(*flags, code=0):
    done = subprocess.run([PROGRAM, *flags], capture_output=True, text=True)
    expect(done.returncode == code, f"{' '.join(flags)}: exit {done.returncode}: {done.stderr}")
    return done


def render(name, *flags):
    lightpath("render", "s.json", "-o", name, "--quiet", *flags)
    return read(name)


def read(name):
    """Checks a file with all other readers, then returns its parts and its channels by name."""
    path = name + ".exr"
    tools = [["exrinfo", "-s", path], ["exrmaketiled", path, "tiled.exr"], ["oiiotool", path, "-o", "copy.exr"]]
    for tool in tools:
        # exrmaketiled supports neither several parts nor, with some libraries, DWA.
        if not shutil.which(tool[0]) or (tool[0] == "exrmaketiled" and name in ("parts", "dwaa")):
            continue
        done = subprocess.run(tool, capture_output=True, text=True)
        # The exit code of Debian 12's exrinfo is uninitialised memory. It prints nothing of a bad file.
        accepted = "channels:" in done.stdout if tool[0] == "exrinfo" else done.returncode == 0
        expect(accepted, f"{' '.join(tool)}: {done.stdout}{done.stderr}")
    parts = OpenEXR.File(path, separate_channels=True).parts
    channels = {n: c.pixels for part in parts for n, c in part.channels.items()}
    return parts, channels


def bytes_of(name):
    with open(name + ".exr", "rb") as file:
        return file.read()


def same(what, found, expected):
    expect(found.keys() == expected.keys(), f"{what}: other channels")
    for name in found.keys() & expected.keys():
        equal = found[name].view(np.uint8).tobytes() == expected[name].view(np.uint8).tobytes()
        expect(equal and found[name].dtype == expected[name].dtype, f"{what}: {name} differs")


def python(script, *arguments):
    done = subprocess.run([sys.executable, os.path.join(HERE, script), *arguments], capture_output=True, text=True)
    print(done.stdout, end="")
    expect(done.returncode == 0, f"{script}: {done.stdout}{done.stderr}")


def header_and_types():
    parts, all_layers = render("all", "--aov", "all", "--frame", "12", "--fps", "24")
    found = {name: pixels.dtype.type for name, pixels in all_layers.items()}
    for name in sorted(found.keys() | TYPES.keys()):
        expect(found.get(name) == TYPES.get(name), f"{name} is {found.get(name)}, expected {TYPES.get(name)}")
    header = parts[0].header
    window = [list(map(int, corner)) for corner in header["displayWindow"]]
    expect(window == [[0, 0], [WIDTH - 1, HEIGHT - 1]], f"display window {window}")
    expect(header["compression"] == OpenEXR.ZIP_COMPRESSION, f"compression {header['compression']}")
    expect(header["lineOrder"] == OpenEXR.INCREASING_Y, "line order")
    wanted = {
        "chromaticities": (0.64, 0.33, 0.30, 0.60, 0.15, 0.06, 0.3127, 0.3290), "pixelAspectRatio": 1.0,
        "screenWindowCenter": (0, 0), "imageCounter": 12, "lightpath:seed": "11", "lightpath:spp": "4",
    }  # fmt: skip
    for name, value in wanted.items():
        said = header.get(name)
        equal = said == value if isinstance(value, str) else said is not None and np.allclose(said, value)
        expect(equal, f"{name} is {said}, expected {value}")
    rate = header.get("framesPerSecond")
    expect(rate == 24, f"framesPerSecond is {rate}")
    names = ["software", "worldToCamera", "worldToNDC", "screenWindowWidth"]
    names += ["lightpath:" + name for name in ("version", "sceneHash", "backend", "Z", "P", "N", "Ncam", "distance")]
    expect(not [name for name in names if name not in header], f"attributes: {sorted(header)}")
    expect("renderTimeSeconds" not in header, "the time is in the header without being asked for")
    info = lightpath("info", "all.exr").stdout
    shown = list(TYPES) + names + list(wanted) + ["framesPerSecond"]
    expect(not [n for n in shown if n not in info], f"info does not show {[n for n in shown if n not in info]}")
    return all_layers


def sums_and_mattes():
    render("relit", "--set", "/scene/lightsources/0/id=[22.5, 22.5, 20]")
    python("check_layers.py", "all.exr", "key", "2.5", "relit.exr")
    python("check_cryptomatte.py", "all.exr", "ball", "plane", "floor", "gloss", "material.sphere")
    render("beside", "--aov", "cryptomatte", "--crypto-sidecar")
    expect(not check_mattes("beside.exr", ["ball", "floor"])[0], "mattes with a manifest beside the picture")
    for name in ("равнина", 'Käse "日本"'):
        render("names", "--aov", "cryptomatte", "--set", f"/scene/shapes/1/name={json.dumps(name)}")
        expect(not check_mattes("names.exr", [name])[0], f"a matte called {name}: {check_mattes('names.exr')}")
    usual = read("all")[1]
    for ranks in (2, 10):
        name = f"ranks{ranks}"
        found = render(name, "--aov", "cryptomatte", "--crypto-ranks", str(ranks))[1]
        layers = sorted({n.split(".")[0] for n in found} - set("RGBA"))
        expected = sorted(f"Crypto{of}{i:02}" for of in ("Object", "Material") for i in range(ranks // 2))
        expect(layers == expected, f"{ranks} ranks: {layers}")
        mistakes, areas = check_mattes(f"{name}.exr", ["ball"])
        expect(not mistakes and set(areas) == {"CryptoObject", "CryptoMaterial"}, f"{ranks} ranks: {mistakes}")
        shared = found.keys() & usual.keys()
        same(f"{ranks} ranks", {n: found[n] for n in shared}, {n: usual[n] for n in shared})


def parts_alone(parts):
    """Checks that each part has all attributes for a reader of one part, and the first for a reader of the first."""
    def mattes(part):
        return {k: v for k, v in part.header.items() if k.startswith("cryptomatte/")}

    def others(part):
        own = ("channels", "name", "chunkCount")
        return {k: str(v) for k, v in part.header.items() if k not in own and not k.startswith("cryptomatte/")}

    first = parts[0]
    expect(mattes(first) == mattes(read("all")[0][0]), f"mattes of the first part: {mattes(first)}")
    for part in parts[1:]:
        name = part.name()
        expect(others(part) == others(first), f"{name}: {sorted(others(part).items() ^ others(first).items())}")
        if not name.startswith("Crypto"):
            expect(not mattes(part), f"{name} has mattes: {sorted(mattes(part))}")
            continue
        OpenEXR.File(part.header, part.channels).write("alone.exr")
        mistakes, areas = check_mattes("alone.exr")
        expect(not mistakes and set(areas) == {name}, f"{name} alone: {areas} {mistakes}")


def long_names():
    """Checks that the version field marks long names as OpenEXR's own writer does."""
    for letters in (23, 24, 200):
        group = f"/scene/lightsources/0/group={json.dumps('k' * letters)}"
        for name, flags in {"short": ["--aov", "light"], "parts": ["--aov", "light", "--multipart"]}.items():
            render(name, "--set", group, *flags)
            OpenEXR.File(name + ".exr", separate_channels=True).write("again.exr")
            ours, theirs = bytes_of(name)[4:8], bytes_of("again")[4:8]
            expect(ours == theirs, f"version {ours.hex()} with {letters} letters, by OpenEXR {theirs.hex()}")
            said = subprocess.run(["exrheader", name + ".exr"], capture_output=True, text=True)
            expect(said.returncode == 0 and "k" * letters in said.stdout, f"exrheader: {said.stdout}{said.stderr}")


def windows(all_layers):
    def piece(x0, y0, x1, y1):
        return {name: np.ascontiguousarray(pixels[y0:y1, x0:x1]) for name, pixels in all_layers.items()}

    for i, crop in enumerate([(0, 0, 45, 31), (45, 0, 90, 31), (0, 31, 90, 61), (13, 7, 14, 50)]):
        parts, crop_layers = render(f"crop{i}", "--aov", "all", "--crop", *map(str, crop))
        corner = [int(c) for c in parts[0].header["dataWindow"][0]]
        expect(corner == [crop[0], crop[1]], f"crop {crop}: data window at {corner}")
        same(f"crop {crop}", crop_layers, piece(*crop))
    parts, wide = render("wide", "--aov", "all", "--overscan", "7")
    (left, top), (right, bottom) = ([int(c) for c in corner] for corner in parts[0].header["dataWindow"])
    window = (left, top, right, bottom)
    expect(window == (-7, -7, WIDTH + 6, HEIGHT + 6), f"overscan: data window {window}")
    middle = {n: np.ascontiguousarray(p[7 : 7 + HEIGHT, 7 : 7 + WIDTH]) for n, p in wide.items()}
    same("overscan", middle, all_layers)
    python("check_layers.py", "wide.exr")


def storage(all_layers):
    for i, flags in enumerate([["--threads", "1"], ["--threads", "2"], ["--threads", "2"]]):
        render(f"again{i}", "--aov", "all", "--frame", "12", "--fps", "24", *flags)
        expect(bytes_of(f"again{i}") == bytes_of("all"), f"other bytes with {flags}")
    for name in ("zips", "piz", "rle", "none"):
        same(name, render(name, "--aov", "all", "--compression", name)[1], all_layers)
    lossy = render("dwaa", "--aov", "Z,N", "--compression", "dwaa")[1]
    off = max(np.abs(lossy[c].astype(float) - all_layers[c].astype(float)).max() for c in "RGB")
    expect(off < 0.1, f"dwaa is off by {off}")
    refused = lightpath("render", "s.json", "--aov", "cryptomatte", "--compression", "dwaa", code=2).stderr
    expect("cryptomatte" in refused and "ids" in refused, f"dwaa with cryptomatte: {refused}")
    parts, multi = render("parts", "--aov", "all", "--multipart")
    same("multipart", multi, all_layers)
    layers = ["rgba"] + sorted({n.rsplit(".")[0].rstrip("0123456789") for n in TYPES} - set("RGBA"))
    expect(sorted(layers) == sorted(part.name() for part in parts), f"parts {[p.name() for p in parts]}")
    expect(not check_mattes("parts.exr", ["ball"])[0], "mattes in several parts")
    parts_alone(parts)
    floats = render("float", "--aov", "all", "--float")[1]
    expect(all(p.dtype != np.float16 for p in floats.values()), "halves with --float")
    halves = {n: p.astype(all_layers[n].dtype) if TYPES[n] == HALF else p for n, p in floats.items()}
    same("--float, rounded", halves, all_layers)


def sudden_death():
    """Checks that a render killed while it writes leaves no file under a final name."""
    os.mkdir("out")
    flags = ["render", "s.json", "-o", "out/x", "--size", "1500x1000", "--spp", "1", "--aov", "all", "--threads", "1"]
    child = subprocess.Popen([PROGRAM, *flags, "--progress", "json"], stderr=subprocess.PIPE, text=True)
    for line in child.stderr:
        if line.startswith("{") and json.loads(line).get("phase") == "write":
            child.send_signal(signal.SIGKILL)
            break
    child.wait()
    child.stderr.close()
    print(f"killed while writing: exit {child.returncode}, left {os.listdir('out')}")
    expect(child.returncode == -signal.SIGKILL, "it was not killed while it wrote: no progress of the phase `write`?")
    expect(all(name.endswith(".part") for name in os.listdir("out")), f"left {os.listdir('out')}")


with tempfile.TemporaryDirectory() as folder:
    os.chdir(folder)
    with open("s.json", "w", encoding="utf-8") as file:
        json.dump(SCENE, file)
    layers = header_and_types()
    sums_and_mattes()
    long_names()
    windows(layers)
    storage(layers)
    sudden_death()
    os.chdir("/")
for line in wrong:
    print("wrong:", line)
print("EXR files:", "FAILED" if wrong else "as they should be")
sys.exit(bool(wrong))
