//! The layer `ao`, compared with closed forms.

use std::f64::consts::PI;

use lightpath::LoadedScene;
use lightpath::scene::{Backend, written::AcceleratorName};
use serde_json::{Value, json};

use crate::support::backends::on_both;

fn quad(corners: [[f64; 3]; 4]) -> Value {
    let [v0, v1, v2, v3] = corners;
    json!({ "type": "plane", "v0": v0, "v1": v1, "v2": v2, "v3": v3, "material": {} })
}

/// The ground's point at x = z = 0 beside `shape`, seen from near, with these rays.
fn scene(shape: &Value, distance: Option<f64>, lights: Value) -> String {
    let ground = quad([[-9.0, 0.0, -9.0], [9.0, 0.0, -9.0], [9.0, 0.0, 9.0], [-9.0, 0.0, 9.0]]);
    json!({
        "spp": 16,
        "camera": { "type": "orthographic", "width": 1, "height": 1, "viewwidth": 1e-4,
                    "position": [0, 0.01, 0], "lookat": [0, -1, 0], "up": [0, 0, -1] },
        "output": { "layers": ["ao"], "aodistance": distance.unwrap_or(1e4), "aosamples": 8 },
        "scene": { "shapes": [ground, shape], "lightsources": lights }
    })
    .to_string()
}

/// Mean over 64 seeds, and its standard error.
fn mean(shape: &Value, distance: Option<f64>, backend: Backend) -> (f64, f64) {
    let (mut sum, mut squares) = (0.0, 0.0);
    let backend = format!("/scene/accelerator={}", backend.name());
    for seed in 0..64 {
        let seed = format!("/seed={seed}");
        let scene = scene(shape, distance, json!([]));
        let loaded = LoadedScene::from_json(&scene, &[&backend, &seed]).unwrap();
        let film = loaded.renderer().unwrap().render().unwrap();
        let value = f64::from(film.planes.float(film.planes.index("ao.Y").unwrap(), 0));
        (sum, squares) = (sum + value / 64.0, squares + value * value / 64.0);
    }
    (sum, ((squares - sum * sum).max(0.0) / 63.0).sqrt())
}

/// Compares occlusion above a point of the ground with closed forms.
fn check_closed_forms(backend: Backend) {
    let far = 4000.0;
    let corner = quad([[1.0, 0.0, -far], [1.0, 0.0, far], [1.0, 3.0, far], [1.0, 3.0, -far]]);
    let wall = quad([[1.0, 0.0, -far], [1.0, 0.0, far], [1.0, far, far], [1.0, far, -far]]);
    let vast = 4e6;
    let vast = quad([[1.0, 0.0, -vast], [1.0, 0.0, vast], [1.0, vast, vast], [1.0, vast, -vast]]);
    let ball = json!({ "type": "sphere", "center": [0, 1.25, 0], "radius": 0.5, "material": {} });
    let around = json!({ "type": "sphere", "center": [0, 0, 0], "radius": 4, "material": {} });
    // Rays of length d hit the wall if the projection of their direction is in a segment of the
    // unit disc at height 1 / d.
    let segment = |h: f64| (h.acos() - h * (1.0 - h * h).sqrt()) / PI;
    let cases = [
        (&corner, None, 1.0 - 0.5 * (1.0 - 1.0 / 10f64.sqrt())),
        (&wall, Some(1.5), 1.0 - segment(1.0 / 1.5)),
        (&wall, Some(4.0), 1.0 - segment(0.25)),
        (&wall, Some(0.9), 1.0),
        // The camera is the origin of coordinates, so positions near it are precise.
        (&vast, Some(1.5), 1.0 - segment(1.0 / 1.5)),
        (&wall, Some(1e-7), 1.0),
        (&ball, None, 1.0 - 0.16),
        (&ball, Some(0.7), 1.0),
        (&around, Some(3.9), 1.0),
        (&around, None, 0.0),
    ];
    for (shape, distance, expected) in cases {
        let (mean, error) = mean(shape, distance, backend);
        let what = format!("{distance:?} {shape}: {mean} +- {error}, {expected}");
        assert!((mean - expected).abs() <= 3.0 * error + 1e-6 && error < 0.003, "{what}");
    }
}

on_both! {
    fn ambient_occlusion_has_its_closed_forms(backend: Backend) {
        check_closed_forms(backend);
    }
}

#[test]
fn brute_force_has_the_closed_forms() {
    check_closed_forms(AcceleratorName::Brute.into());
}

on_both! {
    /// A bare slope, 1,000 below a camera that is the origin of coordinates because of a near ball.
    fn far_ground_does_not_shade_itself(backend: Backend) {
        let at = |x: f64, z: f64| [x, -1000.0 - 0.3 * x - 0.1 * z, z];
        let (low, high) = (-2e4, 2e4);
        let slope = quad([at(low, low), at(high, low), at(high, high), at(low, high)]);
        let ball = json!({ "type": "sphere", "center": [0, -0.7, -1], "radius": 0.2, "material": {} });
        let scene = json!({
            "camera": { "type": "pinhole", "width": 32, "height": 32, "fov": 60,
                        "position": [0, 0, 0], "lookat": [0, -0.9, -1], "up": [0, 1, 0] },
            "output": { "layers": ["ao"], "aodistance": 1e-5, "aosamples": 64 },
            "scene": { "shapes": [slope, ball], "accelerator": backend.name() }
        });
        let loaded = LoadedScene::from_json(&scene.to_string(), &[]).unwrap();
        let told: Vec<String> = loaded.warnings().iter().map(ToString::to_string).collect();
        assert!(told.iter().any(|text| text.contains("from the camera: there, up to")), "{told:?}");
        let film = loaded.renderer().unwrap().render().unwrap();
        let ao = film.planes.index("ao.Y").unwrap();
        let mean = (0..1024).map(|i| film.planes.float(ao, i)).sum::<f32>() / 1024.0;
        assert!((0.999..=1.0).contains(&mean), "{mean}");
    }
}

#[test]
fn the_beauty_does_not_change_with_the_layer() {
    let ball = json!({ "type": "sphere", "center": [0, 1.25, 0], "radius": 0.5, "material": {} });
    let light = json!([{ "type": "environment", "radiance": [1, 1, 1], "samples": 4 }]);
    let scene = scene(&ball, None, light);
    let render = |more: &[&str]| {
        let loaded = LoadedScene::from_json(&scene, more).unwrap();
        loaded.renderer().unwrap().render().unwrap()
    };
    let (with, without) = (render(&[]), render(&["/output/layers=[]"]));
    assert_eq!(with.pixels, without.pixels);
    assert_eq!(without.planes.index("ao.Y"), None);
    // No ray is traced for it either.
    let all = render(&[r#"/output/layers=["all"]"#]);
    assert_eq!(all.planes.index("ao.Y"), None);
}
