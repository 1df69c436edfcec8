"""Compare speed and wrong answers with trimesh (with embreex) and Open3D, on the same rays.

    python -m lightpath.bench                 # a bumpy ball of 196,608 faces
    python -m lightpath.bench scan.ply        # your mesh
    python -m lightpath.bench --help

Packages that are not installed are left out. Times are of whole calls, from numpy arrays to numpy
arrays, after the build. The smallest time of several rounds counts (one round for `contains`). In
each round, all packages take turns. Open3D gets its rays as one float32 array, the others as two
float64 arrays.
"""

import argparse
import importlib
import json
import os
import time

import numpy as np

from ._rays import RayScene


def ball(n=128):
    """Return a closed bumpy ball of 12 n^2 faces: a cube whose sides are grids, moved to a sphere."""
    side = np.linspace(-1, 1, n + 1)
    x, y = np.meshgrid(side, side, indexing="ij")
    one = np.ones_like(x)
    points, faces, first = [], [], 0
    index = np.arange((n + 1) ** 2).reshape(n + 1, n + 1)
    a, b, c, d = index[:-1, :-1], index[1:, :-1], index[1:, 1:], index[:-1, 1:]
    grid = np.stack([a, b, c, a, c, d], axis=-1).reshape(-1, 3)
    for axis in range(3):
        for sign in (-1, 1):
            patch = np.empty((n + 1, n + 1, 3))
            patch[..., axis] = sign * one
            patch[..., (axis + 1) % 3], patch[..., (axis + 2) % 3] = x, y
            points.append(patch.reshape(-1, 3))
            faces.append((grid if sign > 0 else grid[:, ::-1]) + first)
            first += (n + 1) ** 2
    points, inverse = np.unique(np.concatenate(points), axis=0, return_inverse=True)
    faces = inverse.reshape(-1)[np.concatenate(faces)]
    points /= np.linalg.norm(points, axis=1)[:, None]
    bumps = 1 + 0.1 * np.sin(points * 23).prod(axis=1)
    return points * bumps[:, None], faces.astype(np.int64)


def camera_rays(bounds, count):
    """Return about `count` rays of a pinhole camera that sees the mesh, row by row."""
    side = int(np.sqrt(count))
    middle, size = bounds.mean(axis=0), np.linalg.norm(np.ptp(bounds, axis=0))
    x, y = np.meshgrid(np.linspace(-0.35, 0.35, side), np.linspace(0.35, -0.35, side))
    directions = np.stack([x.ravel(), y.ravel(), -np.ones(x.size)], axis=1)
    origins = np.broadcast_to(middle + [0, 0, 1.3 * size], directions.shape)
    return np.ascontiguousarray(origins), directions


def random_rays(bounds, count, rng):
    """Return rays between random points of a box twice as large as the box of the mesh."""
    middle, half = bounds.mean(axis=0), np.ptp(bounds, axis=0)
    origins = middle + half * rng.uniform(-1, 1, (count, 3))
    return origins, middle + half * rng.uniform(-1, 1, (count, 3)) - origins


class Ours:
    """This package."""

    name = "lightpath"
    modules = ()

    def __init__(self, vertices, faces, threads):
        self.scene = RayScene(vertices, faces, threads=threads)
        self.bytes = self.scene.nbytes

    def closest(self, rays):
        return self.scene.closest(rays.origins, rays.directions).primitive

    def occluded(self, rays):
        return self.scene.occluded(rays.origins, rays.directions)

    def all_hits(self, rays):
        return np.diff(self.scene.all_hits(rays.origins, rays.directions).offsets)

    def contains(self, points):
        return self.scene.contains(points)


class Trimesh:
    """trimesh with embreex."""

    name = "trimesh + embreex"
    modules = ("embreex", "trimesh")

    def __init__(self, vertices, faces, threads):
        import trimesh

        mesh = trimesh.Trimesh(vertices, faces, process=False)
        self.rays = trimesh.ray.ray_pyembree.RayMeshIntersector(mesh)
        self.rays.intersects_any(np.zeros((1, 3)), np.ones((1, 3)))
        mesh.face_normals

    def closest(self, rays):
        found = self.rays.intersects_id(rays.origins, rays.directions, multiple_hits=False,
                                        return_locations=True)
        primitive = np.full(len(rays.origins), -1)
        primitive[found[1]] = found[0]
        return primitive

    def occluded(self, rays):
        return self.rays.intersects_any(rays.origins, rays.directions)

    def all_hits(self, rays):
        found = self.rays.intersects_location(rays.origins, rays.directions)
        return np.bincount(found[1], minlength=len(rays.origins))

    def contains(self, points):
        return self.rays.contains_points(points)


