//! Closed forms compared with the film before any file format rounds it: to 1e-6 in f32.

use std::path::Path;

use crate::support::backends::{self, on_both};
use crate::support::errors::worse;
use crate::support::reference::analytic::{
    LitSphere, facing_mirrors, plane_coordinates, polygon_irradiance,
};
use lightpath::{
    film::{Film, Window},
    monitor::Monitor,
    render::{self, RayCounts},
    scene::{self, Backend, Source},
    simd::Isa,
    world::{LoadOptions, World},
};
use serde_json::{Value, json};

/// Renders a scene through the library.
fn film(backend: Backend, scene: &Value, isa: Isa) -> (Film, RayCounts) {
    let text = scene.to_string();
    let source = Source::Text { name: "s.json", text: text.as_bytes(), folder: Path::new("") };
    let scene = scene::load(source, &[]).unwrap().scene;
    let monitor = Monitor::default();
    let (world, _) = World::load(&scene, LoadOptions::default(), &monitor).unwrap();
    let accelerator = backends::build(&world.geometry, backend);
    let [width, height] = world.frame;
    let mut film = Film::new(world.frame, Window::full(width, height)).unwrap();
    let counts = render::render(&world, &*accelerator, isa, &mut film, &monitor).unwrap();
    (film, counts)
}

/// Returns the largest difference between the film and `expected(i, j)`, relative (absolute below
/// 1).
fn worst(film: &Film, expected: impl Fn(usize, usize) -> Option<[f64; 3]>) -> f64 {
    let width = film.frame[0] as usize;
    let mut worst = 0f64;
    for (k, pixel) in film.pixels.iter().enumerate() {
        if let Some(expected) = expected(k % width, k / width) {
            for c in 0..3 {
                let error = (f64::from(pixel[c]) - expected[c]).abs() / expected[c].abs().max(1.0);
                worst = worse(worst, error);
            }
        }
    }
    worst
}

on_both! {
    fn a_unit_sphere_under_a_point_light(backend: Backend) {
        for (falloff, word) in ["none", "linear", "quadratic"].into_iter().enumerate() {
            for isa in Isa::compiled() {
                let (eye, light) = (4.0, [3.0, 2.0, 5.0]);
                // A highlight multiplies the error of the f32 camera ray by its exponent.
                let (kd, ks, specularexponent) = (0.75, 0.5, 8.0);
                let scene = json!({
                    "camera": { "type": "pinhole", "width": 65, "height": 63, "fov": 35,
                                "position": [0, 0, eye], "lookat": [0, 0, -1], "up": [0, 1, 0] },
                    "scene": {
                        "attenuation": word,
                        "lightsources": [{ "type": "pointlight", "position": light, "id": [1, 1, 1] }],
                        "shapes": [{ "type": "sphere", "center": [0, 0, 0], "radius": 1, "material":
                            { "kd": kd, "ks": ks, "specularexponent": specularexponent } }],
                    }
                });
                let (film, counts) = film(backend, &scene, *isa);
                assert_eq!(counts.primary, 65 * 63);
                let sphere =
                    LitSphere { eye, light, kd, ks, specularexponent, falloff: falloff as i32 };
                let at = |i, j| {
                    let (px, py) = plane_coordinates(i, j, (65, 63), 35.0);
                    // At the silhouette and the edge of the light, rounding decides.
                    let clear = |p: f64, q: f64| sphere.radiance(px + p, py + q).is_some();
                    let edge =
                        clear(1e-3, 0.0) != clear(-1e-3, 0.0) || clear(0.0, 1e-3) != clear(0.0, -1e-3);
                    (!edge).then(|| [sphere.radiance(px, py).unwrap_or(0.0); 3])
                };
                let worst = worst(&film, at);
                assert!(worst < 1e-6, "{word}, {isa}: {worst:e}");
            }
        }
    }
}

