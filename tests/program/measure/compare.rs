//! `compare` through the program: numbers, maps, layers, thresholds and exit codes.

use std::path::Path;

use crate::support::program::{self, Done, Scratch};
use exr::prelude::{
    AnyChannel, AnyChannels, AttributeValue, Compression, Encoding, FlatSamples, Image,
    ImageAttributes, Layer, LayerAttributes, Text, WritableImage,
};
use half::f16;
use serde_json::Value;

const DATA: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/tests/data/metrics");

/// Parses what `compare --json` printed.
pub fn json(done: &Done) -> Value {
    serde_json::from_str(&done.stdout()).unwrap_or_else(|_| panic!("{}", done.stderr()))
}

/// Returns the value of a metric of a layer.
pub fn metric(layer: &Value, name: &str) -> f64 {
    layer["metrics"][name]["value"].as_f64().unwrap_or_else(|| panic!("{name} of {layer}"))
}

/// Returns a channel of 32-bit floats.
pub fn floats(values: &[f32]) -> FlatSamples {
    FlatSamples::F32(values.to_vec())
}

/// Writes an EXR of one part.
pub fn write_exr(path: &Path, size: [usize; 2], channels: &[(&str, FlatSamples)]) {
    write_exr_as(Encoding::SMALL_LOSSLESS, path, size, channels);
}

fn write_exr_as(
    encoding: Encoding,
    path: &Path,
    [width, height]: [usize; 2],
    channels: &[(&str, FlatSamples)],
) {
    let list = channels.iter().map(|(name, data)| AnyChannel::new(*name, data.clone())).collect();
    let layer =
        Layer::new((width, height), LayerAttributes::default(), encoding, AnyChannels::sort(list));
    Image::from_layer(layer).write().non_parallel().to_file(path).unwrap();
}

/// Returns the R, G, B channels of 2 x 1 pixels.
fn light(values: [f32; 6]) -> Vec<(&'static str, FlatSamples)> {
    let of = |c: usize| floats(&[values[c], values[3 + c]]);
    vec![("R", of(0)), ("G", of(1)), ("B", of(2))]
}

fn two_pixels(scratch: &Scratch, name: &str, values: [f32; 6]) {
    write_exr(&scratch.path(name), [2, 1], &light(values));
}

#[test]
fn metrics_match_closed_forms_and_name_their_formulas() {
    let scratch = Scratch::new();
    two_pixels(&scratch, "a.exr", [1.0, 0.5, 0.0, 2.0, 2.0, 2.0]);
    two_pixels(&scratch, "b.exr", [0.5, 0.5, 0.0, 2.0, 1.0, 2.0]);
    let done = scratch.run(&["compare", "a.exr", "b.exr", "--json"]);
    assert_eq!(done.code(), 0, "{}", done.stderr());
    let report = json(&done);
    let layer = &report["layers"][0];
    assert_eq!((&layer["name"], &layer["meaning"]), (&"beauty".into(), &"light".into()));
    for (name, expected) in [
        ("mse", 1.25 / 6.0),
        ("rmse", (1.25f64 / 6.0).sqrt()),
        ("mae", 0.25),
        ("bias", 0.25),
        ("relmse", (0.25 / 0.26 + 1.0 / 1.01) / 6.0),
        ("mrse", (0.25 / 0.51f64.powi(2) + 1.0 / 1.01f64.powi(2)) / 6.0),
        ("smape", (0.5 / 1.51 + 1.0 / 3.01) / 6.0),
        ("max", 1.0),
        ("p99", 1.0),
        ("differ", 2.0 / 6.0),
    ] {
        assert!((metric(layer, name) - expected).abs() < 1e-12, "{name}");
        assert!(layer["metrics"][name]["formula"].as_str().unwrap().len() > 5, "{name}");
    }
    for name in ["flip", "hdrflip"] {
        let value = metric(layer, name);
        assert!(value > 0.0 && value <= 1.0, "{name} {value}");
    }
    assert_eq!(layer["metrics"].get("ssim"), None, "2 x 1 pixels hold no window");

    let done = scratch.run(&["compare", "a.exr", "b.exr"]);
    let text = done.stdout();
    for part in ["relmse", "mean d^2 / (r^2 + 0.01)", "max |d|", "b.exr (the reference)"] {
        assert!(text.contains(part), "{part}: {text}");
    }
}

