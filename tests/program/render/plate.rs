//! Foregrounds for a plate through the program: parts, crops, `--over`, refusals.

use std::io::Cursor;

use crate::support::program::{Done, Refusals, Scratch};

/// A ball and an invisible ball on a catcher, behind a holdout.
const SCENE: &str = r#"{
  "spp": 16,
  "camera": { "type": "pinhole", "width": 40, "height": 30, "fov": 45,
              "position": [0, 3, 4], "target": [0, 0, 0], "up": [0, 1, 0] },
  "scene": {
    "ambient": [0.1, 0.1, 0.2],
    "lightsources": [
      { "type": "arealight", "v0": [-2, 4, 0], "v1": [-1, 4, 0], "v2": [-2, 4, 1],
        "id": [3, 3, 2], "samples": 20, "name": "key" },
      { "type": "pointlight", "position": [3, 3, 2], "id": [1, 1, 1], "name": "fill" }],
    "shapes": [
      { "type": "plane", "v0": [-3, 0, 2], "v1": [3, 0, 2], "v2": [3, 0, -2], "v3": [-3, 0, -2],
        "shadow_catcher": true, "material": { "ka": 1 } },
      { "type": "sphere", "center": [0, 0.5, 0], "radius": 0.5, "material": { "kr": 0.3 } },
      { "type": "sphere", "center": [1.3, 0.6, 0], "radius": 0.4, "material": {},
        "visible": { "camera": false } },
      { "type": "sphere", "center": [-0.4, 0.4, 1], "radius": 0.3, "material": {},
        "holdout": true }]
  },
  "tonemap": { "operator": "clamp" }
}"#;

fn scratch() -> Scratch {
    let scratch = Scratch::new();
    scratch.write("s.json", SCENE);
    scratch
}

#[track_caller]
fn render(scratch: &Scratch, name: &str, flags: &[&str]) -> Done {
    scratch.run(&[&["render", "s.json", "--quiet", "-o", name], flags].concat()).good()
}

/// Decodes a PNG of 16 bits: colour type and samples.
fn png(scratch: &Scratch, name: &str) -> (png::ColorType, Vec<u16>) {
    let mut reader = png::Decoder::new(Cursor::new(scratch.read(name))).read_info().unwrap();
    let mut bytes = vec![0; reader.output_buffer_size().unwrap()];
    let info = reader.next_frame(&mut bytes).unwrap();
    assert_eq!(info.bit_depth, png::BitDepth::Sixteen);
    let pairs = bytes[..info.buffer_size()].chunks_exact(2);
    (info.color_type, pairs.map(|two| u16::from_be_bytes([two[0], two[1]])).collect())
}

#[test]
fn parts_threads_and_crops_give_the_same_bits() {
    let scratch = scratch();
    for shadows in [&[][..], &["--adaptive-shadows"]] {
        let all = [&["--aov", "all"], shadows].concat();
        render(&scratch, "whole", &[&all[..], &["--threads", "1", "--spp", "32"]].concat());
        for (name, range) in [("a", "0..16"), ("b", "16..32")] {
            let part = ["--samples", range, "--of", "32", "--threads", "2"];
            render(&scratch, name, &[&all[..], &part].concat());
        }
        scratch.run(&["merge", "a.exr", "b.exr", "-o", "merged", "--quiet"]).good();
        for end in ["exr", "png"] {
            let [whole, merged] = ["whole", "merged"].map(|n| scratch.read(&format!("{n}.{end}")));
            assert!(whole == merged, "{end} {shadows:?}");
        }
    }
    let noise = ["--noise", "0.1", "--float", "--aov", "shadow,samples"];
    render(&scratch, "noise", &[&noise[..], &["--threads", "1"]].concat());
    render(&scratch, "again", &[&noise[..], &["--threads", "2"]].concat());
    assert!(scratch.read("noise.exr") == scratch.read("again.exr"));
    render(&scratch, "crop", &[&noise[..], &["--crop", "9", "5", "31", "22"]].concat());
    let (whole, crop) = (scratch.floats("noise.exr"), scratch.floats("crop.exr"));
    for (name, values) in &crop {
        for (i, value) in values.iter().enumerate() {
            let (x, y) = (9 + i % 22, 5 + i / 22);
            assert_eq!(value.to_bits(), whole[name][40 * y + x].to_bits(), "{name} {x} {y}");
        }
    }
    // Alpha is noise, too: penumbras get more samples than the lit ground.
    let most = whole["samples.Y"].iter().copied().fold(0.0, f32::max);
    let lit = whole["A"].iter().zip(&whole["samples.Y"]).filter(|(alpha, _)| **alpha == 0.0);
    assert!(most > 16.0 && lit.clone().count() > 100);
    // The darkest shadow of the key light is on the ground alone: its alpha is the sum over the
    // lights.
    let shadow = &whole["shadow_key.A"];
    let darkest = (0..40 * 30).max_by(|&a, &b| shadow[a].total_cmp(&shadow[b])).unwrap();
    let parts = ["shadow_key.A", "shadow_fill.A"].map(|name| whole[name][darkest]);
    assert!(parts[0] > 0.1 && (parts[0] + parts[1] - whole["A"][darkest]).abs() < 1e-5);
}

