//! Names with escapes of terminals, line breaks, links and pipes. Nothing that the program prints
//! may move a cursor or start a line that a farm reads as a command, and nothing may be written
//! elsewhere.

use std::{
    fs,
    os::unix::fs::symlink,
    process::Command,
    time::{Duration, Instant},
};

use crate::support::program::{Done, PYRAMID, Scratch, names_in};

/// Clears a terminal; colours it, also with a one-byte escape; adds a line for a farm; reverses the
/// text.
const HOSTILE: &str = "x\u{1b}[2J\u{9b}31m\nopenjd_fail: forged\r\u{202e}\u{200f}\u{7f}\t";

const SMALL: [&str; 8] =
    ["--size", "16x12", "--threads", "2", "--spp", "1", "--set", "/scene/accelerator=bvh"];

/// Fails unless the output is plain lines, none of which a farm reads as a command.
#[track_caller]
fn is_plain(what: &str, done: &Done) {
    for text in [done.stdout(), done.stderr()] {
        let hidden = |c: char| {
            c.is_control() && c != '\n'
                || matches!(c, '\u{61c}' | '\u{200e}'..='\u{200f}' | '\u{2028}'..='\u{202e}' | '\u{2066}'..='\u{2069}')
        };
        assert!(!text.contains(hidden), "{what}: {text:?}");
        // Progress and status come from the program itself.
        let own = ["openjd_progress: ", "openjd_status: "];
        let forged = text.lines().find(|line| {
            (line.starts_with("openjd_") || line.starts_with("ALF_"))
                && !own.iter().any(|own| line.starts_with(own))
        });
        assert_eq!(forged, None, "{what}: {text:?}");
    }
}

/// A scene whose mesh, names and keys are hostile, too.
fn scratch() -> (Scratch, [String; 3]) {
    let scratch = Scratch::new();
    let property = HOSTILE.replace(char::is_whitespace, "_");
    let header = format!("end_header\ncomment TextureFile {property}\n");
    let header = header.lines().rev().collect::<Vec<_>>().join("\n");
    let mesh = PYRAMID.replace("end_header", &header);
    let name = |end: &str| format!("{HOSTILE}.{end}");
    scratch.write(&name("ply"), &mesh);
    let scene = serde_json::json!({
        "camera": { "type": "pinhole", "width": 16, "height": 12, "fov": 40,
                    "position": [0, 1, 6], "lookat": [0, 0, -1], "up": [0, 1, 0] },
        "scene": {
            "lightsources": [{ "type": "pointlight", "position": [0, 5, 5], "id": [1, 1, 1] }],
            "shapes": [{ "type": "trimesh", "path": name("ply"), "material": {} }] }
    });
    scratch.write(&name("json"), &scene.to_string());
    scratch.write("bad.json", &scene.to_string().replace("\"fov\":40", "\"fov\":400"));
    let key = serde_json::to_string(HOSTILE).unwrap();
    let mut named = scene.clone();
    named["scene"]["shapes"][0]["name"] = HOSTILE.into();
    scratch.write("named.json", &named.to_string());
    scratch.write("key.json", &scene.to_string().replace("\"fov\"", &key));
    let done = scratch.run(&["render", &name("json"), "-o", "plain", "--quiet"]);
    assert_eq!(done.code(), 0, "{}", done.stderr());
    fs::copy(scratch.path("plain.exr"), scratch.path(&name("exr"))).unwrap();
    (scratch, [name("ply"), name("json"), name("exr")])
}