#[test]
fn equal_pictures_pass_every_threshold() {
    let file = format!("{DATA}/noise-reference.png");
    let limits = ["--fail-above", "max=0", "--fail-above", "flip=0", "--fail-below", "psnr=99"];
    let done = program::lightpath(&[&["compare", &file, &file, "--json"], &limits[..]].concat());
    assert_eq!(done.code(), 0, "{}", done.stderr());
    let layer = &json(&done)["layers"][0];
    assert_eq!((metric(layer, "mse"), metric(layer, "ssim")), (0.0, 1.0));
    assert_eq!(layer["metrics"]["psnr"]["value"], Value::Null);
}

#[test]
fn a_threshold_decides_the_exit_code() {
    let (a, b) = (format!("{DATA}/bright-test.exr"), format!("{DATA}/bright-reference.exr"));
    let run =
        |limits: &[&str]| program::lightpath(&[&["compare", &a, &b, "--json"], limits].concat());
    let measured = metric(&json(&run(&[]))["layers"][0], "relmse");
    let (over, under) =
        (format!("relmse={}", measured * 1.01), format!("relmse={}", measured * 0.99));
    assert_eq!(run(&["--fail-above", &over]).code(), 0);
    let done = run(&["--fail-above", &over, "--fail-above", &under, "--fail-below", "ssim=0.99"]);
    assert_eq!(done.code(), 1);
    let failures = json(&done)["failures"].as_array().unwrap().len();
    assert_eq!((failures, done.stderr().lines().count()), (2, 2), "{}", done.stderr());
    assert!(done.stderr().contains("beauty: relmse is "), "{}", done.stderr());
}

/// A metric that no layer has is bad use, whatever other thresholds say.
#[test]
fn the_order_of_thresholds_does_not_matter() {
    let (a, b) = (format!("{DATA}/noise-test.png"), format!("{DATA}/noise-reference.png"));
    for limits in [["relmse=0", "hdrflip=1"], ["hdrflip=1", "relmse=0"]] {
        let [first, second] = limits;
        let flags = ["--fail-above", first, "--fail-above", second];
        let done = program::lightpath(&[&["compare", &a, &b], &flags[..]].concat());
        assert_eq!(done.code(), 2, "{limits:?}: {}", done.stderr());
        assert!(done.stderr().contains("has a `hdrflip`"), "{}", done.stderr());
    }
}

#[test]
fn pixels_that_are_not_finite_fail() {
    let scratch = Scratch::new();
    two_pixels(&scratch, "a.exr", [1.0, 0.5, 0.0, 2.0, f32::NAN, 2.0]);
    two_pixels(&scratch, "b.exr", [f32::INFINITY, 0.5, 0.0, 2.0, 1.0, 2.0]);
    let flags = ["--json", "--out", "map.png", "--fail-above", "relmse=1"];
    let done = scratch.run(&[&["compare", "a.exr", "b.exr"], &flags[..]].concat());
    assert_eq!(done.code(), 1);
    assert!(
        done.stderr().contains("not finite: 1 pixel of a.exr and 1 of b.exr, the first at 0, 0")
    );
    let layer = &json(&done)["layers"][0];
    assert_eq!(layer["non_finite"]["first"], serde_json::json!([0, 0]));
    assert_eq!(layer["metrics"], serde_json::json!({}));
    // Neither pixel has a colour of the scale.
    let map = image::open(scratch.path("map.png")).unwrap().to_rgb8();
    assert!(map.pixels().all(|p| p.0 == [0, 230, 255]));
}

