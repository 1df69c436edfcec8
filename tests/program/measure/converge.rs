//! `converge` through the program: studies of a small scene, output files, budgets and bad input.

use std::time::Instant;

use crate::support::program::{Done, Scratch, send};
use serde_json::Value;

/// The shadow of a ball under an area light.
const SCENE: &str = r#"{
  "nbounces": 0,
  "camera": { "type": "pinhole", "width": 40, "height": 30, "fov": 50, "position": [0, 3, 5],
              "target": [0, 0.3, 0], "up": [0, 1, 0] },
  "scene": {
    "lightsources": [{ "type": "arealight", "v0": [-1, 4, -1], "v1": [1, 4, -1], "v2": [-1, 4, 1],
                       "id": [4, 4, 4] }],
    "shapes": [
      { "type": "sphere", "center": [0, 0.8, 0], "radius": 0.7, "material": { "kd": 0.8 } },
      { "type": "plane", "v0": [-4, 0, 4], "v1": [4, 0, 4], "v2": [4, 0, -4], "v3": [-4, 0, -4],
        "material": { "kd": 0.9 } }]
  }
}"#;

fn scratch() -> Scratch {
    let scratch = Scratch::new();
    scratch.write("s.json", SCENE);
    scratch
}

fn study(scratch: &Scratch, flags: &[&str]) -> Done {
    scratch.run(&[&["converge", "s.json", "--quiet", "--threads", "2"], flags].concat())
}

fn text(scratch: &Scratch, name: &str) -> String {
    String::from_utf8(scratch.read(name)).unwrap()
}

fn json(scratch: &Scratch, name: &str) -> Value {
    serde_json::from_str(&text(scratch, name)).unwrap()
}

fn number(value: &Value) -> f64 {
    value.as_f64().unwrap_or_else(|| panic!("{value} is no number"))
}

#[test]
fn soft_shadows_converge_as_theory_says() {
    let scratch = scratch();
    let flags =
        ["--spp", "1", "--light-samples", "2,8,32,128", "--budget", "40", "--json", "r.json"];
    let done = study(&scratch, &flags);
    assert_eq!(done.code(), 0, "{}", done.stderr());
    let report = json(&scratch, "r.json");
    let points = report["points"].as_array().unwrap();
    assert_eq!(points.len(), 8);
    for point in points {
        // One camera ray per pixel, and at most this many shadow rays.
        let samples = number(&point["samples"]);
        let rays = number(&point["rays"]);
        assert!(rays > 1200.0 && rays <= 1200.0 * (1.0 + samples), "{point}");
        assert_eq!(point["seconds"].as_array().unwrap().len(), 4);
        assert_eq!(point["not_antialiased"], false, "the reference has one sample a pixel too");
        let relative = number(&point["rmse"]["standard_error"]) / number(&point["rmse"]["value"]);
        assert!(relative > 0.0 && relative < 0.2, "{point}");
        // No bias: within 5 standard errors of the mean and the error of the reference.
        let bias = number(&point["bias"]["value"]).abs();
        let limit =
            5.0 * number(&point["bias"]["standard_error"]) + number(&report["reference"]["rmse"]);
        assert!(bias <= limit, "{point}");
    }
    let slope = |sampler: &str| {
        let series = report["series"].as_array().unwrap().iter();
        let mut own = series.filter(|s| s["sampler"] == sampler && s["fixed"] == "1 spp");
        let slope = &own.next().unwrap()["slope"];
        assert_eq!((own.next(), number(&slope["points"])), (None, 4.0));
        (number(&slope["slope"]), number(&slope["standard_error"]))
    };
    let ((sobol, _), (random, error)) = (slope("sobol"), slope("random"));
    assert!((random + 0.5).abs() < 0.03 && error < 0.03, "{random} {error}");
    assert!((-1.1..-0.6).contains(&sobol), "{sobol}");
    for ratio in report["ratios"].as_array().unwrap() {
        assert!(number(&ratio["rmse"]["value"]) > 1.0, "{ratio}");
    }
    // The Pareto front runs from the cheapest setting to the best, and has no setting with
    // `random`.
    let front: Vec<&Value> = report["front"].as_array().unwrap().iter().collect();
    let of = |index: &Value, key: &str| points[number(index) as usize][key].clone();
    for pair in front.windows(2) {
        assert!(number(&of(pair[0], "median_s")) <= number(&of(pair[1], "median_s")));
        let error = |i: &Value| number(&of(i, "relmse")["value"]);
        assert!(error(pair[0]) > error(pair[1]));
    }
    let last = front[front.len() - 1];
    assert_eq!((of(last, "sampler"), of(last, "samples")), ("sobol".into(), 128.into()));
    let stdout = done.stdout();
    for part in ["to reach relmse 1e-", "error falls as samples^-", "RMSE(random) is", "r.json\n"] {
        assert!(stdout.contains(part), "{part}: {stdout}");
    }
}

