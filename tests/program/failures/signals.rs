//! Signals and kills give the right exit code, promptly, and never leave an incomplete file under a
//! final name.

use std::{
    fs,
    io::{BufRead, BufReader, Read},
    os::unix::process::ExitStatusExt,
    process::{Command, Stdio},
    sync::LazyLock,
    time::{Duration, Instant},
};

use crate::support::backends::on_both;
use crate::support::program::{self, Running, Scratch, interruptible, names_in, send};
use lightpath::scene::Backend;

/// A render of some minutes.
const SLOW: &str = r#"{
  "spp": 4096,
  "camera": { "type": "pinhole", "width": 2000, "height": 2000, "fov": 40,
              "position": [0, 0, 4], "lookat": [0, 0, -1], "up": [0, 1, 0] },
  "scene": {
    "lightsources": [
      { "type": "arealight", "v0": [-1, 4, 0], "v1": [1, 4, 0], "v2": [1, 4, 2],
        "id": [2, 2, 2], "samples": 64 }],
    "shapes": [{ "type": "sphere", "center": [0, 0, 0], "radius": 1, "material": {} }]
  }
}"#;

/// Time within which a render must react to a signal.
const PROMPT: Duration = Duration::from_secs(5);

/// Starts a render of `file` to `out/x` and waits until it has reached `phase`, or the next one on
/// a fast machine.
fn started(scratch: &Scratch, file: &str, backend: &str, phase: &str, threads: &str) -> Running {
    let args = ["render", file, "-o", "out/x", "--progress", "json", "--backend", backend];
    let args = [&args[..], &["--threads", threads]].concat();
    let mut command = interruptible(&scratch.command(&args));
    let mut child = Running(command.stderr(Stdio::piped()).spawn().unwrap());
    let mut line = String::new();
    let mut stderr = BufReader::new(child.0.stderr.take().unwrap());
    while stderr.read_line(&mut line).unwrap() > 0 {
        let reached = |phase: &str| line.contains(&format!("\"phase\":\"{phase}\""));
        if reached(phase) || reached("render") {
            child.0.stderr = Some(stderr.into_inner());
            return child;
        }
        assert!(!line.starts_with("error"), "{line}");
        line.clear();
    }
    panic!("{phase} was over too soon");
}

/// Sends a signal in `phase` and checks that no file is left.
fn stops(file: (&Scratch, &str), backend: Backend, phase: &str, signal: &str, code: i32) {
    let (scratch, file) = file;
    // The first signal stops several threads. The others leave a processor to other tests.
    let threads = if signal == "INT" { "2" } else { "1" };
    let mut child = started(scratch, file, backend.name(), phase, threads);
    send(signal, child.0.id());
    let sent = Instant::now();
    let mut said = String::new();
    child.0.stderr.take().unwrap().read_to_string(&mut said).unwrap();
    let status = child.0.wait().unwrap();
    assert!(sent.elapsed() < PROMPT, "{signal} in {phase}: {:?}", sent.elapsed());
    assert_eq!(status.code(), Some(code), "{signal} in {phase}: {said}");
    assert!(said.contains("error: stopped by a signal; no output was written"), "{said}");
    assert_eq!(names_in(&scratch.path("out")), [""; 0]);
}

fn scratch() -> Scratch {
    let scratch = Scratch::new();
    scratch.write("slow.json", SLOW);
    fs::create_dir(scratch.path("out")).unwrap();
    scratch
}

on_both! {
    fn a_render_stops(backend: Backend) {
        let _timed = crate::timed();
        let scratch = scratch();
        stops((&scratch, "slow.json"), backend, "render", "INT", 130);
        // Signals do not reach a backend: one shows how all of them end.
        if backend == Backend::default() {
            stops((&scratch, "slow.json"), backend, "render", "TERM", 143);
            // A closed terminal, and Ctrl-\.
            stops((&scratch, "slow.json"), backend, "render", "HUP", 129);
            stops((&scratch, "slow.json"), backend, "render", "QUIT", 131);
            // The soft limit of `ulimit -t`.
            stops((&scratch, "slow.json"), backend, "render", "XCPU", 152);
        }
    }
}

