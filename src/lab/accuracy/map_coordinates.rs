//! Cases with meshes in map coordinates: large values in double precision. Such a mesh must give
//! the same picture as the same mesh at the origin.

use crate::geometry::doubles;
use std::fmt::Write;
use std::path::Path;

use glam::{DVec2, DVec3};
use serde_json::json;

use super::case::{Amount, Case, CaseRun, PassCriterion};
use super::counts::{CaseCounts, WrongKind, ulp};
use super::judge::{AimedPacket, Expect};
use super::meshes::{TestMesh, any_triangle, icosphere, point_on, scan};
use crate::error::{Error, Result};
use crate::film::{Film, Window};
use crate::monitor::Monitor;
use crate::ray::LANES;
use crate::render::render;
use crate::scene::{self, Source};
use crate::world::{LoadOptions, World};

const GROUP: &str = "map coordinates";

/// A shift in metres, as in a survey. Its coordinates are whole numbers and the vertices are
/// multiples of 2^-20, so f64 does not round the sums.
const FAR: DVec3 = DVec3::new(4_500_000.0, 500_000.0, 120.0);

/// A shift for which f64 rounds the sums.
const ODD: DVec3 = DVec3::new(4_500_000.123_456_7, 500_000.765_432_1, 120.000_314_159);

/// Largest difference of a channel if the shift rounds: relative, or absolute for values below 1.
const PIXEL: f32 = 1e-5;

/// Width and height of the picture in the quick run.
const FRAME: [u32; 2] = [64, 48];

/// Text of a PLY file with double coordinates.
fn ply(shape: &TestMesh, shift: DVec3) -> String {
    let (vertices, faces) = (shape.vertices.len(), shape.triangles.len());
    let mut text = format!(
        "ply\nformat ascii 1.0\nelement vertex {vertices}\nproperty double x\nproperty double y\n\
         property double z\nelement face {faces}\nproperty list uchar int vertex_indices\nend_header\n"
    );
    for v in &shape.vertices {
        let v = *v + shift;
        let _ = writeln!(text, "{} {} {}", v.x, v.y, v.z);
    }
    for [a, b, c] in &shape.triangles {
        let _ = writeln!(text, "3 {a} {b} {c}");
    }
    text
}

/// Loads a world of meshes in `folder`, a floor, a sphere and a light. Floor, sphere, light and
/// camera are shifted by `shift`. The files of the meshes are shifted already.
fn load(folder: &Path, meshes: &[&str], shift: DVec3, frame: [u32; 2]) -> Result<World> {
    let at = |x: f64, y: f64, z: f64| json!((shift + DVec3::new(x, y, z)).to_array());
    let mut shapes = vec![
        json!({ "type": "plane", "material": { "kd": 0.9, "kr": 0.25 }, "v0": at(-4.0, -1.5, 4.0),
                "v1": at(4.0, -1.5, 4.0), "v2": at(4.0, -1.5, -4.0), "v3": at(-4.0, -1.5, -4.0) }),
        json!({ "type": "sphere", "material": { "ks": 0.5 }, "center": at(1.75, 0.5, -1.0), "radius": 0.5 }),
    ];
    shapes.extend(
        meshes.iter().map(|path| json!({ "type": "trimesh", "path": path, "material": {} })),
    );
    let scene = json!({
        "nbounces": 1,
        "camera": { "type": "pinhole", "width": frame[0], "height": frame[1], "fov": 50,
                    "position": at(1.0, 1.5, 5.0), "lookat": [-0.2, -0.3, -1], "up": [0, 1, 0] },
        "scene": { "shapes": shapes, "lightsources": [
            { "type": "pointlight", "position": at(3.0, 5.0, 4.0), "id": [1, 0.9, 0.8] }] }
    });
    let text = scene.to_string();
    let loaded =
        scene::load(Source::Text { name: "map coordinates", text: text.as_bytes(), folder }, &[])?;
    Ok(World::load(&loaded.scene, LoadOptions::default(), &Monitor::default())?.0)
}

fn folder() -> Result<tempfile::TempDir> {
    tempfile::tempdir().map_err(|error| {
        Error::io(&std::env::temp_dir(), "create a folder in", &error)
            .help("set TMPDIR to a folder that exists and can be written")
    })
}

fn write(folder: &Path, name: &str, text: &str) -> Result<()> {
    let path = folder.join(name);
    std::fs::write(&path, text).map_err(|error| Error::io(&path, "write", &error))
}

/// Rounds vertices to multiples of 2^-20, so that a shift by whole numbers is exact.
fn on_a_grid(mut shape: TestMesh) -> TestMesh {
    let grid = f64::from(1 << 20);
    shape.vertices.iter_mut().for_each(|v| *v = (*v * grid).round() / grid);
    shape
}