#[test]
fn csv_and_page_hold_every_setting_and_need_nothing_else() {
    let scratch = scratch();
    let files = ["--json", "r.json", "--csv", "r.csv", "--html", "r.html"];
    let flags = [
        "--spp",
        "1,2,4,8",
        "--light-samples",
        "1,2",
        "--backends",
        "bvh,coursework",
        "--repeats",
        "2",
    ];
    let done = study(&scratch, &[&flags[..], &files].concat());
    assert_eq!(done.code(), 0, "{}", done.stderr());
    let report = json(&scratch, "r.json");
    let points = report["points"].as_array().unwrap();
    assert_eq!((points.len(), report["left_out"].as_array().unwrap().len()), (32, 0));
    let csv = text(&scratch, "r.csv");
    let mut lines = csv.lines();
    let head: Vec<&str> = lines.next().unwrap().split(',').collect();
    for (point, line) in points.iter().zip(lines.by_ref()) {
        let row: Vec<&str> = line.split(',').collect();
        assert_eq!(row.len(), head.len(), "{line}");
        let cell = |name: &str| row[head.iter().position(|h| *h == name).unwrap()];
        assert_eq!(cell("backend"), point["backend"].as_str().unwrap());
        assert_eq!(cell("sampler"), point["sampler"].as_str().unwrap());
        assert_eq!(cell("renders"), "2");
        assert_eq!(cell("spp").parse::<f64>().unwrap(), number(&point["spp"]));
        for (name, value) in [("rmse", "value"), ("rmse_se", "standard_error")] {
            assert_eq!(cell(name).parse::<f64>().unwrap(), number(&point["rmse"][value]));
        }
        assert_eq!(point["not_antialiased"] == true, point["spp"] == 1);
    }
    assert_eq!(lines.next(), None);
    // Both trees render the same picture.
    let error = |backend: &str| {
        let same =
            |p: &&Value| p["backend"] == backend && p["samples"] == 8 && p["sampler"] == "sobol";
        number(&points.iter().find(same).unwrap()["rmse"]["value"])
    };
    assert!((error("bvh") / error("coursework") - 1.0).abs() < 0.05);
    let html = text(&scratch, "r.html");
    for part in [
        "Error against time",
        "Error against samples",
        "coursework, random, 4 spp x 2",
        "the reference",
    ] {
        assert!(html.contains(part), "{part}");
    }
    assert_eq!(html.matches("data:image/png;base64,").count(), 5);
    for outside in ["<script", "href=", "@import", "src=\"http"] {
        assert!(!html.contains(outside), "{outside}");
    }
}

#[test]
fn a_budget_is_kept_and_skipped_settings_are_listed() {
    let _timed = crate::timed();
    let scratch = scratch();
    let flags = ["--spp", "4,16,64,1024", "--light-samples", "1,64,1024", "--size", "200x150"];
    let started = Instant::now();
    let done = study(&scratch, &[&flags[..], &["--budget", "2", "--json", "r.json"]].concat());
    let took = started.elapsed().as_secs_f64();
    assert_eq!(done.code(), 0, "{}", done.stderr());
    let report = json(&scratch, "r.json");
    // All settings would take hours. The slack is for a busy machine.
    assert!(number(&report["seconds"]) < 10.0 && took < 15.0, "{} {took}", report["seconds"]);
    let left_out = report["left_out"].as_array().unwrap();
    assert!(left_out.iter().any(|name| name == "bvh, sobol, 1024 spp x 1024"), "{left_out:?}");
    assert!(done.stdout().contains("left out to keep the budget of 2 s"));
    let done = study(&scratch, &["--budget", "0.001", "--html", "no.html"]);
    assert_eq!(done.code(), 2);
    assert!(done.stderr().contains("--budget: 0.001 s do not suffice"), "{}", done.stderr());
    assert!(!scratch.path("no.html").exists());
}

