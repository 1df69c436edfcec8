//! Suns and directional lights, compared with closed forms.

use lightpath::LoadedScene;
use serde_json::{Value, json};

/// A white floor at y = 0 seen from y = 0.5, straight down: `width` x 1 pixels over x in -1 .. 1.
/// `shapes` are added to it.
fn floor(width: u32, light: Value, shapes: &[Value]) -> Value {
    let mut all = vec![json!({
        "type": "plane", "v0": [-9, 0, -9], "v1": [9, 0, -9], "v2": [9, 0, 9], "v3": [-9, 0, 9],
        "material": { "kd": 1, "diffusecolor": [1, 1, 1] }
    })];
    all.extend_from_slice(shapes);
    json!({
        "camera": { "type": "orthographic", "width": width, "height": 1, "viewwidth": 2,
                    "position": [0, 0.5, 0], "lookat": [0, -1, 0], "up": [0, 0, -1] },
        "scene": { "attenuation": "quadratic", "lightsources": [light], "shapes": all }
    })
}

/// Red of each pixel.
fn row(scene: &Value, backend: &str, more: &[&str]) -> Vec<f64> {
    let backend = format!("/scene/accelerator={backend}");
    let overrides = [&[backend.as_str()], more].concat();
    let loaded = LoadedScene::from_json(&scene.to_string(), &overrides).unwrap();
    let film = loaded.renderer().unwrap().render().unwrap();
    film.pixels.iter().map(|pixel| f64::from(pixel[0])).collect()
}

#[test]
fn a_directional_light_gives_the_cosine_and_has_no_falloff() {
    let elevation = 50f64;
    let lights = [
        json!({ "type": "directional", "azimuth": 30, "elevation": elevation, "id": [1, 1, 1] }),
        json!({ "type": "directional", "azimuth": 30, "elevation": elevation,
                "irradiance": [std::f64::consts::PI, 0, 0] }),
        json!({ "type": "sun", "angle": 0, "azimuth": 30, "elevation": elevation, "id": [1, 1, 1] }),
    ];
    let (sin, cos) = elevation.to_radians().sin_cos();
    let (east, north) = 30f64.to_radians().sin_cos();
    let towards = [cos * east, sin, -cos * north];
    let direction =
        json!({ "type": "directional", "direction": towards.map(|d| -3.0 * d), "id": [1, 0, 0] });
    for light in lights.into_iter().chain([direction]) {
        for backend in ["bvh", "brute", "coursework"] {
            for value in row(&floor(8, light.clone(), &[]), backend, &[]) {
                assert!((value - sin).abs() < 1e-6, "{light} {backend} {value}");
            }
        }
    }
}

#[test]
fn the_shadow_of_an_edge_has_the_width_of_the_sun() {
    // The floor's point x sees the directions d with x + d.x/d.y >= 0 beside a wide slab at y = 1
    // over x < 0. The camera is below the slab.
    let slab = json!({
        "type": "plane", "v0": [-90, 1, -90], "v1": [0, 1, -90], "v2": [0, 1, 90],
        "v3": [-90, 1, 90], "material": {}
    });
    let angle = 40f64;
    let light = json!({ "type": "sun", "angle": angle, "samples": 4, "direction": [0, -1, 0],
                        "id": [1, 1, 1] });
    let scene = floor(16, light, &[slab]);
    // The mean over directions, uniform by solid angle, of d.y where the slab is missed.
    let versine = 1.0 - (angle / 2.0).to_radians().cos();
    let expected = |x: f64| {
        let (n, mut sum) = (400, 0.0);
        for i in 0..n {
            let y = 1.0 - versine * (f64::from(i) + 0.5) / f64::from(n);
            let r = (1.0 - y * y).sqrt();
            // cos(phi) >= -x y / r.
            let edge = (-x * y / r).clamp(-1.0, 1.0);
            sum += y * edge.acos() / std::f64::consts::PI;
        }
        sum / f64::from(n)
    };
    let seeds = 64;
    let (mut sums, mut squares) = ([0.0; 16], [0.0; 16]);
    for seed in 0..seeds {
        let seed = format!("/seed={seed}");
        for (i, value) in row(&scene, "bvh", &["/spp=16", &seed]).into_iter().enumerate() {
            sums[i] += value;
            squares[i] += value * value;
        }
    }
    let mut partly = 0;
    for i in 0..16 {
        let n = f64::from(seeds);
        let mean = sums[i] / n;
        let error = ((squares[i] / n - mean * mean).max(0.0) / (n - 1.0)).sqrt();
        // The mean over the pixel.
        let places = (0..64).map(|k| -1.0 + (i as f64 + (f64::from(k) + 0.5) / 64.0) / 8.0);
        let truth = places.map(expected).sum::<f64>() / 64.0;
        partly += i32::from(truth > 0.01 && truth < 0.95);
        assert!((mean - truth).abs() <= 3.0 * error + 2e-5, "{i}: {mean} +- {error}, {truth}");
    }
    assert!(partly >= 4);
}