#[test]
fn layers_are_matched_by_name() {
    let scratch = Scratch::new();
    let ids = |a: u32| FlatSamples::U32(vec![a, 7]);
    let mut a = light([0.5; 6]);
    a.extend([("Z", floats(&[1.0, 3.0])), ("id", ids(3)), ("N.X", floats(&[0.0, 1.0]))]);
    a.extend([
        ("N.Y", floats(&[0.0; 2])),
        ("N.Z", floats(&[1.0, 0.0])),
        ("old.R", floats(&[0.0; 2])),
    ]);
    let mut b = light([0.5; 6]);
    b.extend([("Z", floats(&[1.5, 3.0])), ("id", ids(4)), ("N.X", floats(&[0.0, 1.0]))]);
    b.extend([("N.Y", floats(&[0.0; 2])), ("N.Z", floats(&[1.0, 0.0]))]);
    b.extend([("light_key.R", floats(&[0.0; 2])), ("light_key.G", floats(&[0.0; 2]))]);
    b.push(("light_key.B", floats(&[0.0; 2])));
    write_exr(&scratch.path("a.exr"), [2, 1], &a);
    write_exr(&scratch.path("b.exr"), [2, 1], &b);
    let report = json(&scratch.run(&["compare", "a.exr", "b.exr", "--json"]));
    let layers = report["layers"].as_array().unwrap();
    let facts: Vec<_> = layers
        .iter()
        .map(|layer| {
            let channels = layer["channels"].as_array().unwrap().len();
            let text = |key: &str| layer[key].as_str().unwrap().to_string();
            (text("name"), text("meaning"), channels, metric(layer, "differ"))
        })
        .collect();
    let expected = [
        ("beauty", "light", 3, 0.0),
        ("N", "data", 3, 0.0),
        ("Z", "data", 1, 0.5),
        ("id", "ids", 1, 0.5),
    ];
    let expected = expected.map(|(n, m, c, d)| (n.to_string(), m.to_string(), c, d));
    assert_eq!(facts, expected);
    assert!((metric(&layers[2], "mae") - 0.25).abs() < 1e-12);
    assert_eq!(report["only_in_image"], serde_json::json!(["old.R"]));
    assert_eq!(report["only_in_reference"], serde_json::json!(["light_key"]));
    let text = scratch.run(&["compare", "a.exr", "b.exr"]).stdout();
    assert!(text.contains("only in a.exr: old.R\nonly in b.exr: light_key\n"), "{text}");

    // With one layer selected, thresholds apply to that layer only.
    let done = scratch.run(&["compare", "a.exr", "b.exr", "--layer", "N", "--fail-above", "max=0"]);
    assert_eq!((done.code(), done.stdout().contains("beauty")), (0, false));
    let done = scratch.run(&["compare", "a.exr", "b.exr", "--layer", "light_key"]);
    assert_eq!(done.code(), 2);
    let done = scratch.run(&["compare", "a.exr", "b.exr", "--fail-above", "max=0.4"]);
    assert!(done.stderr().contains("Z: max is 5.0000e-1, above 0.4"), "{}", done.stderr());
    assert_eq!(done.code(), 1);
}

#[test]
fn the_name_of_a_layer_selects_all_its_channels() {
    let scratch = Scratch::new();
    let mut channels = light([0.5; 6]);
    let half = || floats(&[0.5; 2]);
    channels.extend([("uv.U", half()), ("uv.V", half()), ("primid.id", half())]);
    channels.extend([("CryptoObject00.R", half()), ("CryptoObject01.G", half())]);
    write_exr(&scratch.path("a.exr"), [2, 1], &channels);
    for (layer, expected) in [
        ("uv", &["uv.U", "uv.V"][..]),
        ("uv.U", &["uv.U"]),
        ("primid", &["primid.id"]),
        ("CryptoObject", &["CryptoObject00.R", "CryptoObject01.G"]),
        ("beauty", &["beauty"]),
    ] {
        let done = scratch.run(&["compare", "a.exr", "a.exr", "--json", "--layer", layer]).good();
        let report = json(&done);
        let names =
            report["layers"].as_array().unwrap().iter().map(|l| l["name"].as_str().unwrap());
        assert_eq!(names.collect::<Vec<_>>(), expected, "{layer}");
    }
}

#[test]
fn a_part_is_a_layer_of_its_name() {
    let scratch = Scratch::new();
    let part = |name: &str, channels: &[(&str, FlatSamples)]| {
        let list = channels.iter().map(|(name, data)| AnyChannel::new(*name, data.clone()));
        let attributes = LayerAttributes::named(name);
        let channels = AnyChannels::sort(list.collect());
        Layer::new((2, 1), attributes, Encoding::SMALL_LOSSLESS, channels)
    };
    let image = Image::empty(ImageAttributes::with_size((2, 1)))
        .with_layer(part("rgba", &light([0.5; 6])))
        .with_layer(part("albedo", &light([0.25; 6])))
        .with_layer(part("data", &[("data.Z", floats(&[1.0; 2])), ("key.A", floats(&[1.0; 2]))]));
    image.write().non_parallel().to_file(scratch.path("parts.exr")).unwrap();
    let mut all = light([0.5; 6]);
    all.extend(["albedo.R", "albedo.G", "albedo.B"].map(|name| (name, floats(&[0.5; 2]))));
    all.extend(["data.Z", "data.key.A"].map(|name| (name, floats(&[1.0; 2]))));
    write_exr(&scratch.path("one.exr"), [2, 1], &all);
    let report = json(&scratch.run(&["compare", "parts.exr", "one.exr", "--json"]));
    let layers = report["layers"].as_array().unwrap();
    let facts: Vec<_> =
        layers.iter().map(|l| (l["name"].as_str().unwrap(), metric(l, "differ"))).collect();
    let expected = [("beauty", 0.0), ("albedo", 1.0), ("data.Z", 0.0), ("data.key.A", 0.0)];
    assert_eq!(facts, expected);
    for alone in ["only_in_image", "only_in_reference"] {
        assert_eq!(report[alone], serde_json::json!([]));
    }
}

