//! Scenes far from the world's origin. Moved by a shift that f64 holds exactly, they give the same
//! bytes; by any other shift, nearly the same. The program reports the detail that single precision
//! around the scene's own origin keeps.

use std::collections::BTreeSet;
use std::fmt::Write as _;
use std::path::Path;

use crate::support::backends::{self, on_both};
use crate::support::program::{self, Scratch};
use glam::DVec3;
use lightpath::film::{ReservedFilm, Window};
use lightpath::monitor::Monitor;
use lightpath::scene::{self, Backend, Source};
use lightpath::simd::Isa;
use lightpath::world::{LoadOptions, World};
use serde_json::{Value, json};

/// A place in map coordinates: metres east, north, up.
const MAP: DVec3 = DVec3::new(4_500_000.0, 500_000.0, 120.0);

/// Writes a PLY with doubles.
fn ply(points: &[DVec3], triangles: &[[u32; 3]]) -> String {
    let mut text = format!(
        "ply\nformat ascii 1.0\nelement vertex {}\nproperty double x\nproperty double y\n\
         property double z\nelement face {}\nproperty list uchar int vertex_indices\nend_header\n",
        points.len(),
        triangles.len()
    );
    for p in points {
        writeln!(text, "{:?} {:?} {:?}", p.x, p.y, p.z).unwrap();
    }
    for [a, b, c] in triangles {
        writeln!(text, "3 {a} {b} {c}").unwrap();
    }
    text
}

/// An uneven grid of `n` by `n` cells over [-1, 1]^2 with z from `height`. Corners are rounded to
/// multiples of `step` unless it is 0.
fn relief(n: u32, step: f64, height: impl Fn(f64, f64) -> f64) -> (Vec<DVec3>, Vec<[u32; 3]>) {
    let at = |i: u32| 2.0 * f64::from(i) / f64::from(n) - 1.0;
    let uneven = |x: f64, y: f64| x + 0.05 / f64::from(n) * (57.0 * x + 31.0 * y).sin();
    let snap = |p: DVec3| if step > 0.0 { (p / step).round() * step } else { p };
    let grid = (0..=n).flat_map(|j| (0..=n).map(move |i| (at(i), at(j))));
    let points =
        grid.map(|(x, y)| snap(DVec3::new(uneven(x, y), uneven(y, x), height(x, y)))).collect();
    let cells = (0..n).flat_map(|j| (0..n).map(move |i| j * (n + 1) + i));
    let triangles = cells.flat_map(|k| [[k, k + 1, k + n + 2], [k, k + n + 2, k + n + 1]]);
    (points, triangles.collect())
}

fn hills(x: f64, y: f64) -> f64 {
    0.3 * (3.1 * x).sin() * (2.7 * y).cos() + 0.05 * (11.0 * x + 7.0 * y).sin()
}