#[cfg(unix)]
#[test]
fn a_stop_does_not_use_up_the_budget() {
    let _timed = crate::timed();
    let scratch = scratch();
    let flags = ["converge", "s.json", "--spp", "1,4", "--light-samples", "1", "--size", "200x150"];
    let flags = [&flags[..], &["--budget", "4", "--json", "r.json", "--quiet"]].concat();
    let mut command = scratch.command(&flags);
    let mut child = command.stdout(std::process::Stdio::null()).spawn().unwrap();
    // Stops the process in the first second, for longer than the budget, as Ctrl-Z does.
    std::thread::sleep(std::time::Duration::from_millis(200));
    send("STOP", child.id());
    std::thread::sleep(std::time::Duration::from_millis(4500));
    send("CONT", child.id());
    assert_eq!(child.wait().unwrap().code(), Some(0));
    assert!(scratch.path("r.json").is_file());
}

#[test]
fn a_reference_may_be_a_file() {
    let scratch = scratch();
    let render = |flags: &[&str]| {
        let all = [&["render", "s.json", "-o", "ref", "--quiet", "--spp", "64"], flags].concat();
        assert_eq!(scratch.run(&all).code(), 0);
    };
    render(&["--float"]);
    let grid = ["--spp", "4,16", "--light-samples", "1", "--sampler", "sobol", "--json", "r.json"];
    let with = |file: &str, more: &[&str]| {
        study(&scratch, &[&grid[..], &["--reference", file], more].concat())
    };
    assert_eq!(with("ref.exr", &[]).code(), 0);
    let report = json(&scratch, "r.json");
    assert_eq!(
        (&report["reference"]["file"], &report["reference"]["half"]),
        (&"ref.exr".into(), &false.into())
    );
    assert_eq!(report["reference"]["rmse"], Value::Null);
    // The picture itself, rendered with its own seed and samples, has no error, and a warning says
    // so. By default other seeds are used.
    let own = ["--spp", "64", "--light-samples", "16", "--repeats", "1"];
    let flags =
        [&["--sampler", "sobol", "--reference", "ref.exr", "--json", "o.json"], &own[..]].concat();
    let error = || number(&json(&scratch, "o.json")["points"][0]["rmse"]["value"]);
    let others = study(&scratch, &flags);
    assert_eq!(others.code(), 0);
    assert!(error() > 1e-4 && !others.stderr().contains("warning"), "{}", others.stderr());
    let aloud = ["converge", "s.json", "--threads", "2", "--seed", "0"];
    let same = scratch.run(&[&aloud[..], &flags].concat());
    assert_eq!(same.code(), 0);
    assert_eq!(error(), 0.0);
    assert!(same.stderr().contains("the reference has the seed 0"), "{}", same.stderr());

    let grey = [("Y", super::compare::floats(&[0.5; 40 * 30]))];
    super::compare::write_exr(&scratch.path("grey.exr"), [40, 30], &grey);
    for (file, more, message) in [
        ("grey.exr", &[][..], "found a grey picture (Y alone), expected R G B"),
        (
            "ref.exr",
            &["--size", "41x30"][..],
            "found 40 x 30 pixels at (0, 0), expected the whole frame of 41 x 30",
        ),
        ("ref.png", &[], "found a PNG, expected an EXR"),
        ("none.exr", &[], "none.exr: cannot read"),
        ("s.json", &[], "found neither an EXR nor a PNG"),
    ] {
        let done = with(file, more);
        assert_eq!(done.code(), 2, "{file}");
        assert!(done.stderr().contains(message), "{}", done.stderr());
    }
    render(&["--crop", "3", "4", "20", "20"]);
    let done = with("ref.exr", &[]);
    assert!(
        done.code() == 2 && done.stderr().contains("17 x 16 pixels at (3, 4)"),
        "{}",
        done.stderr()
    );
}

#[test]
fn a_reference_of_another_scene_is_noted() {
    let scratch = scratch();
    let darker = SCENE.replace("\"id\": [4, 4, 4]", "\"id\": [3, 4, 4]");
    for (name, scene, warned) in [("same", SCENE, false), ("other", &darker, true)] {
        scratch.write("r.json", scene);
        let render = ["render", "r.json", "-o", "r", "--float", "--spp", "64", "--quiet"];
        scratch.run(&render).good();
        let grid = ["--reference", "r.exr", "--spp", "1,4,16", "--light-samples", "1,4"];
        let done = study(&scratch, &[&grid[..], &["--sampler", "sobol"]].concat()).good();
        let message = "all settings differ from r.exr by the same mean error of";
        assert_eq!(done.stdout().contains(message), warned, "{name}: {}", done.stdout());
    }
}

