//! Compares FLIP and SSIM with other programs: the authors' package flip-evaluator, and
//! scikit-image. scripts/make_metric_references.py writes the pictures and the values.

use std::path::Path;

use lightpath::lab::{
    compare::file::Picture,
    metrics::{Metric, MetricValues, flip, mean},
};
use serde_json::Value;

/// Tolerances: their sums are in f32, ours in f64.
const MEAN: f64 = 2e-6;
const PIXEL: f64 = 2e-5;

fn folder() -> &'static Path {
    Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/tests/data/metrics"))
}

/// Returns the width, and linear RGB.
fn read(pair: &str, which: &str) -> (usize, Vec<[f32; 3]>) {
    let of = |end: &str| folder().join(format!("{pair}-{which}.{end}"));
    let path = if of("png").exists() { of("png") } else { of("exr") };
    let picture = Picture::read(&path).unwrap();
    let [layer] = &picture.layers[..] else { panic!("{} layers", picture.layers.len()) };
    (layer.size[0], layer.values.chunks_exact(3).map(|p| [p[0], p[1], p[2]]).collect())
}

fn bytes(pixels: &[[f32; 3]]) -> Vec<[u8; 3]> {
    let byte = |v: f32| {
        let v = f64::from(v).clamp(0.0, 1.0);
        lightpath::output::srgb::byte(v)
    };
    pixels.iter().map(|p| p.map(byte)).collect()
}

fn number(value: &Value) -> f64 {
    value.as_f64().unwrap()
}

#[track_caller]
fn check(what: &str, map: &[f64], width: usize, expected: &Value, step: usize) {
    let (ours, theirs) = (mean(map), number(&expected["mean"]));
    assert!((ours - theirs).abs() < MEAN, "{what}: {ours} {theirs}");
    let mut seen = 0;
    for (y, row) in expected["map"].as_array().unwrap().iter().enumerate() {
        for (x, value) in row.as_array().unwrap().iter().enumerate() {
            let ours = map[y * step * width + x * step];
            assert!((ours - number(value)).abs() < PIXEL, "{what} at {x}, {y}: {ours} {value}");
            seen += 1;
        }
    }
    assert!(seen > 50, "{what}: {seen} pixels");
}

#[test]
fn flip_and_ssim_are_those_of_their_packages() {
    let text = std::fs::read_to_string(folder().join("expected.json")).unwrap();
    let all: Value = serde_json::from_str(&text).unwrap();
    let step = all["map_step"].as_u64().unwrap() as usize;
    let pairs = all["pairs"].as_object().unwrap();
    assert_eq!(pairs.len(), 3);
    for (name, expected) in pairs {
        let ((width, test), (_, reference)) = (read(name, "test"), read(name, "reference"));
        let map = flip::hdr(&test, &reference, width);
        check(&format!("{name}, HDR"), &map, width, &expected["hdr_flip"], step);
        let (values, map) = MetricValues::of_pictures(&bytes(&test), &bytes(&reference), width);
        check(&format!("{name}, LDR"), &map, width, &expected["ldr_flip"], step);
        assert_eq!(values.get(Metric::Flip), Some(mean(&map)));
        let (ours, theirs) = (values.get(Metric::Ssim).unwrap(), number(&expected["ssim"]));
        assert!((ours - theirs).abs() < 1e-9, "{name}: SSIM {ours} {theirs}");
    }
}
