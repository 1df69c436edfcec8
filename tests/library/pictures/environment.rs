//! Environments of one radiance, compared with closed forms.

use lightpath::LoadedScene;
use serde_json::{Value, json};

fn environment() -> Value {
    json!({ "type": "environment", "radiance": [1, 1, 1], "samples": 4 })
}

/// Pixels of a scene of white diffuse `shapes`.
fn render(camera: Value, shapes: &[Value], more: &[&str]) -> Vec<[f64; 4]> {
    let white: Vec<Value> = shapes
        .iter()
        .map(|shape| {
            let mut shape = shape.clone();
            shape["material"] = json!({});
            shape
        })
        .collect();
    let scene = json!({ "camera": camera,
                        "scene": { "lightsources": [environment()], "shapes": white } });
    let loaded = LoadedScene::from_json(&scene.to_string(), more).unwrap();
    let film = loaded.renderer().unwrap().render().unwrap();
    film.pixels.iter().map(|pixel| pixel.map(f64::from)).collect()
}

fn in_front(distance: f64) -> Value {
    json!({ "type": "pinhole", "width": 48, "height": 48, "fov": 50,
            "position": [0.3, 0.4, distance], "lookat": [0, 0, -1], "up": [0, 1, 0] })
}

fn quad(corners: [[f64; 3]; 4]) -> Value {
    let [v0, v1, v2, v3] = corners;
    json!({ "type": "plane", "v0": v0, "v1": v1, "v2": v2, "v3": v3 })
}

#[test]
fn a_white_convex_body_vanishes_in_a_white_environment() {
    let cube = |axis: usize, side: f64| {
        let corner = |a: f64, b: f64| {
            let mut v = [0.0; 3];
            (v[axis], v[(axis + 1) % 3], v[(axis + 2) % 3]) = (side, a, b);
            v
        };
        quad([corner(-1.0, -1.0), corner(1.0, -1.0), corner(1.0, 1.0), corner(-1.0, 1.0)])
    };
    let cube: Vec<Value> = (0..3).flat_map(|axis| [cube(axis, -1.0), cube(axis, 1.0)]).collect();
    let ball = [json!({ "type": "sphere", "center": [0, 0, 0], "radius": 1.2 })];
    for shapes in [&cube[..], &ball] {
        for backend in ["bvh", "embree", "brute"] {
            let backend = format!("/scene/accelerator={backend}");
            for pixel in render(in_front(5.0), shapes, &[&backend, "/spp=2"]) {
                assert!(pixel[..3].iter().all(|value| (value - 1.0).abs() < 1e-6), "{pixel:?}");
            }
        }
    }
}

/// Mean over 64 seeds of the light on the floor at x = 0, and its standard error.
fn floor(shapes: &[Value]) -> (f64, f64) {
    let down = json!({ "type": "orthographic", "width": 1, "height": 1, "viewwidth": 1e-4,
                       "position": [0, 0.01, 0], "lookat": [0, -1, 0], "up": [0, 0, -1] });
    let ground = quad([[-9.0, 0.0, -9.0], [9.0, 0.0, -9.0], [9.0, 0.0, 9.0], [-9.0, 0.0, 9.0]]);
    let shapes = [&[ground], shapes].concat();
    let (mut sum, mut squares, n) = (0.0, 0.0, 64.0);
    for seed in 0..64 {
        let seed = format!("/seed={seed}");
        let value = render(down.clone(), &shapes, &["/spp=16", &seed])[0][0];
        (sum, squares) = (sum + value, squares + value * value);
    }
    let mean: f64 = sum / n;
    (mean, ((squares / n - mean * mean).max(0.0) / (n - 1.0)).sqrt())
}

#[test]
fn occlusion_has_its_closed_forms() {
    // A wall of height 3 at distance 1, as good as infinitely long.
    let far = 4000.0;
    let wall = quad([[1.0, 0.0, -far], [1.0, 0.0, far], [1.0, 3.0, far], [1.0, 3.0, -far]]);
    // A ball overhead hides the square of the sine of its half angle.
    let ball = json!({ "type": "sphere", "center": [0, 1.25, 0], "radius": 0.5 });
    let around = json!({ "type": "sphere", "center": [0, 0, 0], "radius": 4 });
    for (shape, expected) in
        [(wall, 1.0 - 0.5 * (1.0 - 1.0 / 10f64.sqrt())), (ball, 1.0 - 0.16), (around, 0.0)]
    {
        let (mean, error) = floor(std::slice::from_ref(&shape));
        assert!((mean - expected).abs() <= 3.0 * error + 1e-6, "{shape}: {mean} +- {error}");
        assert!(error < 0.003);
    }
}

#[test]
fn an_environment_is_seen_unless_it_is_hidden() {
    let ball = [json!({ "type": "sphere", "center": [90, 0, 0], "radius": 1 })];
    let seen = render(in_front(5.0), &ball, &["/scene/backgroundcolor=[0.5, 0, 0]"]);
    assert!(seen.iter().all(|pixel| pixel[..3] == [1.5, 1.0, 1.0]));
    let hidden = render(in_front(5.0), &ball, &["/scene/lightsources/0/visible=false"]);
    assert!(hidden.iter().all(|pixel| pixel[..3] == [0.0; 3]));
}