#[test]
fn nothing_hostile_is_printed() {
    let (scratch, [ply, json, exr]) = scratch();
    let bench = ["--quick", "--backends", "bvh", "--classes", "primary"];
    let brief = ["--spp", "1,2", "--size", "16x12", "--budget", "5", "--repeats", "1"];
    let cases: &[(&str, &[&str], &[&str], i32)] = &[
        ("render", &[&json, "-o", "a"], &SMALL, 0),
        ("render", &[&json, "-o", "a", "--json"], &SMALL, 0),
        ("render", &[&ply, "-o", "a", "--progress", "openjd"], &SMALL, 0),
        ("render", &[&json], &[], 2),
        ("render", &[&ply], &[], 2),
        ("render", &["bad.json"], &[], 2),
        ("render", &["key.json"], &[], 2),
        ("render", &["named.json"], &[], 2),
        ("render", &["no", "--isa", HOSTILE], &[], 2),
        ("render", &["no", &format!("--isa={HOSTILE}")], &[], 2),
        ("render", &["no", HOSTILE], &[], 2),
        (HOSTILE, &[], &[], 2),
        ("render", &[&json, "-o", "a", "--set", HOSTILE], &[], 2),
        ("render", &[&json, "-o", "a", "--stats", &ply], &[], 2),
        ("render", &[&json, "-o", HOSTILE], &[], 2),
        ("render", &[HOSTILE], &[], 2),
        ("info", &[&ply, &json, &exr, "plain.exr"], &[], 0),
        ("info", &[&ply, &json, &exr, "plain.exr", "--json"], &[], 0),
        ("info", &[HOSTILE, "key.json", "--json"], &[], 2),
        ("bench", &[&ply, &json], &bench, 0),
        ("compare", &[&exr, &exr], &[], 0),
        ("compare", &["plain.exr", &exr, "--json"], &[], 0),
        ("converge", &[&json], &brief, 0),
        ("crosscheck", &[&json, "--rays", "100", "--backends", "bvh,brute"], &[], 0),
        ("crosscheck", &["--replay", HOSTILE], &[], 2),
        ("merge", &[&exr, "-o", "m"], &[], 2),
        ("merge", &[HOSTILE, "-o", "m"], &[], 2),
        ("batch", &[&ply, "-o", "out"], &SMALL, 2),
        ("batch", &[&ply, "-o", "out", "--name", "{input}"], &SMALL, 0),
        ("batch", &[&ply, "-o", "out", "--name", "{input}", "--resume"], &SMALL, 0),
        ("batch", &[&ply, "-o", "out", "--name", "{input}", "--dry-run"], &SMALL, 0),
        ("batch", &["bad.json", &ply, "-o", "o", "--name", "{input}"], &SMALL, 1),
        ("batch", &["bad.json", &ply, "-o", "o", "--name", "{input}", "--fov", "500"], &[], 2),
        ("batch", &[&ply, "-o", "out", "--name", HOSTILE], &SMALL, 2),
        ("batch", &[&ply, "-o", HOSTILE, "--name", "{input}"], &SMALL, 2),
        ("batch", &[HOSTILE], &SMALL, 2),
        ("submit", &["slurm", &json], &[], 2),
    ];
    for (command, args, more, code) in cases {
        let what = format!("{command} {args:?}");
        let done = scratch.run(&[&[*command], *args, *more].concat());
        assert_eq!(done.code(), *code, "{what}: {}", done.stderr());
        is_plain(&what, &done);
        for line in done.stdout().lines().filter(|_| args.contains(&"--json")) {
            serde_json::from_str::<serde_json::Value>(line)
                .unwrap_or_else(|e| panic!("{what}: {e}"));
        }
    }
}

#[test]
fn a_name_is_never_a_farm_command() {
    let scratch = Scratch::new();
    scratch.write("openjd_fail: x.ply", PYRAMID);
    let done = scratch.run(&[&["render", "openjd_fail: x.ply"], &SMALL[..]].concat());
    assert_eq!(done.code(), 0, "{}", done.stderr());
    is_plain("render", &done);
    assert!(done.stdout().contains("./openjd_fail: x.exr\n"), "{}", done.stdout());
    let done = scratch.run(&[&["batch", "openjd_fail: x.ply"], &SMALL[..]].concat());
    assert_eq!(done.code(), 0, "{}", done.stderr());
    is_plain("batch", &done);
}

#[test]
fn no_name_leads_out_of_the_folder() {
    let scratch = Scratch::new();
    scratch.write("scans/...ply", PYRAMID);
    scratch.write("....ply/x.ply", PYRAMID);
    for (input, flags) in [
        ("scans/...ply", &["--turntable", "2"][..]),
        ("scans/...ply", &["--name", "a/{stem}/{stem}/x{frame}"]),
        ("scans/...ply", &[]),
        ("scans/../scans/...ply", &["--name", "{stem}/x"]),
    ] {
        let args = [&["batch", input, "-o", "a/out", "--no-sheet"], flags, &SMALL].concat();
        let done = scratch.run(&args);
        let outside = names_in(&scratch.path(""));
        assert_eq!(outside, ["....ply", "scans"], "{input} {flags:?}: {}", done.stderr());
        assert_eq!(done.code(), 2, "{input} {flags:?}: {}", done.stderr());
        assert!(done.stderr().contains(&format!("{input}: found frames")), "{}", done.stderr());
    }
}

/// Returns the exit code of a run that must not hang.
fn run_in_time(scratch: &Scratch, args: &[&str]) -> Option<i32> {
    let mut child = scratch.command(args);
    let mut child = child.stdout(std::process::Stdio::null()).spawn().unwrap();
    let start = Instant::now();
    while start.elapsed() < Duration::from_secs(20) {
        if let Some(status) = child.try_wait().unwrap() {
            return status.code();
        }
        std::thread::sleep(Duration::from_millis(20));
    }
    child.kill().unwrap();
    child.wait().unwrap();
    panic!("it hangs: {args:?}");
}