class Open3D:
    """Open3D's RaycastingScene."""

    name = "Open3D"
    modules = ("open3d",)

    def __init__(self, vertices, faces, threads):
        import open3d

        self.tensor, self.threads = open3d.core.Tensor, threads
        self.scene = open3d.t.geometry.RaycastingScene(nthreads=threads)
        self.scene.add_triangles(self.tensor(vertices.astype(np.float32)),
                                 self.tensor(faces.astype(np.uint32)))
        # The first query builds the tree.
        self.scene.test_occlusions(self.tensor(np.ones((1, 6), np.float32)), nthreads=threads)

    def closest(self, rays):
        hits = self.scene.cast_rays(self.tensor(rays.single), nthreads=self.threads)
        primitive = hits["primitive_ids"].numpy().astype(np.int64)
        hits["t_hit"].numpy(), hits["primitive_normals"].numpy(), hits["primitive_uvs"].numpy()
        primitive[primitive == self.scene.INVALID_ID] = -1
        return primitive

    def occluded(self, rays):
        return self.scene.test_occlusions(self.tensor(rays.single), nthreads=self.threads).numpy()

    def all_hits(self, rays):
        hits = self.scene.list_intersections(self.tensor(rays.single), nthreads=self.threads)
        {name: hits[name].numpy() for name in ("t_hit", "primitive_ids", "primitive_uvs")}
        return np.diff(hits["ray_splits"].numpy().astype(np.int64))

    def contains(self, points):
        points = self.tensor(points.astype(np.float32))
        return self.scene.compute_occupancy(points, nthreads=self.threads).numpy() > 0.5


class Rays:
    """The same rays for all packages: float32 values, as float32 and as float64 arrays."""

    def __init__(self, origins, directions):
        self.single = np.concatenate([origins, directions], axis=1).astype(np.float32)
        self.origins = self.single[:, :3].astype(np.float64)
        self.directions = self.single[:, 3:].astype(np.float64)


def aimed_rays(vertices, faces, count, rng):
    """Return rays from the middle of a mesh to its vertices and to points on its edges."""
    middle = vertices.mean(axis=0).astype(np.float32).astype(np.float64)
    face, corner = rng.integers(len(faces), size=count), rng.integers(3, size=count)
    a, b = vertices[faces[face, corner]], vertices[faces[face, (corner + 1) % 3]]
    weight = rng.choice([0.0, 0.5, 0.25, 0.75], count)[:, None]
    targets = a + (b - a) * weight
    return Rays(np.broadcast_to(middle, targets.shape), targets - middle)


def points_of_a_box(count, rng):
    """Return points around the box from -1 to 1, with 1 for inside, 0 for outside, 2 for on it."""
    points = rng.uniform(-1.5, 1.5, (count, 3))
    kind = rng.integers(4, size=count)
    for k in range(3):
        on = kind > k
        points[on, k] = rng.choice([-1.0, 0.0, 1.0], on.sum())
    far = np.abs(points).max(axis=1)
    return points, np.where(far == 1, 2, (far < 1).astype(int))


def box(n=16):
    """Return the box from -1 to 1 as grids of n x n squares on each side."""
    vertices, faces = ball(n)
    return np.round(vertices / np.abs(vertices).max(axis=1)[:, None] * n) / n, faces


def measure(contestants, work, rounds):
    """Return the smallest time of each contestant in seconds, and the last answers."""
    best, answers = dict.fromkeys(contestants, np.inf), {}
    for _ in range(rounds):
        for name, contestant in contestants.items():
            began = time.perf_counter()
            answers[name] = work(contestant)
            best[name] = min(best[name], time.perf_counter() - began)
    return best, answers


