//! No output overwrites an input, and a picture comes from the very files that its fingerprint
//! covers.

use std::{fs, os::unix::fs::symlink, path::Path, process::Stdio, time::Duration};

use crate::support::program::{self, Done, PYRAMID, SMALL, Scratch};
use lightpath::{merge::Parts, monitor::Monitor};

/// A pyramid with texture coordinates that names its own image.
fn textured(image: &str) -> String {
    let uv = "property float z\nproperty float s\nproperty float t";
    let mesh = PYRAMID
        .replace("format ascii 1.0", &format!("format ascii 1.0\ncomment TextureFile {image}"));
    let mut mesh = mesh.replace("property float z", uv);
    for vertex in ["-1 0 -1", "1 0 -1", "1 0 1", "-1 0 1", "0 2 0"] {
        mesh = mesh.replace(&format!("\n{vertex}\n"), &format!("\n{vertex} 0 1\n"));
    }
    mesh
}

fn image(scratch: &Scratch, name: &str) -> Vec<u8> {
    let path = scratch.path(name);
    fs::create_dir_all(path.parent().unwrap()).unwrap();
    image::RgbImage::from_pixel(3, 2, image::Rgb([9, 120, 200])).save(path).unwrap();
    scratch.read(name)
}

const SCENE: &str = r#"{
  "camera": { "type": "pinhole", "width": 24, "height": 16, "fov": 40,
              "position": [0, 1, 9], "lookat": [0, 0, -1], "up": [0, 1, 0] },
  "scene": {
    "lightsources": [{ "type": "pointlight", "position": [2, 3, 4], "id": [3, 3, 3] }],
    "shapes": [{ "type": "trimesh", "path": "MESH", "material": {} }]
  }
}"#;

#[track_caller]
fn refused(done: &Done) {
    assert_eq!(done.code(), 2, "{}", done.stderr());
    let said = done.stderr();
    let refused = said.contains("would overwrite") || said.contains("would be the texture");
    assert!(refused && !said.contains("panicked"), "{said}");
}

fn render(scratch: &Scratch, args: &[&str]) -> Done {
    scratch.run(&[&["render"], args, &SMALL].concat())
}

fn batch(scratch: &Scratch, args: &[&str]) -> Done {
    scratch.run(&[&["batch"], args, &SMALL].concat())
}

#[test]
fn render_never_overwrites_a_texture_that_a_mesh_names() {
    let scratch = Scratch::new();
    let texture = image(&scratch, "s.png");
    scratch.write("m.ply", &textured("s.png"));
    scratch.write("s.json", &SCENE.replace("MESH", "m.ply"));
    refused(&render(&scratch, &["s.json"]));
    refused(&render(&scratch, &["m.ply", "-o", "s"]));
    refused(&render(&scratch, &["m.ply", "-o", "t", "--stats", "s.png"]));
    // Symbolic and hard links, in both directions.
    symlink("s.png", scratch.path("soft.png")).unwrap();
    fs::hard_link(scratch.path("s.png"), scratch.path("hard.png")).unwrap();
    refused(&render(&scratch, &["m.ply", "-o", "soft"]));
    refused(&render(&scratch, &["m.ply", "-o", "hard"]));
    scratch.write("l.ply", &textured("soft.png"));
    refused(&render(&scratch, &["l.ply", "-o", "s"]));
    // A texture that does not exist yet would be an output of this very run.
    scratch.write("n.ply", &textured("new.png"));
    let done = render(&scratch, &["n.ply", "-o", "new"]);
    let said = done.stderr();
    assert!(
        done.code() == 2 && said.contains("new.png: would be the texture that n.ply"),
        "{said}"
    );
    assert!(scratch.read("s.png") == texture && scratch.read("hard.png") == texture);
    assert!(!scratch.names().iter().any(|name| name.ends_with(".exr") || name.ends_with(".part")));
    let done = render(&scratch, &["s.json", "-o", "free"]);
    assert_eq!(done.code(), 0, "{}", done.stderr());
}