/// Everything that has a position (lens, lights of all kinds, every shape), moved by `shift`.
fn moved(folder: &Path, shift: DVec3, step: f64) -> Value {
    let (points, triangles) = relief(24, step, hills);
    let points: Vec<DVec3> = points.into_iter().map(|p| p + shift).collect();
    std::fs::write(folder.join("relief.ply"), ply(&points, &triangles)).unwrap();
    let at = |x: f64, y: f64, z: f64| (DVec3::new(x, y, z) + shift).to_array();
    json!({
        "nbounces": 2, "spp": 4, "seed": 3,
        "camera": { "type": "thinlens", "width": 96, "height": 64, "fov": 45, "aperture": 0.0625,
            "focaldistance": 3.5, "position": at(0.25, -3.0, 1.75), "target": at(0.0, 0.0, 0.125),
            "up": [0, 0, 1] },
        "scene": {
            "backgroundcolor": [0.1, 0.2, 0.3], "ambient": [0.1, 0.1, 0.1],
            "lightsources": [
                { "type": "pointlight", "position": at(2.0, -1.0, 3.0), "id": [2, 1, 1] },
                { "type": "arealight", "v0": at(-2.0, -1.0, 2.5), "v1": at(-1.0, -1.0, 2.5),
                  "v2": at(-2.0, 0.0, 2.75), "id": [1, 2, 1], "samples": 5 },
                { "type": "arealight", "v0": at(0.0, 1.0, 2.5), "v1": at(0.0, 1.5, 2.5),
                  "v2": at(0.5, 1.0, 2.5), "id": [1, 1, 2], "samples": 3,
                  "emission": "lambertian" }],
            "shapes": [
                { "type": "trimesh", "path": "relief.ply", "smooth": true,
                  "material": { "ks": 0.3, "specularexponent": 20, "ka": 1 } },
                { "type": "sphere", "center": at(0.5, -0.5, 0.75), "radius": 0.25,
                  "material": { "kr": 0.6, "ks": 1, "specularexponent": 50 } },
                { "type": "triangle", "v0": at(-0.75, -0.75, 0.5), "v1": at(-0.25, -0.75, 0.5),
                  "v2": at(-0.5, -0.5, 1.0), "material": { "diffusecolor": [1, 0.5, 0.2] } },
                { "type": "plane", "v0": at(-2.0, -2.0, -0.5), "v1": at(2.0, -2.0, -0.5),
                  "v2": at(2.0, 2.0, -0.5), "v3": at(-2.0, 2.0, -0.5),
                  "material": { "kr": 0.25, "ka": 1 } }],
        }
    })
}

fn load(scene: &Value, folder: &Path, resolutions: bool) -> (World, Vec<String>) {
    let text = scene.to_string();
    let source = Source::Text { name: "test", text: text.as_bytes(), folder };
    let scene = scene::load(source, &[]).unwrap().scene;
    let options = LoadOptions { resolutions, ..LoadOptions::default() };
    let (world, warnings) = World::load(&scene, options, &Monitor::default()).unwrap();
    (world, warnings.iter().map(|w| w.to_string()).collect())
}

/// Returns the bits of all pixels.
fn render(world: &World, backend: Backend) -> Vec<[u32; 4]> {
    let (monitor, isa) = (Monitor::default(), Isa::detect());
    let accelerator = backends::build(&world.geometry, backend);
    let [width, height] = world.frame;
    let mut film =
        ReservedFilm::new(world.frame, Window::full(width, height), Vec::new()).unwrap().film();
    lightpath::render::render(world, accelerator.as_ref(), isa, &mut film, &monitor).unwrap();
    film.pixels.iter().map(|p| p.map(f32::to_bits)).collect()
}

/// Returns the pictures at the origin and moved by `shift`.
fn pictures(backend: Backend, shift: DVec3, step: f64) -> [Vec<[u32; 4]>; 2] {
    let folder = tempfile::tempdir().unwrap();
    let worlds = [DVec3::ZERO, shift]
        .map(|shift| load(&moved(folder.path(), shift, step), folder.path(), false).0);
    worlds.each_ref().map(|world| render(world, backend))
}

/// Returns the number of different values: a picture with content has many.
fn variety(picture: &[[u32; 4]]) -> usize {
    picture.iter().collect::<BTreeSet<_>>().len()
}

