//! Wrong usage gives a clear message and the right exit code; commands that need no renderer work.

use crate::support::program::{self, Scratch, lightpath};

const SCENE: &str = r#"{
  "camera": { "type": "pinhole", "width": 8, "height": 6, "fov": 40,
              "position": [0, 0, 4], "lookat": [0, 0, -1], "up": [0, 1, 0] },
  "scene": {
    "lightsources": [{ "type": "pointlight", "position": [2, 3, 4], "id": [3, 3, 3] }],
    "shapes": [{ "type": "sphere", "center": [0, 0, 0], "radius": 1, "material": {} }]
  }
}"#;

#[test]
fn one_flag_that_is_wrong_twice_is_named_once() {
    let scratch = Scratch::new();
    scratch.write("s.json", SCENE);
    let text = scratch.run(&["render", "s.json", "--size", "0x0"]).stderr();
    assert_eq!(text.matches("--size").count(), 1, "{text}");
}

#[test]
fn warnings_name_the_flag_too() {
    let scratch = Scratch::new();
    scratch.write("s.json", SCENE);
    let run = scratch.run(&["render", "s.json", "--adaptive-shadows", "--nbounces", "0"]);
    assert_eq!(run.code(), 0);
    assert!(run.stderr().contains("warning: --adaptive-shadows: found true"), "{}", run.stderr());
}

#[test]
fn usage_errors_exit_2_with_a_reason() {
    let scratch = Scratch::new();
    scratch.write("s.json", SCENE);
    scratch.write("file", "");
    let cases: &[(&[&str], &str)] = &[
        (&[], "Usage"),
        (&["paint"], "unrecognized subcommand"),
        (&["s.json"], "lightpath render s.json"),
        (&["gone.ply"], "lightpath render gone.ply"),
        (&["render", "s.json", "--isa", "mmx"], "possible values"),
        (&["render"], "required arguments"),
        (&["render", "s.json", "--nonsense"], "unexpected argument"),
        (&["render", "s.json", "--size", "12"], "WIDTHxHEIGHT"),
        (&["render", "s.json", "--size", "0x5"], "--size"),
        (&["render", "s.json", "--size", "1000000x1000000"], "film"),
        (&["render", "s.json", "--spp", "-1"], "--spp"),
        (&["render", "s.json", "--spp", "0"], "--spp"),
        (&["render", "s.json", "--light-samples", "x"], "--light-samples"),
        (&["render", "s.json", "--fov", "180"], "--fov"),
        (&["render", "s.json", "--fov", "nan"], "--fov"),
        (&["render", "s.json", "--exposure", "inf"], "--exposure"),
        (&["render", "s.json", "--tonemap", "aces"], "possible values"),
        (&["render", "s.json", "--backend", "gpu"], "possible values"),
        (&["render", "s.json", "--threads", "0"], "--threads"),
        (&["render", "s.json", "--max-memory", "lots"], "8G"),
        (&["render", "s.json", "--max-memory", "1k"], "expected at least"),
        (&["render", "s.json", "--crop", "0", "0", "9", "6"], "frame of 8 x 6"),
        (&["render", "s.json", "--crop", "3", "3", "3", "6"], "empty"),
        (&["render", "s.json", "--crop", "1", "2", "3"], "4 values"),
        (
            &["render", "s.json", "--crop", "0", "0", "2", "2", "--crop", "0", "0", "2", "2"],
            "cannot be used multiple times",
        ),
        (&["render", "s.json", "--set", "camera/fov=3"], "leading `/`"),
        (&["render", "s.json", "--set", "/camera/fovv=3"], "fov"),
        (&["render", "s.json", "--fast", "--backend", "brute"], "no fast mode"),
        (
            &["render", "s.json", "--fast"],
            "--fast: found with the backend `bvh`, which has no fast mode",
        ),
        (
            &["render", "s.json", "--isa", "portable", "--backend", "embree"],
            "leave --isa out, or --backend bvh",
        ),
        (
            &["render", "s.json", "--isa", "portable", "--backend", "brute"],
            "--isa: found with the backend `brute`",
        ),
        (&["render", "s.json", "--exact"], "unexpected argument '--exact'"),
        (&["render", "s.json", "--template", "s.json"], "--template"),
        (&["render", "s.json", "--up", "z"], "--up"),
        (&["render", "s.json", "-o", "missing/x"], "no such folder"),
        (&["render", "s.json", "-o", "file/x"], "expected a folder"),
        (&["render", "s.json", "-o", "/proc/x"], "/proc"),
        (&["render", "s.json", "--stats", "missing/x.json"], "no such folder"),
        (&["render", "s.json", "--write-scene", "missing/x.json"], "no such folder"),
        (&["render", "missing.json"], "missing.json"),
        (&["render", "."], "found a folder, expected a scene file"),
        (&["render", "file"], "found an empty file"),
        (&["render", "missing.ply"], "missing.ply"),
        (&["info"], "required arguments"),
        (&["info", "missing.json"], "missing.json"),
        (&["completions", "cobol"], "possible values"),
        (&["--verbose"], "--version"),
    ];
    for (args, expected) in cases {
        let output = scratch.run(args);
        let stderr = output.stderr();
        assert_eq!(output.code(), 2, "{args:?}: {stderr}");
        assert!(stderr.contains(expected), "{args:?}: {stderr}");
        assert!(!stderr.contains("panicked"), "{args:?}: {stderr}");
        assert_eq!(output.stdout(), "", "{args:?}");
    }
    assert_eq!(scratch.names(), ["file", "s.json"]);
}

