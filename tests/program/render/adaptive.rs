//! `--noise`, `--time` and `--adaptive-shadows` give the same bits as a plain render where that is
//! possible, and no bias elsewhere.

use std::sync::LazyLock;

use crate::support::backends::on_both;
use crate::support::program::{Done, PYRAMID, Scratch};
use lightpath::scene::Backend;
use serde_json::Value;

/// A wire, a fiftieth of a light's width, hangs in front of the light over a floor. A mirror ball
/// and a mesh stand on it.
const SCENE: &str = r#"{
  "seed": 3,
  "camera": { "type": "pinhole", "width": 50, "height": 40, "fov": 40,
              "position": [0, 3, 7], "target": [0, 0.3, 0], "up": [0, 1, 0] },
  "scene": {
    "backgroundcolor": [0.02, 0.02, 0.02], "ambient": [0.01, 0.01, 0.01], "attenuation": "quadratic",
    "lightsources": [
      { "type": "arealight", "v0": [-1, 4, -1], "v1": [1, 4, -1], "v2": [-1, 4, 1],
        "id": [20, 18, 16], "samples": 16 }],
    "shapes": [
      { "type": "plane", "v0": [-2, 2.5, 0.02], "v1": [2, 2.5, 0.02], "v2": [2, 2.5, -0.02],
        "v3": [-2, 2.5, -0.02], "material": {} },
      { "type": "trimesh", "path": "p.ply", "size": 0.5, "center": [-1.2, 0.1, 0.5], "material": {} },
      { "type": "sphere", "center": [1.2, 0.5, 0], "radius": 0.5,
        "material": { "kd": 0.4, "kr": 0.5, "ks": 0.4, "specularexponent": 20 } },
      { "type": "plane", "v0": [-6, 0, 6], "v1": [6, 0, 6], "v2": [6, 0, -6], "v3": [-6, 0, -6],
        "material": { "kd": 0.7, "ka": 1 } }]
  }
}"#;

/// Renders in 32-bit floats and returns the statistics.
#[track_caller]
fn render(scratch: &Scratch, prefix: &str, flags: &[&str]) -> Value {
    let fixed = ["render", "s.json", "-o", prefix, "--quiet", "--float", "--json"];
    let done = scratch.run(&[&fixed, flags].concat());
    assert_eq!(done.code(), 0, "{}", done.stderr());
    serde_json::from_str(&done.stdout()).unwrap()
}

fn pixels(scratch: &Scratch, name: &str) -> Vec<Vec<[f32; 4]>> {
    scratch.rgba(&format!("{name}.exr"))
}

fn attribute(scratch: &Scratch, name: &str, key: &str) -> Option<String> {
    let done = scratch.run(&["info", &format!("{name}.exr"), "--json"]);
    let info: Value = serde_json::from_str(&done.stdout()).unwrap();
    let value = &info["parts"][0]["attributes"][key];
    value.as_str().map(str::to_string)
}

/// The picture of [`SCENE`] with little noise, which several tests compare with.
static REFERENCE: LazyLock<Vec<Vec<[f32; 4]>>> = LazyLock::new(|| {
    let scratch = Scratch::with(SCENE);
    render(&scratch, "reference", &["--spp", "4096", "--light-samples", "1", "--seed", "77"]);
    pixels(&scratch, "reference")
});

/// Returns the mean radiance of a picture.
fn mean(pixels: &[Vec<[f32; 4]>]) -> f64 {
    let all = pixels.iter().flatten().flat_map(|p| &p[..3]);
    all.clone().map(|&v| f64::from(v)).sum::<f64>() / all.count() as f64
}