on_both! {
    fn mirrors_show_the_background_exactly(backend: Backend) {
        let background = [0.1, 0.7, 1.3];
        for shape in [
            json!({ "type": "sphere", "center": [0, 0, 0], "radius": 3, "material": { "kd": 0, "kr": 0.5 } }),
            json!({ "type": "plane", "v0": [-9, 9, 0], "v1": [9, 9, 0], "v2": [9, -9, 0],
                    "v3": [-9, -9, 0], "material": { "kd": 0, "kr": 0.5 } }),
        ] {
            let scene = json!({
                "camera": { "type": "pinhole", "width": 32, "height": 32, "fov": 30,
                            "position": [0, 0, 5], "lookat": [0, 0, -1], "up": [0, 1, 0] },
                "scene": { "backgroundcolor": background, "shapes": [shape] }
            });
            let (film, counts) = film(backend, &scene, Isa::detect());
            assert_eq!(counts.reflection, 32 * 32);
            for pixel in film.pixels.iter() {
                let [r, g, b] = background.map(|c: f64| 0.5 * c as f32);
                assert_eq!(*pixel, [r, g, b, 1.0]);
            }
        }
    }
}

on_both! {
    fn facing_mirrors_sum_to_a_geometric_series(backend: Backend) {
        let wall = |z: f64| {
            json!({ "type": "plane", "v0": [-90, 90, z], "v1": [90, 90, z], "v2": [90, -90, z],
                    "v3": [-90, -90, z], "material": { "kd": 0, "ka": 0.5, "kr": 0.75 } })
        };
        for nbounces in [0, 1, 7, 30] {
            let scene = json!({
                "nbounces": nbounces,
                "camera": { "type": "pinhole", "width": 8, "height": 8, "fov": 60,
                            "position": [0, 0, 1], "lookat": [0, 0, -1], "up": [0, 1, 0] },
                "scene": { "ambient": [1, 1, 1], "shapes": [wall(0.0), wall(2.0)] }
            });
            let (film, _) = film(backend, &scene, Isa::detect());
            let expected = facing_mirrors(0.5, 0.75, nbounces);
            assert!(worst(&film, |_, _| Some([expected; 3])) < 1e-6, "{nbounces} bounces");
        }
    }
}

on_both! {
    fn a_plane_under_an_area_light_has_its_form_factor(backend: Backend) {
        // 65536 well-distributed points on a light that is far enough away for a smooth integrand.
        let (radiance, area) = (3.0, 1.0);
        let id = radiance * area / std::f64::consts::PI;
        let scene = json!({
            "camera": { "type": "pinhole", "width": 8, "height": 8, "fov": 60,
                        "position": [0, 1, 0], "lookat": [0, -1, 0], "up": [0, 0, -1] },
            "scene": {
                "attenuation": "quadratic",
                "lightsources": [{ "type": "arealight", "emission": "lambertian", "samples": 65536,
                    "v0": [-0.5, 2, -0.5], "v1": [0.5, 2, -0.5], "v2": [0.5, 2, 0.5], "id": [id, id, id] }],
                "shapes": [{ "type": "plane", "v0": [-9, 0, -9], "v1": [9, 0, -9], "v2": [9, 0, 9],
                    "v3": [-9, 0, 9], "material": {} }],
            }
        });
        let (film, _) = film(backend, &scene, Isa::detect());
        let light = [[-0.5, 2.0, -0.5], [0.5, 2.0, -0.5], [0.5, 2.0, 0.5], [-0.5, 2.0, 0.5]];
        let at = |i, j| {
            let (px, py) = plane_coordinates(i, j, (8, 8), 60.0);
            let irradiance = polygon_irradiance([px, 0.0, -py], [0.0, 1.0, 0.0], &light);
            Some([radiance * irradiance / std::f64::consts::PI; 3])
        };
        let worst = worst(&film, at);
        assert!(worst < 2e-5, "{worst:e}");
    }
}
