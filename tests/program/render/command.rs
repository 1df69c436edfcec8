//! Whole renders through the program: files, flags, statistics and signals.

use std::io::Cursor;

use crate::support::program::{self, Done, Scratch};

const SCENE: &str = r#"{
  "spp": 2,
  "camera": { "type": "pinhole", "width": 20, "height": 12, "fov": 40,
              "position": [0, 0, 4], "lookat": [0, 0, -1], "up": [0, 1, 0] },
  "scene": {
    "backgroundcolor": [0.1, 0.2, 0.3],
    "lightsources": [
      { "type": "pointlight", "position": [2, 3, 4], "id": [3, 3, 3] },
      { "type": "arealight", "v0": [-1, 4, 0], "v1": [1, 4, 0], "v2": [1, 4, 2],
        "id": [2, 2, 2], "samples": 4 }],
    "shapes": [{ "type": "sphere", "center": [0, 0, 0], "radius": 1, "material": {} }]
  }
}"#;

#[track_caller]
fn render(scratch: &Scratch, args: &[&str]) -> Done {
    scratch.run(&[&["render"], args].concat()).good()
}

fn size_of_png(bytes: &[u8]) -> (u32, u32) {
    let reader = png::Decoder::new(Cursor::new(bytes)).read_info().unwrap();
    (reader.info().width, reader.info().height)
}

#[test]
fn files_paths_summary_statistics() {
    let scratch = Scratch::new();
    scratch.write("in/s.json", SCENE);
    let args = ["in/s.json", "--stats", "st.json", "--threads", "2"];
    let done = render(&scratch, &args);
    assert_eq!(done.stdout(), "s.exr\ns.png\nst.json\n");
    assert!(done.stderr().starts_with("0 triangles, "), "{}", done.stderr());
    for expected in ["load ", "build ", "render ", "write ", "Mray/s", "peak memory"] {
        assert!(done.stderr().contains(expected), "{}", done.stderr());
    }
    assert_eq!(scratch.names(), ["in", "s.exr", "s.png", "st.json"]);
    assert_eq!(size_of_png(&scratch.read("s.png")), (20, 12));
    let stats: serde_json::Value = serde_json::from_slice(&scratch.read("st.json")).unwrap();
    let keys: Vec<&str> = stats.as_object().unwrap().keys().map(String::as_str).collect();
    let expected = [
        "seconds",
        "rays",
        "memory",
        "triangles",
        "backend",
        "threads",
        "versions",
        "cpu",
        "isa",
        "scene_hash",
        "seed",
    ];
    assert_eq!(keys, expected);
    assert_eq!(stats["rays"]["primary"], 20 * 12 * 2);
    assert_eq!(stats["threads"], 2);
    assert!(stats["memory"]["peak_bytes"].as_u64().unwrap() > 1 << 20);
    assert!(stats["seconds"]["total"].as_f64().unwrap() > 0.0);

    let done = render(&scratch, &["in/s.json", "--json", "--quiet", "-o", "in/"]);
    assert_eq!(done.stderr(), "");
    let value: serde_json::Value = serde_json::from_str(&done.stdout()).unwrap();
    assert_eq!(value["outputs"], serde_json::json!(["in/s.exr", "in/s.png"]));
    assert_eq!(value["rays"], stats["rays"]);
}

/// Decodes a PNG of 8 bits with three channels.
fn bytes_of_png(bytes: &[u8]) -> (Option<f32>, bool, Vec<u8>) {
    let mut reader = png::Decoder::new(Cursor::new(bytes)).read_info().unwrap();
    let mut pixels = vec![0; reader.output_buffer_size().unwrap()];
    let frame = reader.next_frame(&mut pixels).unwrap();
    assert_eq!((frame.bit_depth, frame.color_type), (png::BitDepth::Eight, png::ColorType::Rgb));
    let gamma = reader.info().gama_chunk.map(png::ScaledFloat::into_value);
    (gamma, reader.info().srgb.is_some(), pixels)
}

