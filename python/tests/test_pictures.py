"""Pictures from Python."""

import copy
import json
import pickle
import subprocess
import sys

import numpy as np
import pytest

import lightpath
from shapes import TRIANGLE, bumpy_sphere, cube

SCENE = {
    "spp": 1,
    "camera": {"type": "pinhole", "width": 40, "height": 30, "fov": 40, "position": [0, 0, 6],
               "target": [0, 0, 0], "up": [0, 1, 0]},
    "scene": {"lightsources": [{"type": "pointlight", "position": [0, 5, 9], "id": [9, 9, 9]}],
              "materials": {"clay": {"diffusecolor": [0.8, 0.4, 0.3]}}, "shapes": []},
}


def test_a_mesh_in_the_studio_has_layers():
    picture = lightpath.render(cube(), camera={"width": 48, "height": 32}, spp=2, layers=["Z", "N", "primid"])
    assert picture["RGBA"].shape == (32, 48, 4) and picture["RGBA"].dtype == np.float32
    assert picture["RGBA"][16, 24, :3].min() > 0.01
    assert picture["Z"].shape == (32, 48) and picture["N"].shape == (32, 48, 3)
    assert np.isclose(np.linalg.norm(picture["N"][16, 24]), 1, atol=0.01)


def test_a_scene_as_a_dict_with_a_mesh_from_memory():
    picture = lightpath.render(SCENE, meshes={"box": ("clay", *cube())}, camera={"width": np.int64(20)})
    red, green, blue, _ = picture["RGBA"][15, 10]
    assert picture["RGBA"].shape == (30, 20, 4) and red > green > blue > 0
    scene = lightpath.RayScene(*cube())
    assert lightpath.render(scene, spp=1, camera={"width": 8, "height": 8})["RGBA"].shape == (8, 8, 4)


