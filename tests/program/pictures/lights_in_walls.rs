//! Pictures of rotated rooms with a light panel in the ceiling, compared with the independent ray
//! tracer of `tests/reference/`; and lights of almost no area, which act as points.

use std::sync::LazyLock;

use crate::support::backends::on_both;
use crate::support::program::Scratch;
use crate::support::reference::{compare, program};
use glam::{DMat3, DVec3};
use lightpath::scene::Backend;
use lightpath_reference::{self as reference, Density, Picture, scene::Scene};
use serde_json::{Value, json};

/// A rotated glossy room from -1 to 1, open towards +z. Its light is 1 x 0.75 at the height `lamp`.
fn room(turn: DMat3, lamp: f64, light: &dyn Fn([DVec3; 3]) -> Value) -> Value {
    let at = |x: f64, y: f64, z: f64| (turn * DVec3::new(x, y, z)).to_array();
    let matt = |mut shape: Value| {
        // Along the ceiling N.L is only rounding, and so would be a highlight.
        shape["material"]["ks"] = json!(0);
        shape
    };
    let wall = |corners: [[f64; 3]; 4], color: [f64; 3]| {
        let [v0, v1, v2, v3] = corners.map(|[x, y, z]| at(x, y, z));
        json!({ "type": "plane", "v0": v0, "v1": v1, "v2": v2, "v3": v3,
                "material": { "diffusecolor": color, "ks": 0.5, "specularexponent": 12 } })
    };
    let corner = |x: f64, z: f64| turn * DVec3::new(x, lamp, z);
    let grey = [0.7, 0.7, 0.7];
    json!({
        "camera": { "type": "pinhole", "width": 60, "height": 60, "fov": 50, "position": at(0.1, 0.05, 2.8),
                    "target": at(0.0, 0.0, 0.0), "up": (turn * DVec3::Y).to_array() },
        "scene": {
            "ambient": [0.02, 0.02, 0.02],
            "lightsources": [light([corner(-0.5, -0.4), corner(0.5, -0.4), corner(-0.5, 0.35)])],
            "shapes": [
                wall([[-1.0, -1.0, 1.0], [1.0, -1.0, 1.0], [1.0, -1.0, -1.0], [-1.0, -1.0, -1.0]], grey),
                matt(wall([[-1.0, 1.0, 1.0], [1.0, 1.0, 1.0], [1.0, 1.0, -1.0], [-1.0, 1.0, -1.0]], grey)),
                wall([[-1.0, -1.0, -1.0], [1.0, -1.0, -1.0], [1.0, 1.0, -1.0], [-1.0, 1.0, -1.0]], grey),
                wall([[-1.0, -1.0, 1.0], [-1.0, -1.0, -1.0], [-1.0, 1.0, -1.0], [-1.0, 1.0, 1.0]], [0.8, 0.3, 0.3]),
                wall([[1.0, -1.0, 1.0], [1.0, -1.0, -1.0], [1.0, 1.0, -1.0], [1.0, 1.0, 1.0]], [0.3, 0.8, 0.3])]
        }
    })
}

fn panel([v0, v1, v2]: [DVec3; 3]) -> Value {
    json!({ "type": "arealight", "v0": v0.to_array(), "v1": v1.to_array(), "v2": v2.to_array(),
            "id": [1, 1, 1], "is": [1, 1, 1], "samples": 64 })
}

/// Returns the pictures of a backend; with ours also that of `coursework`.
fn pictures(backend: Backend, scratch: &Scratch, scene: &Value) -> Vec<(&'static str, Picture)> {
    scratch.write("s.json", &scene.to_string());
    let backends = match backend {
        Backend::Embree(_) => &["embree"][..],
        _ => &["bvh", "coursework"],
    };
    let each = |&backend: &&'static str| {
        let args = ["render", "s.json", "--backend", backend, "-o", backend, "--float"];
        scratch.run(&args).good();
        (backend, program::read_exr(&scratch.path(&format!("{backend}.exr"))))
    };
    backends.iter().map(each).collect()
}