on_both! {
    fn passes_give_the_bits_of_one_go(backend: Backend) {
        let scratch = Scratch::with(SCENE);
        let aov = ["--aov", "all", "--light-samples", "2", "--backend", backend.name()];
        render(&scratch, "go", &[&aov[..], &["--spp", "64"]].concat());
        let stats =
            render(&scratch, "passes", &[&aov[..], &["--noise", "1e-9", "--max-spp", "64"]].concat());
        // The background has no noise.
        assert_eq!(stats["samples"]["most"], 64);
        let (go, passes) = (scratch.channels("go.exr"), scratch.channels("passes.exr"));
        assert_eq!(go.len(), passes.len());
        // Pixels with all samples are the same in every layer.
        let samples = &scratch.floats("passes.exr")["samples.Y"];
        let sampled: Vec<usize> = (0..50 * 40).filter(|&i| samples[i] == 64.0).collect();
        assert!(sampled.len() > 50 * 40 / 2, "{}", sampled.len());
        for ((name, a), (other, b)) in go.iter().zip(&passes) {
            assert_eq!(name, other);
            let differs = sampled.iter().filter(|&&i| a[i] != b[i]).count();
            assert_eq!(differs, 0, "{name}");
        }
        // Pixels with fewer samples do not change any more.
        let (whole, parts) = (pixels(&scratch, "go"), pixels(&scratch, "passes"));
        let equal = |a: &[f32; 4], b: &[f32; 4]| a.map(f32::to_bits) == b.map(f32::to_bits);
        let pairs = whole.iter().flatten().zip(parts.iter().flatten());
        let same = pairs.filter(|(a, b)| equal(a, b)).count();
        assert!(same * 100 >= 50 * 40 * 99, "{same} of {}", 50 * 40);
    }
}

#[test]
fn texture_areas_are_those_of_the_first_pass() {
    let scratch = Scratch::new();
    let checks = |x: u32, y: u32| image::Luma([if (x + y) % 2 == 0 { 255u8 } else { 0 }]);
    image::GrayImage::from_fn(512, 512, checks).save(scratch.path("t.png")).unwrap();
    scratch.write(
        "s.json",
        r#"{ "camera": { "type": "pinhole", "width": 48, "height": 32, "fov": 40,
                         "position": [0, 1, 4], "target": [0, 0, 0], "up": [0, 1, 0] },
             "scene": { "ambient": [1, 1, 1], "shapes": [
               { "type": "plane", "v0": [-6, 0, 6], "v1": [6, 0, 6], "v2": [6, 0, -6], "v3": [-6, 0, -6],
                 "material": { "kd": 0, "ka": 1, "tPath": "t.png", "filter": "trilinear" } }] } }"#,
    );
    render(&scratch, "go", &["--spp", "16"]);
    let flags = ["--spp", "16", "--noise", "1", "--max-spp", "4096"];
    let stats = render(&scratch, "passes", &flags);
    assert_eq!(stats["samples"]["most"], 16, "no pixel is that noisy");
    assert!(pixels(&scratch, "go") == pixels(&scratch, "passes"));
}

on_both! {
    fn the_same_bytes_for_any_threads_and_as_a_crop(backend: Backend) {
        let scratch = Scratch::with(SCENE);
        for relative in ["pixel", "picture"] {
            same_bytes_for_any_threads_and_as_a_crop(&scratch, backend, relative);
        }
    }
}

fn same_bytes_for_any_threads_and_as_a_crop(scratch: &Scratch, backend: Backend, relative: &str) {
    let flags =
        ["--noise", "0.1", "--noise-of", relative, "--max-spp", "64", "--backend", backend.name()];
    let flags = [&flags[..], &["--light-samples", "1", "--aov", "samples,N"]].concat();
    let stats = render(scratch, "one", &[&flags[..], &["--threads", "1"]].concat());
    let (least, most) = (&stats["samples"]["least"], &stats["samples"]["most"]);
    assert_eq!((least.as_u64(), most.as_u64()), (Some(16), Some(64)));
    for threads in ["2", "5"] {
        render(scratch, "many", &[&flags[..], &["--threads", threads]].concat());
        assert!(scratch.read("one.exr") == scratch.read("many.exr"), "{threads} threads");
    }
    let full = pixels(scratch, "one");
    let crop = ["--crop", "7", "11", "41", "33"];
    render(scratch, "crop", &[&flags[..], &crop].concat());
    let crop = pixels(scratch, "crop");
    for (y, row) in crop.iter().enumerate() {
        assert_eq!(row[..], full[y + 11][7..41], "row {y}");
    }
}

