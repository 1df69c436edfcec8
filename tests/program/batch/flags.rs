//! A flag wins over the inputs of a job file, and an input over the job.

use serde_json::{Value, json};

use crate::support::program::{PYRAMID, SMALL, Scratch};

/// Renders `a.ply` with a job of these keys, and with flags that follow them.
fn channels(scratch: &Scratch, job: Value, flags: &[&str]) -> Vec<(String, Vec<u32>)> {
    scratch.write("job.json", &job.to_string());
    let args = ["batch", "job.json", "-o", "out", "--no-sheet", "--quiet"];
    scratch.run(&[&args[..], &SMALL, flags].concat()).good();
    scratch.channels("out/a.exr")
}

#[test]
fn a_flag_wins_over_every_input_and_job() {
    let scratch = Scratch::new();
    scratch.write("a.ply", PYRAMID);
    let plain = || json!({ "inputs": ["a.ply"] });
    let entry = |keys: Value| {
        let mut entry = json!({ "path": "a.ply" });
        entry.as_object_mut().unwrap().extend(keys.as_object().unwrap().clone());
        json!({ "inputs": [entry] })
    };
    let set = |pointer: &str, value: Value| entry(json!({ "set": { pointer: value } }));
    let shape = "/scene/shapes/0";
    let turned = || set(&format!("{shape}/rotate"), json!([10, 20, 30]));
    let samples = "/scene/lightsources/0/samples";
    let cases: Vec<(Value, &[&str])> = vec![
        (entry(json!({ "up": "z" })), &["--up", "x"]),
        (entry(json!({ "rotate": [10, 20, 30] })), &["--up", "z"]),
        (entry(json!({ "up": "z" })), &["--rotate", "0,0,70"]),
        (turned(), &["--up", "z"]),
        (turned(), &["--rotate", "0,0,70"]),
        (set(&format!("{shape}/smooth"), json!(false)), &["--smooth", "all"]),
        (set(&format!("{shape}/points"), json!(0.5)), &["--points", "0.2"]),
        (set("/spp", json!(9)), &["--quality", "draft"]),
        (set("/spp", json!(9)), &["--quality", "normal"]),
        (set(samples, json!(9)), &["--light-samples", "1"]),
        (set("/tonemap/exposure", json!(2)), &["--set", "/tonemap/exposure=1"]),
        (json!({ "inputs": ["a.ply"], "set": { "/spp": 9 } }), &["--quality", "draft"]),
        (json!({ "inputs": ["a.ply"], "set": { samples: 9 } }), &["--light-samples", "1"]),
    ];
    for (job, flags) in cases {
        let said = format!("{job} {flags:?}");
        assert!(channels(&scratch, job, flags) == channels(&scratch, plain(), flags), "{said}");
    }
    // Without a flag, an input wins over the job.
    let job =
        json!({ "inputs": [{ "path": "a.ply", "set": { "/spp": 2 } }], "set": { "/spp": 9 } });
    let other = channels(&scratch, plain(), &["--spp", "2"]);
    assert!(channels(&scratch, job, &[]) == other);
    // --set is the last word.
    let flags = ["--quality", "draft", "--light-samples", "9", "--set", &format!("{samples}=1")];
    let same = channels(&scratch, set("/spp", json!(9)), &flags);
    assert!(same == channels(&scratch, plain(), &flags));
}

#[test]
fn values_are_set_in_the_order_of_the_file() {
    let scratch = Scratch::new();
    scratch.write("a.ply", PYRAMID);
    let png = |set: Value, entry: Value| {
        let job = json!({ "inputs": [{ "path": "a.ply", "set": entry }], "set": set });
        channels(&scratch, job, &[]);
        scratch.read("out/a.png")
    };
    let brighter = || json!({ "/tonemap/exposure": 2 });
    let then_none = || json!({ "/tonemap/exposure": 2, "/tonemap": {} });
    let pixels_of = |bytes: Vec<u8>| {
        let mut reader = png::Decoder::new(std::io::Cursor::new(bytes)).read_info().unwrap();
        let mut pixels = vec![0; reader.output_buffer_size().unwrap()];
        reader.next_frame(&mut pixels).unwrap();
        pixels
    };
    let plain = pixels_of(png(json!({ "/tonemap": {} }), json!({})));
    assert!(pixels_of(png(brighter(), json!({}))) != plain);
    assert!(pixels_of(png(then_none(), json!({}))) == plain);
    assert!(pixels_of(png(json!({}), then_none())) == plain);
}

