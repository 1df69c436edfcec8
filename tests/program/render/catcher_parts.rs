//! Shadow catchers under lights of many kinds: parts of the samples merge to the whole, wherever
//! they are cut. The alpha of a sample depends on no other sample of its packet.

use crate::support::program::Scratch;
use serde_json::{Value, json};

/// A square light of half side `half` over (x, z), facing down.
fn area(points: u32, color: f64, half: f64, [x, y, z]: [f64; 3]) -> Value {
    json!({ "type": "arealight", "v0": [x - half, y, z - half], "v1": [x + half, y, z - half],
        "v2": [x - half, y, z + half], "id": [color, color, color], "is": [color, color, color],
        "samples": points })
}

/// By name: lights whose points are nearly equal for some samples of a packet, and not for others.
fn lights() -> [(&'static str, Value); 5] {
    let above = [0.0, 2.5, 0.0];
    let grid = (0..9).map(|i| [(i / 3 - 1) as f64 * 3.0, 2.5, (i % 3 - 1) as f64 * 3.0]);
    let many: Vec<_> = grid.map(|at| area(4, 0.2, 1.0, at)).collect();
    [
        ("one point", json!([area(1, 1.0, 3.0, [0.0, 1.5, 0.0])])),
        ("four points", json!(many)),
        ("sixteen points", json!([area(16, 1.0, 1.0, above)])),
        ("negative", json!([area(4, 2.0, 1.0, above), area(1, -1.0, 1.0, [1.0, 2.5, 0.0])])),
        ("environment", json!([{ "type": "environment", "image": "sky.ppm", "samples": 2 }])),
    ]
}

/// A ball on a glossy catcher.
fn scene(lights: &Value) -> Value {
    json!({
        "camera": { "type": "pinhole", "width": 31, "height": 22, "fov": 50,
            "position": [0, 3, 5], "lookat": [0, -0.5, -1], "up": [0, 1, 0] },
        "scene": { "lightsources": lights, "shapes": [
            { "type": "sphere", "center": [0.3, 0.5, 0.2], "radius": 0.5, "material": {} },
            { "type": "plane", "v0": [-6, 0, 6], "v1": [6, 0, 6], "v2": [6, 0, -6],
              "v3": [-6, 0, -6], "shadow_catcher": true,
              "material": { "kd": 0.7, "ks": 0.4, "specularexponent": 40 } }] }
    })
}

fn scratch(lights: &Value) -> Scratch {
    let scratch = Scratch::new();
    scratch.write("s.json", &scene(lights).to_string());
    let row = "120 120 120 255 255 255 180 180 180 90 90 90";
    scratch.write("sky.ppm", &format!("P3 4 2 255 {row} {row}\n"));
    scratch
}

#[track_caller]
fn render(scratch: &Scratch, name: &str, spp: &str, flags: &[&str]) {
    let all = ["render", "s.json", "--quiet", "--float", "--spp", spp];
    scratch.run(&[&all[..], flags, &["-o", name]].concat()).good();
}

#[test]
fn samples_cut_anywhere_merge_to_the_bytes_of_one_render() {
    for (name, lights) in lights() {
        let scratch = scratch(&lights);
        // 16 samples of one pixel share a packet, or 4 samples of each of 4 pixels.
        // Without layers and bounces, the samples of a packet may come in any order.
        let cases = [
            ("16", ["0..5", "5..16"], ["--aov", "shadow"]),
            ("16", ["0..5", "5..16"], ["--nbounces", "0"]),
            ("6", ["0..3", "3..6"], ["--aov", "shadow"]),
        ];
        for (spp, ranges, flags) in cases {
            render(&scratch, "whole", spp, &flags);
            for (part, range) in ["a", "b"].iter().zip(ranges) {
                render(&scratch, part, spp, &[&flags[..], &["--samples", range]].concat());
            }
            scratch.run(&["merge", "a.exr", "b.exr", "-o", "merged", "--quiet"]).good();
            let [whole, merged] = ["whole.exr", "merged.exr"].map(|file| scratch.read(file));
            assert!(whole == merged, "{name}, {spp} samples: {ranges:?}, {flags:?}");
        }
    }
}