#[test]
fn overscan_does_not_change_the_frame() {
    let scratch = Scratch::with(SCENE);
    // Neither side is a multiple of a packet's or a tile's side.
    let size = ["--size", "50x43", "--max-spp", "64", "--light-samples", "1"];
    let noise = |of| [&size[..], &["--noise", "0.1", "--noise-of", of]].concat();
    let shadows = |spp| vec!["--size", "50x43", "--adaptive-shadows", "--spp", spp];
    let ways = [noise("pixel"), noise("picture"), shadows("1"), shadows("4"), shadows("16")];
    for flags in ways {
        render(&scratch, "frame", &flags);
        let frame = pixels(&scratch, "frame");
        for overscan in [5, 32, 40] {
            let more = overscan.to_string();
            render(&scratch, "wide", &[&flags[..], &["--overscan", &more]].concat());
            let wide = pixels(&scratch, "wide");
            let rows = frame.iter().zip(&wide[overscan..]);
            let pairs = rows.flat_map(|(row, wide)| row.iter().zip(&wide[overscan..]));
            let other = pairs.filter(|(a, b)| a.map(f32::to_bits) != b.map(f32::to_bits)).count();
            assert_eq!(other, 0, "{flags:?} --overscan {overscan}");
        }
    }
}

#[test]
fn the_noise_target_is_reached() {
    let scratch = Scratch::with(SCENE);
    let reference = &*REFERENCE;
    let level = mean(reference);
    for target in [0.1, 0.03] {
        let noise = target.to_string();
        let flags = ["--noise", &noise, "--light-samples", "1"];
        let stats = render(&scratch, "noisy", &flags);
        let noisy = pixels(&scratch, "noisy");
        let (mut squares, mut even) = (0.0, 0.0);
        for (x, r) in noisy.iter().flatten().zip(reference.iter().flatten()) {
            let square = |f: &dyn Fn(usize) -> f64| (0..3).map(|c| f(c).powi(2)).sum::<f64>();
            let off = square(&|c| f64::from(x[c]) - f64::from(r[c]));
            squares += off / (square(&|c| f64::from(r[c])) + 3.0 * (0.1 * level).powi(2));
            even += 1.0;
        }
        let relative = (squares / even).sqrt();
        eprintln!("target {target}: {relative:.4}, {}", stats["samples"]);
        // The mean of the error estimate is never too small.
        assert!(relative < target, "{relative} for {target}");
        assert!(stats["samples"]["mean"].as_f64().unwrap() < 2000.0);
    }
}

/// Returns the mean over pictures with different seeds, and its standard error.
fn means(scratch: &Scratch, flags: &[&str], seeds: std::ops::Range<u32>) -> (f64, f64) {
    let values: Vec<f64> = seeds
        .map(|seed| {
            let seed = seed.to_string();
            render(scratch, "seed", &[flags, &["--seed", &seed]].concat());
            mean(&pixels(scratch, "seed"))
        })
        .collect();
    let n = values.len() as f64;
    let mean = values.iter().sum::<f64>() / n;
    let variance = values.iter().map(|v| (v - mean).powi(2)).sum::<f64>() / (n - 1.0);
    (mean, (variance / n).sqrt())
}

#[test]
fn early_stopping_has_hardly_any_bias() {
    let scratch = Scratch::with(SCENE);
    let (truth, exact) = means(&scratch, &["--spp", "1024", "--light-samples", "1"], 0..4);
    for relative in ["pixel", "picture"] {
        let flags = ["--noise", "0.1", "--noise-of", relative, "--light-samples", "1"];
        let (stopped, error) = means(&scratch, &flags, 100..124);
        let bias = (stopped - truth) / truth;
        let (error, exact) = (error / truth, exact / truth);
        eprintln!("{relative}: bias {bias:.2e}, standard errors {error:.1e} {exact:.1e}");
        // A fiftieth of the target noise.
        assert!(bias.abs() < 0.002, "{relative}: {bias}");
    }
}

