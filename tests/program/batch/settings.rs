//! Settings that a batch shares with `render`: overscan, adaptive sampling, `--strict`, the tone
//! curve.

use serde_json::{Value, json};

use crate::support::program::{Done, Scratch};

/// A ball under a light, behind it a floor; without a tone curve.
fn ball(light: f64) -> Value {
    let camera = json!({ "type": "pinhole", "width": 40, "height": 24, "fov": 40,
        "position": [0, 1, 5], "target": [0, 0, 0], "up": [0, 1, 0] });
    let lamp = json!({ "type": "arealight", "id": [light, 1, 1], "samples": 1,
        "v0": [2, 4, 2], "v1": [3, 4, 2], "v2": [2, 4, 3] });
    let shapes = json!([
        { "type": "sphere", "center": [0, 0, 0], "radius": 1, "material": "chalk" },
        { "type": "plane", "v0": [-9, -1, 9], "v1": [9, -1, 9], "v2": [9, -1, -9],
          "v3": [-9, -1, -9], "material": {} }]);
    json!({ "spp": 4, "camera": camera, "scene": {
        "lightsources": [lamp], "materials": { "chalk": {} }, "shapes": shapes } })
}

/// `a.json` and `b.json`, the second one brighter.
fn scratch() -> Scratch {
    let scratch = Scratch::new();
    scratch.write("a.json", &ball(3.0).to_string());
    scratch.write("b.json", &ball(9.0).to_string());
    scratch
}

fn batch(scratch: &Scratch, args: &[&str]) -> Done {
    scratch.run(&[&["batch", "--no-sheet", "-o", "out"], args].concat())
}

/// Checks that a frame has the pixels, the windows and the attributes of a render. Only a frame has
/// a fingerprint.
fn assert_same(scratch: &Scratch, frame: &str, render: &str) {
    let [mut of_frame, of_render] = [frame, render].map(|name| {
        let done = scratch.run(&["info", "--json", &format!("{name}.exr")]).good();
        let mut value: Value = serde_json::from_str(&done.stdout()).unwrap();
        value.as_object_mut().unwrap().remove("file");
        value.as_object_mut().unwrap().remove("bytes");
        value
    });
    let attributes = of_frame["parts"][0]["attributes"].as_object_mut().unwrap();
    assert!(attributes.remove("lightpath:fingerprint").is_some());
    assert_eq!(of_frame, of_render);
    assert_eq!(
        scratch.channels(&format!("{frame}.exr")),
        scratch.channels(&format!("{render}.exr"))
    );
    let [of_frame, of_render] = [frame, render]
        .map(|name| image::open(scratch.path(&format!("{name}.png"))).unwrap().into_bytes());
    assert!(of_frame == of_render);
}

/// A batch with other settings makes its frames again. The same settings in a job file are the same
/// frames.
#[test]
fn overscan_and_noise_are_those_of_render() {
    let scratch = scratch();
    let noise = ["--noise", "0.05", "--noise-of", "picture", "--max-spp", "64"];
    let cases: [(&[&str], Value); 4] = [
        (&["--overscan", "5"], json!({ "overscan": 5 })),
        (&["--noise", "0.2"], json!({ "noise": 0.2 })),
        (&noise, json!({ "noise": 0.05, "noiseof": "picture", "maxspp": 64 })),
        (
            &[&["--overscan", "7", "--threads", "1"][..], &noise].concat(),
            json!({ "overscan": 7, "noise": 0.05, "noiseof": "picture", "maxspp": 64 }),
        ),
    ];
    for (flags, keys) in cases {
        let flags = [flags, &["--aov", "Z,samples"]].concat();
        let done = batch(&scratch, &[&["a.json", "b.json", "--resume"], &flags[..]].concat());
        assert!(done.good().stderr().contains("2 frames rendered, 0 kept"), "{flags:?}");
        scratch.run(&[&["render", "b.json", "-o", "alone"], &flags[..]].concat()).good();
        assert_same(&scratch, "out/b", "alone");
        let mut job = keys;
        job["inputs"] = json!(["a.json", "b.json"]);
        job["layers"] = json!(["Z", "samples"]);
        scratch.write("job.json", &job.to_string());
        let done = batch(&scratch, &["job.json", "--resume"]).good();
        assert!(done.stderr().contains("0 frames rendered, 2 kept"), "{}", done.stderr());
    }
    let sheet = scratch.run(&["batch", "job.json", "-o", "out", "--sheet-only"]);
    assert_eq!(sheet.code(), 0, "{}", sheet.stderr());
}