/// A missing image refuses an output only under its own name, and only if the mesh can show it. No
/// render becomes the texture of the next.
#[test]
fn an_image_that_exists_nowhere_stops_no_other_output() {
    let scratch = Scratch::new();
    let without_uvs = PYRAMID.replace("ascii 1.0", "ascii 1.0\ncomment TextureFile plain.png");
    let meshes = [
        ("scan", textured("textures/scan.png"), &[][..]),
        ("w", textured(r"C:\foo\w.png"), &[]),
        ("null", textured("/dev/null"), &[]),
        ("plain", without_uvs, &[]),
        ("hidden", textured("textures/hidden.png"), &["--color", "none"]),
    ];
    for (name, mesh, flags) in meshes {
        let (ply, png) = (format!("{name}.ply"), format!("{name}.png"));
        scratch.write(&ply, &mesh);
        let args = [&[ply.as_str()], flags].concat();
        let first = (render(&scratch, &args).good().stderr(), scratch.read(&png));
        let next = (render(&scratch, &args).good().stderr(), scratch.read(&png));
        assert_eq!(first.0.contains("is not used"), name != "hidden", "{}", first.0);
        assert!(first.1 == next.1, "{name}: {}", next.0);
        assert_eq!(next.0.contains("is not used"), name != "hidden", "{}", next.0);
    }
    fs::remove_file(scratch.path("hidden.ply")).unwrap();
    for more in [&[][..], &["--resume"]] {
        let done = batch(&scratch, &[&[".", "-o", "."], more].concat()).good();
        let rendered = if more.is_empty() { "4 frames rendered" } else { "4 kept" };
        assert!(done.stderr().contains(rendered), "{}", done.stderr());
    }
    // An image that no render can have made stays the texture.
    scratch.write("p.ply", &textured("textures/p.ppm"));
    image(&scratch, "p.ppm");
    for _ in 0..2 {
        let said = render(&scratch, &["p.ply"]).good().stderr();
        assert!(said.contains("there is no texture \"textures/p.ppm\"; p.ppm is used"), "{said}");
    }
    scratch.write("t.ply", &textured("t.png"));
    // Without the flag, the next render would show it.
    let hidden = render(&scratch, &["t.ply", "--color", "none"]);
    for done in [batch(&scratch, &[".", "-o", "."]), hidden] {
        let said = done.stderr();
        let named = said.contains("t.png: would be the texture") && said.contains("t.ply names");
        assert!(done.code() == 2 && named, "{said}");
    }
}

/// Scanners write images beside a mesh without naming them in it.
#[test]
fn render_never_overwrites_images_beside_a_scan() {
    for (name, more) in [
        ("m.png", &[][..]),
        ("m.albedo.png", &["--png-layer", "albedo"]),
        ("m.instance.png", &["--png-ids"]),
        ("m.semantic.png", &["--png-ids"]),
    ] {
        let scratch = Scratch::new();
        let texture = image(&scratch, name);
        scratch.write("m.ply", PYRAMID);
        let args = [&["m.ply", "--aov", "albedo,objectid"], more].concat();
        let done = render(&scratch, &args);
        assert_eq!(done.code(), 2, "{}", done.stderr());
        let said = done.stderr();
        assert!(said.contains(name) && said.contains("its .exr is missing"), "{said}");
        assert!(scratch.read(name) == texture);
        // An earlier render may be replaced.
        fs::remove_file(scratch.path(name)).unwrap();
        for _ in 0..2 {
            assert_eq!(render(&scratch, &args).code(), 0);
        }
    }
}

/// Only the pictures have names that nobody has given.
#[test]
fn a_render_beside_a_mesh_replaces_the_files_that_flags_name() {
    let scratch = Scratch::new();
    scratch.write("m.ply", PYRAMID);
    scratch.write("st.png", "of another program");
    let args = ["m.ply", "--write-scene", "st.png"];
    assert!(render(&scratch, &args).good().stdout().contains("st.png"));
    assert!(scratch.read("st.png").starts_with(b"{"));
}

#[test]
fn render_never_overwrites_the_texture_of_a_mesh_from_a_pipe() {
    let scratch = Scratch::new();
    let texture = image(&scratch, "s.png");
    scratch.write("m.ply", &textured("s.png"));
    scratch.write("s.json", &SCENE.replace("MESH", "pipe.ply"));
    let pipe = scratch.pipe("pipe.ply");
    let mesh = scratch.read("m.ply");
    for input in ["s.json", "pipe.ply"] {
        let (pipe, mesh) = (pipe.clone(), mesh.clone());
        let writer = std::thread::spawn(move || fs::write(pipe, mesh).unwrap());
        refused(&render(&scratch, &[input, "-o", "s"]));
        writer.join().unwrap();
    }
    assert!(scratch.read("s.png") == texture);
}