/// Pipes under the names of frames, of the page and of part files have no writer.
#[test]
fn pipes_in_the_output_folder_are_never_opened() {
    let _timed = crate::timed();
    let scratch = Scratch::new();
    scratch.write("a.ply", PYRAMID);
    let args = [&["batch", "a.ply", "-o", "out"], &SMALL[..]].concat();
    let names = ["out/a.exr", "out/a.png", "out/a.exr.lpabcdef.part", "out/index.html"];
    for (name, codes) in names.into_iter().zip([[1, 1], [1, 1], [0, 0], [2, 2]]) {
        fs::create_dir(scratch.path("out")).unwrap();
        scratch.pipe(name);
        for (more, code) in [&[][..], &["--resume"]].into_iter().zip(codes) {
            assert_eq!(run_in_time(&scratch, &[&args[..], more].concat()), Some(code), "{name}");
        }
        let code = run_in_time(&scratch, &[&args[..], &["--sheet-only"]].concat());
        assert_eq!(code, Some(codes[0]), "{name}");
        fs::remove_dir_all(scratch.path("out")).unwrap();
    }
}

#[test]
fn a_journal_is_a_file_of_its_folder() {
    let _timed = crate::timed();
    let scratch = Scratch::new();
    scratch.write("a.ply", PYRAMID);
    scratch.write("precious", "mine\n");
    fs::create_dir(scratch.path("out")).unwrap();
    let args = [&["batch", "a.ply", "-o", "out"], &SMALL[..]].concat();
    let run = |args: &[&str]| run_in_time(&scratch, args);
    symlink("../precious", scratch.path("out/batch.jsonl")).unwrap();
    assert_eq!(run(&args), Some(2));
    assert_eq!(scratch.read("precious"), b"mine\n");
    fs::remove_file(scratch.path("out/batch.jsonl")).unwrap();
    symlink("nowhere", scratch.path("out/batch.jsonl")).unwrap();
    assert_eq!(run(&args), Some(2));
    fs::remove_file(scratch.path("out/batch.jsonl")).unwrap();
    scratch.pipe("out/batch.jsonl");
    assert_eq!(run(&args), Some(2));
    fs::remove_file(scratch.path("out/batch.jsonl")).unwrap();
    // The sheet looks for journals of ranges here.
    scratch.pipe("out/batch.0-1.jsonl");
    assert_eq!(run(&args), Some(0));
    assert_eq!(run(&[&args[..], &["--sheet-only"]].concat()), Some(0));
}

/// A problem that only the user can solve gives exit code 2: another try does not help.
#[test]
fn files_and_loops_in_the_way_are_bad_input() {
    let scratch = Scratch::new();
    scratch.write("a.ply", PYRAMID);
    scratch.write("file", "");
    symlink("loop", scratch.path("loop")).unwrap();
    for args in [
        ["batch", "a.ply", "-o", "file"],
        ["batch", "a.ply", "-o", "loop"],
        ["batch", "a.ply", "-o", "file/x"],
        ["render", "a.ply", "-o", "loop/x"],
        ["render", "loop", "-o", "x"],
        ["batch", "loop", "-o", "x"],
        ["info", "loop", "loop", "--json"],
    ] {
        let done = scratch.run(&args);
        assert_eq!(done.code(), 2, "{args:?}: {}", done.stderr());
    }
    let turning = ["batch", "a.ply", "--turntable", "2", "--pivot"];
    let done = scratch.run(&[&turning[..], &["1,2"]].concat());
    assert!(done.stderr().contains("three coordinates of a point"), "{}", done.stderr());
    // In map coordinates.
    let done = scratch.run(&[&turning[..], &["2600000,5,1200000", "--dry-run"]].concat());
    assert_eq!(done.code(), 0, "{}", done.stderr());
}