#[test]
fn a_linear_png_has_the_values_of_the_exr_and_says_so() {
    let scratch = Scratch::new();
    let curve = r#"{ "operator": "clamp", "exposure": -1, "transfer": "linear" }, "spp": 2"#;
    scratch.write("s.json", &SCENE.replacen("\"spp\": 2", &format!("\"tonemap\": {curve}"), 1));
    render(&scratch, &["s.json", "--float"]);
    for (tile, name) in [("1/2", "a"), ("2/2", "b")] {
        render(&scratch, &["s.json", "--float", "--tile", tile, "-o", name]);
    }
    scratch.run(&["merge", "a.exr", "b.exr", "-o", "merged"]).good();
    let exr = scratch.rgba("s.exr").concat();
    let values =
        exr.iter().flat_map(|p| &p[..3]).map(|v| (255.0 * (v / 2.0).clamp(0.0, 1.0)).round() as u8);
    let expected: Vec<u8> = values.collect();
    assert!(expected.iter().any(|&v| v > 100) && expected.iter().any(|&v| v < 20));
    for name in ["s.png", "merged.png"] {
        assert_eq!(
            bytes_of_png(&scratch.read(name)),
            (Some(1.0), false, expected.clone()),
            "{name}"
        );
    }
    render(&scratch, &["s.json", "--set", "/tonemap/transfer=srgb"]);
    let (_, srgb, encoded) = bytes_of_png(&scratch.read("s.png"));
    assert!(srgb && encoded != expected);
}

