//! The predicted memory is what a render takes, and `--max-memory` limits images.

use std::fs;

use crate::support::backends::on_both;
use crate::support::program::{self, Scratch, shuffled_sheet};
use crate::support::random::Random;
use lightpath::{
    error::ErrorKind,
    monitor::Monitor,
    scene::{self, Backend, Source},
    world::{LoadOptions, World},
};
use serde_json::{Value, json};

fn with_shapes(shapes: Value) -> String {
    let scene = json!({
        "camera": { "type": "pinhole", "width": 8, "height": 6, "fov": 40,
                    "position": [0, 3, 4], "lookat": [0, -0.6, -1], "up": [0, 1, 0] },
        "scene": {
            "lightsources": [{ "type": "pointlight", "position": [2, 3, 4], "id": [3, 3, 3] }],
            "shapes": shapes
        }
    });
    scene.to_string()
}

fn ball(x: f64, material: Value) -> Value {
    json!({ "type": "sphere", "center": [x, 0, 0], "radius": 0.4, "material": material })
}

/// Too little memory to load or use Embree gives the exit code for another try, not for a missing
/// Embree.
#[cfg(unix)]
#[test]
#[cfg_attr(not(lightpath_embree), ignore = "needs Embree")]
fn embree_without_memory_may_be_tried_again() {
    let scratch = Scratch::new();
    scratch.write("s.json", &with_shapes(json!([ball(0.0, json!({}))])));
    let args = ["render", "s.json", "-o", "x", "--backend", "embree", "--threads", "2", "--quiet"];
    scratch.run(&args).good();
    let mut not_loaded = 0;
    for mib in (60..300).step_by(8) {
        let limited = format!("ulimit -v {}; exec \"$0\" \"$@\"", mib << 10);
        let mut command = std::process::Command::new("sh");
        command.args(["-c", &limited, env!("CARGO_BIN_EXE_lightpath")]).args(args);
        let done = program::Done::of(command.current_dir(scratch.path("")));
        let said = done.stderr();
        if said.contains("error: Embree: ") {
            assert_eq!(done.code(), 3, "{mib} MiB: {said}");
            not_loaded += usize::from(said.contains("cannot load"));
        }
    }
    assert!(not_loaded > 0, "Embree was loaded in whatever was left");
}

/// Returns `memory` of `info` and of the statistics of a render.
fn predicted_and_found(scratch: &Scratch, backend: Backend) -> [Value; 2] {
    let backend = ["--backend", backend.name()];
    let info = scratch.run(&[&["info", "s.json", "--json"], &backend[..]].concat());
    let render = scratch.run(&[&["render", "s.json", "--json", "--quiet"], &backend[..]].concat());
    [info, render].map(|done| {
        let value: Value = serde_json::from_str(&done.good().stdout()).unwrap();
        value["memory"].clone()
    })
}

on_both! {
    fn an_accelerator_needs_the_predicted_memory(backend: Backend) {
        let scratch = Scratch::new();
        fs::write(scratch.path("sheet.ply"), shuffled_sheet(320)).unwrap();
        let shapes = json!([
            { "type": "trimesh", "path": "sheet.ply", "material": {} },
            { "type": "plane", "v0": [-9, -1, 9], "v1": [9, -1, 9], "v2": [9, -1, -9], "v3": [-9, -1, -9],
              "material": {} },
            ball(0.0, json!({}))
        ]);
        scratch.write("s.json", &with_shapes(shapes));
        let [predicted, found] = predicted_and_found(&scratch, backend);
        assert_eq!(predicted["primitives"], 2 * 320 * 320 + 2 + 1);
        for key in ["accelerator_bytes", "accelerator_peak_bytes"] {
            let ratio = predicted[key].as_f64().unwrap() / found[key].as_f64().unwrap();
            assert!((0.85..1.15).contains(&ratio), "{key}: {predicted} {found}");
        }
        assert!(predicted["peak_bytes"].as_u64() >= found["peak_bytes"].as_u64());
    }
}

