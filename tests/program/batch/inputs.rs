//! Inputs that cannot be listed or named are refused and never left out.

use std::ffi::OsStr;
use std::fs;
use std::os::unix::ffi::OsStrExt;
use std::os::unix::fs::PermissionsExt;
use std::process::Command;

use crate::support::program::{Done, PYRAMID, SMALL, Scratch};

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
                Err(_) => break,
            },
        };
        if done.stderr().contains("setpriv") {
            eprintln!("skipped: {}", done.stderr());
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
    // A pattern does not leave such a folder.
    let folder = scratch.path("").join(OsStr::from_bytes(b"job\xff"));
    fs::create_dir(&folder).unwrap();
    fs::write(folder.join("job.json"), r#"{ "inputs": ["*.ply"] }"#).unwrap();
    let mut command = scratch.command(&["batch", "--dry-run"]);
    let done = Done::of(command.arg(OsStr::from_bytes(b"job\xff/job.json")));
    assert_eq!((done.code(), done.stdout()), (2, String::new()), "{}", done.stderr());
    assert!(done.stderr().contains("not UTF-8"), "{}", done.stderr());
}