/// A turntable shares the film of its frames. The second list has pictures of several sizes.
#[test]
fn frames_with_overscan_share_a_film() {
    let scratch = scratch();
    let flags = ["--overscan", "9", "--jobs", "1"];
    batch(&scratch, &[&["a.json", "--turntable", "3"], &flags[..]].concat()).good();
    scratch.run(&["render", "a.json", "-o", "alone", "--overscan", "9"]).good();
    assert_eq!(scratch.channels("out/a/a.0000.exr"), scratch.channels("alone.exr"));
    // At most two films exist, so the third frame has one of another frame.
    let last = ["--turntable", "3", "--range", "2..3", "--name", "last/{frame}"];
    batch(&scratch, &[&["a.json"], &last[..], &flags].concat()).good();
    assert_eq!(scratch.channels("out/a/a.0002.exr"), scratch.channels("out/last/2.exr"));
    let view = |width: u32| {
        let mut camera = ball(1.0)["camera"].clone();
        camera["width"] = json!(width);
        json!({ "image": width.to_string(), "camera": camera })
    };
    let sizes = [40, 33, 41, 32];
    let list = json!({ "cameras": sizes.map(view) });
    scratch.write("list.json", &list.to_string());
    let all = [&["a.json", "--cameras", "list.json"], &flags[..]].concat();
    batch(&scratch, &all).good();
    assert_eq!(scratch.channels("out/a/40.exr"), scratch.channels("alone.exr"));
    for (i, width) in sizes.into_iter().enumerate() {
        let range = format!("{i}..{}", i + 1);
        let one = [&all[..], &["--range", &range, "--name", "one/{image}"]].concat();
        batch(&scratch, &one).good();
        let [shared, own] = ["a", "one"].map(|folder| format!("out/{folder}/{width}.exr"));
        assert_eq!(scratch.channels(&shared), scratch.channels(&own));
        let size = image::image_dimensions(scratch.path(&format!("out/a/{width}.png"))).unwrap();
        assert_eq!(size, (width + 18, 24 + 18));
    }
}

fn refused_job(scratch: &Scratch, said: &str) {
    let done = batch(scratch, &["job.json"]);
    assert!(done.code() == 2 && done.stderr().contains(said), "{said}: {}", done.stderr());
}

