//! Memory of a batch: films, large frames in the contact sheet, and inputs that exceed a limit.

use std::fs;
use std::process::Command;

use serde_json::{Value, json};

use crate::support::program::{Done, PYRAMID, Scratch};

fn records(scratch: &Scratch, event: &str) -> Vec<Value> {
    let text = String::from_utf8(scratch.read("out/batch.jsonl")).unwrap();
    let all = text.lines().map(|line| serde_json::from_str::<Value>(line).unwrap());
    all.filter(|record| record["event"] == event).collect()
}

/// Writes `scene.json`: a pyramid in many places, as small pictures.
pub fn write_instances(scratch: &Scratch, count: u32) {
    scratch.write("a.ply", PYRAMID);
    let place = |i: u32| {
        let x = f64::from(i) * 3.0;
        json!([[1, 0, 0, x], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]])
    };
    let places: Vec<Value> = (0..count).map(place).collect();
    let mesh = json!({ "type": "trimesh", "path": "a.ply", "material": {}, "instances": places });
    let camera = json!({ "type": "pinhole", "width": 24, "height": 16, "fov": 40,
        "position": [0, 1, 9], "target": [0, 1, 0], "up": [0, 1, 0] });
    let scene = json!({ "spp": 1, "camera": camera, "scene": { "shapes": [mesh] } });
    scratch.write("scene.json", &scene.to_string());
}

/// A film of 1024 x 768 pixels takes 16 MB. Eight at a time do not fit, three do.
#[test]
fn a_limit_of_memory_covers_all_films() {
    let scratch = Scratch::new();
    scratch.write("a.ply", PYRAMID);
    let args = ["batch", "a.ply", "-o", "out", "--turntable", "9", "--size", "1024x768"];
    let more = ["--spp", "1", "--light-samples", "1", "--threads", "2", "--jobs", "7"];
    let limited = ["--max-memory", "90M", "--no-sheet", "--quiet"];
    scratch.run(&[&args[..], &more, &limited].concat()).good();
    let frames = records(&scratch, "frame");
    assert_eq!(frames.len(), 9);
    let peak = frames.iter().map(|frame| frame["peak_bytes"].as_u64().unwrap()).max().unwrap();
    assert!(peak < 90 << 20, "{peak}");
}

/// Writes the scene of a ball, `s.json`, and a list of cameras of these sizes, `list.json`.
fn write_ball(scratch: &Scratch, sizes: &[[u32; 2]]) {
    let camera = |[width, height]: [u32; 2]| {
        json!({ "type": "orthographic", "width": width, "height": height, "viewwidth": 4,
                "position": [0, 0, 5], "lookat": [0, 0, -1], "up": [0, 1, 0] })
    };
    let ball = json!({ "type": "sphere", "center": [0, 0, 0], "radius": 1, "material": {} });
    let scene = json!({ "spp": 1, "camera": camera([8, 8]), "scene": { "shapes": [ball] } });
    scratch.write("s.json", &scene.to_string());
    let sizes = sizes.iter().enumerate();
    let views = sizes.map(|(i, size)| json!({ "image": i.to_string(), "camera": camera(*size) }));
    let list = json!({ "cameras": views.collect::<Vec<_>>() });
    scratch.write("list.json", &list.to_string());
}

/// Films of 1600 x 1200 and 1200 x 1600 pixels take 31 MB each. Two do not fit.
#[test]
fn a_film_of_another_size_takes_the_place_of_the_last() {
    let scratch = Scratch::new();
    write_ball(&scratch, &[[1600, 1200], [1200, 1600], [1600, 1200], [1200, 1600]]);
    let args = ["batch", "s.json", "-o", "out", "--cameras", "list.json", "--threads", "2"];
    let limited = ["--max-memory", "72M", "--no-sheet", "--quiet"];
    scratch.run(&[&args[..], &limited].concat()).good();
    let frames = records(&scratch, "frame");
    assert_eq!(frames.len(), 4);
    let peak = frames.iter().map(|frame| frame["peak_bytes"].as_u64().unwrap()).max().unwrap();
    assert!(peak < 72 << 20, "{peak}");
}

