//! Warnings about lights that give an unexpected picture.

use lightpath::LoadedScene;
use serde_json::{Value, json};

/// Returns the warnings of a scene with one sphere and one light.
fn warnings(camera: Value, light: Value) -> Vec<String> {
    let scene = json!({ "camera": camera, "scene": { "lightsources": [light], "shapes": [
        { "type": "sphere", "center": [0, 0, 0], "radius": 1, "material": {} }] } });
    let loaded = LoadedScene::from_json(&scene.to_string(), &[]).unwrap();
    loaded.warnings().iter().map(ToString::to_string).collect()
}

fn camera(position: [f64; 3], up: [f64; 3]) -> Value {
    json!({ "type": "pinhole", "width": 8, "height": 8, "fov": 40, "position": position,
            "target": [0, 0, 0], "up": up })
}

#[test]
fn a_light_that_faces_away_from_every_shape() {
    let light = |z: f64, turned: bool, emission: &str| {
        let (v1, v2) = ([1.0, 0.0, z], [0.0, 1.0, z]);
        let (v1, v2) = if turned { (v2, v1) } else { (v1, v2) };
        json!({ "type": "arealight", "v0": [0.0, 0.0, z], "v1": v1, "v2": v2, "id": [1, 1, 1],
                "emission": emission })
    };
    let told = |light| warnings(camera([0.0, 0.0, 9.0], [0.0, 1.0, 0.0]), light);
    let away = told(light(3.0, false, "lambertian"));
    assert!(
        away.len() == 1
            && away[0].starts_with("/scene/lightsources/0: emits away from every shape")
            && away[0].contains("swap `v1` and `v2`"),
        "{away:?}"
    );
    // It touches the sphere from outside, then cuts a piece off.
    assert_eq!(told(light(1.0, false, "lambertian")).len(), 1);
    assert_eq!(told(light(0.999, false, "lambertian")), [""; 0]);
    assert_eq!(told(light(3.0, true, "lambertian")), [""; 0]);
    assert_eq!(told(light(3.0, false, "uniform")), [""; 0]);
    // Between lights that the sphere is in front of, on both of its sides.
    let several = json!({ "camera": camera([0.0, 0.0, 9.0], [0.0, 1.0, 0.0]), "scene": {
        "lightsources": [light(3.0, true, "lambertian"), light(-3.0, false, "lambertian"),
            light(3.0, false, "lambertian"), light(3.0, true, "lambertian")],
        "shapes": [{ "type": "sphere", "center": [0, 0, 0], "radius": 1, "material": {} }] } });
    let loaded = LoadedScene::from_json(&several.to_string(), &[]).unwrap();
    let told: Vec<String> = loaded.warnings().iter().map(ToString::to_string).collect();
    assert!(told.len() == 1 && told[0].starts_with("/scene/lightsources/2: emits"), "{told:?}");
}

#[test]
fn a_sky_whose_up_is_not_the_cameras() {
    let sun = json!({ "type": "sun", "azimuth": 0, "elevation": 40, "irradiance": [1, 1, 1] });
    let (aside, above) = ([0.0, -6.0, 2.0], [0.0, 6.0, 0.0]);
    let (y, z) = ([0.3, 1.0, 0.0], [0.0, 0.1, 1.0]);
    let told = warnings(camera(aside, z), sun.clone());
    let expected =
        "(/scene/lightsources/0/elevation): y is up in the sky, but the camera's `up` is mainly z";
    assert!(told.len() == 1 && told[0].contains(expected), "{told:?}");
    assert_eq!(warnings(camera([1.0, 2.0, 6.0], y), sun.clone()), [""; 0]);
    // A plan of a scene whose y is up, and its zenith.
    assert_eq!(warnings(camera(above, z), sun.clone()), [""; 0]);
    assert_eq!(warnings(camera([0.1, -6.0, 0.0], z), sun.clone()), [""; 0]);
    // The same camera in a scene whose y is up, with the `up` of its picture.
    for pitch in [30.0f64, 50.0, 60.0, 75.0, 80.0] {
        let (sin, cos) = pitch.to_radians().sin_cos();
        let (above, below) = ([0.0, 5.0 * sin, 5.0 * cos], [0.0, -5.0 * sin, 5.0 * cos]);
        assert_eq!(warnings(camera(above, [0.0, cos, -sin]), sun.clone()), [""; 0]);
        assert_eq!(warnings(camera(below, [0.0, cos, sin]), sun.clone()), [""; 0]);
    }
    // Steep views in a scene whose z is up. In one whose y is up, -z is at the top from above.
    assert_eq!(warnings(camera([0.0, 6.0, 2.0], [0.0, 0.0, 1.0]), sun.clone()).len(), 1);
    assert_eq!(warnings(camera([0.0, 6.0, 2.0], [0.0, 0.0, -1.0]), sun.clone()), [""; 0]);
    // A camera that is rolled cannot be told apart.
    let rolled = warnings(camera([0.0, 0.0, 5.0], [1.0, 0.0, 0.0]), sun.clone());
    assert!(rolled.len() == 1 && rolled[0].contains("is x up in the scene?"), "{rolled:?}");
    let by_direction = json!({ "type": "sun", "direction": [0, 0, -1], "irradiance": [1, 1, 1] });
    assert_eq!(warnings(camera(aside, z), by_direction), [""; 0]);
    let even = json!({ "type": "environment", "radiance": [1, 1, 1] });
    assert_eq!(warnings(camera(aside, z), even), [""; 0]);
    // The `up` of a matrix says nothing about the scene.
    let matrix = json!({ "type": "intrinsics", "width": 8, "height": 8, "fx": 9,
        "camera_to_world": [[1, 0, 0, 0], [0, 0, 1, -6], [0, -1, 0, 0], [0, 0, 0, 1]] });
    assert_eq!(warnings(matrix, sun), [""; 0]);

    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("sky.hdr");
    image::Rgb32FImage::from_pixel(4, 2, image::Rgb([1.0; 3])).save(&path).unwrap();
    let image = json!({ "type": "environment", "image": path });
    let told = warnings(camera(aside, z), image);
    assert!(told.len() == 1 && told[0].contains("0/image): y is up"), "{told:?}");
}