on_both! {
fn an_exact_shift_gives_the_same_bytes(backend: Backend) {
    // Steps of 2^-20 are exact around 4.5e6, where f64 has steps of 2^-30.
    for shift in [MAP, -MAP, DVec3::new(0.0, 1e9, -3.25)] {
        let [here, there] = pictures(backend, shift, 1.0 / f64::from(1 << 20));
        assert!(variety(&here) > 2000, "only {} values", variety(&here));
        let differ = here.iter().zip(&there).filter(|(a, b)| a != b).count();
        assert_eq!(differ, 0, "of {} pixels, moved by {shift}", here.len());
    }
}

fn any_other_shift_gives_nearly_the_same(backend: Backend) {
    let shift = MAP + DVec3::new(0.1, 1.0 / 3.0, -0.7);
    let [here, there] = pictures(backend, shift, 0.0);
    assert!(here != there, "the shift is not exact");
    for (i, (a, b)) in here.iter().zip(&there).enumerate() {
        for (a, b) in a.iter().zip(b) {
            let (a, b) = (f32::from_bits(*a), f32::from_bits(*b));
            assert!((a - b).abs() <= 1e-5 * a.abs().max(1.0), "pixel {i}: {a} and {b}");
        }
    }
}
}

#[test]
fn two_meshes_far_apart_are_each_as_exact_as_single_precision_allows() {
    let folder = tempfile::tempdir().unwrap();
    let (points, triangles) = relief(20, 0.0, hills);
    let places = [MAP - DVec3::X * 5e5, MAP + DVec3::X * 5e5];
    let meshes = places.map(|place| points.iter().map(|&p| p * 50.0 + place).collect::<Vec<_>>());
    for (name, mesh) in ["a.ply", "b.ply"].iter().zip(&meshes) {
        std::fs::write(folder.path().join(name), ply(mesh, &triangles)).unwrap();
    }
    let scene = json!({
        "camera": { "type": "pinhole", "width": 8, "height": 8, "fov": 45,
            "position": (MAP + DVec3::Z * 1e6).to_array(), "lookat": [0, 0, -1],
            "up": [0, 1, 0] },
        "scene": { "shapes": [
            { "type": "trimesh", "path": "a.ply", "material": {} },
            { "type": "trimesh", "path": "b.ply", "material": {} }] }
    });
    let (world, warnings) = load(&scene, folder.path(), true);
    let origin = world.geometry.origin;
    for (mesh, exact) in world.geometry.meshes.iter().zip(&meshes) {
        for (vertex, exact) in mesh.vertices().iter().zip(exact) {
            let exact = *exact - origin;
            for axis in 0..3 {
                // Half an ulp of single precision: correctly rounded.
                let error = (f64::from(vertex[axis]) - exact[axis]).abs();
                let half = exact[axis].abs() * f64::from(f32::EPSILON) / 2.0;
                assert!(error <= half, "{error:e} at {}", exact[axis]);
            }
        }
    }
    assert_eq!(world.resolutions.len(), 2);
    for one in &world.resolutions {
        // 2^18 <= 500050 < 2^19: ulp 2^-5; the cells are nearly 5 units wide.
        assert_eq!((one.detail.ulp, one.detail.collapsed_edges), (0.03125, 0));
        assert!((4.7..=5.0).contains(&one.detail.shortest_edge), "{}", one.detail.shortest_edge);
    }
    assert!(!warnings.iter().any(|w| w.contains("collapse")), "{warnings:?}");
}

/// A scene of two fine meshes, cells of a centimetre, `apart` from each other. Returns a function
/// that counts the edges that f32 around an origin loses.
fn two_fine_meshes(scratch: &Scratch, apart: f64) -> impl Fn(DVec3) -> usize {
    // Rounded to the grid, so rows and columns are straight.
    let (points, triangles) = relief(10, 0.2, |_, _| 0.0);
    let places = [DVec3::ZERO, DVec3::X * apart];
    let meshes = places.map(|place| points.iter().map(|&p| p * 0.05 + place).collect::<Vec<_>>());
    for (name, mesh) in ["a.ply", "b.ply"].iter().zip(&meshes) {
        scratch.write(name, &ply(mesh, &triangles));
    }
    let scene = json!({
        "camera": { "type": "pinhole", "width": 8, "height": 8, "fov": 45,
            "position": [apart / 2.0, 0, 1.0 + apart], "lookat": [0, 0, -1], "up": [0, 1, 0] },
        "scene": { "shapes": [
            { "type": "trimesh", "path": "a.ply", "material": {} },
            { "type": "trimesh", "path": "b.ply", "material": {} }] }
    });
    scratch.write("s.json", &scene.to_string());
    let sides = triangles.iter().flat_map(|&[a, b, c]| [[a, b], [b, c], [c, a]]);
    let edges: BTreeSet<[u32; 2]> = sides.map(|[a, b]| [a.min(b), a.max(b)]).collect();
    move |origin| {
        let lost = |mesh: &Vec<DVec3>| {
            let seen = |i: u32| (mesh[i as usize] - origin).as_vec3();
            edges.iter().filter(|[a, b]| seen(*a) == seen(*b)).count()
        };
        meshes.iter().map(lost).sum()
    }
}