/// Returns true if a process has a handler for a signal.
fn catches(process: u32, signal: u32) -> bool {
    let status = fs::read_to_string(format!("/proc/{process}/status")).unwrap_or_default();
    let mask = status.lines().find_map(|line| line.strip_prefix("SigCgt:"));
    let mask = mask.and_then(|mask| u64::from_str_radix(mask.trim(), 16).ok());
    mask.is_some_and(|mask| mask >> (signal - 1) & 1 == 1)
}

/// Runs a command that waits, once it has begun to write, for a pipe without a writer or for a
/// program that sleeps. A command that does not wait may end with the exit code `own` before the
/// signal arrives; it is then run again.
fn waits(scratch: &Scratch, args: &[&str], path: &str, own: Option<i32>, begun: impl Fn() -> bool) {
    for (signal, code) in [("HUP", 129), ("INT", 130), ("TERM", 143)] {
        let ended = (0..50).map(|_| {
            end_sleeper(scratch);
            let mut command = interruptible(&scratch.command(args));
            command.env("PATH", path).stdout(Stdio::null()).stderr(Stdio::piped());
            let mut child = Running(command.spawn().unwrap());
            let start = Instant::now();
            while !(catches(child.0.id(), 15) && begun()) {
                assert!(start.elapsed() < PROMPT, "{args:?} does not begin");
                if own.is_none() {
                    std::thread::sleep(Duration::from_millis(5));
                } else if let Some(status) = child.0.try_wait().unwrap() {
                    return status.code();
                }
            }
            send(signal, child.0.id());
            let status = child.0.wait().unwrap();
            assert!(start.elapsed() < 2 * PROMPT);
            let left = names_in(&scratch.path("out"));
            let parts = left.iter().any(|name| name.ends_with(".part"));
            assert!(!parts, "{args:?}, {signal}: {left:?}");
            status.code()
        });
        let mut hit = ended.skip_while(|ended| own.is_some() && *ended == own);
        assert_eq!(hit.next(), Some(Some(code)), "{args:?}, {signal}");
    }
    end_sleeper(scratch);
}

/// Ends the program that sleeps for the run before, whose process is named in `called`.
fn end_sleeper(scratch: &Scratch) {
    if let Ok(process) = fs::read_to_string(scratch.path("called")) {
        let kill = format!("kill -s KILL {process}");
        let _ = Command::new("sh").args(["-c", &kill]).stderr(Stdio::null()).status();
        fs::remove_file(scratch.path("called")).unwrap();
    }
}

