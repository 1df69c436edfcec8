//! A cloud of points is drawn as the spheres that a scene would write one by one.

use crate::support::backends::{self, on_both};
use crate::support::ply_writer::{Encoding, Ply, Rows, V};
use lightpath::{
    film::{Film, Window},
    monitor::Monitor,
    render,
    scene::{self, Backend, Source},
    simd::Isa,
    world::{LoadOptions, World},
};
use serde_json::{Value, json};

/// Coordinates and colours that every step of the placement keeps exactly.
fn points() -> Vec<[f64; 6]> {
    let part = |i: usize, step: usize| ((i * step) % 64) as f64 / 16.0 - 2.0;
    let color = |i: usize, step: usize| ((i * step) % 8) as f64 / 8.0;
    (0..40)
        .map(|i| [part(i, 37), part(i, 23), part(i, 51), color(i, 3), color(i, 5), color(i, 7)])
        .collect()
}

/// Renders shapes from a folder with `cloud.ply`.
fn picture(backend: Backend, shapes: &Value, folder: &std::path::Path) -> (Film, World) {
    let scene = json!({
        "camera": { "type": "pinhole", "width": 64, "height": 64, "fov": 40,
                    "position": [1, -0.75, 4.5], "target": [0.5, -0.25, 1], "up": [0, 1, 0] },
        "scene": {
            "lightsources": [{ "type": "pointlight", "position": [5, 8, 9], "id": [2, 2, 2] }],
            "attenuation": "none",
            "shapes": shapes,
        },
    });
    let text = scene.to_string();
    let source = Source::Text { name: "s.json", text: text.as_bytes(), folder };
    let scene = scene::load(source, &[]).unwrap().scene;
    let monitor = Monitor::default();
    let (world, _) = World::load(&scene, LoadOptions::default(), &monitor).unwrap();
    let accelerator = backends::build(&world.geometry, backend);
    let mut film = Film::new(world.frame, Window::full(64, 64)).unwrap();
    render::render(&world, &*accelerator, Isa::detect(), &mut film, &monitor).unwrap();
    drop(accelerator);
    (film, world)
}

on_both! {
    fn a_cloud_equals_its_spheres(backend: Backend) {
        let folder = tempfile::tempdir().unwrap();
        let rows: Rows = points().iter().map(|row| row.map(V::N).to_vec()).collect();
        let names = ["x", "y", "z"].map(|name| format!("double {name}"));
        let colors = ["red", "green", "blue"].map(|name| format!("float {name}"));
        let names: Vec<&str> = names.iter().chain(&colors).map(String::as_str).collect();
        let ply = Ply::new().element("vertex", &names, rows);
        std::fs::write(folder.path().join("cloud.ply"), ply.write(Encoding::Big)).unwrap();
        let others = [
            json!({ "type": "sphere", "center": [3, 3, 0], "radius": 0.5, "material": {} }),
            json!({ "type": "plane", "v0": [-9, -9, -4], "v1": [9, -9, -4], "v2": [9, 9, -4],
                    "v3": [-9, 9, -4], "material": {} }),
        ];
        for few in [&others[..0], &others[..]] {
            let cloud = json!({ "type": "trimesh", "path": "cloud.ply", "points": 0.25, "size": 0.5,
                                "center": [0.5, -0.25, 1], "material": { "ks": 0.5 } });
            let mut with_cloud = few.to_vec();
            with_cloud.push(cloud);
            let mut one_by_one = few.to_vec();
            one_by_one.extend(points().iter().map(|[x, y, z, r, g, b]| {
                json!({ "type": "sphere", "radius": 0.125,
                        "center": [0.5 * x + 0.5, 0.5 * y - 0.25, 0.5 * z + 1.0],
                        "material": { "ks": 0.5, "diffusecolor": [r, g, b] } })
            }));
            let (film, world) = picture(backend, &json!(with_cloud), folder.path());
            let (expected, _) = picture(backend, &json!(one_by_one), folder.path());
            let bits = |film: &Film| -> Vec<[u32; 4]> {
                film.pixels.iter().map(|pixel| pixel.map(f32::to_bits)).collect()
            };
            assert!(bits(&film) == bits(&expected));
            let lit = film.pixels.iter().filter(|pixel| pixel[0] > 0.0).count();
            assert!(lit > 300, "{lit}");
            // 32 bytes of a sphere, 12 of its colour; a scene with other spheres has their owners.
            let planes = 48 * (few.len() / 2) as u64;
            let spheres = 40 + (few.len() / 2) as u64;
            assert_eq!(world.mesh_bytes(), 32 * spheres + 12 * 40 + planes);
        }
    }
}
