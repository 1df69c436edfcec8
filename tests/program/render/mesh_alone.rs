//! A mesh without a scene: its picture and its messages.

use crate::support::program::{Done, POINT, Scratch};
use glam::DVec3;
use serde_json::{Value, json};

/// A box of 2 x 2 x `long` with shared vertices, from -1 in y up. `more` is added to the header.
fn block(long: f32, more: &str) -> String {
    let corner = |k: u32| {
        let side = |axis: u32| (k >> axis & 1) as f32 * 2.0 - 1.0;
        format!("{} {} {}\n", side(0), side(1), side(2) * long / 2.0)
    };
    let vertices: String = (0..8).map(corner).collect();
    format!(
        "ply\nformat ascii 1.0\n{more}element vertex 8\nproperty float x\nproperty float y\nproperty float z\n\
         element face 6\nproperty list uchar int vertex_indices\nend_header\n{vertices}\
         4 0 2 3 1\n4 4 5 7 6\n4 0 1 5 4\n4 2 6 7 3\n4 0 4 6 2\n4 1 3 7 5\n"
    )
}

/// A square with texture coordinates.
fn square(more: &str) -> String {
    format!(
        "ply\nformat ascii 1.0\n{more}element vertex 4\nproperty float x\nproperty float y\nproperty float z\n\
         property float s\nproperty float t\nelement face 1\nproperty list uchar int vertex_indices\nend_header\n\
         -1 0 0 0 0\n1 0 0 1 0\n1 2 0 1 1\n-1 2 0 0 1\n4 0 1 2 3\n"
    )
}

/// A square with values of its vertices.
fn rows(properties: [&str; 3], [a, b, c, d]: [&str; 4]) -> String {
    let named = properties.into_iter().filter(|property| !property.is_empty());
    let named: String = named.map(|property| format!("property {property}\n")).collect();
    format!(
        "ply\nformat ascii 1.0\nelement vertex 4\nproperty float x\nproperty float y\nproperty float z\n{named}\
         element face 1\nproperty list uchar int vertex_indices\nend_header\n\
         -1 0 0 {a}\n1 0 0 {b}\n1 2 0 {c}\n-1 2 0 {d}\n4 0 1 2 3\n"
    )
}

/// 2 x 2 texels: red, green, blue, white.
const IMAGE: &str = "P3\n2 2\n255\n255 0 0 0 255 0\n0 0 255 255 255 255\n";

fn render(scratch: &Scratch, mesh: &str, flags: &[&str]) -> Done {
    scratch.run(&[&["render", mesh, "--size", "48x48", "-o", "o"], flags].concat())
}

/// Returns the picture of a mesh that renders without messages.
#[track_caller]
fn picture(scratch: &Scratch, mesh: &str, flags: &[&str]) -> Vec<(String, Vec<u32>)> {
    render(scratch, mesh, flags).good();
    scratch.channels("o.exr")
}

#[test]
fn a_block_is_flat_and_a_ball_is_smooth() {
    let scratch = Scratch::new();
    scratch.write("block.ply", &block(2.0, ""));
    let [studio, off, all, at_90] =
        [&[][..], &["--smooth", "off"], &["--smooth", "all"], &["--smooth", "91"]]
            .map(|flags| picture(&scratch, "block.ply", flags));
    assert!(studio == off, "a right angle is a crease");
    assert!(studio != all && all == at_90);

    let ball = concat!(env!("CARGO_MANIFEST_DIR"), "/assets/ball.ply");
    let [studio, off, all] = [&[][..], &["--smooth", "off"], &["--smooth", "all"]]
        .map(|flags| picture(&scratch, ball, flags));
    assert!(studio == all && studio != off);
}

#[test]
fn data_that_are_not_shown_are_told() {
    let scratch = Scratch::new();
    let image = concat!(env!("CARGO_MANIFEST_DIR"), "/assets/checker.ppm");
    let coordinates = rows(["float s", "float t", ""], ["nan 0", "1 0", "1 1", "0 1"]);
    let normal = "0 0 1";
    let normals = rows(["float nx", "float ny", "float nz"], ["nan 0 1", normal, normal, normal]);
    let colours = rows(["int red", "int green", "int blue"], ["9 9 9"; 4]);
    for (mesh, flags, warning) in [
        (coordinates, &["--texture", image][..], "1 pair of texture coordinates is not finite"),
        (normals, &[], "1 normal is not finite"),
        (colours, &[], "its red, green and blue are not shown"),
    ] {
        scratch.write("m.ply", &mesh);
        let done = render(&scratch, "m.ply", flags);
        assert_eq!(done.code(), 0, "{}", done.stderr());
        assert!(done.stderr().contains(warning), "{warning}: {}", done.stderr());
    }
}