/// Triangles that share no vertices need three times the memory of others.
#[test]
fn separate_triangles_need_the_predicted_memory() {
    let scratch = Scratch::new();
    let count = 30_000;
    let mut random = Random(5);
    let mut text = format!(
        "ply\nformat ascii 1.0\nelement vertex {}\nproperty float x\nproperty float y\n\
         property float z\nelement face {count}\nproperty list uchar int vertex_indices\nend_header\n",
        3 * count
    );
    for _ in 0..count {
        let middle = [0; 3].map(|_| random.within(-1.0, 1.0));
        for _ in 0..3 {
            let [x, y, z] = middle.map(|m| m + random.within(-0.01, 0.01));
            text += &format!("{x:.5} {y:.5} {z:.5}\n");
        }
    }
    text.extend((0..count).map(|i| format!("3 {} {} {}\n", 3 * i, 3 * i + 1, 3 * i + 2)));
    scratch.write("soup.ply", &text);
    let mesh = json!([{ "type": "trimesh", "path": "soup.ply", "material": {} }]);
    scratch.write("s.json", &with_shapes(mesh));
    let [predicted, found] = predicted_and_found(&scratch, Backend::default());
    for key in ["accelerator_bytes", "accelerator_peak_bytes"] {
        let ratio = predicted[key].as_f64().unwrap() / found[key].as_f64().unwrap();
        assert!((0.95..1.2).contains(&ratio), "{key}: {predicted} {found}");
    }
}

/// A limit that Embree exceeds and `bvh` does not.
#[test]
#[cfg_attr(not(lightpath_embree), ignore = "needs Embree")]
fn a_backend_that_fits_is_named() {
    let scratch = Scratch::new();
    fs::write(scratch.path("sheet.ply"), shuffled_sheet(320)).unwrap();
    let render = |backend: &str, limit: &str| {
        let args = ["render", "sheet.ply", "-o", "x", "--size", "8x6", "--max-memory", limit];
        scratch.run(&[&args[..], &["--backend", backend]].concat())
    };
    let done = render("embree", "60M");
    assert_eq!(done.code(), 2, "{}", done.stderr());
    let needed = done.stderr().split("help: `--backend bvh` needs ").nth(1).map(str::to_string);
    let needed = needed.unwrap_or_else(|| panic!("{}", done.stderr()));
    render("bvh", needed.trim()).good();
    // The mesh alone does not fit: its scene is not known yet.
    let help = render("embree", "20M").stderr();
    assert!(help.contains("help: film and accelerator come on top: `lightpath info`"), "{help}");
}

#[cfg(target_os = "linux")]
on_both! {
    /// At its end, a build gives back much of its memory, which makes room for the film. Counts
    /// the usual peak of three runs without a film, and the least of up to five with one: now and
    /// then a run peaks some 3 MB higher, and very rarely 7 MB lower.
    fn the_film_is_not_there_while_the_accelerator_is_built(backend: Backend) {
        let scratch = Scratch::new();
        fs::write(scratch.path("sheet.ply"), shuffled_sheet(640)).unwrap();
        let shapes = json!([{ "type": "trimesh", "path": "sheet.ply", "material": {} }]);
        scratch.write("s.json", &with_shapes(shapes));
        let peak = |size: &str| {
            let fixed = ["render", "s.json", "--json", "--quiet", "--threads", "2"];
            let args = [&fixed[..], &["--size", size, "--backend", backend.name()]].concat();
            let shown = scratch.run(&args).good().stdout();
            let value: Value = serde_json::from_str(&shown).unwrap();
            value["memory"]["peak_bytes"].as_u64().unwrap()
        };
        let mut small = [0; 3].map(|_| peak("8x6"));
        small.sort_unstable();
        let film = 16 * 600 * 500;
        let mut large = (0..5).map(|_| peak("600x500"));
        assert!(large.any(|large| large < small[1] + film / 2), "{small:?}");
    }
}

#[test]
fn textures_take_the_memory_that_their_headers_promise() {
    let scratch = Scratch::new();
    let path = |name| scratch.path(name);
    image::RgbImage::new(31, 17).save(path("rgb8.png")).unwrap();
    image::DynamicImage::new_luma16(64, 64).save(path("grey16.png")).unwrap();
    image::DynamicImage::new_rgba16(40, 30).save(path("rgba16.png")).unwrap();
    image::DynamicImage::new_rgb32f(20, 10).save(path("float.exr")).unwrap();
    let texture = |name: &str| json!({ "tPath": name });
    let linear = |name: &str| json!({ "tPath": name, "colorspace": "linear" });
    let materials = [
        texture("rgb8.png"),
        texture("grey16.png"),
        // The same image is loaded only once, unless its colour space differs.
        texture("grey16.png"),
        linear("grey16.png"),
        texture("rgba16.png"),
        texture("float.exr"),
    ];
    let balls: Vec<Value> = (0..).zip(materials).map(|(i, m)| ball(f64::from(i), m)).collect();
    scratch.write("s.json", &with_shapes(json!(balls)));
    let [predicted, found] = predicted_and_found(&scratch, Backend::default());
    assert_eq!(predicted["texture_bytes"], found["texture_bytes"]);
    let floats = 2 * 64 * 64 + 40 * 30 + 20 * 10;
    // A table of the linear value of each byte is kept beside the bytes.
    let expected = 12 * floats + 3 * 31 * 17 + 256 * 4;
    assert_eq!(found["texture_bytes"], expected);
}