#[test]
fn noise_of_the_picture_takes_fewer_samples_for_the_same_rmse() {
    let scratch = Scratch::with(SCENE);
    let one = ["--light-samples", "1"];
    let reference = &*REFERENCE;
    // Returns mean samples per pixel and RMSE.
    let point = |flags: &[&str]| {
        let stats = render(&scratch, "x", &[&one[..], flags].concat());
        let found = pixels(&scratch, "x");
        let off = found.iter().flatten().zip(reference.iter().flatten());
        let squares = off.map(|(x, r)| (0..3).map(|c| f64::from(x[c] - r[c]).powi(2)).sum::<f64>());
        let samples = stats["samples"]["mean"].as_f64();
        (samples, (squares.sum::<f64>() / (3.0 * 50.0 * 40.0)).sqrt())
    };
    let (_, even) = point(&["--spp", "64"]);
    let (samples, adaptive) = point(&["--noise", "0.025", "--noise-of", "picture"]);
    let (more, pixel) = point(&["--noise", "0.08"]);
    let (samples, more) = (samples.unwrap(), more.unwrap());
    eprintln!("64: {even:.2e}; picture {samples:.1}: {adaptive:.2e}; pixel {more:.1}: {pixel:.2e}");
    assert!(samples < 0.75 * 64.0, "{samples}");
    assert!(samples < 1.1 * more, "{samples} {more}");
    assert!(adaptive < even && adaptive < pixel, "{adaptive} {even} {pixel}");
}

#[test]
fn adaptive_shadows_keep_the_mean_before_a_thin_wire() {
    let scratch = Scratch::with(SCENE);
    // One sample per pixel gives the same camera rays for every seed, so only light points and
    // choices differ.
    let flags = ["--spp", "1", "--size", "40x32"];
    let (plain, plain_error) = means(&scratch, &flags, 0..16);
    let (rare, rare_error) =
        means(&scratch, &[&flags[..], &["--adaptive-shadows"]].concat(), 50..114);
    let (off, error) = (rare - plain, plain_error.hypot(rare_error));
    eprintln!("relative difference {:.2e}, standard error {:.1e}", off / plain, error / plain);
    assert!(off.abs() < 4.0 * error, "{off} for a standard error of {error}");
    // The wire must remove many standard errors of light, or the test would not notice its absence.
    let bare = SCENE.replace("[-2, 2.5, 0.02]", "[-2, 9, 0.02]").replace("2.5, ", "9, ");
    scratch.write("s.json", &bare);
    let (unshadowed, _) = means(&scratch, &flags, 0..4);
    assert!(unshadowed - plain > 10.0 * error, "{unshadowed} {plain} {error}");
}

#[test]
fn adaptive_shadows_trace_fewer_rays_and_the_layers_still_add_up() {
    let scratch = Scratch::with(SCENE);
    let shadow = |stats: &Value| stats["rays"]["shadow"].as_u64().unwrap();
    let flags = ["--spp", "16", "--aov", "components,shadow"];
    let all = shadow(&render(&scratch, "all", &flags));
    let few = shadow(&render(&scratch, "few", &[&flags[..], &["--adaptive-shadows"]].concat()));
    assert!(few * 10 < all * 8, "{few} of {all}");
    render(&scratch, "again", &[&flags[..], &["--adaptive-shadows", "--threads", "3"]].concat());
    assert!(scratch.read("few.exr") == scratch.read("again.exr"));
    let values = scratch.floats("few.exr");
    let parts = ["diffuse", "specular", "ambient", "reflection", "background"];
    let parts = parts.map(|part| &values[&format!("{part}.R")]);
    for (i, beauty) in values["R"].iter().enumerate() {
        let sum: f32 = parts.iter().map(|part| part[i]).sum();
        assert!((sum - beauty).abs() <= 1e-5 * beauty.abs().max(0.1), "{sum} {beauty}");
    }
}

#[test]
fn a_time_limit_marks_the_picture_as_not_reproducible() {
    let _timed = crate::timed();
    let scratch = Scratch::with(SCENE);
    let fixed = ["render", "s.json", "-o", "timed", "--light-samples", "1", "--json"];
    let done = scratch.run(&[&fixed[..], &["--time", "0.2", "--size", "100x80"]].concat());
    assert_eq!(done.code(), 0, "{}", done.stderr());
    assert!(done.stderr().contains("not reproducible"), "{}", done.stderr());
    let stats: Value = serde_json::from_str(&done.stdout()).unwrap();
    let samples = &stats["samples"];
    // Samples are spread evenly: every pixel has the same number.
    assert_eq!(samples["least"], samples["most"]);
    assert!(samples["least"].as_u64().unwrap() >= 16);
    assert!(stats["seconds"]["render"].as_f64().unwrap() < 5.0);
    assert_eq!(attribute(&scratch, "timed", "lightpath:reproducible").as_deref(), Some("no"));
    assert_eq!(attribute(&scratch, "timed", "lightpath:time").as_deref(), Some("0.2"));
    render(&scratch, "noise", &["--noise", "0.5"]);
    assert_eq!(attribute(&scratch, "noise", "lightpath:reproducible"), None);
    assert_eq!(attribute(&scratch, "noise", "lightpath:noise").as_deref(), Some("0.5"));
    // With enough time, the picture is the same as with --noise alone.
    render(&scratch, "both", &["--noise", "0.5", "--time", "1000"]);
    assert_eq!(pixels(&scratch, "both"), pixels(&scratch, "noise"));
}