def test_a_scene_of_several_meshes_shows_all_of_them():
    vertices, faces = cube()
    moved = vertices * 0.5 + [2, 0, 0]
    options = {"camera": {"width": 24, "height": 16}, "spp": 1, "layers": "primid"}
    scene = lightpath.RayScene.from_meshes([(vertices, faces), (moved, faces)])
    several = lightpath.render(scene, **options)
    one = lightpath.render((np.concatenate([vertices, moved]), np.concatenate([faces, faces + 8])), **options)
    assert all((several[name] == one[name]).all() for name in one)
    # Each mesh has 12 faces, numbered from 1.
    assert {0, 1} <= set(((several["primid"].astype(int) - 1) // 12).ravel().tolist())


def test_all_problems_of_a_scene_are_listed():
    scene = {**SCENE, "camera": {**SCENE["camera"], "fov": 400, "widht": 3}}
    with pytest.raises(lightpath.Error) as caught:
        lightpath.render(scene)
    text, problems = str(caught.value), caught.value.problems
    assert len(problems) >= 2 and "fov" in text and "widht" in text
    with pytest.raises(lightpath.Error, match="clay2"):
        lightpath.render(SCENE, meshes={"box": ("clay2", *cube())})
    with pytest.raises(lightpath.Error, match="nothing.json"):
        lightpath.render("nothing.json")
    with pytest.raises(TypeError, match="scene: found int"):
        lightpath.render(3)
    with pytest.raises(ValueError, match="meshes: expected only"):
        lightpath.render(cube(), meshes={})
    with pytest.raises(ValueError, match=r"^faces\[0, 1\]: found vertex 9, expected 0 to 7"):
        lightpath.render((cube()[0], cube()[1] + 7))
    with pytest.raises(ValueError, match=r"^box: faces\[0, 0\]: found vertex -1, expected 0 to 7"):
        lightpath.render(SCENE, meshes={"box": ("clay", cube()[0], cube()[1] - 1)})


def test_a_face_that_repeats_a_vertex_is_left_out():
    vertices, faces = cube()
    more = np.concatenate([[[0, 0, 1]], faces])
    options = {"camera": {"width": 16, "height": 16}, "spp": 1}
    pictures = [lightpath.render(mesh, **options)["RGBA"] for mesh in ((vertices, faces), (vertices, more))]
    assert (pictures[0] == pictures[1]).all()
    assert lightpath.RayScene(vertices, more)._repr_png_()[:4] == b"\x89PNG"
    with pytest.raises(lightpath.Error, match="found no face of three different vertices"):
        lightpath.render((vertices, more[:1]))


def test_progress_has_a_total():
    steps = []
    mesh = bumpy_sphere(6)
    options = {"camera": {"width": 32, "height": 32}, "spp": 1}
    lightpath.render(mesh, progress=lambda done, total: steps.append((done, total)), **options)
    assert steps[-1] == (1024, 1024) and all(total > 0 for _, total in steps)


SMALL = {"camera": {"width": 16, "height": 16}, "spp": 1}


def test_a_pickle_holds_the_arrays(tmp_path):
    away = {"position": [0, 5, 50], "target": [0, 5, 90], "width": 8, "height": 8}
    picture = lightpath.render(cube(), camera=away, spp=1, layers=["Z", "primid"])
    assert picture.warnings
    loaded = pickle.loads(pickle.dumps(picture))
    copies = [copy.copy(picture), copy.deepcopy(picture)]
    for other in [loaded, *copies]:
        assert type(other) is lightpath.Picture and other.warnings == picture.warnings
        assert list(other) == list(picture) and all((other[k] == picture[k]).all() for k in picture)
    for write in (loaded.write, loaded.write_exr, loaded.write_png):
        with pytest.raises(ValueError, match="the picture of a pickle, which has only arrays"):
            write(tmp_path / ("a.png" if write == loaded.write_png else "a.exr"))
    assert loaded._repr_png_() is None
    for index, other in enumerate(copies):
        other.write_exr(tmp_path / f"{index}.exr")
    assert (tmp_path / "0.exr").read_bytes() == (tmp_path / "1.exr").read_bytes()


def test_deep_copies_share_nothing_that_can_change():
    picture = lightpath.render(cube(), **SMALL)
    picture["own"] = np.zeros(3)
    for source in [picture, pickle.loads(pickle.dumps(picture))]:
        deep = copy.deepcopy(source)
        deep["own"][0], deep.warnings[:] = 5, ["new"]
        assert source["own"][0] == 0 and source.warnings == []
        for one in [source, deep]:
            with pytest.raises(ValueError, match="read-only"):
                one["RGBA"][:] = -1


def test_a_file_that_holds_not_every_value_gives_warnings(tmp_path):
    scene = copy.deepcopy(SCENE)
    scene["scene"]["lightsources"][0]["id"] = [1e6] * 3
    picture = lightpath.render(scene, meshes={"box": ("clay", *cube())})
    picture.write_png(tmp_path / "a.png")
    picture.write_exr(tmp_path / "float.exr", float=True)
    picture.write(tmp_path / "both", float=True)
    assert picture.warnings == [] and picture["RGBA"].max() > 65504
    assert (tmp_path / "float.exr").read_bytes() == (tmp_path / "both.exr").read_bytes()
    for _ in range(2):
        picture.write_exr(tmp_path / "half.exr")
        (warning,) = picture.warnings
        assert "brighter than a half can hold" in warning and "--" not in warning
    assert (tmp_path / "float.exr").read_bytes() != (tmp_path / "half.exr").read_bytes()


def test_a_legend_without_room_is_a_warning_of_the_png(tmp_path):
    head = TRIANGLE.replace("property float z", "property float z\nproperty float age")
    rows = head[head.index("end_header"):]
    for row in ["0 0 0", "1 0 0", "0 1 0"]:
        rows = rows.replace(f"\n{row}\n", f"\n{row} {row[0]}\n")
    (tmp_path / "a.ply").write_text(head[:head.index("end_header")] + rows)
    scene = copy.deepcopy(SCENE)
    scene["output"] = {"legend": True}
    scene["scene"]["shapes"] = [{"type": "trimesh", "path": tmp_path / "a.ply", "material": "clay",
                                 "color": {"property": "age"}}]
    picture = lightpath.render(scene)
    before = list(picture.warnings)
    picture.write_exr(tmp_path / "a.exr")
    assert picture.warnings == before
    for _ in range(2):
        picture.write_png(tmp_path / "a.png")
        (warning,) = picture.warnings[len(before):]
        assert "too small for the legend" in warning
    picture = lightpath.render(scene)
    picture.write(tmp_path / "a")
    assert picture.warnings == [*before, warning]


def test_copies_and_meshes_from_memory_have_mattes_of_their_own(tmp_path):
    (tmp_path / "a.ply").write_text(TRIANGLE)
    scene = copy.deepcopy(SCENE)
    scene["output"] = {"layers": ["cryptomatte"]}
    places = np.tile(np.eye(4), (2, 1, 1))
    places[:, 0, 3] = -1.5, 0
    scene["scene"]["shapes"] = [{"type": "trimesh", "name": "box", "path": tmp_path / "a.ply",
                                 "instances": places, "material": "clay"}]
    for name in ["box", "box.2", "other"]:
        mesh = np.array([[1.5, 0, 0], [2.5, 0, 0], [1.5, 1, 0]]), [[0, 1, 2]]
        picture = lightpath.render(scene, meshes={name: ("clay", *mesh)})
        ids = picture["CryptoObject00"][..., [0, 2]]
        assert len(np.unique(ids[ids != 0])) == 3, name


def test_one_layer_may_be_a_string():
    assert list(lightpath.render(cube(), **SMALL, layers="albedo")) == ["RGBA", "albedo"]


def test_arrays_are_read_only():
    picture = lightpath.render(cube(), **SMALL, layers=["Z", "N", "primid"])
    for array in picture.values():
        with pytest.raises(ValueError, match="read-only"):
            array[0, 0] = 0


class Visual:
    def __init__(self, kind, colors=None):
        self.kind, self.vertex_colors = kind, colors


class Trimesh:
    """What a render uses of a `trimesh.Trimesh`."""

    def __init__(self, visual):
        (self.vertices, self.faces), self.visual = cube(), visual


class Open3d:
    """What a render uses of a legacy mesh of Open3D."""

    def __init__(self, colors, uvs=()):
        (self.vertices, self.triangles), self.vertex_colors, self.triangle_uvs = cube(), colors, uvs


class Tensors(dict):
    """A map of named tensors of Open3D."""

    def __getattr__(self, name):
        return Tensor(self[name])


class Tensor:
    def __init__(self, array):
        self.array = array

    def numpy(self):
        return self.array


class Open3dTensors:
    """What a render uses of a tensor-based mesh of Open3D."""

    def __init__(self, colors):
        self.vertex = Tensors(positions=cube()[0], colors=colors)
        self.triangle = Tensors(indices=cube()[1])


def test_colours_of_vertices_are_shown(tmp_path):
    rgba = np.tile(np.array([[255, 128, 0, 255]], dtype=np.uint8), (8, 1))
    vertices, faces = cube()
    rows = [" ".join(map(str, [*v, 255, 128, 0])) for v in vertices.astype(int)]
    rows += [" ".join(map(str, [3, *f])) for f in faces]
    head = TRIANGLE.replace("vertex 3", "vertex 8").replace("face 1", "face 12")
    head = head.replace("element face", "property uchar red\nproperty uchar green\nproperty uchar blue\nelement face")
    (tmp_path / "a.ply").write_text(head[:head.index("0 0 0")] + "\n".join(rows) + "\n")
    expected = lightpath.render(tmp_path / "a.ply", **SMALL, layers=["albedo"])["albedo"]
    assert (expected[8, 8] > [0.5, 0.1, -1]).all() and expected[8, 8, 2] < 0.01
    floats = rgba[:, :3] / 255.0
    for mesh in [Trimesh(Visual("vertex", rgba)), Open3d(floats), Open3dTensors(rgba[:, :3])]:
        picture = lightpath.render(mesh, **SMALL, layers=["albedo"])
        assert np.allclose(picture["albedo"], expected, atol=1e-3) and picture.warnings == []
    whole = lightpath.render(Trimesh(Visual("vertex", rgba.astype(np.int64))), **SMALL, layers=["albedo"])
    assert np.allclose(whole["albedo"], expected, atol=1e-3)
    words = rgba.astype(np.uint16) * 257
    for order in "<>":
        picture = lightpath.render(Trimesh(Visual("vertex", words.astype(order + "u2"))), **SMALL, layers=["albedo"])
        assert np.allclose(picture["albedo"], expected, atol=1e-3)
    with pytest.raises(ValueError, match="^colors: found masked values"):
        lightpath.render(Trimesh(Visual("vertex", np.ma.array(rgba, mask=rgba == 0))), **SMALL)
    with pytest.raises(ValueError, match="colors: found 0 to 256, expected 0 to 255"):
        lightpath.render(Trimesh(Visual("vertex", rgba * np.int64(256) // 255)), **SMALL)
    bare = lightpath.render(Open3d(None, None), **SMALL)
    assert bare.warnings == [] and (bare["RGBA"] == lightpath.render(cube(), **SMALL)["RGBA"]).all()
    half = rgba // [1, 1, 1, 2]
    picture = lightpath.render(Trimesh(Visual("vertex", half.astype(np.uint8))), **SMALL, layers=["albedo"])
    assert picture["albedo"].shape == expected.shape
    with pytest.raises(ValueError, match=r"colors: found \(7, 4\) of uint8, expected \(8, 3\)"):
        lightpath.render(Trimesh(Visual("vertex", rgba[1:])), **SMALL)


def test_warnings_tell_what_is_not_shown():
    for mesh, text in [
        (Trimesh(Visual("face")), "the colours of faces are not shown"),
        (Trimesh(Visual("texture")), "texture and material are not shown"),
        (Open3d([], np.zeros((36, 2))), "colours of triangles and textures are not shown"),
    ]:
        assert [w for w in lightpath.render(mesh, **SMALL).warnings if text in w]


def test_the_hash_of_a_scene_from_files(tmp_path):
    (tmp_path / "a.ply").write_text(TRIANGLE)
    shape = {"type": "trimesh", "path": str(tmp_path / "a.ply"), "material": "clay"}
    scene = {**SCENE, "scene": {**SCENE["scene"], "shapes": [shape]}}
    (tmp_path / "s.json").write_text(json.dumps(scene))

    def found(subject, **options):
        picture = lightpath.render(subject, **options)
        picture.write_exr(tmp_path / "x.exr")
        header = (tmp_path / "x.exr").read_bytes()[:8192]
        at = header.find(b"lightpath:sceneHash\0string\0")
        return header[at + 31:at + 95] if at >= 0 else None

    hashes = [found(tmp_path / "s.json"), found(scene), found(tmp_path / "a.ply", **SMALL)]
    assert hashes[0] == hashes[1] and len(hashes[0]) == 64 and int(hashes[0], 16)
    assert hashes[2] not in (None, hashes[0]) and found(scene, spp=2) != hashes[0]
    arguments = ["render", str(tmp_path / "s.json"), "-o", str(tmp_path / "cli"), "--quiet"]
    subprocess.run([sys.executable, "-m", "lightpath", *arguments], check=True)
    assert hashes[0] in (tmp_path / "cli.exr").read_bytes()
    assert found(cube(), **SMALL) is None
    assert found(scene, meshes={"box": ("clay", *cube())}) is None
    changed = lightpath.render(tmp_path / "s.json")
    (tmp_path / "a.ply").write_text(TRIANGLE.replace("1 0 0", "3 0 0"))
    changed.write_exr(tmp_path / "x.exr")
    assert b"lightpath:sceneHash" not in (tmp_path / "x.exr").read_bytes()


def test_files(tmp_path):
    picture = lightpath.render(cube(), camera={"width": 16, "height": 16}, spp=1)
    picture.write_exr(tmp_path / "a.exr")
    picture.write_png(str(tmp_path / "b.png"))
    assert sorted(path.name for path in tmp_path.iterdir()) == ["a.exr", "b.png"]
    assert (tmp_path / "a.exr").read_bytes()[:4] == b"\x76\x2f\x31\x01"
    assert picture._repr_png_()[:4] == (tmp_path / "b.png").read_bytes()[:4] == b"\x89PNG"
    with pytest.raises((lightpath.Error, OSError)):
        picture.write(tmp_path / "no" / "folder")


def test_names_of_files(tmp_path):
    picture = lightpath.render(cube(), camera={"width": 16, "height": 16}, spp=1)
    assert picture.write(tmp_path / "a.exr") == [tmp_path / "a.exr", tmp_path / "a.png"]
    for folder in [tmp_path, f"{tmp_path}/new/", ""]:
        with pytest.raises(ValueError, match="prefix: found the folder"):
            picture.write(folder)
    for write, name in [(picture.write_exr, "x.png"), (picture.write_png, "x")]:
        with pytest.raises(ValueError, match="expected a name with the ending"):
            write(tmp_path / name)
    with pytest.raises(FileNotFoundError, match="no/x.exr': there is no folder .*/no$"):
        picture.write_exr(tmp_path / "no" / "x.exr")
    assert sorted(path.name for path in tmp_path.iterdir()) == ["a.exr", "a.png"]


def test_warnings_name_a_mesh_from_memory():
    away = {"position": [0, 5, 50], "target": [0, 5, 90], "width": 8, "height": 8}
    warnings = lightpath.render(cube(), camera=away, spp=1).warnings
    assert [text for text in warnings if "mesh lies outside the camera's view" in text]
    camera = {**SCENE["camera"], "target": [0, 0, 9]}
    meshes = {name: ("clay", *cube()) for name in ("box", "crate")}
    warnings += lightpath.render({**SCENE, "camera": camera}, meshes=meshes).warnings
    assert [text for text in warnings if "crate lies outside" in text]
    assert not any("--" in text or "\\u{0}" in text or "\0" in text for text in warnings)


def test_views_around_a_mesh_show_it():
    cameras = ({"position": [x, 3, 6], "target": [0, 1, 0], "width": 8, "height": 8} for x in (-4, 4))
    for view in lightpath.render_views(cube(), cameras, spp=1):
        # The ground alone has a spread of 0.07.
        assert np.ptp(view["RGBA"][:, :, 0]) > 0.1 and view.warnings == []


def test_a_scene_file_may_have_an_ending_in_upper_case(tmp_path):
    path = tmp_path / "S.JSON"
    path.write_text(json.dumps(SCENE))
    assert lightpath.render(path)["RGBA"].shape == (30, 40, 4)


def test_a_scene_shows_itself():
    assert lightpath.RayScene(*cube())._repr_png_()[:4] == b"\x89PNG"


def test_views_are_made_one_by_one():
    views = lightpath.render_views(cube(), ({"width": w, "height": 4} for w in (4, 8)), spp=1)
    assert next(views)["RGBA"].shape == (4, 4, 4)
    assert next(views)["RGBA"].shape == (4, 8, 4)


CAMERAS = [
    {"width": 24, "height": 16},
    {"width": 24, "height": 16, "position": [3, 2, 4], "target": [0, 0.5, 0]},
    {"width": 12, "height": 20, "position": [3, 2, 4], "target": [0, 0.5, 0]},
    {"width": 16, "height": 16, "fov": 70},
    {"width": 16, "height": 16, "position": [0, 2, 5], "up": [0, -1, 0]},
    {"width": 16, "height": 16, "position": [0, 50, 5], "target": [1, 90, 5]},
    {"width": 16, "height": 16, "position": [-3, 2, 4], "target": [0, 0.5, 0]},
]


def test_views_have_the_bytes_of_render(tmp_path):
    (tmp_path / "a.ply").write_text(TRIANGLE)
    shape = {"type": "trimesh", "path": str(tmp_path / "a.ply"), "material": "clay"}
    scene = {**SCENE, "scene": {**SCENE["scene"], "shapes": [shape]}}
    (tmp_path / "s.json").write_text(json.dumps(scene))
    for subject, options in [
        (tmp_path / "s.json", {}),
        (tmp_path / "a.ply", {}),
        (SCENE, {"meshes": {"box": ("clay", *cube())}}),
        (cube(), {"settings": {"/output/transparent": True}}),
        (lightpath.RayScene(*cube()), {"backend": "brute"}),
    ]:
        options = {"spp": 2, "layers": ["Z", "N"], **options}
        for camera, view in zip(CAMERAS, lightpath.render_views(subject, iter(CAMERAS), **options)):
            alone = lightpath.render(subject, camera=camera, **options)
            assert view.warnings == alone.warnings
            both = [view.write(tmp_path / "view"), alone.write(tmp_path / "alone")]
            for one, other in zip(*both):
                assert one.read_bytes() == other.read_bytes(), (subject, camera)


def test_views_end_with_an_exception_or_when_closed():
    steps = []

    def progress(done, total):
        steps.append(done)
        if len(steps) == stop:
            raise KeyboardInterrupt

    stop = 0
    views = lightpath.render_views(cube(), iter(CAMERAS), spp=1, progress=progress)
    next(views)
    stop = len(steps) + 1
    with pytest.raises(KeyboardInterrupt):
        next(views)
    assert list(views) == []
    views = lightpath.render_views(cube(), iter(CAMERAS), spp=1)
    next(views)
    views.close()
    assert list(views) == []
    views = lightpath.render_views(cube(), [*CAMERAS[:1], {"fov": 400}], spp=1)
    next(views)
    with pytest.raises(lightpath.Error, match="fov"):
        next(views)