/// A mesh names its image itself. Its mip map is predicted by an upper bound.
#[test]
fn the_image_of_a_mesh_is_predicted() {
    let scratch = Scratch::new();
    image::RgbImage::new(640, 480).save(scratch.path("own.png")).unwrap();
    image::RgbImage::new(320, 480).save(scratch.path("second.png")).unwrap();
    let ply = |numbers: &str, number: &str| {
        format!(
            "ply\nformat ascii 1.0\ncomment TextureFile own.png\ncomment TextureFile second.png\n\
             comment TextureFile missing.png\nelement vertex 4\nproperty float x\n\
             property float y\nproperty float z\nproperty float s\nproperty float t\n\
             element face 2\nproperty list uchar int vertex_indices\n{numbers}end_header\n\
             -1 0 0 0 0\n1 0 0 1 0\n1 2 0 1 1\n-1 2 0 0 1\n3 0 1 2{number}\n3 0 2 3\n"
        )
    };
    let one = ply("", "");
    let two = ply("property int texnumber\n", " 0").replace("3 0 2 3\n", "3 0 2 3 1\n");
    // Alpha is dropped, and told once for each image.
    image::RgbaImage::new(320, 480).save(scratch.path("second.png")).unwrap();
    scratch.write("own.ply", &two);
    let mesh = json!([{ "type": "trimesh", "path": "own.ply", "material": {} }]);
    scratch.write("s.json", &with_shapes(mesh));
    let said = scratch.run(&["render", "s.json", "-o", "x"]).good().stderr();
    assert_eq!(said.matches("the alpha channel of second.png is ignored").count(), 1, "{said}");
    image::RgbImage::new(320, 480).save(scratch.path("second.png")).unwrap();
    for (text, images) in [(one, 3 * 640 * 480), (two, 3 * 960 * 480)] {
        scratch.write("own.ply", &text);
        let mesh = |more: Value| {
            let mut mesh = json!({ "type": "trimesh", "path": "own.ply", "material": {} });
            mesh.as_object_mut().unwrap().extend(more.as_object().unwrap().clone());
            scratch.write("s.json", &with_shapes(json!([mesh])));
            let memory = predicted_and_found(&scratch, Backend::default());
            memory.map(|memory| memory["texture_bytes"].as_f64().unwrap())
        };
        let [predicted, found] = mesh(json!({}));
        assert!(found > f64::from(images), "{found}");
        assert!((found..1.02 * found).contains(&predicted), "{predicted} {found}");
        assert_eq!(mesh(json!({ "color": "none" })), [0.0; 2]);
        assert_eq!(mesh(json!({ "points": 0.1 })), [0.0; 2]);
    }
}

/// A scene with a texture of 3000 x 2000 16-bit texels, which takes 72 MB in memory.
fn large_texture() -> Scratch {
    let scratch = Scratch::new();
    image::DynamicImage::new_luma16(3000, 2000).save(scratch.path("large.png")).unwrap();
    let shapes = json!([ball(0.0, json!({ "tPath": "large.png" }))]);
    scratch.write("s.json", &with_shapes(shapes));
    scratch
}

#[test]
fn a_texture_that_does_not_fit_is_refused_before_it_is_read() {
    let scratch = large_texture();
    let done = scratch.run(&["render", "s.json", "--max-memory", "90M"]);
    assert_eq!((done.code(), done.stdout().as_str()), (2, ""), "{}", done.stderr());
    for expected in ["--max-memory: found 90.0 MiB", "textures 68.7 MiB", "decoding them"] {
        assert!(done.stderr().contains(expected), "{}", done.stderr());
    }
    assert_eq!(scratch.names(), ["large.png", "s.json"]);
    let done = scratch.run(&["render", "s.json", "--max-memory", "160M"]);
    assert_eq!(done.code(), 0, "{}", done.stderr());
}

