//! Pictures with coordinates that are hard to represent: a planet as a floor, something very far
//! away, a camera exactly on a surface. Compared with the independent ray tracer of
//! `tests/reference/` on every backend.

use crate::support::backends::on_both;
use crate::support::program::Scratch;
use crate::support::reference::{compare, program};
use lightpath::scene::Backend;
use lightpath_reference::{self as reference, Density, Picture, scene::Scene};
use serde_json::{Value, json};

/// Returns the pixels that differ from the reference by more than 1 % of the brighter one, with a
/// lower bound: column, row, both colours.
fn wrong(actual: &Picture, expected: &Picture) -> Vec<String> {
    let differs = |a: f64, b: f64| (a - b).abs() > 0.01 * a.abs().max(b.abs()).max(compare::FLOOR);
    let places = (0..actual.height).flat_map(|j| (0..actual.width).map(move |i| (i, j)));
    let pixels = places.map(|(i, j)| (i, j, actual.at(i, j), expected.at(i, j)));
    let wrong = pixels.filter(|(_, _, a, b)| (0..4).any(|c| differs(a[c], b[c])));
    wrong.map(|(i, j, a, b)| format!("({i}, {j}): {a:.4?}, expected {b:.4?}")).collect()
}

/// Returns the wrong pixels of a scene on some backends, and the program's messages.
fn count(backends: &[&'static str], scene: &Value) -> Vec<(&'static str, Vec<String>, String)> {
    let scratch = Scratch::new();
    scratch.write("s.json", &scene.to_string());
    let path = scratch.path("s.json");
    let expected = reference::render(&Scene::load(&path), Density::default());
    let each = |&backend: &&'static str| {
        let args = ["render", "s.json", "--backend", backend, "-o", backend, "--float"];
        let said = scratch.run(&args).good().stderr();
        let actual = program::read_exr(&scratch.path(&format!("{backend}.exr")));
        (backend, wrong(&actual, &expected), said)
    };
    backends.iter().map(each).collect()
}

/// Some shapes around (0, 0, 0), and `more`.
fn still_life(eye: [f64; 3], more: &[Value]) -> Value {
    let mut shapes = vec![
        json!({ "type": "sphere", "center": [-0.75, 0.5, 0.0], "radius": 0.5,
                "material": { "diffusecolor": [1, 0.25, 0.25], "kr": 0.25 } }),
        json!({ "type": "triangle", "v0": [0.25, 0.0, 0.5], "v1": [1.5, 0.0, -0.5],
                "v2": [0.75, 1.25, 0.0], "material": { "diffusecolor": [0.25, 1, 0.25] } }),
        json!({ "type": "plane", "v0": [-2.0, 0.0, -1.5], "v1": [2.0, 0.0, -1.5],
                "v2": [2.0, 1.0, -1.5], "v3": [-2.0, 1.0, -1.5],
                "material": { "diffusecolor": [0.5, 0.5, 1] } }),
    ];
    shapes.extend_from_slice(more);
    json!({
        "nbounces": 1,
        "camera": { "type": "pinhole", "width": 160, "height": 120, "fov": 50, "position": eye,
                    "target": [0.1, 0.4, 0.0], "up": [0, 1, 0] },
        "scene": { "ambient": [0.1, 0.1, 0.1], "backgroundcolor": [0.2, 0.4, 0.8],
            "lightsources": [{ "type": "pointlight", "position": [2.0, 4.0, 3.0], "id": [1, 1, 1] }],
            "shapes": shapes }
    })
}

#[track_caller]
fn assert_right(backend: Backend, name: &str, scene: &Value) {
    // The slow backends need no library, so they run with ours.
    let backends = match backend {
        Backend::Embree(_) => &["embree"][..],
        _ => &["bvh", "coursework", "brute"],
    };
    for (backend, wrong, said) in count(backends, scene) {
        let (count, first) = (wrong.len(), &wrong[..wrong.len().min(5)]);
        assert!(count == 0, "{name}: {backend}: {count} of 19200 pixels are wrong: {first:#?}");
        assert!(!said.contains("of a pixel"), "{name}: {backend}: {said}");
    }
}

on_both! {
    fn a_planet_is_a_floor(backend: Backend) {
        for radius in [1e4, 1e5, 1e6, 6.371e6] {
            let planet = json!({ "type": "sphere", "center": [0, -radius, 0], "radius": radius,
                                 "material": { "diffusecolor": [0.8, 0.8, 0.8], "ka": 1 } });
            assert_right(backend, &format!("radius {radius:e}"), &still_life([0.3, 1.5, 4.0], &[planet]));
        }
    }
}