#[test]
fn the_png_may_show_the_picture_over_a_plate() {
    let scratch = scratch();
    let texel = |i: usize| [i * 7 % 256, i * 3 % 256, 255 - i % 200].map(|v| v as u8);
    let texels: Vec<[u8; 3]> = (0..40 * 30).map(texel).collect();
    let mut bytes = Vec::new();
    let mut encoder = png::Encoder::new(&mut bytes, 40, 30);
    encoder.set_color(png::ColorType::Rgb);
    encoder.write_header().unwrap().write_image_data(texels.as_flattened()).unwrap();
    std::fs::write(scratch.path("plate.png"), bytes).unwrap();

    let common = ["--transparent", "--png-bits", "16", "--float"];
    render(&scratch, "plain", &common);
    render(&scratch, "over", &[&common[..], &["--over", "plate.png"]].concat());
    assert!(scratch.read("plain.exr") == scratch.read("over.exr"), "the EXR is the foreground");
    let (kind, samples) = png(&scratch, "over.png");
    assert_eq!(kind, png::ColorType::Rgb);
    let pixels = scratch.rgba("over.exr");
    let decode = |x: f64| if x <= 0.04045 { x / 12.92 } else { ((x + 0.055) / 1.055).powf(2.4) };
    let encode = |x: f64| {
        if x <= 0.0031308 { 12.92 * x } else { 1.055 * x.powf(1.0 / 2.4) - 0.055 }
    };
    let mut seen = [false; 2];
    for (i, texel) in texels.iter().enumerate() {
        let pixel = pixels[i / 40][i % 40].map(f64::from);
        seen = [seen[0] || pixel[3] == 0.0, seen[1] || pixel[3] > 0.2 && pixel[0] == 0.0];
        for axis in 0..3 {
            let plate = decode(f64::from(texel[axis]) / 255.0);
            let over = pixel[axis] + (1.0 - pixel[3]) * plate;
            let expected = 65535.0 * encode(over.clamp(0.0, 1.0));
            let found = f64::from(samples[3 * i + axis]);
            assert!((found - expected).abs() < 1.0, "{i} {axis}: {found} {expected}");
        }
    }
    assert_eq!(seen, [true; 2]);
    // A crop shows its part of the plate. An EXR is a plate, too.
    let crop = ["--crop", "3", "4", "20", "25", "--over", "plate.png"];
    render(&scratch, "crop", &[&common[..], &crop].concat());
    let (_, cropped) = png(&scratch, "crop.png");
    for (i, three) in cropped.chunks_exact(3).enumerate() {
        let at = 3 * (40 * (4 + i / 17) + 3 + i % 17);
        assert_eq!(three, &samples[at..at + 3], "{i}");
    }
    let flags = [&common[..], &["--over", "plain.exr"]].concat();
    render(&scratch, "twice", &flags);
    // A plate is opaque: the alpha of the first picture, now the plate, does not count.
    assert_eq!(png(&scratch, "twice.png").0, png::ColorType::Rgb);
}

#[test]
fn alpha_and_negative_texels_of_a_plate_are_told() {
    let scratch = scratch();
    let said = |plate: &str| {
        let args = ["render", "s.json", "-o", "o", "--spp", "1", "--over", plate];
        scratch.run(&args).good().stderr()
    };
    let mut bytes = Vec::new();
    let mut encoder = png::Encoder::new(&mut bytes, 40, 30);
    encoder.set_color(png::ColorType::Rgba);
    encoder.write_header().unwrap().write_image_data(&[99; 4 * 40 * 30]).unwrap();
    std::fs::write(scratch.path("alpha.png"), bytes).unwrap();
    assert!(said("alpha.png").contains("--over: the alpha channel of alpha.png is ignored"));
    let red = |x, y| if (x, y) == (7, 2) { -0.5f32 } else { 0.5 };
    let pixels = |x, y| (red(x, y), 0.5f32, 0.5f32);
    exr::prelude::write_rgb_file(scratch.path("dark.exr"), 40, 30, pixels).unwrap();
    let dark = said("dark.exr");
    let expected = "--over: found 1 negative texel in dark.exr, the first at (7, 2)";
    assert!(dark.contains(expected) && !dark.contains("alpha"), "{dark}");
}