#[test]
fn all_wrong_flags_are_named_at_once() {
    let scratch = Scratch::new();
    scratch.write("s.json", SCENE);
    let output = scratch.run(&["render", "s.json", "--spp", "0", "--fov", "200"]);
    let stderr = output.stderr();
    assert!(stderr.contains("--spp: ") && stderr.contains("--fov: "), "{stderr}");
}

#[test]
fn help_version_schema_completions_man() {
    let output = lightpath(&["--help"]);
    assert_eq!(output.code(), 0);
    assert!(output.stdout().contains("render"));
    let output = lightpath(&["render", "--help"]);
    for flag in ["--crop", "--max-memory", "--write-scene", "Exit codes"] {
        assert!(output.stdout().contains(flag), "{flag}");
    }
    let output = lightpath(&["--version"]);
    let version = concat!("lightpath ", env!("CARGO_PKG_VERSION"), "\n");
    assert_eq!(output.stdout(), version);
    let output = lightpath(&["-V", "--verbose"]);
    assert_eq!(output.code(), 0);
    for name in ["commit: ", "rustc: ", "embree: ", "kernels: "] {
        assert!(output.stdout().contains(name), "{}", output.stdout());
    }
    let schema = lightpath(&["schema"]).stdout();
    let schema: serde_json::Value = serde_json::from_str(&schema).unwrap();
    assert!(schema["properties"]["camera"].is_object());
    // An editor learns that a camera has one of `lookat` and `target`.
    let cameras = schema["$defs"]["Camera"]["oneOf"].as_array().unwrap();
    assert!(cameras.len() == 5 && cameras.iter().all(|camera| camera["oneOf"].is_array()));
    // Nor is a sun without a direction valid.
    let lights = schema["$defs"]["Light"]["oneOf"].as_array().unwrap();
    assert_eq!(lights.iter().filter(|light| light["oneOf"].is_array()).count(), 2);
    let job = lightpath(&["schema", "job"]).stdout();
    let job: serde_json::Value = serde_json::from_str(&job).unwrap();
    assert_eq!(job["properties"]["size"]["items"]["minimum"], 1);
    let bits = &job["$defs"]["OutputKeys"]["properties"]["pngbits"];
    assert_eq!(bits["enum"], serde_json::json!([8, 16]), "{bits}");
    // No key takes null, so no default has it.
    assert!(!job.to_string().contains("null"), "{job}");
    for shell in ["bash", "zsh", "fish"] {
        let output = lightpath(&["completions", shell]);
        assert!(output.stdout().contains("light-samples"), "{shell}");
    }
}

#[test]
fn the_man_page_has_every_flag_of_every_command() {
    let page = lightpath(&["man"]).good().stdout().replace("\\-", "-");
    let (about, _) = page.split_once(".SH LIGHTPATH ").unwrap();
    assert!(about.contains(".SH \"EXIT STATUS\""), "{about}");
    let changes = include_str!("../../CHANGELOG.md");
    let heading = concat!("\n## ", env!("CARGO_PKG_VERSION"), " - ");
    let date = changes.split_once(heading).map(|(_, rest)| &rest[..10]).expect("this version");
    assert!(about.contains(&format!(".TH lightpath 1 {date} \"")), "{about}");
    assert!(!page.contains("(1)"), "{page}");
    let mut commands = vec![String::new()];
    let mut seen = 0;
    while let Some(command) = commands.pop() {
        let words: Vec<&str> = command.split_whitespace().chain(["--help"]).collect();
        let help = lightpath(&words).good().stdout();
        let title = format!(".SH LIGHTPATH{}\n", command.to_uppercase());
        let section = match command.is_empty() {
            true => Some(about),
            false => page.split_once(&title).and_then(|(_, rest)| rest.split(".SH ").next()),
        };
        let section = section.unwrap_or_else(|| panic!("no {title}"));
        // Explanations are indented by more than rows of flags are.
        let is_row = |line: &&str| line.get(..7).is_some_and(|l| l.trim_start().starts_with('-'));
        for row in help.lines().filter(is_row) {
            let flag = row.split_whitespace().find(|word| word.starts_with("--"));
            let flag = flag.unwrap_or_else(|| panic!("{row}"));
            assert!(section.contains(&format!("\\fB{flag}\\fR")), "{words:?}: {flag}");
            seen += 1;
        }
        let list = help.split("Commands:\n").nth(1).unwrap_or_default();
        let rows = list.lines().take_while(|line| !line.is_empty());
        let names = rows.filter_map(|line| line.strip_prefix("  ")?.split(' ').next());
        let names = names.filter(|name| !["", "help"].contains(name));
        commands.extend(names.map(|name| format!("{command} {name}")));
    }
    assert!(seen > 200, "{seen} flags");
}