#[test]
fn a_texture_of_another_size_than_the_scene_says_is_told() {
    let scratch = Scratch::new();
    scratch.write("a.ppm", &format!("P3 4 3 255 {}", "90 ".repeat(36)));
    let render = |written: &str| {
        let material = format!(r#""material": {{ "tPath": "a.ppm", {written} }}"#);
        scratch.write("s.json", &SCENE.replace(r#""material": {}"#, &material));
        render(&scratch, &["s.json"]).stderr()
    };
    let told = render(r#""tWidth": 5, "tHeight": 7"#);
    assert!(told.contains("`tWidth` is 5, but a.ppm has 4; 4 is used"), "{told}");
    assert!(told.contains("`tHeight` is 7, but a.ppm has 3; 3 is used"), "{told}");
    let told = render(r#""tWidth": 4, "tHeight": 3"#);
    assert!(!told.contains("is used"), "{told}");
}

#[test]
fn a_texture_that_is_a_pipe_is_refused_at_once() {
    let scratch = Scratch::new();
    scratch.pipe("a.png");
    let textured = SCENE.replace(r#""material": {}"#, r#""material": { "tPath": "a.png" }"#);
    scratch.write("s.json", &textured);
    let done = scratch.run(&["render", "s.json"]);
    assert_eq!(done.code(), 2, "{}", done.stderr());
    assert!(done.stderr().contains("a.png"), "{}", done.stderr());
    assert!(done.stderr().contains("not a regular file"), "{}", done.stderr());
}

#[test]
fn a_picture_that_is_closed_to_others_stays_so() {
    use std::os::unix::fs::PermissionsExt;
    let scratch = Scratch::new();
    scratch.write("s.json", SCENE);
    render(&scratch, &["s.json"]);
    let (exr, png) = (scratch.path("s.exr"), scratch.path("s.png"));
    std::fs::set_permissions(&exr, PermissionsExt::from_mode(0o600)).unwrap();
    let mode = |path| std::fs::metadata(path).unwrap().permissions().mode() & 0o777;
    let other = mode(&png);
    let before = scratch.read("s.exr");
    render(&scratch, &["s.json", "--seed", "5"]);
    assert_eq!((mode(&exr), mode(&png)), (0o600, other));
    assert_ne!(scratch.read("s.exr"), before);
}

#[test]
fn same_bytes_for_any_threads_and_from_stdin() {
    let scratch = Scratch::new();
    scratch.write("s.json", SCENE);
    let one = render(&scratch, &["s.json", "-o", "a", "--threads", "1"]).stderr();
    assert!(one.contains(", 1 thread\n"), "{one}");
    render(&scratch, &["s.json", "-o", "b.png", "--threads", "5"]);
    let done = scratch.run_with_stdin(&["render", "-", "-o", "c"], SCENE);
    assert_eq!(done.code(), 0, "{}", done.stderr());
    for name in ["b", "c"] {
        for end in ["exr", "png"] {
            let [first, second] = ["a", name].map(|n| scratch.read(&format!("{n}.{end}")));
            assert!(first == second, "{name}.{end}");
        }
    }
}

#[test]
fn a_file_named_by_a_minus_is_refused() {
    let scratch = Scratch::new();
    scratch.write("s.json", SCENE);
    let done = scratch.run(&["render", "s.json", "-o", "a", "--stats", "-"]);
    assert_eq!((done.code(), scratch.names()), (2, vec!["s.json".to_string()]));
    let said = "--stats: found `-`, expected the name of a file\n  help: /dev/stdout is";
    assert!(done.stderr().contains(said), "{}", done.stderr());
}

#[test]
fn flags_are_overrides() {
    let scratch = Scratch::new();
    scratch.write("s.json", SCENE);
    let flags = [
        "s.json",
        "-o",
        "a",
        "--size",
        "10x8",
        "--spp",
        "1",
        "--nbounces",
        "0",
        "--seed",
        "-3",
        "--fov",
        "50",
        "--exposure",
        "-1",
        "--tonemap",
        "reinhard",
        "--transparent",
        "--light-samples",
        "2",
        "--write-scene",
        "saved.json",
    ];
    render(&scratch, &flags);
    let sets = [
        "s.json",
        "-o",
        "b",
        "--set",
        "/camera/width=10",
        "--set",
        "/camera/height=8",
        "--set",
        "/spp=1",
        "--set",
        "/nbounces=0",
        "--set",
        "/seed=-3",
        "--set",
        "/camera/fov=50",
        "--set",
        "/tonemap/exposure=-1",
        "--set",
        "/tonemap/operator=reinhard",
        "--set",
        "/output/transparent=true",
        "--set",
        "/scene/lightsources/1/samples=2",
    ];
    render(&scratch, &sets);
    render(&scratch, &["saved.json", "-o", "c"]);
    for name in ["b", "c"] {
        for end in ["exr", "png"] {
            let [first, second] = ["a", name].map(|n| scratch.read(&format!("{n}.{end}")));
            assert!(first == second, "{name}.{end}");
        }
    }
    assert_eq!(size_of_png(&scratch.read("a.png")), (10, 8));
}

#[test]
fn slurm_grants_the_number_of_threads() {
    let scratch = Scratch::new();
    scratch.write("s.json", SCENE);
    let threads = |granted: &str, more: &[&str]| {
        let args = ["render", "s.json", "--size", "4x4", "--json", "--quiet"];
        let mut command = scratch.command(&[&args[..], more].concat());
        let done = Done::of(command.env("SLURM_CPUS_PER_TASK", granted)).good();
        let stats: serde_json::Value = serde_json::from_str(&done.stdout()).unwrap();
        stats["threads"].as_u64().unwrap()
    };
    let processors = std::thread::available_parallelism().map_or(1, |n| n.get() as u64);
    assert_eq!(threads(&(processors + 1).to_string(), &[]), processors + 1);
    assert_eq!(threads(&(processors + 1).to_string(), &["--threads", "1"]), 1);
    assert_eq!(threads("many", &[]), processors);
}

#[test]
fn a_crop_has_its_size() {
    let scratch = Scratch::new();
    scratch.write("s.json", SCENE);
    let args = ["s.json", "--crop", "3", "2", "9", "12"];
    render(&scratch, &args);
    assert_eq!(size_of_png(&scratch.read("s.png")), (6, 10));
    let info = scratch.run(&["info", "s.exr"]).stdout();
    assert!(info.contains("frame 20 x 12, data 6 x 10 at 3, 2"), "{info}");
    assert!(info.contains("lightpath:sceneHash"), "{info}");
}

#[test]
fn a_mesh_alone_is_framed_and_its_scene_can_be_saved() {
    let scratch = Scratch::new();
    scratch.write("meshes/p.ply", program::PYRAMID);
    let args = [
        "meshes/p.ply",
        "--size",
        "60x40",
        "--spp",
        "1",
        "--up",
        "z",
        "--write-scene",
        "saved/p.json",
    ];
    std::fs::create_dir(scratch.path("saved")).unwrap();
    let done = render(&scratch, &args);
    assert_eq!(done.stdout(), "p.exr\np.png\nsaved/p.json\n");
    let saved: serde_json::Value = serde_json::from_slice(&scratch.read("saved/p.json")).unwrap();
    assert_eq!(saved["scene"]["shapes"][0]["path"], "../meshes/p.ply");
    assert_eq!(saved["scene"]["shapes"][0]["rotate"], serde_json::json!([-90, 0, 0]));
    render(&scratch, &["saved/p.json", "-o", "again"]);
    assert!(scratch.read("p.png") == scratch.read("again.png"));
    // A saved scene can serve as a template.
    let template = ["meshes/p.ply", "--template", "saved/p.json", "-o", "third"];
    render(&scratch, &template);
    assert!(scratch.read("p.png") == scratch.read("third.png"));
}

#[test]
fn inputs_and_outputs_are_never_overwritten() {
    let scratch = Scratch::new();
    scratch.write("s.json", SCENE);
    for args in [
        ["s.json", "-o", "a", "--stats", "s.json"],
        ["s.json", "-o", "a", "--stats", "./s.json"],
        ["s.json", "-o", "a", "--stats", "a.png"],
        ["s.json", "--write-scene", "b.json", "--stats", "b.json"],
    ] {
        let done = scratch.run(&[&["render"], &args[..]].concat());
        assert_eq!(done.code(), 2, "{args:?}: {}", done.stderr());
        assert!(done.stderr().contains("would overwrite an input"), "{}", done.stderr());
        assert_eq!(scratch.names(), ["s.json"], "{args:?}");
    }
    assert_eq!(scratch.read("s.json"), SCENE.as_bytes());
}

#[test]
fn every_bad_file_of_a_scene_is_reported() {
    let scratch = Scratch::new();
    // The headers are valid. The errors show only when the files are read completely.
    let bad = "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\n\
        property float z\nelement face 1\nproperty list uchar int vertex_indices\nend_header\n\
        0 0 0\n1 0 0\n0 nan 0\n3 0 1 2\n";
    scratch.write("one.ply", bad);
    scratch.write("two.ply", bad);
    scratch.write("a.png", "not a picture");
    let shape =
        |file: &str| format!(r#"{{ "type": "trimesh", "path": "{file}", "material": {{}} }}"#);
    let ball = r#"{ "type": "sphere", "center": [0, 0, 0], "radius": 1, "material": { "tPath": "a.png" } }"#;
    let shapes = format!("[{}, {}, {ball}]", shape("one.ply"), shape("two.ply"));
    let start = SCENE.split("\"shapes\"").next().unwrap();
    scratch.write("s.json", &format!("{start}\"shapes\": {shapes} }} }}"));
    for command in ["info", "render"] {
        let done = scratch.run(&[command, "s.json"]);
        assert_eq!(done.code(), 2, "{}", done.stderr());
        for file in ["one.ply", "two.ply", "a.png"] {
            assert!(done.stderr().contains(file), "{command}: {}", done.stderr());
        }
    }
}

#[test]
fn a_negative_seed_is_reported_as_it_was_given() {
    let scratch = Scratch::new();
    scratch.write("s.json", SCENE);
    let done = render(&scratch, &["s.json", "--seed", "-1", "--json", "--quiet"]);
    let value: serde_json::Value = serde_json::from_str(&done.stdout()).unwrap();
    assert_eq!(value["seed"], -1);
    let info = scratch.run(&["info", "s.exr"]).stdout();
    assert!(info.contains("lightpath:seed: -1\n"), "{info}");
}

#[test]
fn every_instruction_set_gives_the_same_picture() {
    let scratch = Scratch::new();
    scratch.write("s.json", SCENE);
    for isa in lightpath::simd::Isa::available() {
        let name = isa.to_string().to_lowercase().replace('-', "");
        let args = ["s.json", "--isa", &name, "--json", "--quiet", "-o", &name];
        let done = render(&scratch, &args);
        let value: serde_json::Value = serde_json::from_str(&done.stdout()).unwrap();
        let said = value["isa"].as_str().unwrap();
        assert!(said.ends_with(&format!("{isa} shading")), "{said}");
        assert!(scratch.read("portable.png") == scratch.read(&format!("{name}.png")), "{isa}");
        // The header names the instruction set.
        let pixels = |name: &str| scratch.channels(&format!("{name}.exr"));
        assert!(pixels("portable") == pixels(&name), "{isa}");
    }
}

#[test]
fn a_mesh_is_recognized_by_its_content() {
    let scratch = Scratch::new();
    scratch.write("tri.dat", program::PYRAMID);
    let small = ["--size", "30x20", "--spp", "1"];
    let done = render(&scratch, &[&["tri.dat", "--write-scene", "s.json"], &small[..]].concat());
    assert_eq!(done.stdout(), "tri.exr\ntri.png\ns.json\n");
    render(&scratch, &["s.json", "-o", "again"]);
    assert!(scratch.read("tri.exr") == scratch.read("again.exr"));
}

#[test]
fn messages_name_the_mesh_as_it_was_typed() {
    let scratch = Scratch::new();
    // A face with a corner too few is read with a warning that names the file.
    scratch.write("data/real.ply", &program::PYRAMID.replace("3 3 0 4", "2 3 0"));
    std::os::unix::fs::symlink("real.ply", scratch.path("data/link.ply")).unwrap();
    scratch.write("t/template.json", include_str!("../../../assets/studio.json"));
    let small = ["--size", "30x20", "--spp", "1", "-o", "x"];
    for (typed, template) in [("data/link.ply", None), ("./data/link.ply", Some("t/template.json"))]
    {
        let template: Vec<&str> = template.map_or(vec![], |t| vec!["--template", t]);
        let done = render(&scratch, &[&[typed], &small[..], &template].concat());
        let expected = format!("warning: {typed}: 1 face with fewer than three corners was");
        assert!(done.stderr().contains(&expected), "{}", done.stderr());
    }
}

#[test]
fn names_that_are_not_utf8() {
    use std::{ffi::OsStr, os::unix::ffi::OsStrExt};
    let scratch = Scratch::new();
    let [scene, mesh] = [&b"s\xff.json"[..], b"m\xff.ply"].map(OsStr::from_bytes);
    std::fs::write(scratch.path("").join(scene), SCENE).unwrap();
    std::fs::write(scratch.path("").join(mesh), program::PYRAMID).unwrap();
    let done = Done::of(scratch.command(&["render"]).arg(mesh));
    assert_eq!(done.code(), 2, "{}", done.stderr());
    assert!(done.stderr().contains("a name that is not UTF-8"), "{}", done.stderr());
    for name in [scene, mesh] {
        let done = Done::of(scratch.command(&["info"]).arg(name));
        assert_eq!(done.code(), 0, "{}", done.stderr());
    }
    let output = scratch.command(&["render", "--quiet"]).arg(scene).output().unwrap();
    let stderr = String::from_utf8_lossy(&output.stderr);
    assert_eq!(output.status.code(), Some(0), "{stderr}");
    assert_eq!(output.stdout, b"s\xff.exr\ns\xff.png\n");
    assert!(scratch.path("").join(OsStr::from_bytes(b"s\xff.exr")).is_file());
}

#[test]
fn a_mesh_from_stdin_is_refused_with_a_way_out() {
    let done = Scratch::new().run_with_stdin(&["render", "-"], program::PYRAMID);
    assert_eq!(done.code(), 2);
    assert!(done.stderr().contains("name the pipe FILE.ply"), "{}", done.stderr());
}

/// Behind `/dev/stdin` is a pipe, as behind the shell's `<(...)`.
#[cfg(unix)]
#[test]
fn a_scene_from_a_pipe_is_read_once() {
    let scratch = Scratch::new();
    scratch.write("s.json", SCENE);
    let flags = ["--light-samples", "9", "--quiet", "-o"];
    let piped = [&["render", "/dev/stdin"], &flags[..], &["piped"]].concat();
    scratch.run_with_stdin(&piped, SCENE).good();
    render(&scratch, &[&["s.json"], &flags[..], &["file"]].concat());
    assert!(scratch.read("piped.exr") == scratch.read("file.exr"));
}

#[test]
fn numbers_of_samples_without_effect_are_told() {
    let scratch = Scratch::new();
    scratch.write("s.json", SCENE);
    scratch.write("p.ply", program::PYRAMID);
    let said = |input: &str, draws: &str, more: &[&str]| {
        let small = ["--size", "20x12", "--spp", "1", "-o", "x", "--light-samples", "3"];
        render(&scratch, &[&[input, "--emitter-samples", draws], &small[..], more].concat())
            .stderr()
    };
    let drawn = "warning: --light-samples: has no effect: `emittersamples` draws lights";
    let all = "warning: --emitter-samples: found no fewer than the 2 point and area lights";
    for (input, draws, more, expected) in [
        ("s.json", "1", &[][..], Some(drawn)),
        ("s.json", "2", &[], Some(all)),
        ("p.ply", "1", &[], Some(drawn)),
        // Shadow catchers use the samples of lights that are drawn elsewhere.
        ("p.ply", "1", &["--transparent"], None),
    ] {
        let said = said(input, draws, more);
        let warnings: Vec<&str> = said.lines().filter(|line| line.contains("-samples: ")).collect();
        assert_eq!(warnings.len(), usize::from(expected.is_some()), "{input} {draws}: {said}");
        assert!(said.contains(expected.unwrap_or("")), "{input} {draws}: {said}");
    }
}

#[cfg(unix)]
#[test]
fn a_text_file_is_written_behind_a_link_to_nothing() {
    let scratch = Scratch::new();
    scratch.write("s.json", SCENE);
    std::os::unix::fs::symlink("later.json", scratch.path("link.json")).unwrap();
    let args = ["render", "s.json", "-o", "x", "--stats", "link.json", "--write-scene"];
    let refused = scratch.run(&[&args[..], &["later.json"]].concat());
    assert_eq!(refused.code(), 2, "{}", refused.stderr());
    assert!(refused.stderr().contains("would overwrite"), "{}", refused.stderr());
    let done = scratch.run(&[&args[..], &["saved.json"]].concat()).good();
    assert!(done.stdout().contains("link.json\n"), "{}", done.stdout());
    assert!(scratch.path("link.json").is_symlink());
    assert!(scratch.read("later.json").starts_with(b"{"));
}
