//! Layers for data sets, compared with the layers P and N and with the camera's definition.

use std::path::Path;

use crate::support::backends::{self, on_both};
use glam::DVec3;
use lightpath::{
    film::{ReservedFilm, Window},
    layers::{LayerPlan, MISS_DEPTH},
    monitor::Monitor,
    render::{RenderContext, render_layers},
    scene::{self, Source},
    simd::Isa,
    world::{LoadOptions, World},
};
use serde_json::json;

const POSITION: [f64; 3] = [1000.5, 2.0, 7.0];
const TARGET: [f64; 3] = [1000.0, 0.5, -1.0];

on_both! {
    fn distance_camera_normal_and_facing_ratio_follow_their_definitions(backend: Backend) {
        for spp in [1, 16] {
            let scene = json!({
                "spp": spp,
                "output": { "layers": ["Z", "distance", "P", "N", "Ncam", "facing", "objectid"] },
                "camera": { "type": "pinhole", "width": 60, "height": 40, "fov": 50,
                    "position": POSITION, "target": TARGET, "up": [0.2, 1, 0.1] },
                "scene": { "shapes": [
                    { "type": "plane", "v0": [995, 0, -6], "v1": [1005, 0, -6],
                      "v2": [1005, 0, 4], "v3": [995, 0, 4], "material": {} },
                    { "type": "sphere", "center": [999, 1, 0], "radius": 1, "material": {} },
                    { "type": "trimesh", "path": "assets/teapot.ply", "fit": 2, "smooth": true,
                      "center": [1001.5, 1, 0], "material": {} }] }
            });
            let text = scene.to_string();
            let source =
                Source::Text { name: "s.json", text: text.as_bytes(), folder: Path::new("") };
            let scene = scene::load(source, &[]).unwrap().scene;
            let monitor = Monitor::default();
            let (world, _) = World::load(&scene, LoadOptions::default(), &monitor).unwrap();
            let accelerator = backends::build(&world.geometry, backend);
            let plan = LayerPlan::new(&scene);
            let window = Window::full(60, 40);
            let blank = ReservedFilm::new([60, 40], window, plan.layout.channels.clone());
            let (mut film, isa) = (blank.unwrap().film(), Isa::detect());
            let accelerator = &*accelerator;
            let context = RenderContext { world: &world, accelerator, isa, monitor: &monitor };
            render_layers(context, &mut film, &plan, None).unwrap();
            let value = |name: &str, pixel: usize| {
                f64::from(film.planes.float(film.planes.index(name).unwrap(), pixel))
            };
            let vector = |name: &str, pixel: usize| {
                DVec3::from(["X", "Y", "Z"].map(|axis| value(&format!("{name}.{axis}"), pixel)))
            };
            let eye = DVec3::from(POSITION);
            let forward = (DVec3::from(TARGET) - eye).normalize();
            let right = forward.cross(DVec3::new(0.2, 1.0, 0.1)).normalize();
            let up = right.cross(forward);
            let mut hits = 0;
            for pixel in 0..film.pixels.len() {
                if value("Z", pixel) == f64::from(MISS_DEPTH) {
                    assert_eq!(value("distance.Y", pixel), f64::from(MISS_DEPTH));
                    assert_eq!(vector("Ncam", pixel), DVec3::ZERO);
                    assert_eq!(value("facing.Y", pixel), 0.0);
                    continue;
                }
                hits += 1;
                let way = vector("P", pixel) - eye;
                // P is rounded to f32 in world coordinates of 1000.
                assert!((value("distance.Y", pixel) - way.length()).abs() < 2e-4);
                assert!(value("distance.Y", pixel) >= value("Z", pixel));
                let n = vector("N", pixel);
                let expected = DVec3::new(n.dot(right), n.dot(up), -n.dot(forward));
                assert!((vector("Ncam", pixel) - expected).length() < 1e-5);
                let facing = value("facing.Y", pixel);
                if spp == 1 {
                    let expected = -n.dot(way.normalize());
                    assert!((facing - expected.max(0.0)).abs() < 2e-4, "{facing} {expected}");
                } else {
                    assert!((0.0..=1.000001).contains(&facing), "{facing}");
                }
            }
            assert!(hits > 1000);
        }
    }
}

/// A triangle with a normal that is not finite is flat, also in an instance. A normal of length 0
/// is left out of the mean.
#[test]
fn normals_that_are_not_finite_make_their_triangles_flat() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("m.ply");
    let rotations = [json!(null), json!([[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]])];
    for (instance, normal, flat) in rotations.iter().flat_map(|i| {
        ["nan 0 1", "0 inf 0", "0 0 -inf", "0 0 0"].map(|normal| (i, normal, normal != "0 0 0"))
    }) {
        let ply = format!(
            "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\n\
             property float z\nproperty float nx\nproperty float ny\nproperty float nz\n\
             element face 1\nproperty list int int vertex_indices\nend_header\n\
             -4 -4 0 {normal}\n4 -4 0 0.6 0 0.8\n0 4 0 0.6 0 0.8\n3 0 1 2\n"
        );
        std::fs::write(&path, ply).unwrap();
        let mut shape = json!({ "type": "trimesh", "path": path, "smooth": true,
            "rotate": [0, 0, 90], "material": {} });
        if !instance.is_null() {
            shape["instances"] = json!([instance]);
        }
        let scene = json!({
            "camera": { "type": "pinhole", "width": 4, "height": 4, "fov": 10,
                "position": [0, 0, 4], "lookat": [0, 0, -1], "up": [0, 1, 0] },
            "output": { "layers": ["N"] }, "scene": { "shapes": [shape] } });
        let loaded = lightpath::LoadedScene::from_json(&scene.to_string(), &[]).unwrap();
        let film = loaded.renderer().unwrap().render().unwrap();
        let axis = |name| film.planes.float(film.planes.index(name).unwrap(), 5);
        let found = ["N.X", "N.Y", "N.Z"].map(axis);
        let expected = if flat { [0.0, 0.0, 1.0] } else { [0.0, 0.6, 0.8] };
        for (found, expected) in found.into_iter().zip(expected) {
            assert!((found - expected).abs() < 1e-6, "{instance} {normal}: {found:?}");
        }
    }
}
