//! A disk that fills up while a picture with all its layers is written: exit code 3, no new or
//! broken file, and old files unchanged.

use std::process::Command;

use crate::support::program::{Done, Scratch, skipped};

const SCENE: &str = r#"{
  "spp": 4,
  "camera": { "type": "pinhole", "width": 200, "height": 150, "fov": 40,
              "position": [0, 0, 4], "lookat": [0, 0, -1], "up": [0, 1, 0] },
  "scene": {
    "backgroundcolor": [0.1, 0.2, 0.3],
    "lightsources": [{ "type": "pointlight", "position": [2, 3, 4], "id": [3, 3, 3] }],
    "shapes": [{ "type": "sphere", "center": [0, 0, 0], "radius": 1, "material": {} }]
  }
}"#;

/// Names of the files that exist before.
const OLD: [&str; 5] =
    ["x.CryptoMaterial.json", "x.CryptoObject.json", "x.Z.png", "x.exr", "x.png"];

/// Runs the program with `out` on a private disk of `kib` KiB that holds old files. Prints the
/// files that exist afterwards, those that are unchanged, then the last record of a batch's
/// journal. `None` if this user may not mount.
fn on_a_disk_of(scratch: &Scratch, kib: u64, args: &[&str]) -> Option<Done> {
    let script = format!(
        "mkdir -p out && mount -t tmpfs -o size={kib}k none out || exit 99
         for name in {}; do printf 'old %s\n' $name > out/$name; done
         \"$0\" \"$@\" > said; code=$?; ls -A out; grep -l '^old x' out/*
         tail -n 1 out/batch.jsonl 2> /dev/null; exit $code",
        OLD.join(" ")
    );
    let mut command = Command::new("unshare");
    command.args(["--map-root-user", "--mount", "sh", "-c", &script]);
    command.arg(env!("CARGO_BIN_EXE_lightpath")).args(args);
    command.current_dir(scratch.path("")).env_remove("SLURM_CPUS_PER_TASK");
    let done = Done::of(&mut command);
    if done.stderr().contains("unshare") || done.code() == 99 {
        skipped(&done.stderr());
        return None;
    }
    Some(done)
}

/// Checks disks without room for one file after another of those that `args` writes.
#[track_caller]
fn leaves_all_as_it_was(scratch: &Scratch, args: &[&str]) {
    let done = scratch.run(&[args, &["-o", "x"]].concat());
    assert_eq!(done.code(), 0, "{}", done.stderr());
    let written: Vec<u64> =
        done.stdout().lines().map(|name| scratch.read(name).len() as u64).collect();
    let total = written.iter().sum::<u64>() / 1024;
    // A page per old file; then no pages left, too few, and one missing.
    let old = 4 * OLD.len() as u64;
    let into = [args, &["-o", "out/x", "--quiet"]].concat();
    for kib in [old, old + 8, old + total / 3, old + 2 * total / 3, old + total - 4] {
        let Some(done) = on_a_disk_of(scratch, kib, &into) else { return };
        assert_eq!(done.code(), 3, "{kib} KiB: {}", done.stderr());
        assert!(done.stderr().contains("No space left on device"), "{}", done.stderr());
        let olds = OLD.map(|name| format!("out/{name}\n")).concat();
        assert_eq!(done.stdout(), OLD.join("\n") + "\n" + &olds, "{kib} KiB");
        assert_eq!(scratch.read("said"), b"");
    }
    // With enough room, the old files are replaced.
    let Some(done) = on_a_disk_of(scratch, 2 * (old + total) + 64, &into) else { return };
    assert_eq!(done.code(), 0, "{}", done.stderr());
    assert!(!done.stdout().contains("out/x.exr") && !done.stdout().contains(".part"));
}

fn scratch() -> Scratch {
    let scratch = Scratch::new();
    scratch.write("s.json", SCENE);
    scratch
}

#[test]
fn a_batch_repeats_its_failures_and_ends_its_journal() {
    let scratch = scratch();
    scratch.write("bad.ply", "ply\n");
    scratch.write("t.json", SCENE);
    let args = ["batch", "bad.ply", "s.json", "t.json", "--compression", "none", "--jobs", "1"];
    let Some(done) = on_a_disk_of(&scratch, 64, &[&args[..], &["-o", "out"]].concat()) else {
        return;
    };
    let said = done.stderr();
    assert_eq!(done.code(), 3, "{said}");
    let (ran, end) = said.split_once("of 3 inputs failed:").expect(&said);
    assert!(ran.contains("0 frames rendered, 0 kept, "), "{said}");
    for failure in ["bad.ply", "No space left on device"] {
        let count = |part: &str| part.matches(failure).count();
        assert!(count(ran) > 0 && count(end) == count(ran), "{said}");
    }
    assert!(done.stdout().contains(r#""event":"end""#), "{}", done.stdout());
}

#[test]
fn while_all_layers_are_written() {
    let scratch = scratch();
    for flags in [
        &[][..],
        &["--multipart"],
        &["--float", "--compression", "none"],
        &["--multipart", "--compression", "piz"],
        &["--crypto-sidecar", "--png-layer", "Z"],
    ] {
        leaves_all_as_it_was(&scratch, &[&["render", "s.json", "--aov", "all"], flags].concat());
    }
}

#[test]
fn while_parts_are_written_and_merged() {
    let scratch = scratch();
    let render = ["render", "s.json", "--aov", "all", "--samples"];
    leaves_all_as_it_was(&scratch, &[&render[..], &["0..1"]].concat());
    for (name, samples) in [("a", "0..1"), ("b", "1..4")] {
        let done = scratch.run(&[&render[..], &[samples, "--quiet", "-o", name]].concat());
        assert_eq!(done.code(), 0, "{}", done.stderr());
    }
    leaves_all_as_it_was(&scratch, &["merge", "a.exr", "b.exr", "--crypto-sidecar"]);
}