#[test]
fn a_turntable_of_one_turned_frame_needs_an_axis() {
    let scratch = Scratch::new();
    scratch.write("a.ply", PYRAMID);
    let camera = json!({ "type": "pinhole", "width": 8, "height": 6, "fov": 40,
                         "position": [100, 0, 5], "lookat": [0, 0, -1], "up": [0, 1, 0] });
    let ball = json!({ "type": "sphere", "center": [100, 0, 0], "radius": 1, "material": {} });
    let scene = json!({ "camera": camera, "scene": { "shapes": [ball] } });
    scratch.write("s.json", &scene.to_string());
    let batch = |input: &str, start: &str| {
        let args = ["batch", input, "-o", "out", "--turntable", "1", "--no-sheet", "--quiet"];
        scratch.run(&[&args[..], &["--start", start], &SMALL].concat())
    };
    batch("s.json", "-360").good();
    let refused = batch("s.json", "90");
    assert!(
        refused.code() == 1 && refused.stderr().contains("no `target`"),
        "{}",
        refused.stderr()
    );
    // The angle has the range of the job file.
    for start in ["361", "-1e9", "nan"] {
        let refused = batch("a.ply", start);
        assert_eq!(refused.code(), 2, "{start}");
        assert!(refused.stderr().contains("[-360, 360]"), "{}", refused.stderr());
    }
}

#[test]
fn a_texture_wins_over_the_material_of_an_input() {
    let scratch = Scratch::new();
    let quad = "ply\nformat ascii 1.0\nelement vertex 4\nproperty float x\nproperty float y\n\
                property float z\nproperty float s\nproperty float t\nelement face 1\n\
                property list uchar int vertex_indices\nend_header\n\
                -1 0 0 0 0\n1 0 0 1 0\n1 2 0 1 1\n-1 2 0 0 1\n4 0 1 2 3\n";
    scratch.write("a.ply", quad);
    for (name, color) in [("red", [255, 0, 0]), ("blue", [0, 0, 255])] {
        let image = image::RgbImage::from_pixel(2, 2, image::Rgb(color));
        image.save(scratch.path(&format!("{name}.png"))).unwrap();
    }
    let job = |set: Value| json!({ "inputs": [{ "path": "a.ply", "set": set }] });
    let flags = ["--texture", "red.png"];
    let material = "/scene/materials/subject";
    let plain = channels(&scratch, json!({ "inputs": ["a.ply"] }), &flags);
    let blue = job(json!({ format!("{material}/tPath"): "blue.png" }));
    assert!(channels(&scratch, blue.clone(), &flags) == plain);
    assert!(channels(&scratch, blue, &[]) != plain);
    // The rest of a material stays.
    let dark = job(json!({ material: { "kd": 0.5, "tPath": "blue.png" } }));
    let [r, _, b] = [0, 1, 2].map(|i| {
        let channels = channels(&scratch, dark.clone(), &flags);
        let name = ["R", "G", "B"][i];
        let all = channels.into_iter().find(|(known, _)| known == name).unwrap().1;
        all[8 * 24 + 12]
    });
    assert!(r > b, "{r} {b}");
}

#[test]
fn a_template_a_studio_or_a_turntable_replaces_what_the_job_has() {
    let scratch = Scratch::new();
    scratch.write("a.ply", PYRAMID);
    scratch.write("t.json", include_str!("../../../assets/studio.json"));
    let run = |job: Value, flags: &[&str]| {
        scratch.write("job.json", &job.to_string());
        let args = ["batch", "job.json", "-o", "out", "--no-sheet", "--quiet"];
        scratch.run(&[&args[..], &SMALL, flags].concat()).good().stdout()
    };
    let plain = || json!({ "inputs": ["a.ply"] });
    let (template, studio) = (["--template", "t.json"], ["--studio", "clay"]);
    let job = json!({ "inputs": ["a.ply"], "studio": "clay", "quality": "draft" });
    let [replaced, alone] = [job, plain()].map(|job| channels(&scratch, job, &template));
    assert!(replaced == alone, "--template");
    let job = json!({ "inputs": ["a.ply"], "template": "t.json" });
    let [other, clay] = [job, plain()].map(|job| channels(&scratch, job, &studio));
    assert!(other == clay && clay != alone, "--studio");
    let listed = run(json!({ "inputs": ["a.ply"], "cameras": "none.json" }), &["--turntable", "2"]);
    assert_eq!(listed.lines().count(), 4, "{listed}");
}