#[test]
fn cryptomattes_are_ids() {
    let scratch = Scratch::new();
    // As a float, the second id is a NaN.
    let ids = |last: u32| floats(&[f32::from_bits(0x1385_1a76), f32::from_bits(last)]);
    let write = |name: &str, last: u32| {
        let mut attributes = LayerAttributes::default();
        let text = |text: &str| Text::new_or_none(text).unwrap();
        let value = AttributeValue::Text(text("crypto_object"));
        attributes.other.insert(text("cryptomatte/542cafa/name"), value);
        let channels =
            AnyChannels::sort(vec![AnyChannel::new("crypto_object00.R", ids(last))].into());
        let layer = Layer::new((2, 1), attributes, Encoding::SMALL_LOSSLESS, channels);
        Image::from_layer(layer).write().non_parallel().to_file(scratch.path(name)).unwrap();
    };
    write("a.exr", 0x7fc0_0001);
    write("b.exr", 0x7fc0_0002);
    let report = json(&scratch.run(&["compare", "a.exr", "b.exr", "--json"]));
    let layer = &report["layers"][0];
    assert_eq!((&layer["meaning"], metric(layer, "differ")), (&"ids".into(), 0.5));
    assert_eq!(layer["non_finite"], Value::Null);
    assert_eq!(scratch.run(&["compare", "a.exr", "a.exr", "--fail-above", "differ=0"]).code(), 0);
    assert_eq!(scratch.run(&["compare", "a.exr", "b.exr", "--fail-above", "differ=0"]).code(), 1);
}

#[test]
fn grey_against_colours_is_noted() {
    let scratch = Scratch::new();
    let values = |scale: f32| -> Vec<f32> { (0..64).map(|i| scale * i as f32).collect() };
    write_exr(&scratch.path("grey.exr"), [8, 8], &[("Y", floats(&values(1.0)))]);
    let colours = ["R", "G", "B"].map(|name| (name, floats(&values(1.0))));
    write_exr(&scratch.path("colours.exr"), [8, 8], &colours);
    let note = "grey.exr is grey: its Y is taken for R, G and B alike";
    for (files, grey) in
        [(["grey.exr", "colours.exr"], [true, false]), (["colours.exr", "grey.exr"], [false, true])]
    {
        let [a, b] = files;
        assert!(scratch.run(&["compare", a, b]).stdout().contains(note));
        let report = json(&scratch.run(&["compare", a, b, "--json"]));
        let layer = &report["layers"][0];
        assert_eq!(layer["grey"], serde_json::json!({ "image": grey[0], "reference": grey[1] }));
        assert_eq!(metric(layer, "rmse"), 0.0);
    }
    image::GrayImage::from_pixel(2, 2, image::Luma([99])).save(scratch.path("grey.png")).unwrap();
    image::RgbImage::from_pixel(2, 2, image::Rgb([99; 3]))
        .save(scratch.path("colours.png"))
        .unwrap();
    let text = scratch.run(&["compare", "grey.png", "colours.png"]).stdout();
    assert!(text.contains("grey.png is grey: its Y is taken"), "{text}");
    for file in ["grey.exr", "colours.exr", "grey.png", "colours.png"] {
        assert!(!scratch.run(&["compare", file, file]).stdout().contains("is grey"));
    }
}

#[test]
fn half_floats_are_noted_with_their_floor() {
    let scratch = Scratch::new();
    let exact: Vec<f32> =
        (0..4096).map(|i| ((f64::from(i) * 0.618_033_988_7).fract() + 0.2) as f32).collect();
    let rounded = || FlatSamples::F16(exact.iter().map(|v| f16::from_f32(*v)).collect());
    let all = |data: &dyn Fn() -> FlatSamples| ["R", "G", "B"].map(|name| (name, data()));
    write_exr(&scratch.path("half.exr"), [64, 64], &all(&rounded));
    write_exr(&scratch.path("float.exr"), [64, 64], &all(&|| floats(&exact)));
    let report = json(&scratch.run(&["compare", "half.exr", "float.exr", "--json"]));
    let layer = &report["layers"][0];
    assert_eq!(layer["half"]["image"], true);
    assert_eq!(layer["half"]["reference"], false);
    // Only rounding to halves differs, so the measured error is the floor.
    let floor = layer["half"]["floor"]["rmse"].as_f64().unwrap();
    let ratio = floor / metric(layer, "rmse");
    assert!((0.9..1.1).contains(&ratio), "{ratio}");
    let text = scratch.run(&["compare", "half.exr", "float.exr"]).stdout();
    assert!(text.contains("half.exr holds half floats: their rounding alone may give rmse"));
    let same = json(&scratch.run(&["compare", "float.exr", "float.exr", "--json"]));
    assert_eq!(same["layers"][0]["half"]["floor"], Value::Null);
}

