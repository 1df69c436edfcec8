#!/usr/bin/env python3
"""Compares calibrated cameras with OpenCV and COLMAP: `pip install opencv-python-headless pycolmap OpenEXR numpy`.

check_cameras.py target/release/lightpath

Renders a mesh from random cameras of every model. OpenCV, or COLMAP for files that pycolmap wrote, projects the points of
the layer P; each must fall on the centre of its pixel. Then OpenCV projects the mesh's vertices; the layer P must show
each visible vertex where it falls. Prints the largest errors. Exit code 1 if one exceeds 1e-3 pixel, or if a picture is
missing.
"""
import json
import math
import os
import subprocess
import sys
import tempfile

import cv2
import numpy as np
import OpenEXR
import pycolmap

LIGHTPATH = os.path.abspath(sys.argv[1])
MESH = os.path.abspath(os.path.join(os.path.dirname(__file__), "../assets/spot.ply"))
MOST = 1e-3
worst = 0.0
random = np.random.default_rng(5)


def batch(folder, cameras, names):
    """Renders the mesh from a list of cameras of these names. Returns the points of each picture, by name."""
    command = [LIGHTPATH, "batch", MESH, "--cameras", cameras, "--aov", "P,primid", "--spp", "1", "--no-sheet", "--quiet"]
    subprocess.run([*command, "--name", "{image}", "-o", folder], check=True, stdout=subprocess.DEVNULL)
    found = {}
    for file in sorted(os.listdir(folder)):
        if file.endswith(".exr"):
            part = OpenEXR.File(os.path.join(folder, file), separate_channels=True).parts[0]
            pixels = {name: channel.pixels for name, channel in part.channels.items()}
            points = np.stack([pixels["P." + axis].astype(np.float64) for axis in "XYZ"], -1)
            found[file[:-4]] = points, pixels["primid.id"] > 0
    if found.keys() != set(names):
        sys.exit(f"{folder} has pictures of {sorted(found)}, expected {sorted(names)}")
    return found


def judge(what, points, hit, project):
    """Projects the points of all pixels that show the mesh."""
    global worst
    rows, columns = np.nonzero(hit)
    seen = project(points[hit])
    error = np.abs(seen - np.stack([columns, rows], -1)).max()
    # `max` would pass over a NaN.
    worst = max(worst, math.inf if math.isnan(error) else error)
    print(f"{what}: {hit.sum()} points, off by {error:.1e} pixel at most")


def vertices(what, points, hit, project, focal):
    """Finds the mesh's vertices in the pixels to which they project."""
    lines = open(MESH, "rb").read().split(b"end_header\n", 1)
    count = int(lines[0].split(b"element vertex ")[1].split()[0])
    if b"format ascii" in lines[0]:
        mesh = np.array([line.split()[:3] for line in lines[1].split(b"\n")[:count]], np.float64)
    else:
        names = lines[0].split(b"element vertex")[1].split(b"element face")[0].count(b"property float")
        mesh = np.frombuffer(lines[1], np.float32, count * names).reshape(count, names)[:, :3].astype(np.float64)
    at = np.rint(project(mesh)).astype(int)
    inside = ((at >= 0) & (at < [hit.shape[1], hit.shape[0]])).all(-1)
    mesh, at = mesh[inside], at[inside]
    shown = hit[at[:, 1], at[:, 0]]
    away = np.linalg.norm(points[at[:, 1], at[:, 0]] - mesh, axis=-1)
    # Within the footprint of a pixel on a surface that may be oblique.
    near = shown & (away < 4.0 * 3.0 / focal)
    print(f"{what}: {near.sum()} of {inside.sum()} vertices found in their pixels, the others are hidden")
    if near.sum() < 0.2 * inside.sum():
        sys.exit(f"{what}: too few vertices are where OpenCV projects them")


def pose():
    """A random camera that looks at the mesh from a distance of 3: R, t of OpenCV."""
    z = random.normal(size=3)
    z /= np.linalg.norm(z)
    x = np.cross(z, random.normal(size=3))
    x /= np.linalg.norm(x)
    rotation = np.stack([x, np.cross(z, x), z])
    return rotation, np.array([0.05, -0.1, 3.0])