on_both! {
    fn a_distant_object_does_not_affect_near_ones(backend: Backend) {
        for far in [1e6, 1e7] {
            let shapes = [
                json!({ "type": "triangle", "v0": [far, 0, 0], "v1": [far, 1, 0], "v2": [far, 0, 1],
                        "material": {} }),
                json!({ "type": "plane", "v0": [-9, 0, 9], "v1": [9, 0, 9], "v2": [9, 0, -9],
                        "v3": [-9, 0, -9], "material": {} }),
            ];
            assert_right(backend, &format!("{far:e} away"), &still_life([0.3, 1.5, 4.0], &shapes));
        }
    }
}

/// The program warns of coordinates that doubles cannot represent.
#[test]
fn unrepresentable_coordinates_give_a_warning() {
    let scratch = Scratch::new();
    let planet = json!({ "type": "sphere", "center": [0, -1e14, 0], "radius": 1e14,
                         "material": {} });
    scratch.write("s.json", &still_life([0.3, 1.5, 4.0], &[planet]).to_string());
    for command in [&["render", "s.json", "--backend", "bvh"][..], &["info", "s.json"]] {
        let done = scratch.run(command);
        assert_eq!(done.code(), 0, "{}", done.stderr());
        assert!(done.stderr().contains("of a pixel"), "{command:?}: {}", done.stderr());
    }
    let info = scratch.run(&["info", "s.json"]).stdout();
    assert!(info.contains("precision: positions"), "{info}");
}

on_both! {
    /// The camera stands on a floor, on its edge, on its corner, on a tilted triangle, or on a
    /// sphere. A ray starts after its origin.
    fn a_camera_on_a_surface_sees_what_is_before_it(backend: Backend) {
        let floor = |tilt: f64| {
            json!({ "type": "plane", "v0": [-3, -3.0 * tilt, 4], "v1": [3, 3.0 * tilt, 4],
                    "v2": [3, 3.0 * tilt, -4], "v3": [-3, -3.0 * tilt, -4],
                    "material": { "diffusecolor": [0.8, 0.8, 0.8], "ka": 1 } })
        };
        let ball = json!({ "type": "sphere", "center": [0, -1, 4], "radius": 1, "material": {} });
        let slope = json!({ "type": "triangle", "v0": [-1.5, -0.25, 5.125], "v1": [1.75, 0.5, 4.5],
                            "v2": [0.125, -0.75, 3.0], "material": {} });
        let third = [0.125, -0.75, 3.0];
        let scenes = [
            ("on a floor", [0.3, 0.0, 3.5], floor(0.0)),
            ("on an edge", [0.3, 0.0, 4.0], floor(0.0)),
            ("on a corner", [3.0, 0.0, 4.0], floor(0.0)),
            ("on a tilted floor", [0.5, 0.0625, 3.5], floor(0.125)),
            ("on a sphere", [0.0, 0.0, 4.0], ball),
            ("on a triangle's corner", third, slope),
        ];
        for (name, eye, shape) in scenes {
            assert_right(backend, name, &still_life(eye, &[shape]));
        }
        let wall = |corners: [[f64; 3]; 4]| {
            let [v0, v1, v2, v3] = corners;
            json!({ "type": "plane", "v0": v0, "v1": v1, "v2": v2, "v3": v3, "material": {} })
        };
        let walls = [
            floor(0.0),
            wall([[2.0, -1.0, -2.0], [2.0, -1.0, 4.0], [2.0, 2.0, 4.0], [2.0, 2.0, -2.0]]),
            wall([[-2.0, -1.0, 3.5], [2.5, -1.0, 3.5], [2.5, 2.0, 3.5], [-2.0, 2.0, 3.5]]),
        ];
        assert_right(backend, "in a corner of three walls", &still_life([2.0, 0.0, 3.5], &walls));
        let touching = [-1.0, 1.0].map(|x| {
            json!({ "type": "sphere", "center": [x, 0.25, 3.5], "radius": 1, "material": {} })
        });
        let scene = still_life([0.0, 0.25, 3.5], &touching);
        assert_right(backend, "where two spheres touch", &scene);
        let planet = json!({ "type": "sphere", "center": [0, 6.371e6, 0], "radius": 6.371e6,
                             "material": { "diffusecolor": [0.8, 0.8, 0.8], "ka": 1 } });
        let scene = still_life([0.0, 0.0, 0.0], &[planet]);
        assert_right(backend, "on a planet, from inside", &scene);
    }
}