#[test]
fn the_number_of_light_samples_of_a_study_decides_about_adaptive_shadows() {
    let scratch = scratch();
    scratch.write("s.json", &SCENE.replace("\"id\":", "\"samples\": 1, \"id\":"));
    for (samples, warned) in [("4", true), ("64", false), ("1,64", false)] {
        let flags = ["s.json", "--set", "/adaptiveshadows=true", "--light-samples", samples];
        let grid = ["--spp", "1", "--sampler", "sobol", "--repeats", "1", "--threads", "2"];
        let done = scratch.run(&[&["converge"], &flags[..], &grid].concat()).good();
        let message = "no area light has more than 4 `samples`";
        assert_eq!(done.stderr().contains(message), warned, "{samples}: {}", done.stderr());
    }
}

#[test]
fn a_picture_without_edges_needs_no_antialiasing() {
    let scratch = scratch();
    scratch.write(
        "flat.json",
        r#"{ "camera": { "type": "pinhole", "width": 8, "height": 8, "fov": 50,
               "position": [0, 1, 0], "target": [0, 0, 0], "up": [0, 0, 1] },
             "scene": { "ambient": [1, 1, 1], "shapes": [{ "type": "plane", "v0": [-9, 0, 9],
               "v1": [9, 0, 9], "v2": [9, 0, -9], "v3": [-9, 0, -9],
               "material": { "ka": 0.5, "kd": 0 } }] } }"#,
    );
    for (scene, noted) in [("flat.json", false), ("s.json", true)] {
        let flags = ["converge", scene, "--spp", "1,4", "--budget", "5", "--quiet"];
        let done = scratch.run(&flags).good();
        let note = done.stdout().contains("1 spp is not antialiased");
        assert_eq!(note, noted, "{scene}: {}", done.stdout());
    }
}

/// A sun of size 0 has one direction, whatever its number of samples.
#[test]
fn a_sun_of_size_0_has_no_light_samples() {
    let scratch = scratch();
    let area =
        "{ \"type\": \"arealight\", \"v0\": [-1, 4, -1], \"v1\": [1, 4, -1], \"v2\": [-1, 4, 1],";
    let light = |kind: &str| format!("{{ \"type\": {kind}, \"direction\": [0, -1, 0],");
    let scene = |kind: &str| {
        let scene = SCENE.replace(area, &light(kind));
        assert_ne!(scene, SCENE);
        scene
    };
    scratch.write("sun.json", &scene("\"sun\", \"angle\": 5"));
    scratch.write("size-0.json", &scene("\"sun\", \"angle\": 0, \"samples\": 16"));
    scratch.write("directional.json", &scene("\"directional\""));
    let both =
        SCENE.replace(area, &format!("{} \"id\": [1, 1, 1] }}, {area}", light("\"directional\"")));
    scratch.write("both.json", &both);
    let study = |scene: &str| {
        let flags = ["--spp", "2", "--repeats", "1", "--budget", "20", "--json", "r.json"];
        scratch
            .run(&[&["converge", scene, "--quiet", "--sampler", "sobol"], &flags[..]].concat())
            .good();
        let points = json(&scratch, "r.json")["points"].as_array().unwrap().clone();
        let of = |key: &str| points.iter().map(|point| point[key].as_u64()).collect::<Vec<_>>();
        (of("light_samples"), of("rays"))
    };
    assert_eq!(study("sun.json").0, [Some(1), Some(4), Some(16)]);
    for scene in ["size-0.json", "directional.json"] {
        assert_eq!(study(scene).0, [None], "{scene}");
        let message = "--light-samples: has no effect: the scene has no area light, environment or sun with an angle";
        let done = scratch.run(&["converge", scene, "--light-samples", "4"]);
        assert!(done.code() == 2 && done.stderr().contains(message), "{}", done.stderr());
        let done = scratch.run(&["render", scene, "--light-samples", "4"]).good();
        assert!(done.stderr().contains(message), "{}", done.stderr());
    }
    // The directional light adds one ray a hit, whatever the number of samples of the area light.
    scratch.write("s.json", SCENE);
    let (both, area) = (study("both.json").1, study("s.json").1);
    let added = |i: usize| both[i].unwrap() - area[i].unwrap();
    assert!(added(2) < 2 * added(0), "{} {}", added(0), added(2));
}