def opencv(folder):
    brown = {"k1": -0.25, "k2": 0.06, "p1": 1e-3, "p2": -2e-3, "k3": -0.004}
    lenses = {
        "pinhole": None,
        "brown": {"type": "brownconrady", **brown},
        "rational": {"type": "brownconrady", "k1": 0.9, "k2": 0.1, "p1": -1e-3, "p2": 5e-4, "k3": 0.02, "k4": 1.1, "k5": 0.3, "k6": 0.02},
        "fisheye": {"type": "fisheye", "k1": 0.03, "k2": -0.01, "k3": 0.004, "k4": -3e-4},
    }
    cameras, projections = [], {}
    for name, lens in lenses.items():
        rotation, translation = pose()
        fx, fy, cx, cy = 520.0, 500.0, 331.7, 236.2
        matrix = np.array([[fx, 0, cx], [0, fy, cy], [0, 0, 1]])
        pose_4x4 = np.block([[rotation, translation[:, None]], [np.zeros(3), np.ones(1)]])
        camera = {"type": "intrinsics", "width": 640, "height": 480, "fx": fx, "fy": fy, "cx": cx, "cy": cy}
        camera["world_to_camera"] = pose_4x4.tolist()
        if lens:
            camera["distortion"] = lens
        cameras.append({"image": name, "camera": camera})
        vector, k = cv2.Rodrigues(rotation)[0], np.array([(lens or {}).get(k, 0.0) for k in ["k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6"]])
        if name == "fisheye":
            k = np.array([lens[k] for k in ["k1", "k2", "k3", "k4"]])

        def project(points, name=name, vector=vector, translation=translation, matrix=matrix, k=k):
            if name == "fisheye":
                return cv2.fisheye.projectPoints(points[:, None], vector, translation, matrix, k)[0][:, 0]
            return cv2.projectPoints(points, vector, translation, matrix, k)[0][:, 0]

        projections[name] = project
    path = os.path.join(folder, "list.json")
    with open(path, "w") as file:
        json.dump({"cameras": cameras}, file)
    for name, (points, hit) in batch(os.path.join(folder, "opencv"), path, projections).items():
        judge(f"cv2 {name}", points, hit, projections[name])
        vertices(f"cv2 {name}", points, hit, projections[name], 500.0)


def colmap(folder):
    models = {
        "SIMPLE_PINHOLE": [500, 330, 236],
        "PINHOLE": [520, 500, 330, 236],
        "SIMPLE_RADIAL": [500, 330, 236, -0.1],
        "RADIAL": [500, 330, 236, -0.1, 0.02],
        "OPENCV": [520, 500, 330, 236, -0.2, 0.05, 1e-3, -2e-3],
        "OPENCV_FISHEYE": [520, 500, 330, 236, 0.03, -0.01, 0.004, -3e-4],
        "FULL_OPENCV": [520, 500, 330, 236, 0.9, 0.1, -1e-3, 5e-4, 0.02, 1.1, 0.3, 0.02],
        "SIMPLE_RADIAL_FISHEYE": [500, 330, 236, 0.02],
        "RADIAL_FISHEYE": [500, 330, 236, 0.02, -0.01],
    }
    model = pycolmap.Reconstruction()
    views = {}
    for number, (name, params) in enumerate(models.items(), 1):
        camera = pycolmap.Camera(model=name, width=640, height=480, params=params, camera_id=number)
        rotation, translation = pose()
        moved = pycolmap.Rigid3d(pycolmap.Rotation3d(rotation), translation)
        image = pycolmap.Image(name=name + ".jpg", camera_id=number, image_id=number)
        model.add_camera_with_trivial_rig(camera)
        model.add_image_with_trivial_frame(image, moved)
        views[name] = camera, rotation, translation
    for kind in ["text", "binary"]:
        written = os.path.join(folder, kind)
        os.mkdir(written)
        getattr(model, "write_" + kind)(written)
        for name, (points, hit) in batch(os.path.join(folder, "from-" + kind), written, views).items():
            camera, rotation, translation = views[name]

            def project(points):
                # COLMAP counts from the corner of the picture, not from the first pixel's centre.
                return np.array(camera.img_from_cam(points @ rotation.T + translation)) - 0.5

            judge(f"COLMAP {kind} {name}", points, hit, project)


with tempfile.TemporaryDirectory() as scratch:
    opencv(scratch)
    colmap(scratch)
print(f"largest error: {worst:.1e} pixel")
if worst > MOST:
    sys.exit(1)