/// Overscan of 100 pixels is more than half of the pixels of a long picture.
#[test]
fn the_largest_film_is_that_of_the_most_pixels_with_overscan() {
    let scratch = Scratch::new();
    for sizes in [&[[20_000, 4]][..], &[[283, 283], [20_000, 4]]] {
        write_ball(&scratch, sizes);
        let args = ["batch", "s.json", "--cameras", "list.json", "--overscan", "100"];
        let done = scratch.run(&[&args[..], &["--max-memory", "64M", "--no-sheet"]].concat());
        assert_eq!(done.code(), 1, "{sizes:?}: {}", done.stderr());
        assert!(done.stderr().contains("--max-memory: found 64.0 MiB"), "{}", done.stderr());
    }
}

/// The scenes of all frames together would take 24 MB.
#[test]
fn the_scene_of_a_frame_is_held_while_the_frame_is_rendered() {
    let scratch = Scratch::new();
    write_instances(&scratch, 1500);
    let peak = |frames: &str| {
        let args = ["batch", "scene.json", "-o", "out", "--turntable", frames, "--threads", "1"];
        let more = ["--jobs", "1", "--backend", "bvh", "--no-sheet", "--quiet"];
        scratch.run(&[&args[..], &more].concat()).good();
        let frames = records(&scratch, "frame");
        fs::remove_dir_all(scratch.path("out")).unwrap();
        frames.iter().map(|frame| frame["peak_bytes"].as_u64().unwrap()).max().unwrap()
    };
    let (few, many) = (peak("4"), peak("40"));
    assert!(many < few + (10 << 20), "{few} {many}");
}

/// A frame of 9000 x 9000 pixels, which takes 240 MB when it is decoded.
#[cfg(unix)]
#[test]
fn a_sheet_of_large_frames_takes_little_memory() {
    let scratch = Scratch::new();
    scratch.write("a.ply", PYRAMID);
    let args = ["batch", "a.ply", "-o", "out", "--size", "24x16", "--threads", "1"];
    scratch.run(&args).good();
    image::RgbImage::new(9000, 9000).save(scratch.path("out/a.png")).unwrap();
    let mut command = Command::new("sh");
    let limited = "ulimit -v 200000; exec \"$0\" \"$@\" --sheet-only";
    command.args(["-c", limited, env!("CARGO_BIN_EXE_lightpath")]).args(args);
    command.current_dir(scratch.path("")).env_remove("SLURM_CPUS_PER_TASK");
    // The picture is not that of the batch.
    let done = Done::of(&mut command);
    assert!(done.code() == 1 && done.stderr().contains("has no fingerprint"), "{}", done.stderr());
    let html = String::from_utf8(scratch.read("out/index.html")).unwrap();
    assert_eq!(html.matches("src=\"data:image/jpeg").count(), 1);
}

/// A packed mesh whose header is not believed, so that no memory is predicted for it. It is read
/// within the limit, but leaves no memory for the film. One of its frames was kept before.
#[test]
fn a_kept_frame_of_a_failed_input_counts_once() {
    let scratch = Scratch::new();
    let unused = 1_500_000;
    let mut mesh = format!(
        "ply\nformat binary_little_endian 1.0\nelement vertex {}\nproperty float x\n\
         property float y\nproperty float z\nelement face 1\n\
         property list uchar uint vertex_indices\nend_header\n",
        unused + 3
    )
    .into_bytes();
    for coordinate in [1.0f32, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0] {
        mesh.extend(coordinate.to_le_bytes());
    }
    mesh.resize(mesh.len() + 12 * unused, 0);
    mesh.push(3);
    mesh.extend([0u32, 1, 2].into_iter().flat_map(u32::to_le_bytes));
    let packed = zstd::encode_all(&mesh[..], 19).unwrap();
    assert!(unused > 1032 * packed.len(), "{}", packed.len());
    fs::write(scratch.path("a.ply.zst"), packed).unwrap();
    let args = ["batch", "a.ply.zst", "-o", "out", "--turntable", "4", "--size", "800x600"];
    let more = ["--spp", "1", "--light-samples", "1", "--threads", "2", "--no-sheet"];
    let args = [&args[..], &more].concat();
    scratch.run(&args).good();
    fs::remove_file(scratch.path("out/a/a.0003.png")).unwrap();
    let limited = ["--resume", "--max-memory", "60M", "--progress", "openjd"];
    let done = scratch.run(&[&args[..], &limited].concat());
    assert_eq!(done.code(), 1, "{}", done.stderr());
    assert!(done.stderr().contains("--max-memory"), "{}", done.stderr());
    assert!(done.stderr().contains("0 frames rendered, 3 kept, 1 failure,"), "{}", done.stderr());
    assert!(done.stdout().contains("openjd_status: frames 4 of 4, 1 failed"), "{}", done.stdout());
}