#[test]
fn the_maximum_of_samples_has_a_default() {
    let scratch = Scratch::with(SCENE);
    for (flags, range) in [
        (&["--noise", "1"][..], "16-4096"),
        (&["--noise", "1", "--spp", "512"], "512-8192"),
        (&["--noise", "1", "--spp", "5000"], "8192-65536"),
        (&["--noise", "1", "--adaptive-shadows"], "16-4096"),
        (&["--time", "0.001"], "16-65536"),
        (&["--time", "0.001", "--noise", "1"], "16-4096"),
    ] {
        let small = ["--size", "2x1", "--light-samples", "1"];
        render(&scratch, "x", &[&small[..], flags].concat());
        let found = attribute(&scratch, "x", "lightpath:spp");
        assert_eq!(found.as_deref(), Some(range), "{flags:?}");
    }
    // Both halves of the first pass are packets, for which adaptive shadows draw once.
    render(&scratch, "x", &["--size", "2x1", "--noise", "1", "--adaptive-shadows"]);
    assert_eq!(attribute(&scratch, "x", "lightpath:spp").as_deref(), Some("32-4096"));
}

#[test]
fn contradictions_are_refused() {
    let scratch = Scratch::new();
    scratch.write("s.json", SCENE);
    scratch.write("p.ply", PYRAMID);
    let refused = |flags: &[&str], says: &[&str]| {
        let done: Done = scratch.run(&[&["render", "s.json", "-o", "x"], flags].concat());
        assert_eq!(done.code(), 2, "{flags:?}: {}", done.stderr());
        for text in says {
            assert!(done.stderr().contains(text), "{flags:?}: {}", done.stderr());
        }
    };
    refused(&["--max-spp", "64"], &["--max-spp: found without --noise"]);
    refused(&["--noise-of", "picture"], &["--noise-of: found without --noise"]);
    refused(&["--noise", "0.1", "--noise-of", "all"], &["pixel, picture"]);
    refused(&["--noise", "0"], &["--noise: found 0, expected a number above 0 and up to 1"]);
    refused(&["--noise", "-1"], &["--noise: found -1"]);
    refused(&["--noise", "NaN"], &["--noise: found NaN"]);
    refused(&["--noise", "1.5"], &["--noise: found 1.5"]);
    refused(&["--time", "0"], &["--time: found 0"]);
    refused(&["--time", "1e300"], &["--time: found 1"]);
    let power = ["expected a power of two up to 65536", "512 or 1024"];
    refused(&["--noise", "0.1", "--max-spp", "1000"], &power);
    refused(&["--noise", "0.1", "--max-spp", "0"], &["expected a power of two"]);
    refused(&["--noise", "0.1", "--max-spp", "4000000000"], &["found 4000000000", "65536"]);
    let room = ["--max-spp: there is no room for more samples", "--max-spp 128 or more"];
    refused(&["--noise", "0.1", "--spp", "50", "--max-spp", "64"], &room);
    refused(&["--noise", "0.1", "--spp", "4000000000"], &["--spp: there is no room"]);
    let cut = ["--adaptive-shadows", "--spp", "24", "--samples"];
    refused(&[&cut[..], &["0..8"]].concat(), &["--samples: found 0..8", "multiples of 16"]);
    refused(&[&cut[..], &["8..24"]].concat(), &["--samples: found 8..24", "multiples of 16"]);
    let cut = ["--adaptive-shadows", "--spp", "12", "--samples", "0..6"];
    refused(&cut, &["--samples: found 0..6", "multiples of 4", "0..4 or 0..8"]);
}