/// Scanners write NAME.png beside NAME.ply. Not every file names it.
#[test]
fn an_image_beside_a_mesh_is_not_replaced() {
    let scratch = Scratch::new();
    scratch.write("m.ply", &square(""));
    scratch.write("m.png", "the texture");
    let small = ["render", "m.ply", "--size", "8x8", "--quiet"];
    let done = scratch.run(&small);
    assert!(done.code() == 2 && done.stderr().contains("m.png: would be"), "{}", done.stderr());
    assert_eq!(scratch.read("m.png"), b"the texture");
    scratch.run(&[&small[..], &["-o", "n"]].concat()).good();
    std::fs::remove_file(scratch.path("m.png")).unwrap();
    scratch.run(&small).good();
    scratch.run(&small).good();
}

/// The last line says that the files are written.
#[test]
fn json_progress_ends_with_all_done() {
    let scratch = Scratch::new();
    scratch.write("m.ply", &square(""));
    let done = render(&scratch, "m.ply", &["--progress", "json", "--quiet"]).good();
    let said = done.stderr();
    let lines = said.lines().map(|line| serde_json::from_str(line).unwrap());
    let lines: Vec<Value> = lines.collect();
    let last = lines.last().unwrap();
    assert_eq!((&last["phase"], &last["done"]), (&json!("write"), &json!(1)), "{said}");
}

#[test]
fn a_missing_texture_is_told_once() {
    let scratch = Scratch::new();
    scratch.write("m.ply", &square("comment TextureFile no.png\n"));
    let told = render(&scratch, "m.ply", &[]).good().stderr();
    assert_eq!(told.matches("no.png").count(), 2, "a name and a path in one message: {told}");
}

