//! `lightpath batch` through the program: frames rendered and kept, refusals and messages.

use std::{fs, path::Path, process::Stdio, time::SystemTime};

use crate::support::program::{self, PYRAMID, SMALL, Scratch, names_in};
use serde_json::Value;

fn batch(scratch: &Scratch, args: &[&str]) -> program::Done {
    scratch.run(&[&["batch"], args, &SMALL].concat())
}

/// Three pyramids of different heights.
fn scans() -> Scratch {
    let scratch = Scratch::new();
    for (name, height) in [("a", "1"), ("b", "2"), ("c", "3.5")] {
        scratch.write(
            &format!("scans/{name}.ply"),
            &PYRAMID.replace("0 2 0", &format!("0 {height} 0")),
        );
    }
    scratch
}

fn journal(scratch: &Scratch, name: &str) -> Vec<Value> {
    let text = String::from_utf8(scratch.read(name)).unwrap();
    text.lines().map(|line| serde_json::from_str(line).unwrap()).collect()
}

/// Returns all pictures below a folder with their bytes.
fn pictures(folder: &Path) -> Vec<(String, Vec<u8>)> {
    let mut all = Vec::new();
    let mut folders = vec![folder.to_owned()];
    while let Some(next) = folders.pop() {
        for entry in fs::read_dir(&next).unwrap() {
            let path = entry.unwrap().path();
            if path.is_dir() {
                folders.push(path);
            } else if path.extension().is_some_and(|end| end == "exr" || end == "png") {
                let name = path.strip_prefix(folder).unwrap().display().to_string();
                all.push((name, fs::read(&path).unwrap()));
            }
        }
    }
    all.sort();
    all
}