#[test]
fn the_map_and_the_page_are_written() {
    let scratch = Scratch::new();
    let (a, b) = (format!("{DATA}/bright-test.exr"), format!("{DATA}/bright-reference.exr"));
    let files = ["--out", "map.png", "--html", "page.html"];
    let done = scratch.run(&[&["compare", &a, &b], &files[..]].concat());
    assert_eq!(done.code(), 0, "{}", done.stderr());
    assert!(done.stdout().ends_with("map.png\npage.html\n"));
    assert_eq!(scratch.names(), ["map.png", "page.html"]);
    let map = image::open(scratch.path("map.png")).unwrap().to_rgb8();
    assert_eq!(map.dimensions(), (64, 48));
    // The firefly is at the bright end of the scale.
    assert_eq!(map.get_pixel(11, 20).0, [252, 253, 191]);
    let html = String::from_utf8(scratch.read("page.html")).unwrap();
    assert_eq!(html.matches("data:image/png;base64,").count(), 4);
    assert!(html.ends_with("</html>\n") && html.contains("mean d^2 / (r^2 + 0.01)"));
    for outside in ["src=\"http", "href=", "@import", "<script"] {
        assert!(!html.contains(outside), "{outside}");
    }
    // With --quiet, only the page's name is printed, and no number.
    let done = scratch.run(&["compare", &a, &b, "--quiet", "--html", "page.html"]);
    assert_eq!((done.stdout(), done.stderr()), ("page.html\n".into(), String::new()));
    let done = scratch.run(&["compare", &a, &b, "--quiet", "--fail-above", "mse=0"]);
    assert_eq!((done.code(), done.stdout()), (1, String::new()));
    assert!(done.stderr().starts_with("error: compare: beauty: mse is "), "{}", done.stderr());
    // Equal pictures are black.
    assert_eq!(scratch.run(&["compare", &a, &a, "--out", "same.png"]).code(), 0);
    let same = image::open(scratch.path("same.png")).unwrap().to_rgb8();
    assert!(same.pixels().all(|p| p.0 == [0, 0, 4]));
}

#[test]
fn a_png_is_compared_in_linear_light() {
    let scratch = Scratch::new();
    let save = |name: &str, pixel: [u8; 4]| {
        image::RgbaImage::from_pixel(2, 2, image::Rgba(pixel)).save(scratch.path(name)).unwrap();
    };
    save("a.png", [188, 188, 188, 255]);
    save("b.png", [188, 188, 188, 51]);
    let report = json(&scratch.run(&["compare", "a.png", "b.png", "--json"]));
    // 188 is 0.5029 of white. b is premultiplied by 0.2.
    let light: f64 = ((188.0f64 / 255.0 + 0.055) / 1.055).powf(2.4);
    assert!((metric(&report["layers"][0], "mae") - 0.8 * light).abs() < 1e-6);
    assert_eq!(report["layers"][1]["name"], "A");
    assert!((metric(&report["layers"][1], "mae") - 0.8).abs() < 1e-6);
}

#[test]
fn a_render_is_compared_with_its_own_picture() {
    let scratch = Scratch::new();
    let scene = concat!(env!("CARGO_MANIFEST_DIR"), "/scenes/still-life.json");
    let render = ["render", scene, "-o", "x", "--size", "32x24", "--backend", "bvh", "--quiet"];
    assert_eq!(scratch.run(&[&render[..], &["--tonemap", "clamp"]].concat()).code(), 0);
    let done = scratch.run(&["compare", "x.exr", "x.png", "--json", "--layer", "beauty"]);
    let report = json(&done);
    // The EXR gives the same bytes, up to its half floats.
    assert!(report["layers"][0]["metrics"]["psnr"]["value"].as_f64().unwrap() > 55.0);
    assert_eq!(report["only_in_image"], serde_json::json!(["A"]));
    // The EXR of a crop has a position, its PNG has none.
    let crop = ["--tonemap", "clamp", "--crop", "8", "4", "20", "14"];
    assert_eq!(scratch.run(&[&render[..], &crop].concat()).code(), 0);
    let done = scratch.run(&["compare", "x.png", "x.exr", "--json", "--layer", "beauty"]);
    assert!(json(&done)["layers"][0]["metrics"]["psnr"]["value"].as_f64().unwrap() > 55.0);
}