#[test]
fn a_scene_sets_the_crease_angle() {
    let scratch = Scratch::new();
    scratch.write("block.ply", &block(2.0, ""));
    let of = |smooth: &str| {
        let set = format!("/scene/shapes/0/smooth={smooth}");
        render(&scratch, "block.ply", &["--write-scene", "s.json", "--set", &set]).good();
        scratch.run(&["render", "s.json", "-o", "o", "--quiet"]).good();
        scratch.channels("o.exr")
    };
    let (flat, smooth) = (of("false"), of("true"));
    assert!(flat != smooth);
    assert!(of(r#"{"angle": 89.9}"#) == flat && of(r#"{"angle": 90}"#) == smooth);
    assert!(
        of(r#"{"angle": 180, "flat": 89}"#) == flat
            && of(r#"{"angle": 180, "flat": 100}"#) == smooth
    );
    for (wrong, expected) in [
        (r#"{"angle": 0}"#, "expected a number in (0, 180]"),
        (r#"{"flat": 20}"#, "missing key `angle`"),
        ("20", "expected true or false or an object"),
    ] {
        let set = format!("/scene/shapes/0/smooth={wrong}");
        let done = render(&scratch, "block.ply", &["--set", &set]);
        assert!(done.code() == 2 && done.stderr().contains(expected), "{}", done.stderr());
    }
}

/// Returns the channels R and A of the picture.
fn red_and_alpha(scratch: &Scratch) -> [Vec<f32>; 2] {
    let channels = scratch.channels("o.exr");
    ["R", "A"].map(|name| {
        let words = &channels.iter().find(|(channel, _)| channel == name).unwrap().1;
        words.iter().map(|&word| f32::from_bits(word)).collect()
    })
}

/// Returns alpha of the lower left pixel, which shows the studio's ground.
fn corner_alpha(scratch: &Scratch) -> f32 {
    red_and_alpha(scratch)[1][47 * 48]
}

#[test]
fn a_transparent_picture_has_the_shadows_of_its_ground() {
    let scratch = Scratch::new();
    scratch.write("block.ply", &block(2.0, ""));
    let planes = |flags: &[&str]| {
        let flags = [flags, &["--float", "--write-scene", "s.json"]].concat();
        render(&scratch, "block.ply", &flags).good();
        let scene: Value = serde_json::from_slice(&scratch.read("s.json")).unwrap();
        let shapes = scene["scene"]["shapes"].as_array().unwrap();
        shapes.iter().filter(|shape| shape["type"] == "plane").count()
    };
    assert_eq!((planes(&[]), corner_alpha(&scratch)), (1, 1.0));
    assert_eq!((planes(&["--transparent"]), corner_alpha(&scratch)), (1, 0.0));
    // Black pixels are the shadow of the block.
    let [red, alpha] = red_and_alpha(&scratch);
    let shadow = red.iter().zip(&alpha).filter(|(red, alpha)| **red == 0.0 && **alpha > 0.2);
    assert!(shadow.count() > 10);
    let cut_out = ["--transparent", "--no-ground"];
    assert_eq!((planes(&cut_out), corner_alpha(&scratch)), (0, 0.0));
    let [red, alpha] = red_and_alpha(&scratch);
    assert!(red.iter().zip(&alpha).all(|(red, alpha)| *red > 0.0 || *alpha == 0.0));
    assert_eq!((planes(&["--no-ground"]), corner_alpha(&scratch)), (0, 1.0));
    // A user's template keeps its ground unless the flag is given.
    render(&scratch, "block.ply", &["--write-scene", "template.json"]).good();
    assert_eq!(planes(&["--transparent", "--template", "template.json"]), 1);
    assert_eq!(planes(&["--transparent", "--template", "template.json", "--no-ground"]), 0);
}

#[test]
fn a_changed_ground_keeps_the_instruction_set() {
    let scratch = Scratch::new();
    scratch.write("block.ply", &block(2.0, ""));
    let isa = |flags: &[&str]| {
        let flags = [flags, &["--isa", "portable", "--stats", "stats.json"]].concat();
        render(&scratch, "block.ply", &flags).good();
        let stats: Value = serde_json::from_slice(&scratch.read("stats.json")).unwrap();
        stats["isa"].as_str().unwrap().to_owned()
    };
    let all = isa(&[]);
    assert!(all.contains("portable rays, portable shading"), "{all}");
    assert_eq!(isa(&["--no-ground"]), all);
    assert_eq!(isa(&["--transparent"]), all);
}

#[test]
fn studios_differ_in_their_light_and_exclude_scenes() {
    let scratch = Scratch::new();
    scratch.write("block.ply", &block(2.0, ""));
    let lights = |flags: &[&str]| {
        let flags = [flags, &["--write-scene", "s.json"]].concat();
        render(&scratch, "block.ply", &flags).good();
        let scene: Value = serde_json::from_slice(&scratch.read("s.json")).unwrap();
        let lights = scene["scene"]["lightsources"].as_array().unwrap();
        let kinds = lights.iter().map(|light| light["type"].as_str().unwrap().to_owned());
        (kinds.collect::<Vec<_>>(), scene["scene"]["shapes"][0]["color"].clone())
    };
    let of =
        |kinds: &[&str], color: Value| (kinds.iter().map(ToString::to_string).collect(), color);
    assert_eq!(lights(&[]), lights(&["--studio", "lamps"]));
    assert_eq!(lights(&[]), of(&["arealight", "arealight"], Value::Null));
    assert_eq!(lights(&["--studio", "soft"]), of(&["environment", "sun"], Value::Null));
    assert_eq!(lights(&["--clay"]), of(&["environment"], "none".into()));
    let refused = |input: &str, flags: &[&str], message: &str| {
        let done = render(&scratch, input, flags);
        assert!(done.code() == 2 && done.stderr().contains(message), "{}", done.stderr());
    };
    refused("block.ply", &["--template", "s.json", "--studio", "soft"], "--studio");
    refused("block.ply", &["--clay", "--studio", "soft"], "--studio");
    refused("s.json", &["--clay"], "--clay");
    refused("s.json", &["--color", "face"], "--color: found with s.json");
    refused("s.json", &["--points", "1"], "--points: found with s.json");
}

#[test]
fn a_written_scene_finds_the_image_of_its_environment() {
    let scratch = Scratch::new();
    scratch.write("block.ply", &block(2.0, ""));
    image::Rgb32FImage::from_pixel(4, 2, image::Rgb([0.5, 1.0, 2.0]))
        .save(scratch.path("sky.exr"))
        .unwrap();
    let sky = r#"/scene/lightsources/-={"type": "environment", "image": "sky.exr"}"#;
    std::fs::create_dir(scratch.path("there")).unwrap();
    render(&scratch, "block.ply", &["--set", sky, "--write-scene", "there/s.json"]).good();
    let alone = scratch.read("o.exr");
    render(&scratch, "there/s.json", &[]).good();
    assert!(scratch.read("o.exr") == alone);
}

#[test]
fn quality_sets_the_samples_of_the_studio_only() {
    let scratch = Scratch::new();
    scratch.write("block.ply", &block(2.0, ""));
    let samples = |flags: &[&str]| {
        let flags = [flags, &["--write-scene", "s.json"]].concat();
        render(&scratch, "block.ply", &flags).good();
        let scene: Value = serde_json::from_slice(&scratch.read("s.json")).unwrap();
        let lights = scene["scene"]["lightsources"].as_array().unwrap();
        let lights = lights.iter().map(|light| light["samples"].as_u64().unwrap());
        (scene["spp"].as_u64().unwrap_or(1), lights.collect::<Vec<_>>())
    };
    assert_eq!(samples(&["--quality", "normal"]), samples(&[]));
    assert!(samples(&["--quality", "draft"]).0 < samples(&[]).0);
    assert_eq!(samples(&["--quality", "final", "--light-samples", "3"]), (16, vec![3, 3]));
    assert_eq!(samples(&["--quality", "final", "--spp", "2"]).0, 2);
    let refused = |input: &str, flags: &[&str]| {
        let done = render(&scratch, input, &[&["--quality", "draft"], flags].concat());
        assert!(done.code() == 2 && done.stderr().contains("--quality"), "{}", done.stderr());
    };
    refused("block.ply", &["--template", "s.json"]);
    refused("s.json", &[]);
}

#[test]
fn a_texture_by_flag_and_notes_without_one() {
    let scratch = Scratch::new();
    scratch.write("a.ply", &square(""));
    scratch.write("named.ply", &square("comment TextureFile i.ppm\n"));
    scratch.write("two.ply", &square("comment TextureFile i.ppm\ncomment TextureFile j.ppm\n"));
    scratch.write("i.ppm", IMAGE);
    let grey = render(&scratch, "a.ply", &[]).good();
    let note = "a.ply: found texture coordinates and no texture\n  help: show an image on it: --texture FILE";
    assert!(grey.stderr().contains(note), "{}", grey.stderr());
    let grey = scratch.channels("o.exr");
    let done = render(&scratch, "a.ply", &["--texture", "i.ppm"]).good();
    assert!(!done.stderr().contains("found texture"), "{}", done.stderr());
    let textured = scratch.channels("o.exr");
    let set = ["--set", "/scene/materials/subject/tPath=i.ppm"];
    let done = render(&scratch, "a.ply", &set).good();
    assert!(!done.stderr().contains("found texture"), "{}", done.stderr());
    assert!(textured != grey && textured == picture(&scratch, "named.ply", &[]));
    let done = render(&scratch, "two.ply", &[]).good();
    let note = "two.ply: found 2 texture files; only \"i.ppm\" is used";
    assert!(done.stderr().contains(note), "{}", done.stderr());
    assert!(scratch.channels("o.exr") == textured);
    // Also if the image is not where the mesh says.
    let header = "comment TextureFile tex/i.ppm\ncomment TextureFile tex/j.ppm\n";
    scratch.write("two.ply", &square(header));
    let said = render(&scratch, "two.ply", &[]).good().stderr();
    let several = note.replace("i.ppm", "tex/i.ppm");
    assert!(said.contains("; i.ppm is used") && said.contains(&several), "{said}");

    scratch.write("block.ply", &block(2.0, ""));
    let done = render(&scratch, "block.ply", &["--texture", "i.ppm"]);
    assert!(
        done.code() == 2 && done.stderr().contains("no texture coordinates"),
        "{}",
        done.stderr()
    );
    let set = "/scene/shapes/0/material/tPath=i.ppm";
    let done = render(&scratch, "a.ply", &["--set", set]);
    let help = "the material is named \"subject\": --set /scene/materials/subject/tPath=VALUE";
    assert!(done.code() == 2 && done.stderr().contains(help), "{}", done.stderr());
    render(&scratch, "a.ply", &["--set", "/scene/materials/subject/tPath=i.ppm"]).good();
    assert!(scratch.channels("o.exr") == textured);
}

#[test]
fn a_ground_across_another_axis_does_not_move_the_mesh() {
    let scratch = Scratch::new();
    scratch.write("cube.ply", &block(2.0, ""));
    let placed = |flags: &[&str]| {
        let said = render(&scratch, "cube.ply", flags).good().stderr();
        let scene: Value = serde_json::from_slice(&scratch.read("s.json")).unwrap();
        let center = numbers(&scene["scene"]["shapes"][0]["center"]);
        (center, said.contains("warning: /camera/up: found") && said.contains("--up "))
    };
    let write = ["--write-scene", "s.json"];
    let up = |up: &'static str| ["--set", up, write[0], write[1]];
    assert_eq!(placed(&write), (vec![0.0, 1.0002, 0.0], false));
    assert_eq!(placed(&up("/camera/up=[0.1,0,1]")), (vec![0.0, 0.0, 1.0002], true));
    assert_eq!(placed(&up("/camera/up=[1,0,0]")), (vec![1.0002, 0.0, 0.0], true));
}

/// The whole scene is turned about the camera's axis, so the picture stays.
#[test]
fn a_camera_upside_down_turns_the_mesh_as_well() {
    let scratch = Scratch::new();
    // A square of 2 x 2 and a point 3 above it, in z.
    let pyramid = "ply\nformat ascii 1.0\nelement vertex 5\nproperty float x\nproperty float y\n\
         property float z\nelement face 5\nproperty list uchar int vertex_indices\nend_header\n\
         -1 -1 0\n1 -1 0\n1 1 0\n-1 1 0\n0.5 -0.5 3\n\
         4 0 3 2 1\n3 0 1 4\n3 1 2 4\n3 2 3 4\n3 3 0 4\n";
    scratch.write("pyramid.ply", pyramid);
    let seen = |up: i32, axis: &str| {
        let scene = json!({
            "camera": { "type": "pinhole", "fov": 40, "position": [0, 0, 6], "lookat": [0, 0, -1], "up": [0, up, 0] },
            "scene": {
                "lightsources": [{ "type": "pointlight", "position": [0, 0, 9], "id": [1, 1, 1] }],
                "shapes": [{ "type": "trimesh", "path": "x.ply", "fit": 2, "material": { "kd": 1 } }] } });
        scratch.write("t.json", &scene.to_string());
        render(&scratch, "pyramid.ply", &["--template", "t.json", "--up", axis]).good();
        scratch.floats("o.exr")["G"].clone()
    };
    for axis in ["x", "y", "z"] {
        let pairs = seen(1, axis).into_iter().zip(seen(-1, axis));
        let different = pairs.filter(|(a, b)| (a - b).abs() > 1e-3 * (a + b)).count();
        // Rays along an edge may see either side of it.
        assert!(different < 100, "{axis}: {different}");
    }
}

#[test]
fn a_mesh_on_its_side_gives_a_note() {
    let scratch = Scratch::new();
    scratch.write("tall.ply", &block(6.0, ""));
    scratch.write("cube.ply", &block(2.0, ""));
    let says = |mesh: &str, flags: &[&str]| {
        let said = render(&scratch, mesh, flags).good().stderr();
        said.contains("lies on its side?") && said.contains("--up z")
    };
    assert!(says("tall.ply", &[]));
    assert!(!says("tall.ply", &["--up", "z"]) && !says("tall.ply", &["--up", "y"]));
    assert!(!says("tall.ply", &["--rotate", "0,90,0"]) && !says("cube.ply", &[]));
    // A template that turns its mesh, and one whose z points up.
    let template = |rotate: [i32; 3], up: [i32; 3], lookat: [i32; 3]| {
        let scene = json!({
            "camera": { "type": "pinhole", "fov": 40, "position": [0, 0, 0], "lookat": lookat, "up": up },
            "scene": { "shapes": [{ "type": "trimesh", "path": "cube.ply", "material": {}, "rotate": rotate }] } });
        scratch.write("t.json", &scene.to_string());
    };
    template([0, 0, 0], [0, 1, 0], [0, 0, -1]);
    assert!(says("tall.ply", &["--template", "t.json"]));
    template([-90, 0, 0], [0, 1, 0], [0, 0, -1]);
    assert!(!says("tall.ply", &["--template", "t.json"]));
    template([0, 0, 0], [0, 0, 1], [0, 1, 0]);
    assert!(!says("tall.ply", &["--template", "t.json"]));
}

/// Corners of the cube of side 2 around the middle of the studio, seen by the written scene.
fn corners_seen(scratch: &Scratch, flags: &[&str]) -> ([f64; 3], Vec<[f64; 2]>) {
    render(scratch, "block.ply", &[&["--write-scene", "w.json"], flags].concat()).good();
    let scene: Value = serde_json::from_slice(&scratch.read("w.json")).unwrap();
    let point = |value: &Value| DVec3::from_slice(&numbers(value));
    let (camera, mesh) = (&scene["camera"], &scene["scene"]["shapes"][0]);
    assert_eq!(mesh["type"], "trimesh");
    let position = point(&camera["position"]);
    let z = match camera.get("target") {
        Some(target) => point(target) - position,
        None => point(&camera["lookat"]),
    };
    let z = z.normalize();
    let x = z.cross(DVec3::Y).normalize();
    let y = x.cross(z);
    let slope = (camera["fov"].as_f64().unwrap().to_radians() / 2.0).tan();
    let corner = |i: u32| {
        let side = |bit: u32| if i >> bit & 1 == 1 { 1.0 } else { -1.0 };
        let d = point(&mesh["center"]) + DVec3::new(side(0), side(1), side(2)) - position;
        [d.dot(x) / d.dot(z) / slope, d.dot(y) / d.dot(z) / slope]
    };
    (position.to_array(), (0..8).map(corner).collect())
}

fn numbers(value: &Value) -> Vec<f64> {
    value.as_array().unwrap().iter().map(|number| number.as_f64().unwrap()).collect()
}

#[test]
fn a_target_or_position_of_the_user_is_kept() {
    let scratch = Scratch::new();
    scratch.write("block.ply", &block(2.0, ""));
    let largest = |seen: &[[f64; 2]]| seen.iter().flatten().fold(0.0, |a: f64, v| a.max(v.abs()));
    let (_, plain) = corners_seen(&scratch, &[]);
    // The default margin is 0.08 at each border.
    assert!((largest(&plain) - 0.84).abs() < 1e-3, "{plain:?}");
    let (_, seen) = corners_seen(&scratch, &["--set", "/camera/target=[1,1.5,0]"]);
    assert!((largest(&seen) - 0.84).abs() < 1e-3, "{seen:?}");
    // A template with a target: the user's position looks at it.
    scratch.write("cube.ply", &block(2.0, ""));
    let scene = json!({
        "camera": { "type": "pinhole", "fov": 40, "position": [0, 2, 6], "target": [0, 1, 0], "up": [0, 1, 0] },
        "scene": { "shapes": [{ "type": "trimesh", "path": "cube.ply", "material": {} }] } });
    scratch.write("t.json", &scene.to_string());
    let set = "/camera/position=[0,1,9]";
    let (position, seen) = corners_seen(&scratch, &["--template", "t.json", "--set", set]);
    assert_eq!(position, [0.0, 1.0, 9.0]);
    let scene: Value = serde_json::from_slice(&scratch.read("w.json")).unwrap();
    assert_eq!(numbers(&scene["camera"]["target"]), [0.0, 1.0, 0.0]);
    assert!(largest(&seen) < 1.0, "{seen:?}");
}

#[test]
fn a_texture_for_a_shared_material_is_refused() {
    let scratch = Scratch::new();
    scratch.write("a.ply", &square(""));
    scratch.write("i.ppm", IMAGE);
    let scene = json!({
        "camera": { "type": "pinhole", "fov": 40, "position": [0, 2, 6], "lookat": [0, 0, -1], "up": [0, 1, 0] },
        "scene": { "materials": { "clay": {} }, "shapes": [
            { "type": "sphere", "center": [0, 0, 0], "radius": 1, "material": "clay" },
            { "type": "trimesh", "path": "a.ply", "material": "clay" }] } });
    scratch.write("t.json", &scene.to_string());
    render(&scratch, "a.ply", &["--template", "t.json"]).good();
    let done = render(&scratch, "a.ply", &["--template", "t.json", "--texture", "i.ppm"]);
    let shared = "--texture: found the material \"clay\", which /scene/shapes/0 has, too";
    assert!(done.code() == 2 && done.stderr().contains(shared), "{}", done.stderr());
    // The materials are those after the overrides.
    let refused = |flags: &[&str], expected: &str| {
        let done = render(&scratch, "a.ply", &[&["--texture", "i.ppm"], flags].concat());
        assert!(done.code() == 2 && done.stderr().contains(expected), "{}", done.stderr());
    };
    let ground = |key: &str| format!("--set=/scene/shapes/1/{key}");
    refused(
        &[&ground("material=subject")],
        "found the material \"subject\", which /scene/shapes/1",
    );
    let other = "--set=/scene/shapes/0/material={}";
    render(&scratch, "a.ply", &["--template", "t.json", "--texture", "i.ppm", other]).good();
    render(&scratch, "a.ply", &["--texture", "i.ppm", &ground("material={}")]).good();
    refused(&["--points", "0.1"], "--texture: found with a.ply, which is shown as points");
}

#[test]
fn the_counts_are_those_of_the_mesh() {
    let scratch = Scratch::new();
    scratch.write("block.ply", &block(2.0, ""));
    let done = render(&scratch, "block.ply", &["--stats", "s.json"]).good();
    assert!(done.stderr().contains("12 triangles, "), "{}", done.stderr());
    let stats: Value = serde_json::from_slice(&scratch.read("s.json")).unwrap();
    assert_eq!(stats["triangles"], 12);
    assert!(scratch.run(&["info", "block.ply"]).good().stdout().contains("\n  12 triangles\n"));
    scratch.run(&["batch", "block.ply", "--size", "16x16", "-o", "out"]).good();
    let journal = String::from_utf8(scratch.read("out/batch.jsonl")).unwrap();
    assert!(journal.contains("\"triangles\":12,"), "{journal}");
    let page = String::from_utf8(scratch.read("out/index.html")).unwrap();
    assert!(page.contains("data-triangles=\"12\""));
}

#[test]
fn a_job_sets_the_look_of_meshes() {
    let scratch = Scratch::new();
    scratch.write("a.ply", &square(""));
    scratch.write("i.ppm", IMAGE);
    let job = r#"{ "inputs": ["a.ply"], "size": [48, 48], "texture": "i.ppm", "smooth": false, "ground": false,
                   "quality": "draft",
                   "output": { "folder": "out", "name": "{stem}" } }"#;
    scratch.write("job.json", job);
    scratch.run(&["batch", "job.json", "--quiet"]).good();
    let found = scratch.channels("out/a.exr");
    let flags = ["--texture", "i.ppm", "--smooth", "off", "--no-ground", "--quality", "draft"];
    assert!(found == picture(&scratch, "a.ply", &flags));
    scratch
        .run(
            &[&["batch", "a.ply", "--size", "48x48", "-o", "out", "--name", "b"], &flags[..]]
                .concat(),
        )
        .good();
    assert!(found == scratch.channels("out/b.exr"));
}

/// Five points with colours and a number.
const CLOUD: &str = "ply\nformat ascii 1.0\nelement vertex 5\nproperty float x\nproperty float y\n\
    property float z\nproperty uchar red\nproperty uchar green\nproperty uchar blue\n\
    property float quality\nend_header\n0 0 0 255 0 0 1\n1 0 0 0 255 0 2\n0 1 0 0 0 255 nan\n\
    0 0 1 255 255 0 4\n1 1 1 0 255 255 5\n";

#[test]
fn a_cloud_of_points_is_drawn_as_spheres_on_request() {
    let scratch = Scratch::new();
    scratch.write("c.ply", CLOUD);
    let done = render(&scratch, "c.ply", &[]);
    let help = "draw its points as spheres: --points RADIUS";
    assert!(done.code() == 2 && done.stderr().contains(help), "{}", done.stderr());
    for wrong in ["0", "-1"] {
        let done = render(&scratch, "c.ply", &["--points", wrong]);
        assert!(done.code() == 2 && done.stderr().contains("--points"), "{}", done.stderr());
    }
    let small = picture(&scratch, "c.ply", &["--points", "0.1", "--up", "y"]);
    let large = picture(&scratch, "c.ply", &["--points", "0.3", "--up", "y"]);
    assert!(small != large);
    let info = scratch.run(&["info", "--json", "c.ply"]).good().stdout();
    let info: Value = serde_json::from_str(&info).unwrap();
    assert_eq!((&info["points"], &info["colors_of"]), (&5.into(), &"vertex".into()));
    // A scene that is written shows the same.
    let flags = ["--points", "0.3", "--up", "y", "--write-scene", "s.json"];
    render(&scratch, "c.ply", &flags).good();
    scratch.run(&["render", "s.json", "-o", "o", "--quiet"]).good();
    assert!(scratch.channels("o.exr") == large);
}

#[test]
fn a_property_gets_a_legend() {
    let scratch = Scratch::new();
    scratch.write("c.ply", CLOUD);
    let flags = ["--points", "0.3", "--up", "y", "--color", "quality"];
    let done = render(&scratch, "c.ply", &flags).good();
    let note = "1 of 5 values of vertex.quality are not finite; they have the colour [1, 0, 1]";
    assert!(done.stderr().contains(note), "{}", done.stderr());
    let (exr, png) = (scratch.channels("o.exr"), scratch.read("o.png"));
    let done = render(&scratch, "c.ply", &[&flags[..], &["--legend"]].concat()).good();
    assert!(scratch.channels("o.exr") == exr, "the EXR has no legend");
    assert!(scratch.read("o.png") == png && done.stderr().contains("too small for the legend"));
    for (name, legend) in [("plain", &[][..]), ("o", &["--legend"])] {
        let large = ["render", "c.ply", "--size", "160x120", "--quiet", "-o", name];
        scratch.run(&[&large[..], &flags, legend].concat()).good();
    }
    assert!(scratch.channels("o.exr") == scratch.channels("plain.exr"));
    assert!(scratch.read("o.png") != scratch.read("plain.png"));
    let ranged = [&flags[..], &["--color-range", "-1,2", "--color-map", "magma"]].concat();
    render(&scratch, "c.ply", &ranged).good();
    assert!(scratch.channels("o.exr") != exr);
    for (flags, message) in [
        (
            &["--color", "qality", "--points", "1"][..],
            "--color: c.ply has no scalar property \"qality\"",
        ),
        (&["--color", "vertex", "--color-map", "magma"], "--color-map: found with --color vertex"),
        (&["--legend", "--points", "1"], "--legend: found true, but no mesh shows a property"),
        (&["--color-map", "magma"], "--color"),
        (&["--color", "quality", "--color-range", "1,1"], "expected two different numbers"),
    ] {
        let done = render(&scratch, "c.ply", flags);
        assert!(done.code() == 2 && done.stderr().contains(message), "{}", done.stderr());
    }
    let job = r#"{ "inputs": ["c.ply"], "size": [48, 48], "points": 0.3, "up": "y",
                   "color": { "property": "quality" }, "set": { "/output/legend": true },
                   "output": { "folder": "out", "name": "{stem}" } }"#;
    scratch.write("job.json", job);
    scratch.run(&["batch", "job.json", "--quiet"]).good();
    assert!(scratch.channels("out/c.exr") == exr);
}

/// A cloud of one point has no extent but that of its sphere, which fills the picture.
#[test]
fn a_single_point_is_a_sphere() {
    let scratch = Scratch::new();
    scratch.write("one.ply", POINT);
    picture(&scratch, "one.ply", &["--points", "0.01", "--transparent", "--no-ground"]);
    let covered: f32 = scratch.floats("o.exr")["A"].iter().sum();
    assert!((0.3..0.8).contains(&(covered / (48.0 * 48.0))), "{covered}");
}

/// The cube fills the picture up to the margin in one direction.
#[test]
fn a_margin_is_free_at_each_border() {
    let scratch = Scratch::new();
    scratch.write("block.ply", &block(2.0, ""));
    for (margin, half) in [("0", 1.0), ("0.25", 0.5), ("0.4", 0.2)] {
        let (_, seen) = corners_seen(&scratch, &["--margin", margin, "--spp", "1"]);
        let largest = seen.iter().flatten().fold(0.0, |a: f64, v| a.max(v.abs()));
        assert!((largest - half).abs() < 1e-3, "{margin}: {seen:?}");
    }
}
