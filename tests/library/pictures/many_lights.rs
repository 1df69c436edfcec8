//! Scenes in which each shading point draws some of the lights, compared with gathering all.

use lightpath::LoadedScene;
use serde_json::{Value, json};

use super::lifted_origins::OCTAHEDRON;

/// A room with a glossy ball and a mirror: point lights, lamps that shine to one side or to both,
/// panels in the ceiling, and a sun.
fn room(falloff: &str) -> Value {
    let mut lights = Vec::new();
    for i in 0..36u32 {
        let at = |k: u32| f64::from(i * k % 37) / 37.0;
        let (x, y, z) = (6.0 * at(5) - 3.0, 0.3 + 2.4 * at(11), 6.0 * at(17) - 3.0);
        let color = [0.1 + at(3), 0.1 + at(7), 0.1 + at(13)].map(|c| c / 8.0);
        let (group, s) = (["a", "b", "c"][i as usize % 3], 0.3);
        lights.push(match i % 4 {
            0 | 1 => json!({ "type": "pointlight", "position": [x, y, z], "id": color, "group": group }),
            2 => json!({ "type": "arealight", "v0": [x, y, z], "v1": [x + s, y, z], "v2": [x, y + s, z],
                         "id": color, "samples": 4, "group": group }),
            _ => {
                // Every other one lies in the ceiling.
                let y = if i % 8 == 3 { 3.0 } else { y };
                json!({ "type": "arealight", "v0": [x, y, z], "v1": [x + s, y, z], "v2": [x, y, z + s],
                        "id": color, "samples": 4, "emission": "lambertian", "group": group })
            }
        });
    }
    lights.push(
        json!({ "type": "sun", "azimuth": 30, "elevation": 20, "samples": 4, "id": [0.1, 0.1, 0.1],
                        "group": "sun" }),
    );
    let side = |y: f64| json!([[-4, y, -4], [4, y, -4], [4, y, 4], [-4, y, 4]]);
    let plane = |corners: Value, material: Value| {
        json!({ "type": "plane", "v0": corners[0], "v1": corners[1], "v2": corners[2], "v3": corners[3],
                "material": material })
    };
    json!({
        "spp": 4, "nbounces": 1,
        "camera": { "type": "pinhole", "width": 8, "height": 8, "fov": 70,
                    "position": [0.5, 1.6, 3.5], "lookat": [0, -0.25, -1], "up": [0, 1, 0] },
        "scene": { "attenuation": falloff, "lightsources": lights, "shapes": [
            plane(side(0.0), json!({ "kd": 0.8, "kr": 0.2 })),
            plane(side(3.0), json!({ "kd": 0.8 })),
            { "type": "sphere", "center": [-0.8, 0.9, 0], "radius": 0.9,
              "material": { "kd": 0.6, "ks": 0.4, "specularexponent": 12 } } ] }
    })
}

/// Mean by pixel and axis over 64 seeds, and its standard error.
fn means(scene: &Value, more: &[&str]) -> Vec<[f64; 2]> {
    let mut sums: Vec<[f64; 2]> = Vec::new();
    for seed in 0..64 {
        let seed = format!("/seed={seed}");
        let more = [more, &[&seed]].concat();
        let loaded = LoadedScene::from_json(&scene.to_string(), &more).unwrap();
        let film = loaded.renderer().unwrap().render().unwrap();
        let values = film.pixels.iter().flat_map(|pixel| &pixel[..3]).map(|&v| f64::from(v));
        let values: Vec<f64> = values.collect();
        // The last entry is the mean of the picture.
        let whole = values.iter().sum::<f64>() / values.len() as f64;
        sums.resize(values.len() + 1, [0.0; 2]);
        for (sum, value) in sums.iter_mut().zip(values.into_iter().chain([whole])) {
            *sum = [sum[0] + value / 64.0, sum[1] + value * value / 64.0];
        }
    }
    sums.iter()
        .map(|[mean, square]| [*mean, ((square - mean * mean).max(0.0) / 63.0).sqrt()])
        .collect()
}