/// Settings that do not fit one input fail once, before its frames.
#[test]
fn an_input_that_the_settings_do_not_fit_fails_once() {
    let scratch = scratch();
    let mut many = ball(3.0);
    many["spp"] = json!(64);
    scratch.write("b.json", &many.to_string());
    let flags = ["--turntable", "3", "--noise", "0.1", "--max-spp", "64"];
    let done = batch(&scratch, &[&["a.json", "b.json"], &flags[..]].concat());
    assert_eq!(done.code(), 1, "{}", done.stderr());
    let journal = String::from_utf8(scratch.read("out/batch.jsonl")).unwrap();
    let failed = journal.lines().filter(|line| line.contains(r#""event":"failed""#));
    let failed: Vec<&str> = failed.collect();
    assert!(failed.len() == 1 && failed[0].contains("no room for more samples"), "{failed:?}");
}

/// A flag wins over the job file, also with its default.
#[test]
fn no_overscan_wins_over_the_job() {
    let scratch = scratch();
    scratch.write("job.json", &json!({ "inputs": ["a.json"], "overscan": 5 }).to_string());
    batch(&scratch, &["job.json", "--overscan", "0"]).good();
    assert_eq!(image::image_dimensions(scratch.path("out/a.png")).unwrap(), (40, 24));
}

#[test]
fn settings_that_fit_no_input_are_refused() {
    let scratch = scratch();
    let refused = |flags: &[&str], said: &str| {
        let done = batch(&scratch, &[&["a.json"], flags].concat());
        assert_eq!(done.code(), 2, "{flags:?} {}", done.stderr());
        assert!(done.stderr().contains(said), "{flags:?} {}", done.stderr());
        assert!(!scratch.path("out").exists());
    };
    refused(&["--overscan", "60000", "--size", "30000x30000"], "--overscan: found 60000");
    refused(&["--noise", "2"], "--noise: found 2");
    refused(&["--max-spp", "64"], "--max-spp: found without --noise");
    refused(&["--noise", "0.1", "--max-spp", "16"], "no room for more samples");
    refused(&["--crop", "0", "0", "1", "1"], "--crop: found with `batch`");
    for (key, value, said) in [
        ("noise", json!(2), "/noise"),
        ("noiseof", json!("pixel"), "--noise-of: found without --noise"),
        ("maxspp", json!(64), "--max-spp: found without --noise"),
    ] {
        let job = json!({ "inputs": ["a.json"], key: value });
        scratch.write("job.json", &job.to_string());
        refused_job(&scratch, said);
    }
    let job = json!({ "inputs": ["a.json"], "noise": 0.1, "maxspp": 3 });
    scratch.write("job.json", &job.to_string());
    refused_job(&scratch, "expected a power of two");
}

/// The light is finite, its product with the material is not.
#[test]
fn a_strict_batch_writes_no_frame_with_nan() {
    let scratch = scratch();
    let mut bright = ball(1e18);
    bright["scene"]["materials"]["chalk"] = json!({ "kd": 1e6, "diffusecolor": [1e18, 1, 1] });
    scratch.write("b.json", &bright.to_string());
    let flags = ["a.json", "b.json", "--resume"];
    let strict = || batch(&scratch, &[&flags[..], &["--strict"]].concat());
    let done = strict();
    assert_eq!(done.code(), 1, "{}", done.stderr());
    let said = done.stderr();
    assert!(said.contains("error: b.json: out/b.exr: ") && said.contains("NaN or inf"), "{said}");
    assert!(scratch.path("out/a.exr").exists() && !scratch.path("out/b.exr").exists());
    assert!(!scratch.path("out/b.png").exists());
    let journal = String::from_utf8(scratch.read("out/batch.jsonl")).unwrap();
    let failed = journal.lines().map(|line| serde_json::from_str::<Value>(line).unwrap());
    let failed: Vec<Value> = failed.filter(|record| record["event"] == "failed").collect();
    assert_eq!((failed.len(), &failed[0]["frame"]), (1, &json!(0)));
    assert!(failed[0]["message"].as_str().unwrap().contains("NaN or infinite"));
    // Without the flag the frame is written, and a later run with the flag does not keep it.
    let done = batch(&scratch, &flags).good();
    assert!(done.stderr().contains("NaN or infinite"), "{}", done.stderr());
    assert!(scratch.path("out/b.exr").exists());
    assert_eq!(strict().code(), 1);
    // A frame that was checked is also one without the flag.
    let done = batch(&scratch, &["a.json", "--resume"]).good();
    assert!(done.stderr().contains("0 frames rendered, 1 kept"), "{}", done.stderr());
    let job = json!({ "inputs": ["b.json"], "output": { "strict": true } });
    scratch.write("job.json", &job.to_string());
    assert_eq!(batch(&scratch, &["job.json"]).code(), 1);
}

#[test]
fn frames_that_may_flicker_are_warned_of_once() {
    let scratch = scratch();
    let warnings = |args: &[&str]| {
        let said = batch(&scratch, args).good().stderr();
        assert_eq!(said.matches("tonemap").count(), 2 * said.matches("no operator").count());
        said.matches("warning: ").count()
    };
    assert_eq!(warnings(&["a.json", "b.json"]), 1);
    assert_eq!(warnings(&["a.json", "--turntable", "3"]), 1);
    assert_eq!(warnings(&["a.json"]), 0);
    for operator in ["max", "clamp"] {
        assert_eq!(warnings(&["a.json", "b.json", "--tonemap", operator]), 0);
        let set = format!("/tonemap/operator={operator}");
        assert_eq!(warnings(&["a.json", "b.json", "--set", &set]), 0);
        let mut scene = ball(3.0);
        scene["tonemap"] = json!({ "operator": operator });
        scratch.write("c.json", &scene.to_string());
        assert_eq!(warnings(&["c.json", "--turntable", "2"]), 0);
    }
    scratch.write("m.ply", crate::support::program::PYRAMID);
    assert_eq!(warnings(&["m.ply", "--turntable", "2", "--size", "24x16"]), 0);
}