/// Returns the origin in the report of `info`.
fn origin_of(info: &Value) -> DVec3 {
    serde_json::from_value::<[f64; 3]>(info["resolution"]["origin"].clone()).unwrap().into()
}

#[test]
fn info_reports_the_resolution_and_render_warns_of_lost_edges() {
    let scratch = Scratch::new();
    let lost_around = two_fine_meshes(&scratch, 1e6);
    let info = scratch.run(&["info", "--json", "s.json"]);
    assert_eq!(info.code(), 0, "{}", info.stderr());
    let value: Value = serde_json::from_str(&info.stdout()).unwrap();
    let lost = lost_around(origin_of(&value));
    assert!(lost > 100, "{lost} edges");
    let resolution = &value["resolution"];
    assert_eq!(resolution["collapsed_edges"], json!(lost));
    assert_eq!(resolution["ulp"], json!(0.03125));
    let edge = resolution["shortest_edge"].as_f64().unwrap();
    assert!((edge - 0.01).abs() < 1e-6, "{edge}");
    assert_eq!(resolution["meshes"].as_array().unwrap().len(), 2);
    let text = scratch.run(&["info", "s.json"]);
    let line = text.stdout();
    let line = line.lines().find(|l| l.contains("resolution of the scene")).unwrap().to_string();
    assert!(line.contains("3.12e-2") && line.contains(&format!("{lost} edges collapse")), "{line}");
    // The two count in different ways: `info` before rounding, `render` after it.
    let [info, render] =
        [&["info", "s.json"][..], &["render", "s.json", "-o", "out"]].map(|args| {
            let done = scratch.run(args);
            assert_eq!(done.code(), 0);
            let warned = done.stderr();
            let warnings = warned.lines().filter(|line| line.contains("collapse"));
            warnings.map(str::to_string).collect::<Vec<_>>()
        });
    assert_eq!(info.len(), 2, "{info:?}");
    assert_eq!(info, render);
}

#[test]
fn there_is_no_warning_without_lost_edges() {
    let scratch = Scratch::new();
    let lost_around = two_fine_meshes(&scratch, 1.0);
    let info = scratch.run(&["info", "--json", "s.json"]);
    let value: Value = serde_json::from_str(&info.stdout()).unwrap();
    assert_eq!(lost_around(origin_of(&value)), 0);
    assert_eq!(value["resolution"]["collapsed_edges"], json!(0));
    let done = scratch.run(&["render", "s.json", "-o", "out"]);
    assert_eq!(done.code(), 0);
    assert!(!done.stderr().contains("collapse"), "{}", done.stderr());
}

