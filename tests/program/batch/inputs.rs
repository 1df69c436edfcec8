//! Inputs that cannot be listed or named are refused and never left out.

use std::ffi::OsStr;
use std::fs;
use std::os::unix::ffi::OsStrExt;
use std::os::unix::fs::PermissionsExt;
use std::process::Command;

use serde_json::{Value, json};

use crate::support::program::{Done, PYRAMID, SMALL, Scratch, skipped};

const SCENE: &str = r#"{
  "camera": { "type": "pinhole", "position": [0, 0, 5], "lookat": [0, 0, -1], "up": [0, 1, 0] },
  "scene": { "shapes": [{ "type": "sphere", "center": [0, 0, 0], "radius": 1, "material": {} }] }
}"#;

/// Returns [`SCENE`] with what its camera lacks, and a mesh in place of its ball.
fn scene_of(mesh: &str, material: Value) -> String {
    let mut scene: Value = serde_json::from_str(SCENE).unwrap();
    for (key, value) in [("width", 24), ("height", 16), ("fov", 50)] {
        scene["camera"][key] = json!(value);
    }
    scene["scene"]["shapes"][0] = json!({ "type": "trimesh", "path": mesh, "material": material });
    scene.to_string()
}

#[test]
fn a_folder_that_cannot_be_listed_is_an_error() {
    let scratch = Scratch::new();
    scratch.write("scans/a.ply", PYRAMID);
    scratch.write("scans/locked/b.ply", PYRAMID);
    fs::set_permissions(scratch.path(""), fs::Permissions::from_mode(0o755)).unwrap();
    let lock = |mode| {
        let locked = scratch.path("scans/locked");
        fs::set_permissions(locked, fs::Permissions::from_mode(mode)).unwrap();
    };
    lock(0o000);
    let as_root = fs::read_dir(scratch.path("scans/locked")).is_ok();
    for pattern in ["scans/*/*.ply", "scans/**/*.ply", "**/*.ply"] {
        scratch.write("job.json", &format!(r#"{{ "inputs": ["{pattern}"] }}"#));
        let mut command = Command::new("setpriv");
        command.args(["--reuid", "64321", "--clear-groups", "--inh-caps=-all"]);
        command.arg(env!("CARGO_BIN_EXE_lightpath")).args(["batch", "job.json", "--dry-run"]);
        command.current_dir(scratch.path("")).env_remove("SLURM_CPUS_PER_TASK");
        let done = match as_root {
            false => scratch.run(&["batch", "job.json", "--dry-run"]),
            true => match command.output() {
                Ok(output) => Done::from(output),
                Err(_) => {
                    skipped("there is no setpriv");
                    break;
                }
            },
        };
        if done.stderr().contains("setpriv") {
            skipped(&done.stderr());
            break;
        }
        assert_eq!(
            (done.code(), done.stdout()),
            (2, String::new()),
            "{pattern}: {}",
            done.stderr()
        );
        assert!(done.stderr().contains("scans/locked: cannot list"), "{}", done.stderr());
    }
    lock(0o755);
}

/// Left out, they would change the numbers of the frames.
#[test]
fn names_of_inputs_that_are_no_files_are_refused() {
    let scratch = Scratch::new();
    scratch.write("scans/a.ply", PYRAMID);
    let refused = |parts: &[&str]| {
        for pattern in ["scans", "scans/*.ply*", "**/*.ply*"] {
            scratch.write("job.json", &format!(r#"{{ "inputs": ["{pattern}"] }}"#));
            let done = scratch.run(&["batch", "job.json", "--dry-run"]);
            assert_eq!((done.code(), done.stdout()), (2, String::new()), "{}", done.stderr());
            for part in parts {
                assert!(done.stderr().contains(part), "{pattern}: {}", done.stderr());
            }
        }
    };
    let path = |name: &str| scratch.path("scans").join(name);
    std::os::unix::fs::symlink("nowhere.ply", path("b.ply")).unwrap();
    refused(&["scans/b.ply: cannot read: No such file"]);
    let done = scratch.run(&["batch", "scans/b.ply", "--dry-run"]);
    assert!(
        done.stderr().contains("\"scans/b.ply\": it is a link to nothing"),
        "{}",
        done.stderr()
    );
    assert_eq!(done.code(), 2);
    fs::remove_file(path("b.ply")).unwrap();
    fs::create_dir(path("b.ply.gz")).unwrap();
    refused(&["scans/b.ply.gz: found a folder, expected a file"]);
    fs::remove_dir(path("b.ply.gz")).unwrap();
    assert!(Command::new("mkfifo").arg(path("b.ply")).status().unwrap().success());
    refused(&["scans/b.ply: found a pipe or a device, expected a file"]);
}

/// A batch reads its files more than once, and opening a pipe would wait for a writer.
#[test]
fn pipes_are_refused_before_anything_is_rendered() {
    let scratch = Scratch::new();
    scratch.write("a.ply", PYRAMID);
    for name in ["pipe.ply", "pipe.png"] {
        scratch.pipe(name);
    }
    scratch.write("mesh.json", &scene_of("pipe.ply", json!({})));
    scratch.write("image.json", &scene_of("a.ply", json!({ "tPath": "pipe.png" })));
    scratch.write("job.json", r#"{ "inputs": ["a.ply", "mesh.json"] }"#);
    let refused = |args: &[&str], pipe: &str| {
        let done = scratch.run(args);
        assert_eq!((done.code(), done.stdout()), (2, String::new()), "{args:?}: {}", done.stderr());
        let message = format!("{pipe}: found a pipe or a device, expected a file");
        assert!(done.stderr().contains(&message), "{args:?}: {}", done.stderr());
        assert!(!scratch.path("out").exists(), "{args:?}");
    };
    refused(&["batch", "pipe.ply", "--dry-run"], "pipe.ply");
    refused(&["batch", "a.ply", "pipe.ply"], "pipe.ply");
    refused(&["batch", "a.ply", "mesh.json"], "pipe.ply");
    refused(&["batch", "a.ply", "image.json"], "pipe.png");
    refused(&["batch", "a.ply", "--texture", "pipe.png"], "pipe.png");
    refused(&["batch", "job.json", "--sheet-only"], "pipe.ply");
    refused(&["submit", "slurm", "job.json", "--dry-run"], "pipe.ply");
}

/// The first page of this file is not mapped, so that reading it is an error of the device.
#[cfg(target_os = "linux")]
#[test]
fn another_try_may_cure_an_error_of_the_device() {
    let scratch = Scratch::new();
    std::os::unix::fs::symlink("/proc/self/mem", scratch.path("a.ply")).unwrap();
    scratch.write("s.json", &scene_of("a.ply", json!({})));
    for input in ["a.ply", "s.json"] {
        let done = scratch.run(&[&["batch", input, "--no-sheet"], &SMALL[..]].concat());
        assert_eq!(done.code(), 3, "{input}: {}", done.stderr());
        assert!(done.stderr().contains("a.ply: cannot read: "), "{}", done.stderr());
    }
    // A face of a missing vertex needs another file.
    scratch.write("bad.ply", &PYRAMID.replace("3 3 0 4", "3 3 0 9"));
    let done = scratch.run(&[&["batch", "a.ply", "bad.ply", "--no-sheet"], &SMALL[..]].concat());
    assert_eq!(done.code(), 1, "{}", done.stderr());
    scratch.write("b.ply", PYRAMID);
    let turntable = ["batch", "b.ply", "bad.ply", "--turntable", "3", "-o", "out", "--no-sheet"];
    let done = scratch.run(&[&turntable[..], &SMALL].concat());
    assert_eq!(done.code(), 1, "{}", done.stderr());
    // The frames of the bad mesh count, as they do in the progress of the batch.
    let journal = String::from_utf8(scratch.read("out/batch.jsonl")).unwrap();
    let end: Value = serde_json::from_str(journal.lines().last().unwrap()).unwrap();
    let counts = ["rendered", "kept", "failed"].map(|key| end[key].as_u64().unwrap());
    assert_eq!(counts, [3, 0, 3], "{end}");
}

/// Of each input 200 problems are shown, and every input that failed.
#[test]
fn an_input_with_many_problems_hides_no_other() {
    let scratch = Scratch::new();
    let mut inputs: Vec<String> = (0..250).map(|i| format!("m{i}.ply")).collect();
    inputs.iter().for_each(|name| scratch.write(name, "ply\n"));
    let keys: Vec<String> = (0..1000).map(|i| format!("\"wrong{i}\": 0")).collect();
    scratch.write("a.json", &SCENE.replace("{\n", &format!("{{\n{},\n", keys.join(", "))));
    inputs.insert(0, "a.json".into());
    let names = inputs.iter().map(String::as_str);
    let args = ["batch"].into_iter().chain(names).chain(SMALL).chain(["--no-sheet", "-o", "out"]);
    let done = scratch.run(&args.collect::<Vec<_>>());
    assert_eq!(done.code(), 1, "{}", done.stderr());
    let said = done.stderr();
    let (events, verdict) = said.split_once("251 of 251 inputs failed:").unwrap();
    for text in [events, verdict] {
        let lines = |of: &str| text.lines().filter(|line| line.contains(of)).count();
        let all = inputs[1..].iter().all(|name| lines(&format!("{name}: ")) == 1);
        assert!(all && lines("a.json:") == 201, "{text}");
        let more = lines("a.json: and ");
        assert!(more == 1 && text.contains(" more problems"), "{text}");
    }
    let journal = String::from_utf8(scratch.read("out/batch.jsonl")).unwrap();
    assert!(journal.contains(" more problems") && !journal.contains("wrong999"), "{journal}");
}

#[test]
fn a_folder_stands_for_the_names_of_meshes_or_scenes() {
    let scratch = Scratch::new();
    for name in ["a.ply", "b.PLY"] {
        scratch.write(&format!("scans/{name}"), PYRAMID);
    }
    for name in ["._a.ply", "a.ply.bak", "a.ply~", "notes.txt", "s.json", "sub/c.ply"] {
        scratch.write(&format!("scans/{name}"), "ply\n");
    }
    let inputs = |input: &str| {
        let done = scratch.run(&["batch", "--dry-run", input]).good();
        let lines = done.stdout();
        let lines = lines.lines().map(|line| serde_json::from_str(line).unwrap());
        lines.map(|line: serde_json::Value| line["input"].as_str().unwrap().to_string()).collect()
    };
    let found: Vec<String> = inputs("scans");
    assert_eq!(found, ["scans/a.ply", "scans/b.PLY"]);
    assert_eq!(inputs("scans/*.ply"), ["scans/a.ply"]);
    assert_eq!(inputs("scans/.*.ply"), ["scans/._a.ply"]);
    assert_eq!(inputs("scans/*~"), ["scans/a.ply~"]);
    // Sidecars of an earlier run are no scenes.
    for name in ["a.json", "a.CryptoObject.json", "a.CryptoMaterial.json"] {
        scratch.write(&format!("scenes/{name}"), SCENE);
    }
    assert_eq!(inputs("scenes"), ["scenes/a.json"]);
}

/// A dry run reads no mesh.
#[test]
fn a_folder_stands_for_packed_meshes_too() {
    let scratch = Scratch::new();
    for name in ["a.ply.gz", "b.PLY.ZST", "c.ply", "d.gz", "e.json"] {
        scratch.write(&format!("scans/{name}"), PYRAMID);
    }
    let lines = scratch.run(&["batch", "scans", "--dry-run"]).good().stdout();
    let frames: Vec<Value> =
        lines.lines().map(|line| serde_json::from_str(line).unwrap()).collect();
    let found: Vec<&Value> = frames.iter().map(|frame| &frame["outputs"][0]).collect();
    assert_eq!(found, ["out/a.exr", "out/b.exr", "out/c.exr"]);
}

#[test]
fn a_misspelt_key_of_inputs_is_an_error_of_a_job() {
    let scratch = Scratch::with("{}");
    scratch.write("job.json", r#"{ "input": ["p.ply"], "size": [8, 8] }"#);
    let done = scratch.run(&["batch", "job.json", "--dry-run"]);
    assert_eq!(done.code(), 2);
    for text in
        ["missing key `inputs`", "found the unknown key \"input\"", "did you mean `inputs`?"]
    {
        assert!(done.stderr().contains(text), "{}", done.stderr());
    }
    // A scene may have the same mistake: it is rendered as what it is.
    scratch.write("scene.json", r#"{ "input": 1, "camera": {}, "scene": {} }"#);
    let done = scratch.run(&["batch", "scene.json", "--dry-run"]);
    assert!(!done.stderr().contains("`inputs`"), "{}", done.stderr());
}

#[test]
fn a_job_file_may_have_any_name() {
    let scratch = Scratch::new();
    scratch.write("a.ply", PYRAMID);
    for name in ["job", "job.lp", "JOB.JSON"] {
        scratch.write(name, r#"{ "inputs": ["a.ply"] }"#);
        let done = scratch.run(&["batch", name, "--dry-run"]).good();
        assert_eq!(done.stdout().lines().count(), 1, "{name}");
    }
    scratch.write("scene.lp", SCENE);
    assert_eq!(scratch.run(&["batch", "scene.lp", "--dry-run"]).good().stdout().lines().count(), 1);
}

#[test]
fn an_input_in_a_folder_that_may_not_be_entered_gives_the_error_of_the_system() {
    let scratch = Scratch::new();
    scratch.write("s", "");
    let done = scratch.run(&["batch", "s/a.ply"]);
    assert!(done.stderr().contains("s/a.ply: cannot read: Not a directory"), "{}", done.stderr());
    assert_eq!(done.code(), 2);
}

#[test]
fn names_that_are_not_utf8_are_refused() {
    let scratch = Scratch::new();
    scratch.write("a.ply", PYRAMID);
    fs::create_dir(scratch.path("scans")).unwrap();
    let scene = r#"{ "camera": { "type": "pinhole", "width": 8, "height": 8, "fov": 40,
                                 "position": [0, 0, 4], "lookat": [0, 0, -1], "up": [0, 1, 0] },
                     "scene": { "lightsources": [], "shapes": [] } }"#;
    let name = OsStr::from_bytes(b"m\xff.json");
    fs::write(scratch.path("scans").join(name), scene).unwrap();
    let args = ["batch", "scans", "-o", "out", "--no-sheet", "--resume"];
    let done = scratch.run(&[&args[..], &SMALL].concat());
    assert_eq!(done.code(), 2, "{}", done.stderr());
    assert!(done.stderr().contains("found frames whose names are not UTF-8"), "{}", done.stderr());
    assert!(!scratch.path("out").exists());
    // Under another name, the second run keeps the frame.
    for expected in ["1 frame rendered, 0 kept", "0 frames rendered, 1 kept"] {
        let named = [&args[..], &["--name", "{input:04}"], &SMALL].concat();
        let done = scratch.run(&named).good();
        assert!(done.stderr().contains(expected), "{}", done.stderr());
    }
    // A scene names its mesh, so another name of the frames would not help.
    fs::write(scratch.path("").join(OsStr::from_bytes(b"m\xff.ply")), PYRAMID).unwrap();
    let mut command = scratch.command(&["batch", "--dry-run"]);
    let done = Done::of(command.arg("."));
    let said = "help: rename the input\n";
    assert!(done.code() == 2 && done.stderr().contains(said), "{}", done.stderr());
    // A pattern does not leave such a folder.
    let folder = scratch.path("").join(OsStr::from_bytes(b"job\xff"));
    fs::create_dir(&folder).unwrap();
    fs::write(folder.join("job.json"), r#"{ "inputs": ["*.ply"] }"#).unwrap();
    let mut command = scratch.command(&["batch", "--dry-run"]);
    let done = Done::of(command.arg(OsStr::from_bytes(b"job\xff/job.json")));
    assert_eq!((done.code(), done.stdout()), (2, String::new()), "{}", done.stderr());
    assert!(done.stderr().contains("not UTF-8"), "{}", done.stderr());
}