#[test]
fn flags_for_meshes_are_refused_with_scenes_alone() {
    let scratch = scans();
    scratch.write("s.json", r#"{"camera": {"width": 8}, "scene": {"shapes": []}}"#);
    for flag in [&["--up", "z"][..], &["--smooth", "30"], &["--quality", "draft"], &["--no-ground"]]
    {
        let alone = scratch.run(&[&["batch", "s.json", "--dry-run"], flag].concat());
        let expected = format!("error: {}: found with scenes, expected with a .ply file", flag[0]);
        assert!(alone.stderr().contains(&expected), "{}", alone.stderr());
        assert_eq!(alone.code(), 2);
        scratch.run(&[&["batch", "s.json", "scans/a.ply", "--dry-run"], flag].concat()).good();
    }
    // So are keys of a job file.
    for (key, value) in [("up", "\"z\""), ("margin", "0.2"), ("quality", "\"draft\"")] {
        let job = |inputs: &str| {
            scratch.write("job.json", &format!(r#"{{ "inputs": {inputs}, "{key}": {value} }}"#));
            scratch.run(&["batch", "job.json", "--dry-run"])
        };
        let done = job(r#"["s.json"]"#);
        let expected = format!("(/{key}): found with scenes, expected with a .ply file");
        assert!(done.stderr().starts_with("error: job.json:1:"), "{}", done.stderr());
        assert!(done.code() == 2 && done.stderr().contains(&expected), "{}", done.stderr());
        job(r#"["s.json", "scans/a.ply"]"#).good();
    }
    let entry = r#"{ "inputs": ["scans/a.ply", { "path": "s.json", "up": "z" }] }"#;
    scratch.write("job.json", entry);
    let done = scratch.run(&["batch", "job.json", "--dry-run"]);
    assert!(
        done.stderr().contains("error: job.json:1:55 (/inputs/1/up): found with scenes"),
        "{}",
        done.stderr()
    );
    assert_eq!(done.code(), 2);
}

#[test]
fn a_frame_has_the_bytes_of_render() {
    let scratch = scans();
    let done = batch(&scratch, &["scans", "-o", "out", "--no-sheet"]);
    assert_eq!((done.code(), done.stdout().lines().count()), (0, 6), "{}", done.stderr());
    assert_eq!(
        names_in(&scratch.path("out")),
        ["a.exr", "a.png", "b.exr", "b.png", "batch.jsonl", "c.exr", "c.png"]
    );
    let done = scratch.run(&[&["render", "scans/b.ply", "-o", "b"], &SMALL[..]].concat());
    assert_eq!(done.code(), 0, "{}", done.stderr());
    assert_eq!(scratch.channels("out/b.exr"), scratch.channels("b.exr"));
}

#[test]
fn the_printed_camera_makes_the_same_files_again() {
    let scratch = scans();
    let args = ["scans/c.ply", "-o", "out", "--turntable", "3", "--no-sheet"];
    let done = batch(&scratch, &args);
    assert_eq!(done.code(), 0, "{}", done.stderr());
    let said = done.stderr();
    let camera =
        said.lines().find_map(|line| line.strip_prefix("framed scans/c.ply: camera ")).unwrap();
    let recorded = journal(&scratch, "out/batch.jsonl");
    let mesh = recorded.iter().find(|record| record["event"] == "mesh").unwrap();
    assert_eq!(mesh["camera"], serde_json::from_str::<Value>(camera).unwrap());
    let job = format!(
        r#"{{ "inputs": ["scans/c.ply"], "camera": {camera}, "margin": 0.3,
             "turntable": {{ "frames": 3 }}, "output": {{ "folder": "again" }} }}"#
    );
    scratch.write("job.json", &job);
    let done = batch(&scratch, &["job.json", "--no-sheet"]);
    assert_eq!(done.code(), 0, "{}", done.stderr());
    let (first, second) = (pictures(&scratch.path("out")), pictures(&scratch.path("again")));
    assert_eq!(first.len(), 6);
    assert!(first == second);
    let frame = |n: u32| scratch.channels(&format!("out/c/c.000{n}.exr"));
    assert!(frame(0) != frame(1) && frame(1) != frame(2));
}

#[test]
fn what_turns_decides_the_light_and_the_way_round() {
    let scratch = scans();
    let turn = |out: &str, flags: &[&str]| {
        let args = [&["scans/a.ply", "-o", out, "--turntable", "3", "--no-sheet"], flags].concat();
        let done = batch(&scratch, &args);
        assert_eq!(done.code(), 0, "{}", done.stderr());
        let frame = |n: u32| scratch.channels(&format!("{out}/a/a.000{n}.exr"));
        [frame(0), frame(1), frame(2)]
    };
    let object = turn("object", &["--lights", "object"]);
    let camera = turn("camera", &["--turn", "camera"]);
    let room = turn("room", &[]);
    assert_eq!(object[0], camera[0]);
    assert_eq!([&object[1], &object[2]], [&camera[2], &camera[1]]);
    assert_eq!(object[0], room[0]);
    assert!(object[1] != room[1]);
}

#[test]
fn an_invalid_mesh_fails_alone() {
    let scratch = scans();
    scratch.write("scans/b.ply", "ply\nformat ascii 1.0\nelement vertex 3\n");
    let args = ["scans", "-o", "out", "--turntable", "2"];
    let done = batch(&scratch, &args);
    assert_eq!(done.code(), 1, "{}", done.stderr());
    let said = done.stderr();
    assert!(said.contains("error: 1 of 3 inputs failed:"), "{said}");
    assert_eq!(
        said.matches("error: scans/b.ply: the header has no end_header").count(),
        2,
        "{said}"
    );
    assert_eq!(pictures(&scratch.path("out/a")).len() + pictures(&scratch.path("out/c")).len(), 8);
    let html = String::from_utf8(scratch.read("out/index.html")).unwrap();
    assert!(html.contains("class=\"failed\"") && html.contains("the header has no end_header"));
    // After a repair, only that mesh is rendered, and no card is red any more.
    scratch.write("scans/b.ply", PYRAMID);
    let done = batch(&scratch, &[&args[..], &["--resume"]].concat());
    assert_eq!(done.code(), 0, "{}", done.stderr());
    assert!(done.stderr().contains("2 frames rendered, 4 kept, 0 failures"), "{}", done.stderr());
    let html = String::from_utf8(scratch.read("out/index.html")).unwrap();
    assert!(!html.contains("class=\"failed\""));
    // With --fail-fast, the first failure is the last one.
    scratch.write("scans/a.ply", "ply\n");
    let args = ["scans", "-o", "fast", "--jobs", "1", "--fail-fast", "--quiet"];
    let done = batch(&scratch, &args);
    assert_eq!(
        (done.code(), done.stdout().contains("fast/c.exr")),
        (1, false),
        "{}",
        done.stderr()
    );
}

/// A watch folder moves every file as soon as it has its name.
#[test]
fn frames_may_be_moved_at_once() {
    let scratch = Scratch::new();
    let names: Vec<String> = (0..16).map(|i| format!("i{i:02}.ply")).collect();
    names.iter().for_each(|name| scratch.write(name, PYRAMID));
    fs::create_dir_all(scratch.path("out")).unwrap();
    fs::create_dir_all(scratch.path("moved")).unwrap();
    let mut args = vec!["batch", "-o", "out", "--no-sheet", "--quiet"];
    args.extend(SMALL);
    args.extend(names.iter().map(String::as_str));
    let mut command = scratch.command(&args);
    let mut child = command.stderr(Stdio::piped()).stdout(Stdio::null()).spawn().unwrap();
    let (out, moved) = (scratch.path("out"), scratch.path("moved"));
    let move_all = || {
        for entry in fs::read_dir(&out).unwrap().flatten() {
            let name = entry.file_name();
            let is_frame = [".exr", ".png"].iter().any(|end| name.to_string_lossy().ends_with(end));
            if is_frame {
                fs::rename(entry.path(), moved.join(&name)).unwrap();
            }
        }
    };
    while child.try_wait().unwrap().is_none() {
        move_all();
    }
    move_all();
    let done = program::Done::from(child.wait_with_output().unwrap());
    assert_eq!((done.code(), done.stderr()), (0, String::new()));
    assert_eq!(names_in(&moved).len(), 32);
    // The journal has the hashes of the files.
    for name in names_in(&moved) {
        fs::rename(moved.join(&name), out.join(&name)).unwrap();
    }
    args.retain(|arg| *arg != "--quiet");
    let done = scratch.run(&[&args[..], &["--resume"]].concat()).good();
    assert!(done.stderr().contains("0 frames rendered, 16 kept"), "{}", done.stderr());
}

#[test]
fn resume_keeps_complete_matching_frames_and_gives_reasons() {
    let scratch = scans();
    let args = ["scans", "-o", "out", "--turntable", "2", "--no-sheet"];
    let run = |more: &[&str]| {
        let done = batch(&scratch, &[&args[..], &["--skip-existing"], more].concat());
        assert_eq!(done.code(), 0, "{}", done.stderr());
        let said = done.stderr();
        let again = said.lines().filter_map(|line| line.strip_prefix("again: "));
        let mut again: Vec<String> = again.map(str::to_string).collect();
        again.sort();
        (again, said.contains(" 6 kept,"))
    };
    assert_eq!(run(&[]), (vec![], false));
    assert_eq!(run(&[]), (vec![], true));
    let whole = pictures(&scratch.path("out"));
    // A truncated file, a deleted one, a foreign one, and a changed mesh.
    let cut = scratch.read("out/a/a.0000.exr");
    fs::write(scratch.path("out/a/a.0000.exr"), &cut[..cut.len() - 1]).unwrap();
    let cut = scratch.read("out/a/a.0001.png");
    fs::write(scratch.path("out/a/a.0001.png"), &cut[..cut.len() - 3]).unwrap();
    fs::remove_file(scratch.path("out/b/b.0000.png")).unwrap();
    fs::write(scratch.path("out/b/b.0001.exr"), "not a picture").unwrap();
    let (again, _) = run(&[]);
    let expected = [
        "out/a/a.0000.exr is not whole",
        "out/a/a.0001.png is not whole",
        "out/b/b.0000.png is missing",
        "out/b/b.0001.exr is not whole",
    ];
    assert_eq!(again, expected);
    assert!(pictures(&scratch.path("out")) == whole);
    let mesh = scratch.read("scans/c.ply");
    scratch.write("scans/c.ply", &format!("{}\n", String::from_utf8(mesh).unwrap()));
    let changed = "a mesh or a texture changed";
    let expected = [0, 1].map(|n| format!("out/c/c.000{n}.exr: {changed}"));
    assert_eq!(run(&[]).0, expected);
    let (again, _) = run(&["--spp", "3"]);
    assert_eq!(again.len(), 6);
    assert!(again[0].ends_with(": the scene changed"), "{again:?}");
    let (again, _) = run(&["--spp", "3", "--float"]);
    assert!(again.len() == 6 && again[0].ends_with(": settings changed"), "{again:?}");
    // A picture of `render` has no fingerprint.
    let render = ["render", "scans/a.ply", "-o", "out/a/a.0000", "--spp", "3", "--float"];
    scratch.run(&[&render[..], &SMALL].concat());
    let (again, _) = run(&["--spp", "3", "--float"]);
    assert_eq!(again, ["out/a/a.0000.exr has no fingerprint"]);
    // The same file under another path is the same mesh.
    let old = scratch.path("out/b/b.0000.exr").metadata().unwrap().modified().unwrap();
    let absolute = scratch.path("scans").display().to_string();
    let all = ["--spp", "3", "--float", "--resume", "--turntable", "2", "-o", "out", "--no-sheet"];
    let done = batch(&scratch, &[&[absolute.as_str()], &all[..]].concat());
    assert!(done.stderr().contains(" 6 kept,"), "{}", done.stderr());
    let now: SystemTime = scratch.path("out/b/b.0000.exr").metadata().unwrap().modified().unwrap();
    assert_eq!(old, now);
}

#[test]
fn frames_record_their_number_and_rate() {
    let scratch = scans();
    let args = ["scans/a.ply", "-o", "out", "--turntable", "3", "--multipart", "--no-sheet"];
    let args = [&args[..], &["--aov", "Z", "--resume"]].concat();
    let run = |rate: &str, kept: &str| {
        let done = batch(&scratch, &[&args[..], &["--fps", rate]].concat());
        assert_eq!(done.code(), 0, "{}", done.stderr());
        assert!(done.stderr().contains(kept), "{}", done.stderr());
        done.stderr()
    };
    run("24", "3 frames rendered, 0 kept");
    // Files of several parts are also recognized as complete.
    run("24", "0 frames rendered, 3 kept");
    assert!(run("23.976", "3 frames rendered, 0 kept").contains("settings changed"));
    for frame in 0..3 {
        let path = scratch.path(&format!("out/a/a.000{frame}.exr"));
        let meta = exr::meta::MetaData::read_from_file(path, false).unwrap();
        assert_eq!(meta.headers.len(), 2);
        for header in &meta.headers {
            let own = &header.own_attributes;
            assert_eq!(own.frames_per_second, Some((24000, 1001)));
            let counter = own.other.iter().find(|(name, _)| **name == *"imageCounter");
            assert_eq!(counter.unwrap().1, &exr::meta::attribute::AttributeValue::I32(frame));
        }
    }
    let length = fs::metadata(scratch.path("out/a/a.0001.exr")).unwrap().len();
    let file = fs::File::options().write(true).open(scratch.path("out/a/a.0001.exr")).unwrap();
    file.set_len(length - 1).unwrap();
    let said = run("23.976", "1 frame rendered, 2 kept");
    assert!(said.contains("a.0001.exr is not whole"), "{said}");
}

#[test]
fn a_legend_is_for_the_inputs_that_show_a_property() {
    let scratch = Scratch::new();
    let mesh = "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\n\
                property float z\nproperty float heat\nelement face 1\n\
                property list uchar int vertex_indices\nend_header\n\
                0 0 0 1\n1 0 0 2\n0 1 0 4\n3 0 1 2\n";
    scratch.write("a.ply", mesh);
    let scene = |shape: &str| {
        format!(
            r#"{{ "camera": {{ "type": "pinhole", "width": 8, "height": 8, "fov": 50,
                               "position": [0, 0, 5], "lookat": [0, 0, -1], "up": [0, 1, 0] }},
                  "scene": {{ "shapes": [{{ {shape}, "material": {{}} }}] }} }}"#
        )
    };
    let plain = scene(r#""type": "sphere", "center": [0, 0, 0], "radius": 1"#);
    scratch.write("plain.json", &plain);
    let colored = r#""type": "trimesh", "path": "a.ply", "color": { "property": "heat" }"#;
    scratch.write("colored.json", &scene(colored));
    let run = |folder: &str, flags: &[&str]| {
        let inputs = ["batch", "a.ply", "plain.json", "colored.json", "--color", "heat"];
        let size = ["--size", "320x200", "--no-sheet", "--quiet", "-o", folder];
        scratch.run(&[&inputs[..], &size, flags].concat()).good();
    };
    run("with", &["--legend"]);
    run("without", &[]);
    for (name, changes) in [("a", true), ("plain", false), ("colored", true)] {
        let png = |folder: &str| scratch.read(&format!("{folder}/{name}.png"));
        assert_eq!(png("with") != png("without"), changes, "{name}");
    }
    // A job file is like flags.
    let job = |keys: &str| {
        let inputs = r#""inputs": ["plain.json", "a.ply"], "size": [320, 200]"#;
        scratch.write("job.json", &format!("{{ {inputs}, {keys} }}"));
        scratch.run(&["batch", "job.json", "-o", "job", "--no-sheet", "--quiet"])
    };
    let legend = r#""set": { "/output/legend": true }"#;
    for set in [legend, r#""set": { "/output": { "legend": true } }"#] {
        job(&format!(r#"{set}, "color": {{ "property": "heat" }}"#)).good();
        for name in ["a.png", "plain.png"] {
            let [found, expected] = ["job", "with"].map(|at| scratch.read(&format!("{at}/{name}")));
            assert!(found == expected, "{name}: {set}");
        }
    }
    // If no input shows a property, the legend is a mistake of the whole job.
    let (done, place) = (job(legend), "(/set/~1output~1legend): found true");
    assert!(done.code() == 2 && done.stderr().contains(place), "{}", done.stderr());
    for inputs in [&["plain.json"][..], &["plain.json", "a.ply"]] {
        let done = scratch.run(&[&["batch", "--legend", "--dry-run"], inputs].concat());
        assert!(done.code() == 2 && done.stderr().contains("--legend: found true"), "{inputs:?}");
    }
    // The legend of one input is for this input.
    let entry = r#"{ "inputs": ["a.ply", { "path": "plain.json", "set": { "/output/legend": true } }],
                     "color": { "property": "heat" } }"#;
    scratch.write("entry.json", entry);
    let done = scratch.run(&["batch", "entry.json", "-o", "entry", "--size", "8x8"]);
    assert!(done.code() == 1 && done.stderr().contains("plain.json: entry.json:1:"));
    // A scene that would have a legend goes without if the batch says so.
    let camera = r#"{ "output": { "legend": true }, "camera""#;
    scratch.write("asks.json", &plain.replacen(r#"{ "camera""#, camera, 1));
    let inputs = ["batch", "asks.json", "a.ply", "--size", "8x8", "-o", "off"];
    scratch.run(&[&inputs[..], &["--set", "/output/legend=false"]].concat()).good();
}

#[test]
fn manifests_are_files_of_their_frames() {
    let scratch = scans();
    let files = ["--aov", "cryptomatte", "--crypto-sidecar", "--png-bits", "16"];
    let render = ["render", "scans/a.ply", "-o", "alone"];
    let done = scratch.run(&[&render[..], &files, &SMALL].concat());
    assert_eq!(done.code(), 0, "{}", done.stderr());
    let args = ["scans/a.ply", "-o", "out", "--turntable", "2", "--resume", "--no-sheet"];
    let args = [&args[..], &files].concat();
    let run = |kept: &str| {
        let done = batch(&scratch, &args);
        assert_eq!(done.code(), 0, "{}", done.stderr());
        assert!(done.stderr().contains(kept), "{}", done.stderr());
        done.stderr()
    };
    run("2 frames rendered, 0 kept");
    let text = |name: &str| String::from_utf8(scratch.read(name)).unwrap();
    for frame in ["out/a/a.0000", "out/a/a.0001"] {
        for kind in ["CryptoObject", "CryptoMaterial"] {
            assert_eq!(text(&format!("{frame}.{kind}.json")), text(&format!("alone.{kind}.json")));
        }
        let png = scratch.read(&format!("{frame}.png"));
        assert_eq!(png[24], 16, "bits of a channel");
        let path = scratch.path(&format!("{frame}.exr"));
        let meta = exr::meta::MetaData::read_from_file(path, false).unwrap();
        let other = &meta.headers[0].own_attributes.other;
        let named: Vec<String> = other
            .iter()
            .filter(|(name, _)| name.to_string().ends_with("/manif_file"))
            .map(|(_, value)| format!("{value:?}"))
            .collect();
        assert_eq!(named.len(), 2);
        let stem = frame.rsplit('/').next().unwrap();
        assert!(named.iter().all(|name| name.contains(stem)), "{named:?}");
    }
    run("0 frames rendered, 2 kept");
    fs::remove_file(scratch.path("out/a/a.0001.CryptoMaterial.json")).unwrap();
    let said = run("1 frame rendered, 1 kept");
    assert!(said.contains("a.0001.CryptoMaterial.json is missing"), "{said}");
    // As a run of another scene leaves it, if it is killed between two renames.
    let manifest = "out/a/a.0001.CryptoObject.json";
    let whole = text(manifest);
    for other in [whole.replacen("\":\"", "b\":\"", 1), whole.replacen("\":\"", "\":\"0", 1)] {
        assert_ne!(other, whole);
        scratch.write(manifest, &other);
        let done = batch(&scratch, &[&args[..], &["--no-verify"]].concat());
        let said = done.stderr();
        assert!(said.contains("a.0001.CryptoObject.json: the names or ids changed"), "{said}");
        assert!(said.contains("1 frame rendered, 1 kept"), "{said}");
        assert_eq!(text(manifest), whole);
    }
    // The same settings in a job file. With another bit depth, the frames are rendered again.
    let job = r#"{ "inputs": ["scans/a.ply"], "turntable": { "frames": 2 }, "layers": ["cryptomatte"],
                   "output": { "folder": "out", "cryptosidecar": true, "pngbits": BITS } }"#;
    scratch.write("job.json", &job.replace("BITS", "16"));
    let resume = |expected: &str| {
        let done = batch(&scratch, &["job.json", "--resume", "--no-sheet"]);
        assert!(done.stderr().contains(expected), "{}", done.stderr());
        done.code()
    };
    assert_eq!(resume("0 frames rendered, 2 kept"), 0);
    scratch.write("job.json", &job.replace("BITS", "8"));
    assert_eq!(resume("settings changed"), 0);
    scratch.write("job.json", &job.replace("BITS", "12"));
    assert_eq!(resume("(/output/pngbits): found 12, expected 8 or 16"), 2);
    scratch.write("job.json", &job.replace("BITS", "\"16\""));
    assert_eq!(resume("(/output/pngbits): found \"16\", expected 8 or 16"), 2);
}

#[test]
fn a_still_has_the_same_header_as_render() {
    let scratch = scans();
    let done = batch(&scratch, &["scans/b.ply", "-o", "out", "--no-sheet"]);
    assert_eq!(done.code(), 0, "{}", done.stderr());
    let done = scratch.run(&[&["render", "scans/b.ply", "-o", "b"], &SMALL[..]].concat());
    assert_eq!(done.code(), 0, "{}", done.stderr());
    let said = |name: &str| {
        let meta = exr::meta::MetaData::read_from_file(scratch.path(name), false).unwrap();
        let other = meta.headers[0].own_attributes.other.clone();
        let mut said: Vec<_> = other.into_iter().map(|(n, v)| (n.to_string(), v)).collect();
        said.retain(|(name, _)| name != "lightpath:fingerprint");
        said.sort_by(|a, b| a.0.cmp(&b.0));
        said
    };
    assert_eq!(said("out/b.exr"), said("b.exr"));
    assert!(said("b.exr").iter().any(|(name, _)| name == "lightpath:sceneHash"));
    assert!(!said("b.exr").iter().any(|(name, _)| name == "imageCounter"));
}

/// Flags that a scene description cannot hold apply to every frame of a turntable.
#[test]
#[cfg_attr(not(lightpath_embree), ignore = "needs Embree")]
fn fast_mode_of_embree_applies_to_every_frame() {
    let scratch = scans();
    let args = ["scans/b.ply", "-o", "out", "--turntable", "2", "--no-sheet", "--spp", "1"];
    let fast = ["--backend", "embree", "--fast"];
    let done = batch(&scratch, &[&args[..], &fast].concat());
    assert_eq!(done.code(), 0, "{}", done.stderr());
    for name in ["out/b/b.0000.exr", "out/b/b.0001.exr"] {
        let said = scratch.run(&["info", name]).stdout();
        assert!(said.contains("lightpath:backend: embree (Embree 4."), "{said}");
        assert!(said.contains(", fast)") && said.contains(",fast,"), "{said}");
    }
    // Without the flag the frames differ. On the default backend the flag is refused.
    let again = batch(&scratch, &[&args[..], &["--backend", "embree", "--resume"]].concat());
    assert!(again.stderr().contains("settings changed"), "{}", again.stderr());
    let refused = batch(&scratch, &[&args[..], &["--fast"]].concat());
    assert_eq!(refused.code(), 2, "{}", refused.stderr());
    assert!(refused.stderr().contains("which has no fast mode"), "{}", refused.stderr());
}

#[test]
fn a_warning_that_all_frames_share_is_told_once() {
    let scratch = Scratch::new();
    let heights = PYRAMID.replace("property float z\n", "property float z\nproperty float h\n");
    let heights = heights.replace("0 -1\n", "0 -1 0\n").replace("0 1\n", "0 1 0\n");
    for name in ["a", "b"] {
        scratch.write(&format!("{name}.ply"), &heights.replace("0 2 0\n", "0 2 0 2\n"));
    }
    let args = ["a.ply", "b.ply", "-o", "out", "--color", "h", "--legend", "--turntable", "3"];
    let said = batch(&scratch, &args).good().stderr();
    for name in ["a.ply", "b.ply"] {
        let line = format!("warning: {name}: the picture is too small for the legend");
        assert_eq!(said.matches(&line).count(), 1, "{said}");
    }
    let records = journal(&scratch, "out/batch.jsonl");
    let frames = records.iter().filter(|record| record["event"] == "frame");
    let warned = |frame: &&Value| frame["warnings"].to_string().contains("too small");
    assert_eq!(frames.filter(warned).count(), 6, "each frame records its own");
}

#[test]
fn ranges_together_render_all_frames() {
    let scratch = scans();
    let args =
        |out: &'static str| ["scans", "-o", out, "--turntable", "3", "--no-sheet", "--quiet"];
    assert_eq!(batch(&scratch, &args("all")).code(), 0);
    for range in ["0..1", "1..5", "5..9"] {
        let done = batch(&scratch, &[&args("parts")[..], &["--range", range]].concat());
        assert_eq!(done.code(), 0, "{}", done.stderr());
    }
    assert!(pictures(&scratch.path("all")) == pictures(&scratch.path("parts")));
    let names = names_in(&scratch.path("parts"));
    assert!(names.contains(&"batch.1-5.jsonl".to_string()), "{names:?}");
    let done = batch(&scratch, &[&args("parts")[..], &["--range", "8..10"]].concat());
    assert_eq!(done.code(), 2);
    assert!(done.stderr().contains("expected frames A..B of 0..9"), "{}", done.stderr());
    // The contact sheet shows the frames of all ranges.
    let done = batch(&scratch, &["scans", "-o", "parts", "--turntable", "3", "--sheet-only"]);
    assert_eq!(done.stdout(), "parts/index.html\nparts/sheet.png\n", "{}", done.stderr());
    let html = String::from_utf8(scratch.read("parts/index.html")).unwrap();
    assert!(html.contains("3 inputs, 9 of 9 frames"), "{html}");
}

#[test]
fn a_job_file_has_all_settings() {
    let scratch = scans();
    let job = r#"{
      "comment": "three pyramids",
      "inputs": ["scans/[ab].ply", { "path": "scans/c.ply", "up": "z", "set": { "/spp": 2 } }],
      "size": [20, 10], "layers": ["Z"], "set": { "/spp": 1 },
      "turntable": { "frames": 2, "turn": "camera", "start": 30 },
      "output": { "folder": "made", "name": "{stem}-{frame:02}.exr", "compression": "piz" },
      "limits": { "memory": "1G", "threads": 2, "jobs": 2 }
    }"#;
    scratch.write("jobs/job.json", &job.replace("scans/", "../scans/"));
    let done = scratch.run(&["batch", "jobs/job.json"]);
    assert_eq!(done.code(), 0, "{}", done.stderr());
    let names = names_in(&scratch.path("jobs/made"));
    let frames = ["a-00.exr", "a-00.png", "a-01.exr", "a-01.png", "b-00.exr"];
    assert_eq!(names[..5], frames, "{names:?}");
    let file = exr::meta::MetaData::read_from_file(scratch.path("jobs/made/a-00.exr"), false);
    let header = &file.unwrap().headers[0];
    assert_eq!((header.layer_size.x(), header.layer_size.y()), (20, 10));
    assert_eq!(header.compression, exr::compression::Compression::PIZ);
    assert!(header.channels.list.iter().any(|channel| channel.name.to_string() == "Z"));
    let records = journal(&scratch, "jobs/made/batch.jsonl");
    let rays = |input: &str| {
        let mut records = records.iter().filter(|r| r["event"] == "frame");
        let record = records.find(|r| r["input"].as_str().unwrap().ends_with(input)).unwrap();
        record["rays"]["primary"].as_u64().unwrap()
    };
    assert_eq!([rays("a.ply"), rays("c.ply")], [200, 400]);
    // Flags win over the job file.
    let done =
        scratch.run(&["batch", "jobs/job.json", "--spp", "3", "-o", "here", "--range", "0..1"]);
    assert_eq!(done.stdout(), "here/a-00.exr\nhere/a-00.png\n", "{}", done.stderr());
    // The schema has these keys.
    let schema: Value = serde_json::from_str(&scratch.run(&["schema", "job"]).stdout()).unwrap();
    for key in ["inputs", "template", "turntable", "output", "limits", "comment"] {
        assert!(schema["properties"][key].is_object(), "{key}");
    }
    assert_eq!(schema["additionalProperties"], false);
}

#[test]
fn invalid_jobs_are_refused_before_rendering() {
    let scratch = scans();
    scratch.write("other/a.ply", PYRAMID);
    let refused = |args: &[&str], expected: &str| {
        let done = batch(&scratch, args);
        assert_eq!(done.code(), 2, "{args:?}: {}", done.stderr());
        assert!(done.stderr().contains(expected), "{args:?}: {}", done.stderr());
        assert!(!scratch.path("out").exists(), "{args:?}");
    };
    refused(&["nosuch.ply"], "INPUT: found \"nosuch.ply\": there is no such file");
    refused(&["scans", "--name", "index.html/{stem}"], "the contact sheet would both be written");
    refused(&["scans", "other"], "would both be written to");
    refused(&["scans", "other"], "--name '{parent}/{stem}', or '{input:03}-{stem}'\n");
    refused(&["scans/a.ply", "scans/a.ply"], "apart: --name '{input:03}-{stem}'\n");
    let turning = ["scans", "other", "--turntable", "2"];
    refused(&turning, "--name '{parent}/{stem}.{frame:04}', or '{input:03}-{stem}.{frame:04}'\n");
    refused(&["scans", "--name", "{stem}", "--turntable", "2"], "expected {frame} in it");
    refused(&["scans", "--name", "../{stem}"], "expected a name within the output folder");
    refused(&["scans", "--name", "{stem}/."], "expected a name within the output folder");
    refused(&["scans", "--template", "nosuch.json"], "nosuch.json: cannot read");
    let job = |text: &str| {
        scratch.write("job.json", text);
        "job.json"
    };
    refused(&[job(r#"{ "inputs": ["scans"], "turntabel": { "frames": 2 } }"#)], "turntable");
    refused(&[job(r#"{ "inputs": [{ "path": "scans", "upp": "z" }] }"#)], "job.json:1:33");
    refused(&[job(r#"{ "inputs": ["scans/*.obj"] }"#)], "a pattern that matches no file");
    refused(&[job(r#"{ "inputs": ["scans"], "limits": { "memory": "lots" } }"#)], "limits/memory");
    // A setting that no mesh can be rendered with is a mistake of the whole job.
    for (flag, value) in [
        ("--set", "/camera/fov=200"),
        ("--set", "/nope/x=3"),
        ("--set", "/spp=abc"),
        ("--aov", "Q"),
        ("--size", "0x5"),
    ] {
        for more in [&[][..], &["--dry-run"]] {
            let done = scratch.run(&[&["batch", "scans", "-o", "out", flag, value], more].concat());
            assert_eq!(done.code(), 2, "{value}: {}", done.stderr());
            assert!(done.stderr().contains(&format!("error: {flag}")), "{}", done.stderr());
            assert!(!scratch.path("out").exists(), "{value}");
        }
    }
    for (key, value, place) in [
        ("layers", r#"["Q"]"#, "34 (/layers)"),
        ("size", "[0, 48]", "33 (/size/0)"),
        ("camera", r#"{ "fov": 0 }"#, "43 (/camera/fov)"),
        ("set", r#"{ "/nope/x": 3 }"#, "44 (/set/~1nope~1x)"),
        ("camera", r#"{ "lookat": [1, 0, 0], "target": [0, 0, 9] }"#, "67 (/camera/target)"),
        (
            "set",
            r#"{ "/camera/lookat": [1, 0, 0], "/camera/target": [0, 0, 9] }"#,
            "80 (/set/~1camera~1target)",
        ),
        ("output", r#"{ "fps": "fast" }"#, "43 (/output/fps)"),
        ("output", r#"{ "pngbits": 9 }"#, "47 (/output/pngbits)"),
        ("output", r#"{ "name": "{nope}" }"#, "44 (/output/name)"),
        ("undistort", "true", "37 (/undistort)"),
    ] {
        let job = job(&format!(r#"{{ "inputs": ["scans"], "{key}": {value} }}"#));
        let said = scratch.run(&["batch", job, "--dry-run"]);
        assert_eq!(said.code(), 2, "{key}: {}", said.stderr());
        let place = format!("error: job.json:1:{place}: ");
        assert!(said.stderr().contains(&place), "{place}{}", said.stderr());
    }
    let limited = job(r#"{ "inputs": ["scans"], "limits": { "memory": "8X" } }"#);
    refused(&[limited, "--dry-run"], "job.json:1:46 (/limits/memory): found \"8X\"");
    // Too little memory is reported for every mesh, with the numbers.
    let done = batch(&scratch, &["scans", "-o", "bad", "--max-memory", "1M", "--quiet"]);
    assert_eq!(done.code(), 1);
    assert!(done.stderr().contains("--max-memory: found 1.0 MiB, expected at least"));
    // No output may overwrite an input.
    let studio = include_str!("../../../assets/studio.json");
    let textured =
        studio.replace("\"kd\": 1,\n        \"ka\"", "\"kd\": 1, \"tPath\": \"a.png\", \"ka\"");
    assert_ne!(studio, textured);
    scratch.write("scans/t.json", &textured);
    let picture = image::RgbImage::new(2, 2);
    picture.save(scratch.path("scans/a.png")).unwrap();
    let before = scratch.read("scans/a.png");
    let args = ["scans/a.ply", "-o", "scans", "--template", "scans/t.json", "--no-sheet"];
    let done = batch(&scratch, &args);
    assert_eq!(
        (done.code(), scratch.read("scans/a.png") == before),
        (2, true),
        "{}",
        done.stderr()
    );
    assert!(done.stderr().contains("would overwrite an input or another output"));
    // A dot at the end of the folder's name says nothing.
    batch(&scratch, &["scans/a.ply", "-o", "new/folder/.", "--no-sheet"]).good();
    assert!(scratch.path("new/folder/a.exr").is_file());
}

#[test]
fn progress_for_farms() {
    let scratch = scans();
    let run = |mode: &str, more: &[&str]| {
        let args = ["scans", "-o", mode, "--turntable", "4", "--no-sheet", "--progress", mode];
        let done = batch(&scratch, &[&args[..], more].concat());
        assert_eq!(done.code(), 0, "{}", done.stderr());
        (done.stdout(), done.stderr())
    };
    let percents = |text: &str, start: &str, end: &str| -> Vec<u32> {
        let lines = text.lines().filter_map(|line| line.strip_prefix(start)?.strip_suffix(end));
        lines.map(|number| number.parse().unwrap()).collect()
    };
    let openjd = run("openjd", &[]).0;
    let said = percents(&openjd, "openjd_progress: ", "");
    assert!(said.is_sorted() && said.last() == Some(&100), "{openjd}");
    assert!(openjd.contains("openjd_status: frames 12 of 12"), "{openjd}");
    let said = percents(&run("alf", &[]).0, "ALF_PROGRESS ", "%");
    assert!(said.is_sorted() && said.last() == Some(&100));
    // A batch that cannot begin has done nothing.
    let beyond = ["scans", "-o", "out", "--range", "0..4", "--no-sheet", "--progress", "alf"];
    let done = batch(&scratch, &beyond);
    assert_eq!((done.code(), done.stdout().as_str()), (2, "ALF_PROGRESS 0%\n"));
    assert!(run("json", &[]).1.contains("framed "));
    // Beside `--quiet`, a program reads nothing but JSON.
    let said = run("json", &["--quiet"]).1;
    let lines = said.lines().map(|line| serde_json::from_str(line).unwrap());
    let lines: Vec<Value> = lines.collect();
    assert!(lines.iter().all(|line| line["total"] == 12), "{said}");
    assert_eq!(lines.last().unwrap()["rendered"], 12, "{said}");
}

#[test]
fn paths_that_cannot_be_printed_are_told_at_the_end() {
    let scratch = scans();
    let run = |stdout: &str| {
        let line = format!("\"$0\" batch scans -o out --size 24x16 --no-sheet --quiet {stdout}");
        let mut shell = std::process::Command::new("sh");
        shell.args(["-c", &line, env!("CARGO_BIN_EXE_lightpath")]);
        program::Done::of(shell.current_dir(scratch.path("")))
    };
    let full = run("> /dev/full");
    assert_eq!(full.code(), 3, "{}", full.stderr());
    assert!(full.stderr().contains("<stdout>: cannot write"), "{}", full.stderr());
    assert_eq!(pictures(&scratch.path("out")).len(), 6);
    // A reader may end early.
    let mut command = scratch.command(&["batch", "scans", "-o", "ended", "--no-sheet", "--quiet"]);
    command.args(SMALL).stdout(Stdio::piped()).stderr(Stdio::piped());
    let mut child = command.spawn().unwrap();
    drop(child.stdout.take());
    let ended = program::Done::from(child.wait_with_output().unwrap());
    assert_eq!((ended.code(), ended.stderr().as_str()), (0, ""));
    assert_eq!(pictures(&scratch.path("ended")).len(), 6);
}

#[test]
fn a_turntable_of_one_frame_is_named_like_any_other() {
    let scratch = scans();
    let done = batch(&scratch, &["scans/a.ply", "-o", "out", "--turntable", "1", "--no-sheet"]);
    assert_eq!(done.good().stdout(), "out/a/a.0000.exr\nout/a/a.0000.png\n");
}

#[test]
fn a_job_file_is_no_scene() {
    let scratch = scans();
    scratch.write("job.json", r#"{ "inputs": ["scans"] }"#);
    for args in [&["info", "job.json"][..], &["render", "job.json", "-o", "x"]] {
        let done = scratch.run(args);
        assert_eq!(done.code(), 2, "{args:?}: {}", done.stderr());
        let said =
            "job.json:1:13 (/inputs): found a job file of `lightpath batch`, expected a scene";
        assert!(done.stderr().contains(said), "{}", done.stderr());
        assert_eq!(done.stderr().matches("error:").count(), 1, "{}", done.stderr());
    }
    let done = batch(&scratch, &["job.json", "scans/a.ply", "-o", "out"]);
    assert!(done.stderr().contains("lightpath batch job.json"), "{}", done.stderr());
    assert_eq!(done.code(), 1);
}

#[test]
fn a_dry_run_lists_the_frames() {
    let scratch = scans();
    let args = ["scans", "-o", "out", "--turntable", "2", "--range", "1..3", "--dry-run"];
    let done = batch(&scratch, &args);
    let lines: Vec<Value> =
        done.stdout().lines().map(|line| serde_json::from_str(line).unwrap()).collect();
    assert_eq!(lines.len(), 2, "{}", done.stderr());
    assert_eq!(lines[0]["outputs"][0], "out/a/a.0001.exr");
    assert_eq!((&lines[1]["index"], &lines[1]["frame"]), (&2.into(), &0.into()));
    assert!(!scratch.path("out").exists());
    // With the manifests, as the journal lists them. A file that is no mesh is listed, too.
    scratch.write("scans/d.ply", "ply\n");
    let args = ["scans", "-o", "out", "--aov", "cryptomatte", "--crypto-sidecar", "--no-sheet"];
    let done = batch(&scratch, &[&args[..], &["--dry-run"]].concat()).good();
    let listed: Vec<Value> =
        done.stdout().lines().map(|line| serde_json::from_str(line).unwrap()).collect();
    assert_eq!(listed.len(), 4);
    batch(&scratch, &args);
    let records = journal(&scratch, "out/batch.jsonl");
    let frames: Vec<&Value> = records.iter().filter(|r| r["event"] == "frame").collect();
    assert_eq!(frames.len(), 3);
    for frame in frames {
        let outputs = frame["outputs"].as_array().unwrap();
        assert_eq!(outputs.len(), 4, "{frame}");
        let outputs: Vec<String> =
            outputs.iter().map(|path| format!("out/{}", path.as_str().unwrap())).collect();
        let same = listed.iter().find(|line| line["index"] == frame["index"]).unwrap();
        assert_eq!(same["outputs"], Value::from(outputs));
    }
}

#[test]
fn names_that_collide_in_any_frame_are_refused() {
    let scratch = Scratch::new();
    for i in 0..12 {
        scratch.write(&format!("scans/m{i:02}.ply"), PYRAMID);
    }
    let refused = |args: &[&str], both: [&str; 2]| {
        let done = batch(&scratch, &[args, &["-o", "out"]].concat());
        assert_eq!(done.code(), 2, "{args:?}: {}", done.stderr());
        let said = done.stderr();
        assert!(both.iter().all(|name| said.contains(name)), "{args:?}: {said}");
        assert!(!scratch.path("out").exists(), "{args:?}");
    };
    let turn = |name: &'static str| ["scans", "--turntable", "12", "--name", name];
    // Input 1, frame 10 and input 11, frame 0 have the same name.
    refused(&turn("{input}{frame}"), ["frame 10 of scans/m01.ply", "frame 0 of scans/m11.ply"]);
    refused(&turn("x/{input}{frame}"), ["frame 10 of scans/m01.ply", "frame 0 of scans/m11.ply"]);
    scratch.write("two/a.ply", PYRAMID);
    scratch.write("two/a1.ply", PYRAMID);
    let stems = ["two", "--turntable", "12", "--name", "{stem}{frame}"];
    refused(&stems, ["frame 10 of two/a.ply", "frame 0 of two/a1.ply"]);
    // Names of frames may not collide with the contact sheet.
    scratch.write("sheet.ply", PYRAMID);
    scratch.write("sheet.2.ply", PYRAMID);
    refused(&["sheet.ply"], ["sheet.ply", "contact sheet"]);
    refused(&["sheet.ply", "--name", "./{stem}"], ["sheet.ply", "contact sheet"]);
    let done = batch(&scratch, &["sheet.2.ply", "-o", "fine"]);
    assert_eq!(done.code(), 0, "one sheet is enough: {}", done.stderr());
    // The same pattern is valid with fewer inputs.
    let done =
        batch(&scratch, &["two", "--turntable", "12", "--name", "{stem}-{frame}", "-o", "fine"]);
    assert_eq!(done.code(), 0, "{}", done.stderr());
}

#[test]
fn resume_detects_flipped_bits() {
    let scratch = scans();
    let layers = ["--aov", "Z,cryptomatte", "--crypto-sidecar"];
    let args = ["scans/a.ply", "-o", "out", "--no-sheet"];
    let args = [&args[..], &layers].concat();
    let run = |more: &[&str]| {
        let done = batch(&scratch, &[&args[..], more].concat());
        assert_eq!(done.code(), 0, "{}", done.stderr());
        done.stderr()
    };
    run(&[]);
    let kept = |said: &str| said.contains("0 frames rendered, 1 kept");
    assert!(kept(&run(&["--resume"])));
    for name in ["a.exr", "a.png", "a.CryptoObject.json", "a.CryptoMaterial.json"] {
        let name = format!("out/{name}");
        let whole = scratch.read(&name);
        // Some 24 places over the whole file, with another bit flipped at each.
        for i in 0..24 {
            let mut flipped = whole.clone();
            flipped[i * (whole.len() - 1) / 23] ^= 1 << (i % 8);
            fs::write(scratch.path(&name), &flipped).unwrap();
            let said = run(&["--resume"]);
            assert!(said.contains("1 frame rendered, 0 kept"), "{name} {i}: {said}");
            assert!(said.contains(&format!("again: {name}")), "{name} {i}: {said}");
            assert!(scratch.read(&name) == whole, "{name} {i}");
        }
    }
    // --no-verify skips the reading, and with it the check.
    let mut flipped = scratch.read("out/a.png");
    let middle = flipped.len() / 2;
    flipped[middle] ^= 1;
    fs::write(scratch.path("out/a.png"), &flipped).unwrap();
    assert!(kept(&run(&["--resume", "--no-verify"])));
    // Without a journal there is no hash to compare with.
    fs::remove_file(scratch.path("out/batch.jsonl")).unwrap();
    assert!(kept(&run(&["--resume", "--no-verify"])));
    let said = run(&["--resume"]);
    assert!(said.contains("1 frame rendered, 0 kept"), "{said}");
    assert!(said.contains("no journal knows its bytes"), "{said}");
    assert!(kept(&run(&["--resume"])));
    // The journal of a range counts as much as that of a whole run.
    fs::remove_file(scratch.path("out/batch.jsonl")).unwrap();
    run(&["--range", "0..1"]);
    assert!(kept(&run(&["--resume"])));
}

/// The whole mesh is in every frame: hits, and none at the border of the picture.
#[test]
fn the_mesh_stays_in_the_picture_on_its_circle_around_any_pivot() {
    let scratch = Scratch::new();
    // Long, and from no side thinner than a pixel.
    scratch.write("p.ply", &PYRAMID.replace("-1 0", "-6 0").replace("\n1 0", "\n6 0"));
    for (out, count, flags) in [
        ("far", 4, &["--turntable", "4", "--pivot", "3,0,-1"][..]),
        ("start", 1, &["--turntable", "1", "--start", "90"]),
    ] {
        let fixed =
            ["batch", "p.ply", "--no-ground", "--aov", "Z", "--spp", "1", "--size", "40x30"];
        scratch.run(&[&fixed[..], &["-o", out, "--no-sheet"], flags].concat()).good();
        let pictures = pictures(&scratch.path(out)).into_iter().map(|(name, _)| name);
        let files: Vec<String> = pictures.filter(|name| name.ends_with(".exr")).collect();
        assert_eq!(files.len(), count, "{files:?}");
        for file in files {
            let depths = &scratch.floats(&format!("{out}/{file}"))["Z"];
            let is_hit = |i: usize| depths[i] < 1e30;
            let is_border = |i: &usize| i % 40 == 0 || i % 40 == 39 || i / 40 == 0 || i / 40 == 29;
            assert!((0..40 * 30).any(is_hit), "{out}/{file} shows nothing");
            assert!(!(0..40 * 30).filter(is_border).any(is_hit), "{out}/{file} is cut");
        }
    }
}

/// Without `--pivot` the axis goes through the camera's target, parallel to the axis nearest to
/// `up`: a quarter turn counterclockwise takes (x, y) from the target to (-y, x).
#[test]
fn a_turntable_of_a_scene_turns_about_its_target() {
    let scratch = Scratch::new();
    let write = |name: &str, camera: [f64; 3], up: [f64; 3], lamp: [f64; 3], sun: [f64; 3]| {
        let scene = serde_json::json!({
            "camera": { "type": "pinhole", "fov": 40, "position": camera, "target": [1, 1, 0.5],
                        "up": up },
            "scene": { "attenuation": "none", "lightsources": [
                { "type": "pointlight", "position": lamp, "id": [1, 1, 1] },
                { "type": "directional", "direction": sun, "id": [0.5, 0.2, 0.1] }], "shapes": [
                { "type": "sphere", "center": [1.5, 1, 0.5], "radius": 0.5, "material": {} },
                { "type": "plane", "v0": [-4, -4, 0], "v1": [6, -4, 0], "v2": [6, 6, 0],
                  "v3": [-4, 6, 0], "material": { "kd": 0.5 } }] } });
        scratch.write(&format!("{name}.json"), &scene.to_string());
    };
    let (lamp, sun) = ([5.0, -3.0, 6.0], [1.0, 2.0, -3.0]);
    write("s", [3.0, 2.0, 4.0], [0.2, 0.3, 1.0], lamp, sun);
    // The lights stay with the object.
    write("camera", [0.0, 3.0, 4.0], [-0.3, 0.2, 1.0], lamp, sun);
    // The object turns this way under lights that stay with the camera, or these turn the other
    // way.
    let around = ([-3.0, -3.0, 6.0], [2.0, -1.0, -3.0]);
    write("object", [2.0, -1.0, 4.0], [0.3, -0.2, 1.0], around.0, around.1);
    for turn in ["camera", "object"] {
        let args = ["s.json", "-o", turn, "--turntable", "4", "--turn", turn, "--range", "1..2"];
        batch(&scratch, &[&args[..], &["--no-sheet"]].concat()).good();
        let scene = format!("{turn}.json");
        scratch.run(&[&["render", &scene, "-o", "alone"], &SMALL[..]].concat()).good();
        let turned = scratch.channels(&format!("{turn}/s/s.0001.exr"));
        assert!(turned == scratch.channels("alone.exr"), "{turn}");
    }
}