#[test]
fn a_flag_that_a_command_refuses_is_not_offered() {
    assert!(!lightpath(&["batch", "--help"]).good().stdout().contains("--crop"));
    // Once in what a render may be given, once where its values are completed.
    let bash = lightpath(&["completions", "bash"]).good().stdout();
    assert_eq!(bash.matches("--crop").count(), 2);
    let fish = lightpath(&["completions", "fish"]).good().stdout();
    assert_eq!(fish.matches("-l crop ").count(), 1);
}

#[cfg(target_os = "linux")]
#[test]
fn a_full_disk_behind_stdout_is_an_error_of_help_too() {
    for args in [&["--help"][..], &["help", "render"], &["render", "--help"], &["--version"]] {
        let full = std::fs::File::options().write(true).open("/dev/full").unwrap();
        let mut command = std::process::Command::new(env!("CARGO_BIN_EXE_lightpath"));
        let output = command.args(args).stdout(full).output().unwrap();
        let stderr = String::from_utf8(output.stderr).unwrap();
        assert_eq!(output.status.code(), Some(3), "{args:?}: {stderr}");
        assert!(stderr.contains("<stdout>: cannot write"), "{args:?}: {stderr}");
    }
}

#[test]
fn a_missing_instruction_set_is_refused_with_a_list() {
    use lightpath::simd::Isa;
    let scratch = Scratch::new();
    scratch.write("s.json", SCENE);
    let all = [
        ("portable", Isa::Portable),
        ("neon", Isa::Neon),
        ("avx2", Isa::Avx2),
        ("avx512", Isa::Avx512),
    ];
    for (name, isa) in all {
        let done = scratch.run(&["render", "s.json", "--isa", name, "-o", "none/x"]);
        let said = match Isa::available().any(|found| found == isa) {
            // The instruction set is accepted; the folder is missing.
            true => "no such folder",
            false => "available: portable",
        };
        assert_eq!(done.code(), 2, "{}", done.stderr());
        assert!(done.stderr().contains(said), "{name}: {}", done.stderr());
    }
}

#[test]
fn every_backend_is_known() {
    let scratch = Scratch::new();
    scratch.write("s.json", SCENE);
    for name in ["bvh", "embree", "coursework", "brute"] {
        let accelerator = format!("\"scene\": {{ \"accelerator\": \"{name}\",");
        scratch.write("b.json", &SCENE.replace("\"scene\": {", &accelerator));
        let info = scratch.run(&["info", "b.json"]);
        assert_eq!(info.code(), 0, "{}", info.stderr());
        assert!(info.stdout().contains(&format!("backend {name}")), "{}", info.stdout());
        // The backend is accepted; the folder is missing.
        let done = scratch.run(&["render", "s.json", "--backend", name, "-o", "none/x"]);
        assert!(done.stderr().contains("no such folder"), "{}", done.stderr());
    }
}