#[test]
fn patterns_terminate_and_list_each_mesh_once_despite_links() {
    let scratch = Scratch::new();
    scratch.write("scans/a.ply", PYRAMID);
    scratch.write("scans/d/e/b.ply", PYRAMID);
    symlink("..", scratch.path("scans/d/up")).unwrap();
    symlink("../..", scratch.path("scans/d/e/up")).unwrap();
    symlink("..", scratch.path("scans/d/e/up2")).unwrap();
    let run = |pattern: &str| {
        let job = format!(r#"{{ "inputs": ["{pattern}"], "output": {{ "name": "{{input}}" }} }}"#);
        scratch.write("job.json", &job);
        let mut limited = Command::new("timeout");
        limited.args(["20", env!("CARGO_BIN_EXE_lightpath"), "batch", "job.json", "--dry-run"]);
        Done::of(limited.current_dir(scratch.path("")))
    };
    let listed = |pattern: &str| {
        let done = run(pattern);
        assert_eq!(done.code(), 0, "{pattern}: {}", done.stderr());
        let input = |line: &str| {
            let line: serde_json::Value = serde_json::from_str(line).unwrap();
            line["input"].as_str().unwrap().to_string()
        };
        done.stdout().lines().map(input).collect::<Vec<_>>()
    };
    let all = ["scans/a.ply", "scans/d/e/b.ply"];
    assert_eq!(listed("scans/**/*.ply"), all);
    assert_eq!(listed("**/*.ply"), all);
    assert_eq!(listed("**/**/**/*.ply"), all);
    assert_eq!(listed("s*/**/e/**/*.ply"), all[1..]);
    assert_eq!(listed("scans/*/*/b.ply"), all[1..]);
    // `*` follows links to folders. A file that several paths reach counts once.
    assert_eq!(listed("scans/*/*/*/*.ply"), ["scans/d/e/up/a.ply"]);
    assert_eq!(listed("scans/**/*/**/*/**/*.ply"), ["scans/d/e/b.ply", "scans/d/up/a.ply"]);
    // Other names of a mesh are meshes of their own.
    symlink("a.ply", scratch.path("scans/c.ply")).unwrap();
    assert_eq!(listed("scans/*.ply"), ["scans/a.ply", "scans/c.ply"]);
    // Folders alone are no meshes.
    for pattern in ["scans/**", "**"] {
        let done = run(pattern);
        assert_eq!(done.code(), 2, "{pattern}: {}", done.stderr());
        assert!(done.stderr().contains("matches no file"), "{pattern}: {}", done.stderr());
    }
}

#[test]
fn a_scene_that_cannot_name_its_mesh_is_refused_before_the_render() {
    use std::os::unix::ffi::OsStrExt;
    let scratch = Scratch::new();
    let folder = scratch.path("").join(std::ffi::OsStr::from_bytes(b"caf\xe9"));
    fs::create_dir(&folder).unwrap();
    fs::write(folder.join("p.ply"), PYRAMID).unwrap();
    for args in [
        &["render", "p.ply", "--write-scene", "../s.json"][..],
        &["crosscheck", "p.ply", "--backends", "bvh,brute", "--save", "../s.json"],
    ] {
        let done = Done::of(scratch.command(args).current_dir(&folder));
        assert_eq!(done.code(), 2, "{}", done.stderr());
        assert!(done.stderr().contains("not UTF-8"), "{}", done.stderr());
        assert_eq!((names_in(&folder), done.stdout()), (vec!["p.ply".to_string()], String::new()));
    }
}

#[test]
fn names_too_long_for_their_part_files_are_refused_at_once() {
    let scratch = Scratch::new();
    let stem = "x".repeat(240);
    let mesh = format!("{stem}.ply");
    scratch.write(&mesh, PYRAMID);
    for args in [&["render", &mesh][..], &["batch", &mesh, "-o", "out", "--no-sheet"]] {
        let done = scratch.run(&[args, &SMALL[..]].concat());
        assert_eq!(done.code(), 2, "{}", done.stderr());
        let said = done.stderr();
        assert!(said.contains("found a file name of 244 bytes, expected at most 241"), "{said}");
        assert!(said.contains("help: choose a shorter name"), "{said}");
        // Also before the frames are rendered somewhere else.
        if args[0] == "batch" {
            let done = scratch.run(&[args, &["--dry-run"], &SMALL[..]].concat());
            assert_eq!((done.code(), done.stdout().as_str()), (2, ""), "{}", done.stderr());
        }
        assert!(scratch.names().iter().all(|name| name == &mesh || name == "out"));
    }
    scratch.run(&[&["render", &mesh, "-o", "short"], &SMALL[..]].concat()).good();
}

/// Nothing but the word before `.part` tells a part file from a file of the user.
#[test]
fn a_backup_of_the_user_is_never_swept() {
    let scratch = Scratch::new();
    scratch.write("a.ply", PYRAMID);
    let names = ["out/a.exr.backup.part", "out/a.exr.lpA1b2C3.part"];
    names.iter().for_each(|name| scratch.write(name, "mine"));
    scratch.run(&[&["batch", "a.ply", "-o", "out"], &SMALL[..]].concat()).good();
    assert_eq!(names.map(|name| scratch.path(name).exists()), [true, false]);
}