#[test]
fn incomparable_files_are_refused() {
    let scratch = Scratch::new();
    let deep: Vec<_> = light([1.0; 6]).into_iter().chain([("Z", floats(&[1.0; 2]))]).collect();
    write_exr(&scratch.path("z.exr"), [2, 1], &deep);
    two_pixels(&scratch, "a.exr", [1.0; 6]);
    write_exr(&scratch.path("wide.exr"), [3, 1], &["R", "G", "B"].map(|c| (c, floats(&[1.0; 3]))));
    write_exr(&scratch.path("depth.exr"), [2, 1], &[("Z", floats(&[1.0; 2]))]);
    scratch.write("text.exr", "hello");
    let whole = std::fs::read(format!("{DATA}/bright-test.exr")).unwrap();
    std::fs::write(scratch.path("cut.exr"), &whole[..whole.len() / 2]).unwrap();
    let whole = std::fs::read(format!("{DATA}/noise-test.png")).unwrap();
    std::fs::write(scratch.path("cut.png"), &whole[..whole.len() / 2]).unwrap();
    let cases: &[(&[&str], &str)] = &[
        (&["missing.exr", "a.exr"], "missing.exr: cannot read"),
        (&["a.exr", "."], ".: cannot read"),
        (&["text.exr", "a.exr"], "found neither an EXR nor a PNG"),
        (&["cut.exr", "a.exr"], "cut.exr: cannot read this EXR"),
        (&["cut.png", "a.exr"], "cut.png: cannot read the PNG"),
        (&["wide.exr", "a.exr"], "found 3 x 1 pixels in the layer beauty, expected 2 x 1 pixels"),
        (&["depth.exr", "a.exr"], "a.exr has beauty"),
        (&["a.exr", "a.exr", "--fail-above", "relmes=1"], "did you mean `relmse`?"),
        (&["a.exr", "a.exr", "--fail-above", "psnr=30"], "--fail-below psnr=30"),
        (&["a.exr", "a.exr", "--fail-above", "mse"], "expected METRIC=VALUE"),
        (&["a.exr", "a.exr", "--fail-above", "mse=x"], "found `x`, expected a number"),
        (&["a.exr", "a.exr", "--fail-above", "mse=nan"], "found `nan`, expected a number"),
        (&["a.exr", "a.exr", "--fail-below", "ssim=1"], "no layer that was compared has a `ssim`"),
        (&["a.exr", "a.exr", "--layer", "beauti"], "did you mean `beauty`?"),
        (&["a.exr", "a.exr", "--exposure", "inf"], "in [-100, 100]"),
        (&["a.exr", "a.exr", "--exposure", "101"], "found 101, expected a number of stops in"),
        (&["a.exr", "cut.png", "--out", "cut.png"], "would overwrite"),
        (&["a.exr", "a.exr", "--out", "no/map.png"], "there is no such folder"),
        (&["a.exr", "a.exr", "--out", "map.jpg"], "expected a name that ends in .png"),
        (
            &["z.exr", "a.exr", "--layer", "Z"],
            "found `Z`, which a.exr does not have: it has `beauty`",
        ),
        (&["a.exr"], "required"),
    ];
    let before = scratch.names();
    for (arguments, message) in cases {
        let done = scratch.run(&[&["compare"], *arguments].concat());
        let stderr = done.stderr();
        assert_eq!(done.code(), 2, "{arguments:?}: {stderr}");
        assert!(stderr.contains(message), "{arguments:?}: {stderr}");
        assert!(!stderr.contains("panicked") && done.stdout().is_empty(), "{stderr}");
        assert_eq!(scratch.names(), before, "{arguments:?}");
    }
    // One run reports the errors of both files.
    let stderr = scratch.run(&["compare", "text.exr", "missing.exr"]).stderr();
    assert!(stderr.contains("text.exr") && stderr.contains("missing.exr"), "{stderr}");
}