fn turns() -> [DMat3; 3] {
    let turn = |a: f64, b: f64| DMat3::from_rotation_x(a) * DMat3::from_rotation_z(b);
    [turn(0.0, 0.0), turn(0.7, 0.4), turn(-1.3, 2.1)]
}

/// The reference's pictures of the room with a panel, which both backends need.
static PANELS: LazyLock<[Picture; 3]> = LazyLock::new(|| {
    let scratch = Scratch::new();
    turns().map(|turn| {
        scratch.write("s.json", &room(turn, 1.0, &panel).to_string());
        reference::render(&Scene::load(&scratch.path("s.json")), Density::default())
    })
});

on_both! {
    fn a_panel_in_a_ceiling_lights_the_room(backend: Backend) {
        let scratch = Scratch::new();
        for (turn, expected) in turns().into_iter().zip(&*PANELS) {
            for (backend, actual) in pictures(backend, &scratch, &room(turn, 1.0, &panel)) {
                compare::assert_same_sampled(&format!("panel-{backend}"), &actual, expected);
            }
        }
    }
}

on_both! {
    /// Just behind the ceiling the light leaves the room dark. Just in front of it the room gets
    /// all its light.
    fn a_hair_before_and_behind_the_ceiling(backend: Backend) {
        let scratch = Scratch::new();
        let mean = |picture: &Picture| picture.pixels.iter().map(|p| p[0]).sum::<f64>() / 3600.0;
        for turn in turns() {
            let flush = pictures(backend, &scratch, &room(turn, 1.0, &panel));
            // No surface has `ka`, so a light behind the ceiling gives black.
            for (_, behind) in pictures(backend, &scratch, &room(turn, 1.0 + 1e-5, &panel)) {
                assert_eq!(mean(&behind), 0.0);
            }
            let before = pictures(backend, &scratch, &room(turn, 1.0 - 1e-5, &panel));
            for ((backend, flush), (_, before)) in flush.iter().zip(&before) {
                let (all, lit) = (mean(flush), mean(before));
                assert!((lit / all - 1.0).abs() < 2e-3, "{backend}: {lit}, flush {all}");
            }
        }
    }
}

on_both! {
    /// Lights of almost no area act as point lights.
    fn a_light_of_almost_no_area_is_a_point(backend: Backend) {
        let scratch = Scratch::new();
        for side in [1e-6, 1e-12, 1e-20] {
            let small = |[v0, v1, v2]: [DVec3; 3]| {
                let [v1, v2] = [v1, v2].map(|v| v0 + (v - v0) * side);
                // Next to coordinates of 1, doubles cannot hold a side of 1e-20. So it lies at 0
                // along the axes.
                let (v0, v1, v2) = match v1 == v0 {
                    true => (DVec3::ZERO, DVec3::X * side, DVec3::Z * side),
                    false => (v0, v1, v2),
                };
                json!({ "type": "arealight", "v0": v0.to_array(), "v1": v1.to_array(), "v2": v2.to_array(),
                        "id": [1, 1, 1], "is": [1, 1, 1], "samples": 4 })
            };
            let turn = turns()[1];
            let area = room(turn, 0.5, &small);
            let point = area["scene"]["lightsources"][0]["v0"].clone();
            let mut with_point = area.clone();
            with_point["scene"]["lightsources"][0] =
                json!({ "type": "pointlight", "position": point, "id": [1, 1, 1], "is": [1, 1, 1] });
            let (areas, points) = (pictures(backend, &scratch, &area), pictures(backend, &scratch, &with_point));
            for ((backend, a), (_, b)) in areas.iter().zip(&points) {
                let differs = |(a, b): &(&[f64; 4], &[f64; 4])| {
                    (0..3).any(|c| (a[c] - b[c]).abs() > 1e-4 * b[c].abs().max(0.01))
                };
                let wrong = a.pixels.iter().zip(&b.pixels).filter(differs).count();
                assert!(wrong == 0, "{backend}, side {side:e}: {wrong} pixels differ");
            }
        }
    }
}