/// A file of floats, scaled so small and moved so far away that its corners coincide.
#[test]
fn render_warns_of_lost_edges_in_files_of_floats() {
    let scratch = Scratch::new();
    scratch.write("p.ply", program::PYRAMID);
    let scene = |size: f64| {
        json!({
            "camera": { "type": "pinhole", "width": 8, "height": 8, "fov": 45,
                "position": [0, 0, 9000], "lookat": [0, 0, -1], "up": [0, 1, 0] },
            "scene": { "shapes": [
                { "type": "trimesh", "path": "p.ply", "size": size, "center": [4000, 0, 0],
                  "material": {} },
                { "type": "plane", "v0": [-4096, -1, 4096], "v1": [4096, -1, 4096],
                  "v2": [4096, -1, -4096], "v3": [-4096, -1, -4096], "material": {} }] }
        })
    };
    // Around x = 4000 f32 has steps of 2^-12 = 2.4e-4, so the two sides along x have no length
    // left. The ends of the other edges differ in y or z, where f32 is finer.
    for (size, lost) in [(1.0, 0), (3e-5, 2)] {
        scratch.write("s.json", &scene(size).to_string());
        let info = scratch.run(&["info", "--json", "s.json"]);
        let value: Value = serde_json::from_str(&info.stdout()).unwrap();
        let collapsed = value["resolution"]["collapsed_edges"].as_u64().unwrap();
        assert_eq!(collapsed, lost, "{value}");
        let done = scratch.run(&["render", "s.json", "-o", "out"]);
        assert_eq!(done.code(), 0);
        assert_eq!(done.stderr().contains("collapse"), lost > 0, "{}", done.stderr());
    }
}

/// The same for instances, of which the farther one counts.
#[test]
fn render_warns_of_lost_edges_in_instances() {
    let scratch = Scratch::new();
    scratch.write("p.ply", program::PYRAMID);
    let at = |scale: f64, x: f64| {
        json!([[scale, 0, 0, x], [0, scale, 0, 0], [0, 0, scale, 0], [0, 0, 0, 1]])
    };
    let scene = |size: f64, scale: f64| {
        json!({
            "camera": { "type": "pinhole", "width": 8, "height": 8, "fov": 45,
                "position": [0, 0, 9000], "lookat": [0, 0, -1], "up": [0, 1, 0] },
            "scene": { "shapes": [
                { "type": "trimesh", "path": "p.ply", "size": size, "material": {},
                  "instances": [at(scale, 0.0), at(scale, 4000.0), at(scale, 1.0)] },
                { "type": "plane", "v0": [-4096, -1, 4096], "v1": [4096, -1, 4096],
                  "v2": [4096, -1, -4096], "v3": [-4096, -1, -4096], "material": {} }] }
        })
    };
    for (size, scale, lost) in [(1.0, 1.0, false), (3e-5, 1.0, true), (1.0, 3e-5, true)] {
        scratch.write("s.json", &scene(size, scale).to_string());
        for backend in ["bvh", "brute"] {
            let done = scratch.run(&["render", "s.json", "-o", "out", "--backend", backend]);
            let said = done.good().stderr();
            let expected = "collapsed edges of an instance of p.ply: 2.";
            assert_eq!(said.contains(expected), lost, "{size} {scale}: {said}");
            assert_eq!(said.contains("collapse"), lost, "{size} {scale}: {said}");
        }
    }
}

#[test]
fn info_reports_the_resolution_of_a_mesh_file_around_its_middle() {
    let scratch = Scratch::new();
    let (points, triangles) = relief(8, 0.0, hills);
    let points: Vec<DVec3> = points.into_iter().map(|p| p * 4.0 + MAP).collect();
    scratch.write("far.ply", &ply(&points, &triangles));
    let info = scratch.run(&["info", "--json", "far.ply"]);
    let value: Value = serde_json::from_str(&info.stdout()).unwrap();
    // The mesh is eight units across. The farthest coordinate is about 4, where neighbours are
    // 2^-22 to 2^-21 apart.
    let ulp = value["resolution"]["ulp"].as_f64().unwrap();
    assert!(ulp == 1.0 / f64::from(1 << 22) || ulp == 1.0 / f64::from(1 << 21), "{ulp:e}");
    assert_eq!(value["resolution"]["collapsed_edges"], json!(0));
    assert!(scratch.run(&["info", "far.ply"]).stdout().contains("resolution around its middle"));
}