#[test]
fn batch_never_overwrites_textures_of_its_inputs() {
    let scratch = Scratch::new();
    scratch.write("scans/a.ply", PYRAMID);
    let texture = image(&scratch, "out/a.png");
    let names = |text: &str| scratch.write("scans/b.ply", &textured(text));
    names("../out/a.png");
    let untouched = || assert!(scratch.read("out/a.png") == texture);
    refused(&batch(&scratch, &["scans", "-o", "out"]));
    refused(&batch(&scratch, &["scans", "-o", "out", "--resume", "--range", "0..1"]));
    untouched();
    // The output folder through a link.
    symlink("out", scratch.path("way")).unwrap();
    refused(&batch(&scratch, &["scans", "-o", "way"]));
    untouched();
    // A texture of another scene's material.
    names("none.png");
    let scene = SCENE.replace("MESH", "scans/a.ply");
    let scene = scene.replace("\"material\": {}", r#""material": { "tPath": "out/a.png" }"#);
    scratch.write("c.json", &scene);
    refused(&batch(&scratch, &["scans", "c.json", "-o", "out"]));
    untouched();
    // The texture for the job's meshes is an output of a scene that is rendered before them.
    let no_texture = scene.replace("out/a.png", "scans/none.png");
    scratch.write("a.json", &no_texture);
    let both = ["a.json", "scans/b.ply", "-o", "out", "--texture", "out/a.png"];
    refused(&batch(&scratch, &both));
    untouched();
    let job = r#"{ "inputs": ["a.json", "scans/b.ply"], "texture": "out/a.png" }"#;
    scratch.write("job.json", job);
    refused(&batch(&scratch, &["job.json", "-o", "out"]));
    untouched();
    // A file that the first input would write and the second one would read.
    names("../out/c/../a.png");
    fs::remove_file(scratch.path("out/a.png")).unwrap();
    fs::create_dir(scratch.path("out/c")).unwrap();
    refused(&batch(&scratch, &["scans", "-o", "out"]));
    assert!(!scratch.path("out/a.exr").exists());
}

#[test]
fn contact_sheets_never_overwrite_inputs() {
    let scratch = Scratch::new();
    let texture = image(&scratch, "out/sheet.png");
    scratch.write("a.ply", &textured("out/sheet.png"));
    refused(&batch(&scratch, &["a.ply", "-o", "out"]));
    refused(&batch(&scratch, &["a.ply", "-o", "out", "--sheet-only"]));
    assert!(scratch.read("out/sheet.png") == texture);
    assert_eq!(program::names_in(&scratch.path("out")), ["sheet.png"]);
}

#[test]
fn scripts_of_a_farm_never_overwrite_inputs() {
    let scratch = Scratch::new();
    scratch.write("out/slurm/frames.sh", PYRAMID);
    scratch.write("job.json", r#"{ "inputs": ["out/slurm/frames.sh"] }"#);
    refused(&scratch.run(&["submit", "slurm", "job.json", "-o", "out", "--dry-run"]));
    assert_eq!(scratch.read("out/slurm/frames.sh"), PYRAMID.as_bytes());
    assert_eq!(program::names_in(&scratch.path("out/slurm")), ["frames.sh"]);
}

#[test]
fn merge_and_compare_resolve_links() {
    let scratch = Scratch::new();
    scratch.write("p.ply", PYRAMID);
    let parts = ["1/2", "2/2"].map(|tile| {
        let name = format!("part{}", &tile[..1]);
        let done = render(&scratch, &["p.ply", "--tile", tile, "-o", &name]);
        assert_eq!(done.code(), 0, "{}", done.stderr());
        format!("{name}.exr")
    });
    fs::hard_link(scratch.path(&parts[0]), scratch.path("hard.exr")).unwrap();
    let before = scratch.read(&parts[0]);
    refused(&scratch.run(&["merge", &parts[0], &parts[1], "-o", "hard"]));
    fs::hard_link(scratch.path("part1.png"), scratch.path("hard.png")).unwrap();
    refused(&scratch.run(&["compare", "part1.png", "part2.png", "--out", "hard.png"]));
    assert!(scratch.read("hard.exr") == before);
    // A folder in memory counts like any other.
    let Ok(memory) = tempfile::tempdir_in("/dev/shm") else {
        return program::skipped("there is no /dev/shm");
    };
    let picture = memory.path().join("a.png");
    fs::copy(scratch.path("part1.png"), &picture).unwrap();
    let picture = picture.to_str().unwrap();
    refused(&scratch.run(&["compare", picture, "part2.png", "--out", picture]));
}

/// Files beside meshes and textures: the image of an environment, a template, a reference.
#[test]
fn no_other_file_that_a_command_reads_is_overwritten() {
    let scratch = Scratch::new();
    image(&scratch, "sky.png");
    scratch.write("m.ply", PYRAMID);
    let scene = SCENE.replace("MESH", "m.ply");
    scratch.write("t.json", &scene);
    let lights = r#""lightsources": [{ "type": "environment", "image": "sky.png" }, "#;
    scratch.write("e.json", &scene.replace(r#""lightsources": ["#, lights));
    render(&scratch, &["t.json", "-o", "r"]).good();
    let read = || ["sky.png", "t.json", "r.exr"].map(|name| scratch.read(name));
    let before = read();
    refused(&render(&scratch, &["e.json", "-o", "sky"]));
    refused(&batch(&scratch, &["e.json", "-o", ".", "--name", "sky", "--no-sheet"]));
    for flag in ["--stats", "--write-scene"] {
        refused(&render(&scratch, &["m.ply", "--template", "t.json", "-o", "x", flag, "t.json"]));
    }
    let study = ["converge", "t.json", "--backend", "bvh", "--spp", "1", "--reference", "r.exr"];
    refused(&scratch.run(&[&study[..], &["--csv", "r.exr"]].concat()));
    assert!(read() == before);
}

#[test]
fn a_part_that_is_replaced_while_it_is_merged_is_noticed() {
    let scratch = Scratch::new();
    scratch.write("p.ply", PYRAMID);
    for (spp, name) in [("1", "a"), ("2", "b")] {
        let args = ["p.ply", "--part", "--spp", spp, "-o", name];
        let done = render(&scratch, &args);
        assert_eq!(done.code(), 0, "{}", done.stderr());
    }
    let parts = Parts::open(&[scratch.path("a.exr")]).unwrap();
    assert!(parts.film(&Monitor::default()).is_ok());
    fs::rename(scratch.path("b.exr"), scratch.path("a.exr")).unwrap();
    let error = parts.film(&Monitor::default()).unwrap_err();
    assert!(error.to_string().contains("changed while it was read"), "{error}");
}

/// A grid as text, which takes long to read. Vertices at every multiple of `step` are low; all
/// grids have the same box.
fn grid(step: usize) -> String {
    let side = 300;
    let mut text = format!(
        "ply\nformat ascii 1.0\nelement vertex {}\nproperty float x\nproperty float y\n\
         property float z\nelement face {}\nproperty list uchar int vertex_indices\nend_header\n",
        side * side,
        (side - 1) * (side - 1)
    );
    for i in 0..side * side {
        text += &format!("{}.25 {}.5 {}.75\n", i % side, 9 * (i % step).min(1), i / side);
    }
    for y in 0..side - 1 {
        for x in 0..side - 1 {
            let a = y * side + x;
            text += &format!("4 {a} {} {} {}\n", a + 1, a + side + 1, a + side);
        }
    }
    text
}

/// Starts a program and calls `act` as soon as it reads the file.
fn when_read(scratch: &Scratch, args: &[&str], file: &Path, act: impl FnOnce()) -> Done {
    let mut command = scratch.command(args);
    command.stdin(Stdio::null()).stdout(Stdio::piped()).stderr(Stdio::piped());
    let mut child = command.spawn().unwrap();
    let maps = format!("/proc/{}/maps", child.id());
    let file = file.canonicalize().unwrap().display().to_string();
    let reads = || fs::read_to_string(&maps).is_ok_and(|text| text.contains(&file));
    while !reads() {
        assert_eq!(child.try_wait().unwrap(), None, "it was never seen to read {file}");
        std::thread::sleep(Duration::from_millis(1));
    }
    act();
    Done::from(child.wait_with_output().unwrap())
}

/// Whenever the mesh is replaced, the final picture matches the file that exists.
#[cfg(target_os = "linux")]
#[test]
fn a_mesh_that_is_replaced_while_it_is_read_never_stays_in_a_picture() {
    let scratch = Scratch::new();
    let run = ["batch", "m.ply", "-o", "out", "--no-sheet", "--template", "t.json", "--resume"];
    let template = SCENE.replace("MESH", "m.ply");
    // The same camera for both.
    let args = [&run[..], &SMALL, &["--set", "/camera/position=[150,90,400]"]].concat();
    scratch.write("t.json", &template);
    scratch.write("m.ply", &grid(5));
    scratch.write("next.ply", &grid(7));
    let next = scratch.path("next.ply");
    let mesh = scratch.path("m.ply");
    let done = when_read(&scratch, &args, &mesh, || fs::rename(&next, &mesh).unwrap());
    // Either the change was noticed, or the picture matches its fingerprint.
    if done.code() != 0 {
        assert_eq!(done.code(), 3, "{}", done.stderr());
        assert!(done.stderr().contains("changed while it was read"), "{}", done.stderr());
        assert!(!scratch.path("out/m.exr").exists());
    }
    let done = scratch.run(&args);
    assert_eq!(done.code(), 0, "{}", done.stderr());
    let kept = scratch.read("out/m.exr");
    fs::remove_file(scratch.path("out/m.exr")).unwrap();
    let done = scratch.run(&args);
    assert_eq!(done.code(), 0, "{}", done.stderr());
    assert!(kept == scratch.read("out/m.exr"), "the picture of another mesh was kept");
}