#[test]
fn every_backend_gives_the_same_soft_shadow() {
    let ball = json!({ "type": "sphere", "center": [0.2, 1.5, 0], "radius": 0.4, "material": {} });
    let light = json!({ "type": "sun", "angle": 8, "samples": 8, "azimuth": 100, "elevation": 70,
                        "id": [2, 1, 1] });
    let scene = floor(32, light, &[ball]);
    let bvh = row(&scene, "bvh", &["/spp=4"]);
    assert_eq!(bvh, row(&scene, "brute", &["/spp=4"]));
    assert!(bvh.iter().any(|value| *value < 0.1) && bvh.iter().any(|value| *value > 1.5));
}

#[test]
fn problems_of_suns_are_reported_with_their_places() {
    let errors = |light: Value| {
        let scene = floor(4, light, &[]).to_string();
        LoadedScene::from_json(&scene, &[]).map(|_| ()).unwrap_err().to_string()
    };
    for (light, part) in [
        (json!({ "type": "sun", "id": [1, 1, 1] }), "no complete direction"),
        (
            json!({ "type": "sun", "id": [1, 1, 1], "azimuth": 3 }),
            "expected `direction`, or `azimuth` and `elevation`",
        ),
        (
            json!({ "type": "directional", "id": [1, 1, 1], "direction": [0, -1, 0], "azimuth": 3 }),
            "`direction` together with",
        ),
        (json!({ "type": "directional", "id": [1, 1, 1], "direction": [0, 0, 0] }), "zero vector"),
        (json!({ "type": "sun", "direction": [0, -1, 0] }), "found neither"),
        (
            json!({ "type": "sun", "direction": [0, -1, 0], "id": [1, 1, 1],
                    "irradiance": [1, 1, 1] }),
            "found both",
        ),
        (json!({ "type": "sun", "direction": [0, -1, 0], "id": [1, 1, 1], "angle": 400 }), "179"),
    ] {
        let message = errors(light.clone());
        assert!(message.contains(part), "{light}: {message}");
    }
    let below = json!({ "type": "sun", "azimuth": 0, "elevation": -5, "id": [1, 1, 1] });
    let loaded = LoadedScene::from_json(&floor(4, below, &[]).to_string(), &[]).unwrap();
    let warnings: Vec<String> = loaded.warnings().iter().map(ToString::to_string).collect();
    assert!(warnings.iter().any(|w| w.contains("5.0 degrees below the horizon")), "{warnings:?}");
    // A scene may have its up elsewhere.
    let by_direction = json!({ "type": "sun", "direction": [0, 1, -1], "id": [1, 1, 1] });
    let loaded = LoadedScene::from_json(&floor(4, by_direction, &[]).to_string(), &[]).unwrap();
    assert!(loaded.warnings().is_empty(), "{:?}", loaded.warnings());
}