#[test]
fn info_names_every_error_of_every_file() {
    let scratch = Scratch::new();
    scratch.write("good.json", SCENE);
    scratch.write("bad.json", &SCENE.replace("\"radius\": 1", "\"radius\": -1"));
    scratch.write("worse.json", &SCENE.replace("\"fov\": 40", "\"fov\": 400, \"fuv\": 1"));
    let output = scratch.run(&["info", "good.json"]);
    assert_eq!(output.code(), 0, "{}", output.stderr());
    for expected in ["8 x 6 pixels", "1 sphere, 0 planes", "1 point", "memory", "hash"] {
        assert!(output.stdout().contains(expected), "{}", output.stdout());
    }
    let output = scratch.run(&["info", "bad.json", "good.json", "worse.json"]);
    assert_eq!(output.code(), 2);
    assert!(output.stdout().contains("8 x 6 pixels"));
    for expected in ["bad.json:", "radius", "worse.json:", "/camera/fov", "fuv"] {
        assert!(output.stderr().contains(expected), "{}", output.stderr());
    }
    let output = scratch.run(&["info", "--json", "good.json", "bad.json"]);
    let stdout = output.stdout();
    let lines: Vec<serde_json::Value> =
        stdout.lines().map(|line| serde_json::from_str(line).unwrap()).collect();
    assert_eq!(lines[0]["ok"], true);
    assert!(lines[0]["memory"]["peak_bytes"].as_u64().unwrap() > 0);
    assert_eq!(lines[1]["ok"], false);
    assert!(lines[1]["errors"][0]["message"].is_string());
}

#[test]
fn info_refuses_the_texture_numbers_that_a_render_refuses() {
    let scratch = Scratch::new();
    let text = "ply\nformat ascii 1.0\ncomment TextureFile a.png\ncomment TextureFile b.png\n\
                element vertex 3\nproperty float x\nproperty float y\nproperty float z\n\
                property float s\nproperty float t\nelement face 1\n\
                property list uchar int vertex_indices\nproperty int texnumber\nend_header\n\
                0 0 0 0 0\n1 0 0 1 0\n0 1 0 0 1\n3 0 1 2 7\n";
    scratch.write("t.ply", text);
    for command in ["info", "render"] {
        let done = scratch.run(&[command, "t.ply"]);
        assert_eq!(done.code(), 2, "{command}: {}", done.stdout());
        assert!(done.stderr().contains("texnumber 7 is out of range"), "{}", done.stderr());
    }
    let repaired = scratch.run(&["render", "t.ply", "--repair", "--size", "8x8", "--spp", "1"]);
    let expected = "1 face with a texnumber out of range is shown without a texture (--repair)";
    assert!(repaired.good().stderr().contains(expected));
}

#[test]
fn info_leaves_pipes_alone_and_refuses_unless_a_retry_helps() {
    let scratch = Scratch::new();
    let pipe = scratch.pipe("s.json");
    // Open for both, so that neither side waits.
    let mut both = std::fs::File::options().read(true).write(true).open(&pipe).unwrap();
    std::io::Write::write_all(&mut both, b"0123").unwrap();
    let output = scratch.run(&["info", "s.json"]);
    assert_eq!(output.code(), 2);
    assert!(output.stderr().contains("s.json: found a pipe"), "{}", output.stderr());
    let mut held = [0; 4];
    std::io::Read::read_exact(&mut both, &mut held).unwrap();
    assert_eq!(&held, b"0123");
    let output = scratch.run_with_stdin(&["info", "-"], "{}");
    assert!(output.stderr().contains("-: found a pipe"), "{}", output.stderr());
    // The first page of this file is not mapped, so that reading it is an error of the device.
    #[cfg(target_os = "linux")]
    for (files, code) in [(&["/proc/self/mem"][..], 3), (&["/proc/self/mem", "none.json"], 2)] {
        let output = scratch.run(&[&["info"], files].concat());
        assert_eq!(output.code(), code, "{}", output.stderr());
    }
}

#[test]
fn info_describes_a_mesh() {
    let scratch = Scratch::new();
    scratch.write("m.ply", program::PYRAMID);
    let output = scratch.run(&["info", "m.ply", "--json"]);
    assert_eq!(output.code(), 0, "{}", output.stderr());
    let value: serde_json::Value = serde_json::from_str(&output.stdout()).unwrap();
    assert_eq!(value["triangles"], 6);
    assert_eq!(value["polygons_split"], 1);
    assert_eq!(value["bounds"][1][1], 2.0);
    let text = scratch.run(&["info", "m.ply"]).good().stdout();
    assert!(text.contains("  5 faces\n  1 polygon split into triangles\n"), "{text}");
    scratch.write("bad.ply", &program::PYRAMID.replace("3 0 1 4", "3 0 1 9"));
    let accelerator = |backend: &str| {
        let output = scratch.run(&["info", "m.ply", "--json", "--backend", backend]);
        let report: serde_json::Value = serde_json::from_str(&output.stdout()).unwrap();
        report["memory"]["accelerator_bytes"].as_u64().unwrap()
    };
    assert!(accelerator("bvh") > accelerator("brute"));
    let output = scratch.run(&["info", "bad.ply"]);
    assert_eq!(output.code(), 2);
    assert!(output.stderr().contains("bad.ply"), "{}", output.stderr());
}