#[test]
fn a_texture_is_not_decoded_beyond_the_budget() {
    let scratch = large_texture();
    let scene = scene::load(Source::File(&scratch.path("s.json")), &[]).unwrap().scene;
    let load = |bytes: u64| {
        let options = LoadOptions { texture_bytes: Some(bytes), ..LoadOptions::default() };
        World::load(&scene, options, &Monitor::default()).map(|(world, _)| world.texture_bytes())
    };
    // During decoding, a texel takes 6 bytes besides its 12.
    let decoding = 18 * 3000 * 2000;
    assert_eq!(load(decoding), Ok(12 * 3000 * 2000));
    let error = load(decoding - 1).unwrap_err();
    assert_eq!(error.kind, ErrorKind::Limit);
    assert!(error.to_string().contains("large.png: 3000 x 2000 pixels need"), "{error}");
}

/// Whether temporary files are on a disk.
#[cfg(target_os = "linux")]
fn has_disk() -> bool {
    let temporary = std::env::temp_dir();
    let folders = [temporary.as_os_str(), "/var/tmp".as_ref()];
    let done = std::process::Command::new("stat").args(["-f", "-c", "%T"]).args(folders).output();
    let done = String::from_utf8(done.unwrap().stdout).unwrap();
    done.lines().any(|kind| kind != "tmpfs")
}

/// A texture of more than 8192 x 8192 texels is in a temporary file, so it takes less memory than
/// its texels.
#[cfg(target_os = "linux")]
#[test]
fn a_large_texture_takes_the_memory_of_the_texels_in_view() {
    if !has_disk() {
        return program::skipped("temporary files are not on a disk");
    }
    let scratch = Scratch::new();
    let (width, height) = (16384u32, 4208);
    // Rows are equal in sixteens: a test is not optimised.
    let row = |y: u32| {
        let texels = (0..width).flat_map(|x| [(x / 32) as u8, y as u8, (x / 64) as u8 ^ y as u8]);
        texels.collect::<Vec<u8>>().repeat(16)
    };
    let mut texels = Vec::new();
    (0..height / 16).for_each(|y| texels.extend_from_slice(&row(y)));
    let texels = image::RgbImage::from_raw(width, height, texels).unwrap();
    texels.save(scratch.path("large.png")).unwrap();
    let material = json!({ "tPath": "large.png", "filter": "trilinear" });
    scratch.write("s.json", &with_shapes(json!([ball(0.0, material)])));
    let [predicted, found] = predicted_and_found(&scratch, Backend::default());
    assert_eq!(predicted["texture_bytes"], found["texture_bytes"]);
    let [predicted, found] = [predicted, found].map(|all| all["peak_bytes"].as_u64().unwrap());
    assert!(found <= predicted, "{predicted} {found}");
    let whole = 3 * u64::from(width) * u64::from(height);
    assert!(found < whole, "{found} {whole}");
    let limit = (predicted + (1 << 20)).to_string();
    let done = scratch.run(&["render", "s.json", "-o", "whole", "--max-memory", &limit]);
    assert_eq!(done.code(), 0, "{}", done.stderr());
    let data = fs::read(scratch.path("large.png")).unwrap();
    fs::write(scratch.path("large.png"), &data[..data.len() / 2]).unwrap();
    let done = scratch.run(&["render", "s.json", "-o", "cut"]);
    assert_eq!(done.code(), 2, "{}", done.stderr());
    assert!(done.stderr().contains("large.png: the image ends too early"), "{}", done.stderr());
}

/// The header of a pipe could not be read a second time.
#[cfg(unix)]
#[test]
fn a_limit_refuses_pipes() {
    let scratch = Scratch::new();
    scratch.pipe("pipe.ply");
    let shape = json!({ "type": "trimesh", "path": "pipe.ply", "material": {} });
    scratch.write("s.json", &with_shapes(json!([shape])));
    for input in ["pipe.ply", "s.json"] {
        let done = scratch.run(&["render", input, "-o", "x", "--max-memory", "200M"]);
        assert_eq!(done.code(), 2, "{}", done.stderr());
        let message = "pipe.ply: found a pipe or a device, expected a file";
        assert!(done.stderr().contains(message), "{}", done.stderr());
    }
}
