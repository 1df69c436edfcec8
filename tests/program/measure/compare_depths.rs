//! `compare` on layers of depths: pixels where the camera sees no surface hold 1e30.

use super::compare::{floats, json, metric, write_exr};
use crate::support::program::Scratch;
use serde_json::json;

const MISS: f32 = 1e30;

fn write(scratch: &Scratch, name: &str, depths: [f32; 4]) {
    write_exr(&scratch.path(name), [2, 2], &[("Z", floats(&depths))]);
}

#[test]
fn misses_of_both_files_are_left_out() {
    let scratch = Scratch::new();
    write(&scratch, "a.exr", [1.1, MISS, 1.0, MISS]);
    write(&scratch, "b.exr", [1.0, MISS, 1.0, MISS]);
    let flags = ["compare", "a.exr", "b.exr", "--json", "--out", "map.png"];
    let report = json(&scratch.run(&flags));
    let layer = &report["layers"][0];
    assert_eq!(
        layer["misses"],
        json!({ "both": 2, "image": 0, "reference": 0, "first": null }),
        "{layer}"
    );
    for (name, expected) in [("mae", 0.05), ("max", 0.1), ("p99", 0.1), ("differ", 0.5)] {
        assert!((metric(layer, name) - expected).abs() < 1e-6, "{name}: {layer}");
    }
    // An error of 10 % is 3/4 of the way from 1e-4 to 1; no error is black.
    let map = image::open(scratch.path("map.png")).unwrap().to_rgb8();
    assert!(map.get_pixel(0, 0).0[0] > 200, "{map:?}");
    assert!([(1, 0), (0, 1), (1, 1)].iter().all(|&(x, y)| map.get_pixel(x, y).0 == [0, 0, 4]));
    let done = scratch.run(&["compare", "a.exr", "b.exr", "--fail-above", "rmse=0.08"]);
    assert!(done.stdout().contains("2 misses of both files left out"), "{}", done.stdout());
    assert!(done.stdout().contains("all pixels and channels but depths of misses"));
    assert_eq!(done.code(), 0, "{}", done.stderr());
}

#[test]
fn a_miss_of_one_file_alone_differs_and_fails_other_thresholds() {
    let scratch = Scratch::new();
    write(&scratch, "a.exr", [1.0, MISS, 2.0, MISS]);
    write(&scratch, "b.exr", [1.0, MISS, MISS, MISS]);
    let report = json(&scratch.run(&["compare", "a.exr", "b.exr", "--json", "--out", "map.png"]));
    let layer = &report["layers"][0];
    let misses = json!({ "both": 2, "image": 0, "reference": 1, "first": [0, 1] });
    assert_eq!(layer["misses"], misses);
    assert_eq!((metric(layer, "rmse"), metric(layer, "differ")), (0.0, 0.5));
    let map = image::open(scratch.path("map.png")).unwrap().to_rgb8();
    assert_eq!(map.get_pixel(0, 1).0, [0, 230, 255]);
    for (limits, reason) in [
        (&["--fail-above", "differ=0.5"][..], None),
        (&["--fail-above", "differ=0.4"], Some("Z: differ is 5.0000e-1, above 0.4")),
        (
            &["--fail-above", "rmse=1", "--fail-above", "max=1"],
            Some("Z: 0 misses of a.exr alone and 1 of b.exr alone, the first at 0, 1"),
        ),
    ] {
        let done = scratch.run(&[&["compare", "a.exr", "b.exr"], limits].concat());
        assert_eq!(done.code(), i32::from(reason.is_some()), "{}", done.stderr());
        let lines = done.stderr().lines().count();
        assert_eq!(lines, usize::from(reason.is_some()), "{}", done.stderr());
        assert!(done.stderr().contains(reason.unwrap_or_default()), "{}", done.stderr());
    }
}

#[test]
fn the_page_of_a_layer_without_metrics_has_no_table_of_them() {
    let scratch = Scratch::new();
    write(&scratch, "a.exr", [1.0, f32::NAN, 2.0, 3.0]);
    write(&scratch, "b.exr", [1.0; 4]);
    for (file, tables) in [("a.exr", 0), ("b.exr", 1)] {
        scratch.run(&["compare", file, "b.exr", "--html", "page.html"]);
        let page = String::from_utf8(scratch.read("page.html")).unwrap();
        assert_eq!(page.matches("Metrics").count(), tables, "{page}");
    }
}
