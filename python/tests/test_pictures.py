"""Pictures from Python."""

import json

import numpy as np
import pytest

import lightpath
from shapes import bumpy_sphere, cube

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
    with pytest.raises(FileNotFoundError, match="no/x.exr': there is no folder"):
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


