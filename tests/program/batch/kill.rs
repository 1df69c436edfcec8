//! Kills a batch again and again. Finished files must be complete, and in the end all frames must
//! exist.

use std::{
    collections::BTreeMap,
    fs,
    io::{BufRead, BufReader, Read},
    path::Path,
    process::{Command, Stdio},
    time::{Duration, Instant},
};

use crate::support::program::{PYRAMID, Running, Scratch, interruptible, names_in, send};
use crate::support::random::Random;

use super::memory::write_instances;

const MESHES: u32 = 50;
const FRAMES: u32 = 4;

fn scratch() -> Scratch {
    let scratch = Scratch::new();
    for mesh in 0..MESHES {
        let apex = format!("0.{mesh:02} {} 0", 1 + mesh % 5);
        scratch.write(&format!("scans/m{mesh:02}.ply"), &PYRAMID.replace("0 2 0", &apex));
    }
    scratch
}

fn batch(scratch: &Scratch, out: &str) -> Command {
    let frames = FRAMES.to_string();
    let args =
        ["batch", "scans", "-o", out, "--turntable", &frames, "--size", "60x42", "--spp", "2"];
    let more = ["--backend", "bvh", "--threads", "2", "--resume", "--no-sheet", "--quiet"];
    scratch.command(&[&args[..], &more].concat())
}

/// Returns all files below a folder except the journal.
fn files(folder: &Path) -> BTreeMap<String, Vec<u8>> {
    let mut all = BTreeMap::new();
    for name in names_in(folder) {
        let path = folder.join(&name);
        if path.is_dir() {
            let below = files(&path).into_iter();
            all.extend(below.map(|(file, bytes)| (format!("{name}/{file}"), bytes)));
        } else if name != "batch.jsonl" {
            all.insert(name, fs::read(&path).unwrap());
        }
    }
    all
}

/// Starts the batch `kills` times and kills it each time at a random moment, then lets it finish.
fn survives(kills: u32) {
    let scratch = scratch();
    let whole = batch(&scratch, "whole").output().unwrap();
    assert!(whole.status.success(), "{}", String::from_utf8_lossy(&whole.stderr));
    let whole = files(&scratch.path("whole"));
    assert_eq!(whole.len() as u32, 2 * MESHES * FRAMES);
    let mut random = Random(1);
    let mut killed = 0;
    for _ in 0..kills {
        let mut child = Running(batch(&scratch, "out").stdout(Stdio::piped()).spawn().unwrap());
        let mut stdout = BufReader::new(child.0.stdout.take().unwrap());
        // Waits for up to three lines of output, then for a random moment within a frame.
        let mut line = String::new();
        for _ in 0..random.below(4) {
            stdout.read_line(&mut line).unwrap();
        }
        std::thread::sleep(Duration::from_micros(random.below(4000) as u64));
        killed += u32::from(child.0.try_wait().unwrap().is_none());
        drop(child);
        let mut rest = Vec::new();
        stdout.read_to_end(&mut rest).unwrap();
        // A file with its final name is complete.
        for (name, bytes) in files(&scratch.path("out")) {
            assert!(name.ends_with(".part") || whole.get(&name) == Some(&bytes), "{name}");
        }
    }
    assert!(killed >= kills * 4 / 5, "{killed} of {kills} were still running");
    let done = batch(&scratch, "out").output().unwrap();
    assert!(done.status.success(), "{}", String::from_utf8_lossy(&done.stderr));
    let made = files(&scratch.path("out"));
    assert_eq!(made.keys().collect::<Vec<_>>(), whole.keys().collect::<Vec<_>>());
    assert!(made == whole);
    let journal = String::from_utf8(scratch.read("out/batch.jsonl")).unwrap();
    for line in journal.lines() {
        let record: Result<serde_json::Value, _> = serde_json::from_str(line);
        assert!(record.is_ok(), "{line}");
    }
}

#[test]
fn kills_at_random_moments_lose_nothing() {
    survives(50);
}