/// Writes a grey PNG of linear values.
fn linear_png(scratch: &Scratch, name: &str, value: u8) {
    let mut bytes = Vec::new();
    let mut encoder = png::Encoder::new(&mut bytes, 40, 30);
    encoder.set_source_gamma(png::ScaledFloat::new(1.0));
    encoder.write_header().unwrap().write_image_data(&[value; 40 * 30]).unwrap();
    std::fs::write(scratch.path(name), bytes).unwrap();
}

#[test]
fn a_plate_of_linear_values_is_as_bright_as_it_says() {
    let scratch = scratch();
    linear_png(&scratch, "linear.png", 51);
    exr::prelude::write_rgb_file(scratch.path("same.exr"), 40, 30, |_, _| (0.2f32, 0.2f32, 0.2f32))
        .unwrap();
    for (name, plate) in [("a", "linear.png"), ("b", "same.exr")] {
        render(&scratch, name, &["--transparent", "--over", plate]);
    }
    assert!(scratch.read("a.png") == scratch.read("b.png"));
}

#[test]
fn a_gamma_that_a_texture_ignores_is_told() {
    let scratch = Scratch::new();
    linear_png(&scratch, "linear.png", 51);
    let said = |material: &str| {
        let material = format!(r#""material": {{ "tPath": "linear.png"{material} }}"#);
        let scene = SCENE.replace(r#""material": { "kr": 0.3 }"#, &material);
        assert_ne!(scene, SCENE);
        scratch.write("s.json", &scene);
        scratch.run(&["render", "s.json", "-o", "o", "--spp", "1"]).good().stderr()
    };
    let warned = said("");
    let expected = "the gAMA chunk of linear.png (1) is ignored: it is read as sRGB";
    assert!(warned.contains(expected) && warned.contains("`colorspace`"), "{warned}");
    for space in ["srgb", "linear"] {
        let said = said(&format!(r#", "colorspace": "{space}""#));
        assert!(!said.contains("gAMA"), "{said}");
    }
}

#[test]
fn contradictions_are_refused_before_anything_is_written() {
    let refusals = Refusals::new();
    let write = |name: &str, text: &str| refusals.scratch.write(name, text);
    write("s.json", SCENE);
    let opaque =
        SCENE.replace("\"shadow_catcher\": true, ", "").replace(",\n        \"holdout\": true", "");
    write("opaque.json", &opaque);
    write("plate.ppm", "P3 2 1 255 0 0 0 9 9 9\n");
    let refused = |file: &str, flags: &[&str], expected: &[&str]| {
        let done = refusals.render(file, flags);
        assert_eq!(done.code(), 2, "{}", done.stderr());
        for text in expected {
            assert!(done.stderr().contains(text), "{text}: {}", done.stderr());
        }
    };
    refused("s.json", &["--over", "plate.ppm"], &["--over: found plate.ppm", "2 x 1", "40 x 30"]);
    refused("s.json", &["--over", "missing.png"], &["missing.png"]);
    refused("opaque.json", &["--over", "plate.ppm"], &["--over: ", "alpha is 1", "--transparent"]);
    let part = ["--over", "plate.ppm", "--tile", "1/2"];
    refused("s.json", &part, &["--over: ", "part of a picture"]);
    refused("s.json", &["--over", "plate.ppm", "--overscan", "4"], &["--over: ", "--overscan"]);
    let set = |value: &str| format!("/scene/shapes/{value}");
    for (value, expected) in [
        ("0/holdout=true", &["/scene/shapes/0/shadow_catcher", "with `holdout`"][..]),
        (
            r#"0/visible={"camera":false}"#,
            &["/scene/shapes/0/shadow_catcher", "`visible.camera` false"],
        ),
        (r#"3/visible={"camera":false}"#, &["/scene/shapes/3/holdout", "`visible.camera` false"]),
        (r#"1/visible={"shadows":false}"#, &["unknown key \"shadows\"", "did you mean `shadow`?"]),
        (r#"1/visible=false"#, &["/scene/shapes/1/visible", "expected an object"]),
        (r#"1/holdout="yes""#, &["/scene/shapes/1/holdout", "expected true or false"]),
        (
            "1/shadowcatcher=true",
            &["unknown key \"shadowcatcher\"", "did you mean `shadow_catcher`?"],
        ),
    ] {
        refused("s.json", &["--set", &set(value)], expected);
    }
    // The plate is an input.
    let scratch = &refusals.scratch;
    std::fs::copy(scratch.path("plate.ppm"), scratch.path("o.png")).unwrap();
    let done = scratch.run(&["render", "s.json", "-o", "o", "--size", "2x1", "--over", "o.png"]);
    assert!(done.code() == 2 && done.stderr().contains("o.png"), "{}", done.stderr());
    let none = set(r#"1/visible={"camera":false,"shadow":false,"reflection":false}"#);
    let done = scratch.run(&["render", "s.json", "-o", "n", "--set", &none]).good();
    assert!(done.stderr().contains("no ray can hit"), "{}", done.stderr());
}