def build(vertices, faces, threads, log):
    contestants = {}
    for kind in (Ours, Trimesh, Open3D):
        try:
            for module in kind.modules:
                importlib.import_module(module)
            began = time.perf_counter()
            contestants[kind.name] = kind(vertices, faces, threads)
            log[kind.name] = time.perf_counter() - began
        except ImportError as error:
            print(f"{kind.name} is left out: {error}")
    return contestants


def main():
    """Parse the arguments, measure, and print tables."""
    parser = argparse.ArgumentParser(prog="python -m lightpath.bench", description=__doc__,
                                     formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("mesh", nargs="*", help="PLY files; a bumpy ball without any")
    parser.add_argument("--rays", type=int, default=1_000_000, help="rays or points of a query")
    parser.add_argument("--threads", type=int, default=os.cpu_count(), help="threads")
    parser.add_argument("--rounds", type=int, default=3, help="repetitions")
    parser.add_argument("--no-contains", action="store_true", help="leave `contains` out")
    parser.add_argument("--json", help="file for the figures")
    options = parser.parse_args()
    # embreex takes no number of threads.
    rng, rows = np.random.default_rng(1), []

    def report(mesh, query, best, more=""):
        for name, seconds in best.items():
            ratio = best["lightpath"] / seconds
            rows.append({"mesh": mesh, "query": query, "name": name, "seconds": seconds})
            print(f"{mesh:>18} {query:>14} {name:>18} {seconds:9.3f} s   ours/theirs {ratio:6.3f} {more}")

    meshes = [(os.path.basename(path), *RayScene.from_ply(path).meshes[0]) for path in options.mesh]
    for label, vertices, faces in meshes or [("ball", *ball())]:
        vertices, faces, log = vertices.astype(np.float64), faces.astype(np.int64), {}
        contestants = build(vertices, faces, options.threads, log)
        report(label, "build", log)
        scene = contestants["lightpath"].scene
        print(f"{label:>18} {len(faces)} faces, {scene.nbytes / len(faces):.1f} bytes a face")
        rays = Rays(*camera_rays(scene.bounds, options.rays))
        best, answers = measure(contestants, lambda c: c.closest(rays), options.rounds)
        report(label, "closest", best, f"{(answers['lightpath'] >= 0).mean():.2f} hit")
        rays = Rays(*random_rays(scene.bounds, options.rays, rng))
        best, answers = measure(contestants, lambda c: c.occluded(rays), options.rounds)
        report(label, "occluded", best, f"{answers['lightpath'].mean():.2f} hit")
        best, answers = measure(contestants, lambda c: c.all_hits(rays), options.rounds)
        report(label, "all hits", best, f"{answers['lightpath'].mean():.2f} a ray")
        if options.no_contains:
            continue
        low, high = scene.bounds
        points = rng.uniform(low, high, (options.rays, 3))
        best, answers = measure(contestants, lambda c: c.contains(points), 1)
        report(label, "contains", best, "closed" if scene.is_closed[0] else "open")
    print("\nwrong answers")
    wrong_answers(options, rng, rows)
    if options.json:
        with open(options.json, "w", encoding="utf-8") as file:
            json.dump(rows, file, indent=1)


def wrong_answers(options, rng, rows):
    """Count wrong answers: rays from inside that miss or do not cross once, and wrong insides."""

    def report(what, name, wrong, count):
        rows.append({"query": what, "name": name, "wrong": int(wrong), "of": int(count)})
        print(f"{what:>44} {name:>18} {wrong:9} of {count}")

    vertices, faces = ball()
    vertices = vertices.astype(np.float32).astype(np.float64)
    contestants = build(vertices, faces, options.threads, {})
    rays = aimed_rays(vertices, faces, options.rays, rng)
    for name, contestant in contestants.items():
        missed = (contestant.closest(rays) < 0).sum()
        report("aimed rays that miss the ball around them", name, missed, options.rays)
        report("aimed rays that do not cross it once", name, (contestant.all_hits(rays) != 1).sum(),
               options.rays)
    points, truth = points_of_a_box(options.rays, rng)
    for name, contestant in build(*box(), options.threads, {}).items():
        inside = contestant.contains(points)
        sure = truth < 2
        report("points beside a box", name, (inside != truth)[sure].sum(), sure.sum())
        if name == "lightpath":
            report("points on a box that are not inside", name, (~inside[~sure]).sum(), (~sure).sum())


if __name__ == "__main__":
    main()