/// A drawn light has one point, whatever its number of samples.
#[test]
fn drawn_lights_have_no_light_samples() {
    let scratch = scratch();
    let start = SCENE.find("{ \"type\": \"arealight\"").unwrap();
    let end = SCENE.find(" }],\n    \"shapes\"").unwrap() + 2;
    let lights = |lights: &[&str]| SCENE.replace(&SCENE[start..end], &lights.join(", "));
    let (area, sun) = (
        &SCENE[start..end],
        r#"{ "type": "sun", "angle": 5, "direction": [0, -1, 0], "id": [1, 1, 1] }"#,
    );
    scratch.write("s.json", &lights(&[area, area]));
    scratch.write("sun.json", &lights(&[area, area, sun]));
    let catcher = lights(&[area, area])
        .replace("\"radius\": 0.7,", "\"radius\": 0.7, \"shadow_catcher\": true,");
    scratch.write("catcher.json", &catcher);
    let study = |scene: &str, draws: u32| {
        let draws = format!("/emittersamples={draws}");
        let flags = ["--spp", "2", "--repeats", "1", "--budget", "20", "--json", "r.json"];
        let all = ["converge", scene, "--quiet", "--sampler", "sobol", "--set", &draws];
        scratch.run(&[&all[..], &flags].concat()).good();
        let points = json(&scratch, "r.json")["points"].as_array().unwrap().clone();
        points.iter().map(|point| point["light_samples"].as_u64()).collect::<Vec<_>>()
    };
    let all = [Some(1), Some(4), Some(16)];
    assert_eq!(study("s.json", 1), [None]);
    // These lights are not drawn.
    assert_eq!(study("s.json", 2), all);
    assert_eq!(study("sun.json", 1), all);
    assert_eq!(study("catcher.json", 1), all);
    let flags = ["converge", "s.json", "--set", "/emittersamples=1", "--light-samples", "4"];
    let done = scratch.run(&flags);
    let message = "--light-samples: has no effect: `emittersamples` draws lights";
    assert!(done.code() == 2 && done.stderr().contains(message), "{}", done.stderr());
}

#[test]
fn bad_input_is_refused_before_anything_is_rendered() {
    let scratch = scratch();
    scratch.write(
        "plain.json",
        &SCENE.replace(
            "\"arealight\", \"v0\": [-1, 4, -1], \"v1\": [1, 4, -1], \"v2\": [-1, 4, 1]",
            "\"pointlight\", \"position\": [0, 4, 0]",
        ),
    );
    for (flags, message) in [
        (&["s.json", "--budget", "-1"][..], "--budget: found -1, expected seconds in (0, 1e6]"),
        (&["s.json", "--budget", "nan"], "--budget"),
        (&["s.json", "--spp", "0"], "--spp"),
        (&["s.json", "--spp", "4,x"], "--spp"),
        (&["s.json", "--sampler", "halton"], "sobol"),
        (&["s.json", "--backends", "embre"], "--backends: found \"embre\""),
        (&["s.json", "--backends", "bvh,bvh"], "found bvh twice"),
        (&["s.json", "--html", "a", "--csv", "a"], "overwrite an input or another output"),
        (&["s.json", "--json", "s.json"], "overwrite an input or another output"),
        (
            &["plain.json", "--light-samples", "4"],
            "--light-samples: has no effect: the scene has no area light",
        ),
        (&["none.json"], "none.json"),
        (&["s.json", "--set", "/camera/fov=200"], "/camera/fov"),
        (&["s.json", "--html", "no/where.html"], "no/where.html"),
    ] {
        let done = scratch.run(&[&["converge"], flags].concat());
        assert_eq!(done.code(), 2, "{flags:?}: {}", done.stderr());
        assert!(done.stderr().contains(message), "{flags:?}: {}", done.stderr());
        assert_eq!(done.stdout(), "");
    }
    // A scene without area lights still has pixels to sample.
    let flags = ["converge", "plain.json", "--spp", "2,4", "--budget", "5", "--quiet"];
    let done = scratch.run(&flags);
    assert_eq!(done.code(), 0, "{}", done.stderr());
    assert!(done.stdout().contains("bvh, sobol, 4 spp "), "{}", done.stdout());
}

/// Files are written although the table cannot be printed.
#[test]
fn results_are_kept_if_stdout_fails() {
    let scratch = scratch();
    for args in [
        "converge s.json --spp 1 --light-samples 1 --repeats 2 --budget 20",
        "bench s.json --quick --classes primary --backend bvh",
        "accuracy --case nearly --backend bvh:portable",
    ] {
        let line = format!("\"$0\" {args} --quiet --json r.json > /dev/full");
        let mut shell = std::process::Command::new("sh");
        shell.args(["-c", &line, env!("CARGO_BIN_EXE_lightpath")]);
        let done = Done::of(shell.current_dir(scratch.path("")));
        assert_eq!(done.code(), 3, "{args}: {}", done.stderr());
        assert!(done.stderr().contains("<stdout>: cannot write"), "{args}: {}", done.stderr());
        assert!(json(&scratch, "r.json").is_object(), "{args}");
        std::fs::remove_file(scratch.path("r.json")).unwrap();
    }
}