/// A farm may run a task twice, also at the same time.
#[test]
fn runs_at_the_same_time_lose_nothing() {
    let scratch = Scratch::new();
    scratch.write("a.ply", PYRAMID);
    let command = |out: &str| {
        let args = ["batch", "a.ply", "-o", out, "--turntable", "6", "--size", "24x16"];
        let more = ["--spp", "1", "--threads", "1", "--resume", "--no-sheet"];
        scratch.command(&[&args[..], &more].concat())
    };
    assert!(command("whole").output().unwrap().status.success());
    let whole = files(&scratch.path("whole"));
    assert_eq!(whole.len(), 12);
    let start = || {
        let mut command = command("out");
        command.stdout(Stdio::null()).stderr(Stdio::piped());
        Running(command.spawn().unwrap())
    };
    for mut run in [start(), start(), start()] {
        let mut said = String::new();
        run.0.stderr.take().unwrap().read_to_string(&mut said).unwrap();
        assert!(run.0.wait().unwrap().success(), "{said}");
    }
    // No part file is left, and the journal knows every file.
    assert!(files(&scratch.path("out")) == whole);
    let last = command("out").output().unwrap();
    let said = String::from_utf8_lossy(&last.stderr);
    assert!(said.contains("0 frames rendered, 6 kept"), "{said}");
}

/// The scenes of a turntable of thousands of instances are compared with the files first.
#[test]
fn a_signal_stops_the_comparison_of_frames() {
    let scratch = Scratch::new();
    write_instances(&scratch, 2000);
    let args = ["batch", "scene.json", "-o", "out", "--turntable", "1000", "--threads", "2"];
    let mut child = Running(interruptible(&scratch.command(&args)).spawn().unwrap());
    child.until(|| scratch.path("out/batch.jsonl").exists());
    std::thread::sleep(Duration::from_millis(500));
    let began = Instant::now();
    send("INT", child.0.id());
    assert_eq!(child.0.wait().unwrap().code(), Some(130));
    // All frames take a minute and more.
    assert!(began.elapsed() < Duration::from_secs(20), "{:?}", began.elapsed());
    let journal = String::from_utf8(scratch.read("out/batch.jsonl")).unwrap();
    assert!(!journal.contains("\"event\":\"mesh\""), "{journal}");
}

#[test]
fn a_signal_stops_the_batch_and_keeps_finished_frames() {
    let scratch = scratch();
    assert!(batch(&scratch, "whole").output().unwrap().status.success());
    let whole = files(&scratch.path("whole"));
    for (signal, code) in [("INT", 130), ("TERM", 143)] {
        let mut command = interruptible(&batch(&scratch, signal));
        command.stdout(Stdio::piped()).stderr(Stdio::piped());
        let mut child = Running(command.spawn().unwrap());
        // The first of 200 frames is finished.
        let mut stdout = BufReader::new(child.0.stdout.take().unwrap());
        assert!(stdout.read_line(&mut String::new()).unwrap() > 0);
        // `timeout` signals the process and then its group, which the process is in.
        send(signal, child.0.id());
        send(signal, child.0.id());
        let mut said = String::new();
        child.0.stderr.take().unwrap().read_to_string(&mut said).unwrap();
        assert_eq!(child.0.wait().unwrap().code(), Some(code), "{said}");
        assert!(said.contains("error: stopped by a signal; finished frames stay"), "{said}");
        let files = files(&scratch.path(signal));
        let pictures = files.keys().filter(|name| name.ends_with(".exr")).count();
        assert!(pictures > 0 && files.len() < whole.len(), "{:?}", files.keys());
        for (name, bytes) in &files {
            assert!(whole.get(name) == Some(bytes), "{signal}: {name}");
        }
        let journal = String::from_utf8(scratch.read(&format!("{signal}/batch.jsonl"))).unwrap();
        let end = journal.lines().last().unwrap();
        let stopped = end.contains(&format!("\"signal\":{}", code - 128));
        assert!(end.contains("\"event\":\"end\"") && stopped, "{journal}");
    }
}
