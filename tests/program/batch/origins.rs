//! Frames far apart: each has the origin of coordinates that a render of its own camera would have.

use serde_json::{Value, json};

use crate::support::program::Scratch;

/// Distance between the two halves of the scene: too far for one origin in single precision.
const FAR: f64 = 4e6;

/// A ball with its light at 0, and another at [`FAR`].
fn scene() -> String {
    let ball =
        |x: f64| json!({ "type": "sphere", "center": [x, 0, 0], "radius": 1, "material": {} });
    let light = |x: f64| json!({ "type": "pointlight", "position": [x, 3, 3], "id": [20, 20, 20] });
    let shapes = [ball(0.0), ball(FAR)];
    json!({ "spp": 1, "camera": camera(0.0, 3.0),
            "scene": { "shapes": shapes, "lightsources": [light(0.0), light(FAR)] } })
    .to_string()
}

/// A camera in front of a ball, or behind it if `z` is negative.
fn camera(x: f64, z: f64) -> Value {
    json!({ "type": "pinhole", "width": 24, "height": 16, "fov": 50,
            "position": [x, 0, z], "target": [x, 0, 0], "up": [0, 1, 0] })
}

/// Writes a list of cameras at these places.
fn list(scratch: &Scratch, name: &str, places: &[(&str, f64)]) {
    let camera = |(image, x): &(&str, f64)| json!({ "image": image, "camera": camera(*x, 3.0) });
    let all = json!({ "cameras": places.iter().map(camera).collect::<Vec<_>>() });
    scratch.write(name, &all.to_string());
}

#[test]
fn a_frame_does_not_depend_on_the_other_cameras_of_the_list() {
    let scratch = Scratch::new();
    scratch.write("s.json", &scene());
    list(&scratch, "b.json", &[("b", FAR)]);
    list(&scratch, "aba.json", &[("a", 0.0), ("b", FAR), ("c", 0.0)]);
    list(&scratch, "ba.json", &[("b", FAR), ("a", 0.0)]);
    let args = ["batch", "s.json", "--max-memory", "200M", "--cameras"];
    for name in ["b", "aba", "ba"] {
        let cameras = format!("{name}.json");
        let said = scratch.run(&[&args[..], &[&cameras, "-o", name]].concat()).good().stderr();
        assert!(!said.contains("of a pixel"), "{name}: {said}");
    }
    let alone = scratch.channels("b/s/b.exr");
    assert!(scratch.channels("aba/s/b.exr") == alone && scratch.channels("ba/s/b.exr") == alone);
    let first = scratch.channels("ba/s/a.exr");
    assert!(scratch.channels("aba/s/a.exr") == first && scratch.channels("aba/s/c.exr") == first);
    let flags = ["--set", &format!("/camera={}", camera(FAR, 3.0)), "-o", "own", "--quiet"];
    scratch.run(&[&["render", "s.json"], &flags[..]].concat()).good();
    assert!(scratch.channels("own.exr") == alone);
    // Frames `a` and `c` share a world.
    let journal = String::from_utf8(scratch.read("aba/batch.jsonl")).unwrap();
    assert_eq!(journal.matches(r#""event":"mesh""#).count(), 2);
}

#[test]
fn a_frame_of_a_turntable_gets_an_origin_that_does_not_blur_it() {
    let scratch = Scratch::new();
    scratch.write("s.json", &scene());
    let middle = format!("{},0,0", FAR / 2.0);
    let turn = ["--turntable", "2", "--turn", "camera", "--pivot", &middle, "-o", "out"];
    let said = scratch.run(&[&["batch", "s.json"], &turn[..]].concat()).good().stderr();
    assert!(!said.contains("of a pixel"), "{said}");
    let flags = ["--set", &format!("/camera={}", camera(FAR, -3.0)), "-o", "own", "--quiet"];
    scratch.run(&[&["render", "s.json"], &flags[..]].concat()).good();
    let differ = ["compare", "out/s/s.0001.exr", "own.exr", "--fail-above", "rmse=1e-3"];
    scratch.run(&differ).good();
}