#[test]
fn short_commands_leave_no_file_either() {
    let _timed = crate::timed();
    let scratch = scratch();
    let path = std::env::var("PATH").unwrap();
    scratch.pipe("x.exr");
    let args = ["compare", "x.exr", "x.exr", "--out", "out/map.png", "--html", "out/page.html"];
    waits(&scratch, &args, &path, None, || names_in(&scratch.path("out")).len() == 2);

    scratch.pipe("stats");
    let args = ["render", "slow.json", "-o", "out/x", "--stats", "stats"];
    waits(&scratch, &args, &path, None, || names_in(&scratch.path("out")).len() == 2);

    fs::write(scratch.path("a.ply"), program::PYRAMID).unwrap();
    // Long enough to be hit.
    fs::create_dir(scratch.path("many")).unwrap();
    for i in 0..300 {
        fs::write(scratch.path(&format!("many/{i}.ply")), program::PYRAMID).unwrap();
    }
    let args = ["batch", "many", "-o", "out", "--sheet-only"];
    waits(&scratch, &args, &path, Some(1), || true);

    scratch.write("bin/sbatch", "#!/bin/sh\necho $$ >pid; mv pid called; exec sleep 20\n");
    let made = Command::new("chmod").arg("+x").arg(scratch.path("bin/sbatch")).status().unwrap();
    assert!(made.success());
    scratch.write("job.json", r#"{ "inputs": ["a.ply"] }"#);
    let path = format!("{}:{path}", scratch.path("bin").display());
    let args = ["submit", "slurm", "job.json", "-o", "out"];
    waits(&scratch, &args, &path, None, || scratch.path("called").is_file());
}

/// The signal comes after the last frame. A run that ends before the signal arrives is repeated.
#[test]
fn a_signal_during_the_contact_sheet_counts() {
    let _timed = crate::timed();
    let scratch = scratch();
    fs::write(scratch.path("a.ply"), program::PYRAMID).unwrap();
    let args = ["batch", "a.ply", "-o", "out", "--turntable", "24", "--resume", "--spp", "1"];
    let args = [&args[..], &["--size", "240x160", "--threads", "1"]].concat();
    let codes = (0..50).map(|_| {
        let mut command = interruptible(&scratch.command(&args));
        command.stdout(Stdio::null()).stderr(Stdio::piped());
        let mut child = Running(command.spawn().unwrap());
        let stderr = BufReader::new(child.0.stderr.take().unwrap());
        let mut lines = stderr.lines().map_while(std::result::Result::ok);
        assert!(lines.any(|line| line.contains(" rendered, ")));
        send("TERM", child.0.id());
        let said: Vec<String> = lines.collect();
        let code = child.0.wait().unwrap().code();
        assert!(code != Some(143) || said.concat().contains("stopped by a signal"), "{said:?}");
        code
    });
    let mut hit = codes.skip_while(|code| *code == Some(0));
    assert_eq!(hit.next(), Some(Some(143)));
}

#[test]
fn a_signal_that_the_shell_ignores_stops_nothing() {
    let _timed = crate::timed();
    let scratch = scratch();
    // As `nohup` does, and a script for a job that it starts with `&`.
    let render = "trap '' HUP INT QUIT; exec \"$0\" render slow.json -o out/x --size 300x300 --spp 4 --threads 1 --quiet";
    let mut command = Command::new("sh");
    command.args(["-c", render, env!("CARGO_BIN_EXE_lightpath")]).current_dir(scratch.path(""));
    let mut child = Running(command.spawn().unwrap());
    let start = Instant::now();
    while names_in(&scratch.path("out")).is_empty() {
        assert!(start.elapsed() < PROMPT, "it does not begin");
        std::thread::sleep(Duration::from_millis(5));
    }
    for signal in ["HUP", "INT", "QUIT"] {
        send(signal, child.0.id());
    }
    assert_eq!(child.0.wait().unwrap().code(), Some(0));
    assert_eq!(names_in(&scratch.path("out")), ["x.exr", "x.png"]);
}

#[test]
fn a_limit_of_file_sizes_is_an_error_and_leaves_nothing() {
    let scratch = scratch();
    // In blocks of 512 or 1024 bytes; the EXR is larger.
    let render = "ulimit -f 4; exec \"$0\" render slow.json -o out/x --size 128x128 --spp 1 --float \
                  --compression none --quiet --progress openjd";
    let mut command = Command::new("sh");
    command.args(["-c", render, env!("CARGO_BIN_EXE_lightpath")]).current_dir(scratch.path(""));
    let done = program::Done::of(&mut command);
    assert_eq!(done.code(), 2, "{}", done.stderr());
    assert!(done.stderr().starts_with("error: out/x."), "{}", done.stderr());
    let said = done.stdout();
    assert!(said.contains("openjd_progress: 99\n") && !said.contains(": 100\n"), "{said}");
    assert_eq!(names_in(&scratch.path("out")), [""; 0]);
}

#[test]
fn sudden_death_leaves_no_file_under_a_final_name() {
    let scratch = scratch();
    fs::write(scratch.path("out/x.png"), "the picture before").unwrap();
    let mut child = started(&scratch, "slow.json", "bvh", "render", "1");
    child.0.kill().unwrap();
    assert_eq!(child.0.wait().unwrap().signal(), Some(9));
    let names = names_in(&scratch.path("out"));
    assert!(names.iter().all(|name| name == "x.png" || name.ends_with(".part")), "{names:?}");
    assert_eq!(scratch.read("out/x.png"), b"the picture before");
}

static SHEET: LazyLock<Vec<u8>> = LazyLock::new(|| program::sheet(1400));

on_both! {
    fn a_build_stops(backend: Backend) {
        let _timed = crate::timed();
        let scratch = scratch();
        fs::write(scratch.path("sheet.ply"), &*SHEET).unwrap();
        let shape = r#"{ "type": "sphere", "center": [0, 0, 0], "radius": 1, "material": {} }"#;
        let mesh = r#"{ "type": "trimesh", "path": "sheet.ply", "material": {} }"#;
        scratch.write("mesh.json", &SLOW.replace(shape, mesh));
        stops((&scratch, "mesh.json"), backend, "build", "INT", 130);
    }
}
