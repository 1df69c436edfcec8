//! Photographs of a list of cameras stay: no frame is written over a picture that no batch has
//! rendered.

use std::fs;

use serde_json::{Value, json};

use crate::support::program::{Done, PYRAMID, Scratch};

/// Cameras of `a.png` and `b.png` before the pyramid.
fn cameras(folder: &str) -> Value {
    let frame = |name: &str| {
        json!({ "file_path": format!("{folder}{name}.png"),
            "transform_matrix": [[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 6], [0, 0, 0, 1]] })
    };
    json!({ "fl_x": 40, "w": 40, "h": 30, "frames": [frame("a"), frame("b")] })
}

/// The photographs `images/a.png` and `images/b.png`, and a mesh whose frames have their names.
fn scratch() -> Scratch {
    let scratch = Scratch::new();
    scratch.write("images.ply", PYRAMID);
    scratch.write("images/transforms.json", &cameras("").to_string());
    for name in ["a", "b"] {
        let file = fs::File::create(scratch.path(&format!("images/{name}.png"))).unwrap();
        let mut encoder = png::Encoder::new(file, 40, 30);
        encoder.set_color(png::ColorType::Grayscale);
        encoder.write_header().unwrap().write_image_data(&[7; 40 * 30]).unwrap();
    }
    scratch
}

fn batch(scratch: &Scratch, list: &str, more: &[&str]) -> Done {
    let args = ["batch", "images.ply", "--cameras", list, "--spp", "1", "--no-sheet"];
    scratch.run(&[&args, more].concat())
}

fn photographs(scratch: &Scratch) -> [Vec<u8>; 2] {
    ["images/a.png", "images/b.png"].map(|name| scratch.read(name))
}

#[test]
fn frames_are_not_written_over_photographs() {
    let scratch = scratch();
    scratch.write("transforms.json", &cameras("images/").to_string());
    let own = json!({ "cameras": [{ "image": "a.png", "camera": { "type": "pinhole",
        "width": 8, "height": 8, "fov": 40, "position": [0, 0, 6], "target": [0, 0, 0],
        "up": [0, 1, 0] } }] });
    scratch.write("own.json", &own.to_string());
    scratch.write("sparse/cameras.txt", "1 PINHOLE 40 30 40 40 20 15\n");
    scratch.write("sparse/images.txt", "1 0 1 0 0 0 0 6 1 a.png\n\n");
    let job = json!({ "inputs": ["images.ply"], "cameras": "transforms.json",
        "output": { "name": "{image}" } });
    scratch.write("job.json", &job.to_string());
    let before = photographs(&scratch);
    let refused = |done: Done| {
        let said = done.stderr();
        assert_eq!(done.code(), 2, "{said}");
        assert!(said.contains("images/a.png: found a picture that is no frame"), "{said}");
        assert!(photographs(&scratch) == before);
        assert!(!scratch.path("images/a.exr").exists());
    };
    let list = "images/transforms.json";
    for more in [&[][..], &["--resume"], &["--dry-run"]] {
        refused(batch(&scratch, list, &[&["-o", "."], more].concat()));
    }
    for list in [list, "own.json", "sparse"] {
        refused(batch(&scratch, list, &["-o", "images", "--name", "{image}"]));
    }
    refused(scratch.run(&["submit", "slurm", "job.json", "-o", ".", "--dry-run"]));
    assert!(!scratch.path("slurm").exists());
    // A camera by itself: only what a run writes counts.
    fs::remove_file(scratch.path("images/b.png")).unwrap();
    batch(&scratch, list, &["-o", ".", "--range", "1..2"]).good();
    assert!(scratch.read("images/a.png") == before[0]);
    // Not even a PNG.
    scratch.write("images/a.png", "a JPEG");
    let done = batch(&scratch, list, &["-o", "."]);
    assert!(done.code() == 2 && scratch.read("images/a.png") == b"a JPEG", "{}", done.stderr());
}

#[test]
fn a_contact_sheet_is_written_over_a_contact_sheet_only() {
    let scratch = scratch();
    scratch
        .write("job.json", r#"{ "inputs": ["images.ply"], "cameras": "images/transforms.json" }"#);
    let run = |more: &[&str]| {
        let cameras = ["batch", "images.ply", "--cameras", "images/transforms.json", "-o", "out"];
        scratch.run(&[&cameras[..], &["--spp", "1"], more].concat())
    };
    run(&[]).good();
    let sheet = scratch.read("out/sheet.png");
    run(&["--resume"]).good();
    run(&["--sheet-only"]).good();
    assert!(scratch.read("out/sheet.png") == sheet);
    // A photograph of the size of a sheet.
    let size = image::load_from_memory(&sheet).unwrap().to_rgb8().dimensions();
    image::RgbImage::new(size.0, size.1).save(scratch.path("large.png")).unwrap();
    for photograph in ["images/a.png", "large.png"] {
        fs::copy(scratch.path(photograph), scratch.path("out/sheet.png")).unwrap();
        for done in [
            run(&[]),
            run(&["--dry-run"]),
            run(&["--sheet-only"]),
            scratch.run(&["submit", "slurm", "job.json", "-o", "out", "--dry-run"]),
        ] {
            let said = done.stderr();
            assert!(done.code() == 2 && said.contains("no contact sheet of a batch"), "{said}");
        }
        assert!(scratch.read("out/sheet.png") == scratch.read(photograph));
    }
    // A page of the user.
    fs::write(scratch.path("out/sheet.png"), &sheet).unwrap();
    scratch.write("out/index.html", "<title>My scans</title>");
    let said = run(&["--sheet-only"]).stderr();
    assert!(said.contains("index.html: found a page that is no contact sheet"), "{said}");
    assert!(run(&[]).code() == 2 && scratch.read("out/index.html").starts_with(b"<title>My"));
    // These write none.
    run(&["--no-sheet"]).good();
    run(&["--range", "0..1"]).good();
    fs::copy(scratch.path("large.png"), scratch.path("out/sheet.png")).unwrap();
    // Without cameras, no picture has the name of a photograph.
    let small = ["--size", "40x30", "--spp", "1"];
    scratch.run(&[&["batch", "images.ply", "-o", "out"], &small[..]].concat()).good();
    assert!(scratch.read("out/sheet.png") != scratch.read("large.png"));
}

#[test]
fn frames_are_written_over_frames() {
    let scratch = scratch();
    let list = "images/transforms.json";
    let run = |more: &[&str], said: &str| {
        let done = batch(&scratch, list, &[&["-o", "renders", "--name", "{image}"], more].concat());
        assert!(done.stderr().contains(said), "{}", done.stderr());
        done.good();
    };
    run(&[], "2 frames rendered");
    run(&[], "2 frames rendered");
    run(&["--resume"], "0 frames rendered, 2 kept");
    // Frames that are cut short, or have nothing to lose.
    for (name, whole) in
        [("renders/a.png", true), ("renders/b.exr", true), ("renders/b.png", false)]
    {
        let file = fs::File::options().write(true).open(scratch.path(name)).unwrap();
        let length = file.metadata().unwrap().len();
        file.set_len(if whole { length - 1 } else { 0 }).unwrap();
    }
    run(&["--resume"], "2 frames rendered, 0 kept");
}