#[test]
fn drawn_lights_have_the_mean_of_all_lights() {
    for falloff in ["none", "linear", "quadratic"] {
        let scene = room(falloff);
        let all = means(&scene, &["/spp=4"]);
        for (backend, draws) in [("bvh", 1), ("bvh", 5), ("embree", 1)] {
            let draws = format!("/emittersamples={draws}");
            let backend = format!("/scene/accelerator={backend}");
            let drawn = means(&scene, &[&draws, &backend]);
            let last = all.len() - 1;
            for (i, (a, b)) in all.iter().zip(&drawn).enumerate() {
                let error = a[1].hypot(b[1]) + 1e-5 * a[0];
                let bound = if i == last { 3.0 } else { 4.5 };
                assert!(
                    (a[0] - b[0]).abs() <= bound * error,
                    "{falloff} {draws} {backend} {i}: {a:?} {b:?}"
                );
            }
            assert!(all[last][1] < 0.01 * all[last][0] && drawn[last][1] < 0.02 * drawn[last][0]);
        }
    }
}

/// Shadow rays from a coarse smooth mesh start outside of it, nearer to the lights. The light that
/// the lamps emit towards the mesh is that towards the mesh itself.
#[test]
fn drawn_lamps_near_a_coarse_smooth_mesh_have_the_mean_of_all() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("octahedron.ply");
    std::fs::write(&path, OCTAHEDRON).unwrap();
    let lamp = |x: f64, y: f64| {
        json!({ "type": "arealight", "v0": [x, y, 0.8], "v1": [x, y + 0.1, 0.8],
                "v2": [x + 0.1, y, 0.8], "id": [1, 1, 1], "emission": "lambertian" })
    };
    let scene = json!({
        "spp": 64,
        "camera": { "type": "pinhole", "width": 8, "height": 8, "fov": 15,
                    "position": [4, 4, 4], "target": [0.33, 0.33, 0.33], "up": [0, 0, 1] },
        "scene": { "lightsources": [lamp(0.0, 0.5), lamp(0.5, 0.0), lamp(0.5, 0.5)], "shapes": [
            { "type": "trimesh", "path": path, "smooth": true, "material": {} } ] }
    });
    let (all, drawn) = (means(&scene, &[]), means(&scene, &["/emittersamples=1"]));
    let ([a, a_error], [b, b_error]) = (all[all.len() - 1], drawn[drawn.len() - 1]);
    assert!((a - b).abs() < 3.0 * a_error.hypot(b_error) + 1e-5 * a, "{a} {b} {b_error}");
    assert!(a > 0.01 && b_error < 0.005 * b, "{a} {b} {b_error}");
}

/// Lights of negative colour take light away. Some have only one channel below 0.
#[test]
fn drawn_lights_may_be_negative() {
    let mut scene = room("linear");
    for (i, light) in scene["scene"]["lightsources"].as_array_mut().unwrap().iter_mut().enumerate()
    {
        match i % 5 {
            0 => light["id"] = json!([-0.03, -0.05, -0.01]),
            1 => light["id"] = json!([-0.2, 0.01, 0]),
            _ => {}
        }
    }
    let (all, drawn) = (means(&scene, &[]), means(&scene, &["/emittersamples=5"]));
    let last = all.len() - 1;
    for (i, (a, b)) in all.iter().zip(&drawn).enumerate() {
        let error = a[1].hypot(b[1]) + 1e-5 * a[0].abs();
        let bound = if i == last { 3.0 } else { 4.5 };
        assert!((a[0] - b[0]).abs() <= bound * error, "{i}: {a:?} {b:?}");
    }
}

#[test]
fn as_many_draws_as_lights_gather_all() {
    let scene = room("linear");
    let picture = |more: &[&str]| {
        let loaded = LoadedScene::from_json(&scene.to_string(), more).unwrap();
        loaded.renderer().unwrap().render().unwrap().pixels
    };
    let all = picture(&[]);
    assert_eq!(all, picture(&["/emittersamples=36"]));
    assert_ne!(all, picture(&["/emittersamples=35"]));
}

#[test]
fn shadow_catchers_gather_all_lights() {
    let mut scene = room("quadratic");
    scene["scene"]["shapes"][0]["shadow_catcher"] = json!(true);
    // No camera ray hits anything else.
    scene["camera"]["lookat"] = json!([0, -1, -0.2]);
    scene["camera"]["fov"] = json!(20);
    let picture = |more: &[&str]| {
        let loaded = LoadedScene::from_json(&scene.to_string(), more).unwrap();
        loaded.renderer().unwrap().render().unwrap().pixels
    };
    let all = picture(&[]);
    assert!(all.iter().all(|pixel| pixel[3] > 0.0));
    assert_eq!(all, picture(&["/emittersamples=2"]));
}