#[test]
fn damaged_files_never_panic() {
    let scratch = Scratch::new();
    let lossy = Encoding { compression: Compression::DWAA(None), ..Encoding::SMALL_LOSSLESS };
    let values = floats(&(0..32 * 24).map(|i| (i % 37) as f32 * 0.1).collect::<Vec<_>>());
    let channels = ["R", "G", "B"].map(|name| (name, values.clone()));
    write_exr_as(lossy, &scratch.path("dwaa.exr"), [32, 24], &channels);
    let data = ["bright-test.exr", "noise-test.png"].map(|name| Path::new(DATA).join(name));
    for path in data.into_iter().chain([scratch.path("dwaa.exr")]) {
        let whole = std::fs::read(&path).unwrap();
        // Changes the bytes that announce channels and chunks, one after the other.
        let places = (0..whole.len().min(600)).step_by(11);
        for (at, value) in places.flat_map(|at| [0, 0x80, !whole[at]].map(|value| (at, value))) {
            let mut bytes = whole.clone();
            bytes[at] = value;
            std::fs::write(scratch.path("bad"), &bytes).unwrap();
            let done = scratch.run(&["compare", "bad", path.to_str().unwrap()]);
            assert!([0, 1, 2].contains(&done.code()), "{path:?} {at}: {}", done.stderr());
            assert!(!done.stderr().contains("panicked"), "{path:?} {at}: {}", done.stderr());
        }
    }
    let mut bytes = std::fs::read(scratch.path("dwaa.exr")).unwrap();
    // The first chunk begins with its line, which is 0, and its size. A version of 2 and the sizes
    // follow.
    let version = bytes.windows(8).rposition(|eight| eight == [2, 0, 0, 0, 0, 0, 0, 0]).unwrap();
    bytes[version + 8 + 6] = 0x7f;
    std::fs::write(scratch.path("bad"), &bytes).unwrap();
    for arguments in [
        &["compare", "bad", "dwaa.exr", "--html", "page.html"][..],
        &["compare", "dwaa.exr", "bad"],
    ] {
        let done = scratch.run(arguments);
        let stderr = done.stderr();
        assert_eq!(done.code(), 2, "{stderr}");
        assert!(stderr.contains("announces more than its pixels need"), "{stderr}");
    }
    let mut bytes = std::fs::read(scratch.path("dwaa.exr")).unwrap();
    // An entry of the channel list has a name, its end, the kind, three bytes and `linear`, then
    // two sampling factors.
    let list = bytes.windows(7).position(|seven| seven == b"chlist\0").unwrap() + 7 + 4;
    bytes[list + 2 + 8] = 0;
    std::fs::write(scratch.path("bad"), &bytes).unwrap();
    let stderr = scratch.run(&["compare", "bad", "dwaa.exr"]).stderr();
    assert!(stderr.contains("zero sampling factor"), "{stderr}");
    assert_eq!(scratch.names(), ["bad", "dwaa.exr"]);
}

#[test]
fn parts_have_the_layers_that_one_part_has() {
    let scratch = Scratch::new();
    let scene = r#"{ "camera": { "type": "pinhole", "width": 16, "height": 12, "fov": 40,
        "position": [0, 0, 5], "target": [0, 0, 0], "up": [0, 1, 0] },
        "scene": { "ambient": [1, 1, 1], "lightsources": [
            { "type": "pointlight", "position": [0, 4, 3], "id": [1, 1, 1] }],
        "shapes": [{ "type": "sphere", "center": [0, 0, 0], "radius": 1, "material": { "kd": 1, "ka": 1 } }] } }"#;
    scratch.write("s.json", scene);
    for (name, flag) in [("one", None), ("parts", Some("--multipart"))] {
        let fixed =
            ["render", "s.json", "--backend", "bvh", "--aov", "all", "--spp", "4", "-o", name];
        let flags: Vec<&str> = fixed.into_iter().chain(flag).collect();
        let done = scratch.run(&flags);
        assert_eq!(done.code(), 0, "{}", done.stderr());
    }
    let flags = ["--json", "--layer", "Z", "--layer", "samples", "--layer", "CryptoObject00.R"];
    let report = json(&scratch.run(&["compare", "parts.exr", "one.exr", "--json"]));
    assert_eq!(report["only_in_image"], serde_json::json!([]));
    assert_eq!(report["only_in_reference"], serde_json::json!([]));
    let done = scratch.run(&[&["compare", "parts.exr", "one.exr"], &flags[..]].concat());
    assert_eq!(done.code(), 0, "{}", done.stderr());
    let report = json(&done);
    let layers = report["layers"].as_array().unwrap();
    let meanings = layers.iter().map(|layer| layer["meaning"].as_str().unwrap());
    assert_eq!(meanings.collect::<Vec<_>>(), ["ids", "data", "data"]);
    assert!(layers.iter().all(|layer| metric(layer, "differ") == 0.0), "{report}");
    // The picture itself has the name of its part.
    for name in ["rgba", "rgb", "beauty"] {
        let done = scratch.run(&["compare", "parts.exr", "one.exr", "--json", "--layer", name]);
        let layers = &json(&done.good())["layers"];
        assert_eq!((&layers[0]["name"], layers.as_array().unwrap().len()), (&"beauty".into(), 1));
    }
}