/// Compares the picture of a shifted scene with the picture at the origin, pixel by pixel.
fn moved(
    run: &mut CaseRun,
    shape: &TestMesh,
    shift: DVec3,
    same: fn(f32, f32) -> bool,
) -> Result<()> {
    let folder = folder()?;
    write(folder.path(), "here.ply", &ply(shape, DVec3::ZERO))?;
    write(folder.path(), "there.ply", &ply(shape, shift))?;
    let grown = (run.settings.times as f64).sqrt().clamp(1.0, 10.0);
    let frame = FRAME.map(|n| (f64::from(n) * grown) as u32);
    let here = load(folder.path(), &["here.ply"], DVec3::ZERO, frame)?;
    let there = load(folder.path(), &["there.ply"], shift, frame)?;
    let sums = {
        let run = &*run;
        let [a, b] = [run.build(&here.geometry)?, run.build(&there.geometry)?];
        let mut sums = Vec::new();
        for (one, other) in a.backends().zip(b.backends()) {
            let isa = one.tested.backend.isa();
            let mut counts = CaseCounts::default();
            let started = std::time::Instant::now();
            let mut pictures = Vec::new();
            for (world, backend) in [(&here, one), (&there, other)] {
                let mut film = Film::new(frame, Window::full(frame[0], frame[1]))?;
                render(world, backend.accelerator, isa, &mut film, run.monitor)?;
                pictures.push(film.pixels);
            }
            run.monitor.check()?;
            counts.nanoseconds = started.elapsed().as_nanos() as u64;
            for (index, (p, q)) in pictures[0].iter().zip(&pictures[1]).enumerate() {
                counts.rays += 1;
                if !p.iter().zip(q).all(|(&p, &q)| same(p, q)) {
                    let pixel = [index as u32 % frame[0], index as u32 / frame[0]];
                    let at = DVec2::new(pixel[0].into(), pixel[1].into());
                    let [x, y] = (at / f64::from(frame[0]) * 2.0 - 1.0).to_array();
                    counts.fail(WrongKind::Pixel, DVec3::new(x, -y, 0.0));
                }
            }
            sums.push(counts);
        }
        sums
    };
    run.keep(&here.geometry, sums)
}

/// Checks two meshes 1e6 apart: vertices within half an ulp, and no leak in either.
fn apart(run: &mut CaseRun) -> Result<()> {
    let folder = folder()?;
    let shape = icosphere(4).squashed(DVec3::splat(50.0 + 1.0 / 3.0));
    let places =
        [DVec3::new(4_000_000.1, 500_000.7, 120.3), DVec3::new(5_000_000.9, 500_000.2, 80.6)];
    let names = ["west.ply", "east.ply"];
    for (name, place) in names.iter().zip(places) {
        write(folder.path(), name, &ply(&shape, place))?;
    }
    let world = load(folder.path(), &names, places[0].lerp(places[1], 0.5), FRAME)?;
    let geometry = &world.geometry;
    let mut off: f64 = 0.0;
    let mut counts = CaseCounts::default();
    for (mesh, place) in geometry.meshes.iter().zip(places) {
        for (stored, v) in mesh.vertices().iter().zip(&shape.vertices) {
            let exact = (*v + place) - geometry.origin;
            let error = (doubles(*stored) - exact).abs();
            counts.rays += 1;
            let bound = exact.to_array().map(|x| 0.5001 * ulp(x));
            if !error.cmple(DVec3::from(bound)).all() {
                counts.fail(WrongKind::WrongDistance, doubles(*stored));
            }
            off = off.max(error.max_element());
        }
    }
    run.note = Some(format!(
        "vertices within {off:.3} of the file's doubles, half an f32 ulp at 5e5 from the scene's origin"
    ));
    let sums = vec![counts; run.counts.len()];
    run.keep(geometry, sums)?;
    let amount = Amount { packets: 600, slow_stride: 8, oracle_stride: 8 };
    run.trace(geometry, amount, |random| {
        let which = random.below(2) as usize;
        let mesh = &geometry.meshes[which];
        let center = places[which] - geometry.origin;
        AimedPacket::each(Expect::Closed([f64::INFINITY; LANES]), |aimed, i| {
            let triangle = any_triangle(random, mesh);
            let which = random.below(3);
            let goal = point_on(random, triangle, which);
            aimed.through(i, center + random.cube() * 15.0, goal);
        })
    })
}

/// All cases of this group.
pub fn cases() -> Vec<Case> {
    let pixels = || PassCriterion::Zero("pixels are compared");
    vec![
        Case::new(
            GROUP,
            "moved by an exact shift",
            "a scan in doubles, a mirror and a sphere moved to (4500000, 500000, 120) with camera and \
             light: the same bytes as at the origin",
            pixels(),
            |run| moved(run, &on_a_grid(scan()), FAR, |p, q| p.to_bits() == q.to_bits()),
        ),
        Case::new(
            GROUP,
            "moved by a shift that rounds",
            "the same with coordinates that f64 rounds: every pixel within 1e-5",
            pixels(),
            |run| {
                moved(run, &scan(), ODD, |p, q| {
                    (p - q).abs() <= PIXEL * p.abs().max(q.abs()).max(1.0)
                })
            },
        ),
        Case::new(
            GROUP,
            "two meshes 1e6 apart",
            "closed meshes of size 100 in map coordinates, 1e6 from each other: vertices to half an f32 \
             ulp around the common origin, and no ray from within escapes",
            PassCriterion::Exact,
            apart,
        ),
    ]
}