#[test]
fn a_layer_named_beauty_is_the_picture_itself() {
    let scratch = Scratch::new();
    two_pixels(&scratch, "plain.exr", [1.0, 0.5, 0.0, 2.0, 2.0, 2.0]);
    let named = |name: &str| {
        let channel = |(c, data): &(&str, FlatSamples)| (format!("{name}.{c}"), data.clone());
        let own: Vec<_> = light([0.5; 6]).iter().map(channel).collect();
        own.into_iter().chain([("Z".to_string(), floats(&[1.0; 2]))])
    };
    let write = |file: &str, channels: &[(String, FlatSamples)]| {
        let channels: Vec<_> = channels.iter().map(|(c, data)| (&**c, data.clone())).collect();
        write_exr(&scratch.path(file), [2, 1], &channels);
    };
    let compare = |test: &str, reference: &str| {
        let done = scratch.run(&["compare", test, reference, "--json"]);
        assert_eq!(done.code(), 0, "{}", done.stderr());
        json(&done)
    };
    for name in ["beauty", "rgb", "RGBA"] {
        write("named.exr", &named(name).collect::<Vec<_>>());
        let report = compare("named.exr", "plain.exr");
        let layers = report["layers"].as_array().unwrap();
        assert_eq!((layers.len(), &layers[0]["name"]), (1, &"beauty".into()));
        assert!(metric(&layers[0], "max") == 1.5, "{report}");
        assert_eq!(report["only_in_image"], serde_json::json!(["Z"]));
    }
    // Beside a picture without a name, it is a layer of its own, and only one file has it.
    let plain = light([1.0; 6]).into_iter().map(|(c, data)| (c.to_string(), data));
    write("both.exr", &plain.chain(named("beauty")).collect::<Vec<_>>());
    let report = compare("both.exr", "plain.exr");
    assert!(metric(&report["layers"][0], "max") == 1.0, "{report}");
    assert_eq!(report["only_in_image"], serde_json::json!(["Z", "beauty"]));
}

/// Parts of one file may have different data windows.
#[test]
fn a_rank_of_mattes_may_be_smaller_than_the_first() {
    let scratch = Scratch::new();
    let text = |text: &str| Text::new_or_none(text).unwrap();
    let part = |rank: &str, (width, x): (usize, i32), shares: [f32; 2]| {
        let own = |c: &str, value: f32| {
            AnyChannel::new(text(&format!("Mask{rank}.{c}")), floats(&vec![value; width]))
        };
        let ids = [("R", "G", 1.0, shares[0]), ("B", "A", 2.0, shares[1])];
        let list = ids.iter().flat_map(|(id, of, n, share)| [own(id, *n), own(of, *share)]);
        let mut attributes = LayerAttributes::named(text(&format!("Mask{rank}")));
        attributes.layer_position.0 = x;
        let value = AttributeValue::Text(text("Mask"));
        attributes.other.insert(text("cryptomatte/1234567/name"), value);
        let channels = AnyChannels::sort(list.collect());
        Layer::new((width, 1), attributes, Encoding::SMALL_LOSSLESS, channels)
    };
    let write = |name: &str, shares: [f32; 2]| {
        let image = Image::empty(ImageAttributes::with_size((4, 1)))
            .with_layer(part("00", (4, 0), [0.5, 0.0]))
            .with_layer(part("01", (2, 1), shares));
        image.write().non_parallel().to_file(scratch.path(name)).unwrap();
    };
    write("a.exr", [0.0, 0.25]);
    write("b.exr", [0.0, 0.5]);
    let done = scratch.run(&["compare", "a.exr", "b.exr", "--html", "page.html"]);
    assert_eq!(done.code(), 0, "{}", done.stderr());
    let page = String::from_utf8(scratch.read("page.html")).unwrap();
    assert!(page.contains("mattes differ in 2 of 4 pixels"), "{page}");
    for pixels in ["0.50", "1.00", "2.00"] {
        assert!(page.contains(pixels), "{pixels}: {page}");
    }
}
