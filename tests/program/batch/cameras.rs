//! Lists of cameras: every format gives the pictures whose points OpenCV projects to their pixels.

use glam::{DMat3, DQuat, DVec3};
use serde_json::{Value, json};

use crate::support::errors::worse;
use crate::support::program::{Done, POINT, PYRAMID, Scratch};

/// A picture of the lists: name, size, fx, fy, cx, cy from the corner of the picture, k1, k2, p1,
/// p2, and the pose.
struct View {
    name: &'static str,
    size: [usize; 2],
    focal: [f64; 2],
    corner: [f64; 2],
    lens: [f64; 4],
    rotation: DQuat,
    translation: DVec3,
}

fn views() -> [View; 3] {
    let view = |name, size: [usize; 2], lens, axis: DVec3, angle| View {
        name,
        size,
        focal: [size[0] as f64 * 1.1, size[0] as f64 * 1.05],
        corner: [size[0] as f64 / 2.0 + 1.25, size[1] as f64 / 2.0 - 0.5],
        lens,
        rotation: DQuat::from_axis_angle(axis.normalize(), angle),
        translation: DVec3::new(0.1, -0.2, 4.0),
    };
    [
        view("a.jpg", [40, 30], [-0.1, 0.02, 1e-3, -2e-3], DVec3::new(1.0, 0.3, 0.2), 2.8),
        view("left/b.png", [52, 24], [0.05, 0.0, 0.0, 1e-3], DVec3::new(0.2, 1.0, 0.1), 1.9),
        view("left/c d.png", [24, 28], [0.0; 4], DVec3::new(-0.5, 1.0, 0.4), 0.4),
    ]
}

impl View {
    /// Pixel of a point, by OpenCV's formulas.
    fn project(&self, p: DVec3) -> [f64; 2] {
        let q = DMat3::from_quat(self.rotation) * p + self.translation;
        let (x, y) = (q.x / q.z, q.y / q.z);
        let ([k1, k2, p1, p2], r2) = (self.lens, x * x + y * y);
        let radial = 1.0 + k1 * r2 + k2 * r2 * r2;
        let xd = x * radial + 2.0 * p1 * x * y + p2 * (r2 + 2.0 * x * x);
        let yd = y * radial + p1 * (r2 + 2.0 * y * y) + 2.0 * p2 * x * y;
        let pixel = |k: usize, d: f64| self.focal[k] * d + self.corner[k] - 0.5;
        [pixel(0, xd), pixel(1, yd)]
    }

    fn params(&self) -> Vec<f64> {
        [&self.focal[..], &self.corner, &self.lens].concat()
    }

    /// Rows of the matrix from camera to world, with OpenGL's axes.
    fn transform(&self) -> Vec<[f64; 4]> {
        let to_world = DMat3::from_quat(self.rotation).transpose();
        let position = -(to_world * self.translation);
        let row =
            |k: usize| [to_world.row(k).x, -to_world.row(k).y, -to_world.row(k).z, position[k]];
        vec![row(0), row(1), row(2), [0.0, 0.0, 0.0, 1.0]]
    }
}

fn cameras_txt() -> String {
    let line = |(i, view): (usize, &View)| {
        let params: Vec<String> = view.params().iter().map(f64::to_string).collect();
        format!("{} OPENCV {} {} {}\n", i + 5, view.size[0], view.size[1], params.join(" "))
    };
    format!("# cameras\n{}", views().iter().enumerate().map(line).collect::<String>())
}

fn images_txt() -> String {
    let line = |(i, view): (usize, &View)| {
        let ([x, y, z, w], t) = (view.rotation.to_array(), view.translation);
        let points = if i == 1 { "1.5 2.5 -1 3 4 7" } else { "" };
        format!("{i} {w} {x} {y} {z} {} {} {} {} {}\n{points}\n", t.x, t.y, t.z, i + 5, view.name)
    };
    // From the last to the first: pictures are sorted by name.
    format!("# images\n{}", views().iter().enumerate().rev().map(line).collect::<String>())
}

fn cameras_bin() -> Vec<u8> {
    let mut bytes = 3u64.to_le_bytes().to_vec();
    for (i, view) in views().iter().enumerate() {
        bytes.extend((i as u32 + 5).to_le_bytes());
        bytes.extend(4i32.to_le_bytes());
        view.size.iter().for_each(|side| bytes.extend((*side as u64).to_le_bytes()));
        view.params().iter().for_each(|p| bytes.extend(p.to_le_bytes()));
    }
    bytes
}

fn images_bin() -> Vec<u8> {
    let mut bytes = 3u64.to_le_bytes().to_vec();
    for (i, view) in views().iter().enumerate().rev() {
        let ([x, y, z, w], t) = (view.rotation.to_array(), view.translation);
        bytes.extend((i as u32).to_le_bytes());
        [w, x, y, z, t.x, t.y, t.z].iter().for_each(|p| bytes.extend(p.to_le_bytes()));
        bytes.extend((i as u32 + 5).to_le_bytes());
        bytes.extend(view.name.as_bytes());
        bytes.push(0);
        bytes.extend((i as u64).to_le_bytes());
        bytes.extend(vec![7; 24 * i]);
    }
    bytes
}

fn transforms() -> Value {
    let frame = |view: &View| {
        let [k1, k2, p1, p2] = view.lens;
        json!({ "file_path": format!("./{}", view.name), "transform_matrix": view.transform(),
            "w": view.size[0], "h": view.size[1], "fl_x": view.focal[0], "fl_y": view.focal[1],
            "cx": view.corner[0], "cy": view.corner[1], "k1": k1, "k2": k2, "p1": p1, "p2": p2,
            "sharpness": 3 })
    };
    let frames: Vec<Value> = views().iter().map(frame).collect();
    json!({ "camera_model": "OPENCV", "aabb_scale": 16, "frames": frames })
}

fn own_list() -> Value {
    let camera = |view: &View| {
        let [k1, k2, p1, p2] = view.lens;
        json!({ "image": view.name, "camera": { "type": "intrinsics", "width": view.size[0],
            "height": view.size[1], "fx": view.focal[0], "fy": view.focal[1],
            "cx": view.corner[0] - 0.5, "cy": view.corner[1] - 0.5, "axes": "opengl",
            "camera_to_world": view.transform(),
            "distortion": { "type": "brownconrady", "k1": k1, "k2": k2, "p1": p1, "p2": p2 } } })
    };
    json!({ "cameras": views().iter().map(camera).collect::<Vec<_>>() })
}

fn scratch() -> Scratch {
    let scratch = Scratch::new();
    scratch.write("scan.ply", PYRAMID);
    scratch.write("text/cameras.txt", &cameras_txt());
    scratch.write("text/images.txt", &images_txt());
    std::fs::create_dir(scratch.path("binary")).unwrap();
    std::fs::write(scratch.path("binary/cameras.bin"), cameras_bin()).unwrap();
    std::fs::write(scratch.path("binary/images.bin"), images_bin()).unwrap();
    scratch.write("transforms.json", &transforms().to_string());
    scratch.write("list.json", &own_list().to_string());
    scratch
}

fn batch(scratch: &Scratch, list: &str, more: &[&str]) -> Done {
    let args =
        ["batch", "scan.ply", "--cameras", list, "--aov", "P,primid", "--spp", "1", "--quiet"];
    scratch.run(&[&args, more].concat())
}

/// Names of the pictures without their endings.
const NAMES: [&str; 3] = ["a", "left/b", "left/c d"];

#[test]
fn every_format_gives_pictures_whose_points_project_to_their_pixels() {
    let scratch = scratch();
    for list in ["text", "binary/images.bin", "transforms.json", "list.json"] {
        batch(&scratch, list, &["-o", "out"]).good();
        for (view, name) in views().iter().zip(NAMES) {
            let file = format!("out/scan/{name}.exr");
            let floats = scratch.floats(&file);
            let [width, height] = view.size;
            assert_eq!(floats["P.X"].len(), width * height, "{list} {name}");
            let (mut hits, mut worst) = (0, 0.0f64);
            for pixel in 0..width * height {
                let p = ["P.X", "P.Y", "P.Z"].map(|c| f64::from(floats[c][pixel]));
                // The pyramid does not touch the origin.
                if p == [0.0; 3] {
                    continue;
                }
                hits += 1;
                let [u, v] = view.project(DVec3::from(p));
                worst = worse(worst, (u - (pixel % width) as f64).abs());
                worst = worse(worst, (v - (pixel / width) as f64).abs());
            }
            assert!(hits > 30 && hits < width * height, "{list} {name}: {hits}");
            assert!(worst < 1e-3, "{list} {name}: {worst}");
        }
        std::fs::remove_dir_all(scratch.path("out")).unwrap();
    }
}

/// Renders the mesh from two lists of cameras that name the same lenses, and compares the pictures.
#[track_caller]
fn same_pictures(scratch: &Scratch, lists: [&str; 2], names: &[&str]) {
    for (list, out) in lists.into_iter().zip(["one", "other"]) {
        batch(scratch, list, &["-o", out, "--no-sheet"]).good();
    }
    for name in names {
        let [one, other] =
            ["one", "other"].map(|out| scratch.channels(&format!("{out}/scan/{name}.exr")));
        assert!(one == other, "{name}");
    }
}

#[test]
fn every_model_of_colmap_has_its_own_parameters() {
    let scratch = scratch();
    let lens = [0.05, -0.02, 0.004, -0.003, 0.006, 0.01, 0.02, 0.03];
    let brown = ["k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6"];
    let fisheye = ["k1", "k2", "k3", "k4"];
    // Name, number of focal lengths, coefficients.
    let models: [(&str, usize, &[&str]); 9] = [
        ("SIMPLE_PINHOLE", 1, &[]),
        ("PINHOLE", 2, &[]),
        ("SIMPLE_RADIAL", 1, &brown[..1]),
        ("RADIAL", 1, &brown[..2]),
        ("OPENCV", 2, &brown[..4]),
        ("FULL_OPENCV", 2, &brown),
        ("SIMPLE_RADIAL_FISHEYE", 1, &fisheye[..1]),
        ("RADIAL_FISHEYE", 1, &fisheye[..2]),
        ("OPENCV_FISHEYE", 2, &fisheye),
    ];
    let (mut cameras, mut images, mut own) = (String::new(), String::new(), Vec::new());
    for (i, (model, count, names)) in models.into_iter().enumerate() {
        let focal = [20.0, 21.0];
        let params = [&focal[..count], &[16.5, 11.25][..], &lens[..names.len()]].concat();
        let params: Vec<String> = params.iter().map(f64::to_string).collect();
        cameras += &format!("{i} {model} 32 24 {}\n", params.join(" "));
        images += &format!("{i} 0 1 0 0 0.1 0.2 4 {i} {model}.png\n\n");
        let mut camera = json!({ "type": "intrinsics", "width": 32, "height": 24,
            "fx": focal[0], "fy": focal[count - 1], "cx": 16.0, "cy": 10.75,
            "world_to_camera": [[1, 0, 0, 0.1], [0, -1, 0, 0.2], [0, 0, -1, 4], [0, 0, 0, 1]] });
        if !names.is_empty() {
            let kind = if model.ends_with("FISHEYE") { "fisheye" } else { "brownconrady" };
            camera["distortion"] = json!({ "type": kind });
        }
        for (name, value) in names.iter().zip(lens) {
            camera["distortion"][*name] = json!(value);
        }
        own.push(json!({ "image": format!("{model}.png"), "camera": camera }));
    }
    scratch.write("models/cameras.txt", &cameras);
    scratch.write("models/images.txt", &images);
    scratch.write("own.json", &json!({ "cameras": own }).to_string());
    same_pictures(&scratch, ["models", "own.json"], &models.map(|(model, ..)| model));
}

/// A key of a frame wins over the same key of the file.
#[test]
fn lenses_of_transforms_are_those_of_opencv() {
    let scratch = scratch();
    let view = &views()[2];
    let with = |mut all: Value, more: Value| {
        all.as_object_mut().unwrap().extend(more.as_object().unwrap().clone());
        all
    };
    let frame = |name: &str, more: Value| {
        let all =
            json!({ "file_path": name, "transform_matrix": view.transform(), "w": 24, "h": 28 });
        with(all, more)
    };
    let bent = json!({ "is_fisheye": true, "k2": -0.01, "k3": 0.02, "k4": 0.03 });
    let list = json!({ "fl_x": 26, "k1": 0.05, "frames": [
        frame("file.png", json!({})),
        frame("frame.png", json!({ "fl_x": 30, "k1": 0.02, "k3": 0.01 })),
        frame("flag.png", bent),
        frame("model.png", json!({ "camera_model": "OPENCV_FISHEYE", "fl_y": 27 })) ] });
    scratch.write("lenses.json", &list.to_string());
    let own = |name: &str, [fx, fy]: [u32; 2], distortion: Value| {
        json!({ "image": name, "camera": { "type": "intrinsics", "width": 24, "height": 28,
            "fx": fx, "fy": fy, "cx": 11.5, "cy": 13.5, "axes": "opengl",
            "camera_to_world": view.transform(), "distortion": distortion } })
    };
    let (brown, fisheye) = (json!({ "type": "brownconrady" }), json!({ "type": "fisheye" }));
    let all = json!({ "k1": 0.05, "k2": -0.01, "k3": 0.02, "k4": 0.03 });
    let list = [
        own("file", [26, 26], with(brown.clone(), json!({ "k1": 0.05 }))),
        own("frame", [30, 30], with(brown, json!({ "k1": 0.02, "k3": 0.01 }))),
        own("flag", [26, 26], with(fisheye.clone(), all)),
        own("model", [26, 27], with(fisheye, json!({ "k1": 0.05 }))),
    ];
    scratch.write("own.json", &json!({ "cameras": list }).to_string());
    let names = ["file", "frame", "flag", "model"];
    same_pictures(&scratch, ["lenses.json", "own.json"], &names);
}

/// Pictures of 40 x 30, 52 x 24 and 24 x 28 pixels are shown in cells of 52 x 30.
#[test]
fn the_contact_sheet_shows_pictures_of_several_sizes() {
    let scratch = scratch();
    batch(&scratch, "list.json", &["-o", "out"]).good();
    let page = String::from_utf8(scratch.read("out/index.html")).unwrap();
    assert!(page.contains("data-count=\"3\" style=\"aspect-ratio:52/30\""), "{page}");
}

#[test]
fn undistorted_pictures_leave_the_lens_out() {
    let scratch = scratch();
    batch(&scratch, "text", &["-o", "flat", "--undistort", "--name", "{image}-{frame:02}"]).good();
    let (view, name) = (&views()[1], "flat/left/b-01.exr");
    let floats = scratch.floats(name);
    let flat = View { lens: [0.0; 4], ..views().into_iter().nth(1).unwrap() };
    let off = |view: &View| {
        let pixels = (0..floats["P.X"].len()).filter(|&pixel| floats["P.Z"][pixel] != 0.0);
        let away = pixels.map(|pixel| {
            let p = ["P.X", "P.Y", "P.Z"].map(|c| f64::from(floats[c][pixel]));
            (view.project(DVec3::from(p))[0] - (pixel % 52) as f64).abs()
        });
        away.fold(0.0, worse)
    };
    assert!(off(&flat) < 1e-3 && off(view) > 0.01, "{} {}", off(&flat), off(view));
}

#[test]
fn ranges_resume_and_lists_of_frames_count_cameras() {
    let scratch = scratch();
    let listed = batch(&scratch, "list.json", &["--dry-run"]).good().stdout();
    assert_eq!(listed.lines().count(), 3);
    assert!(listed.contains("out/scan/left/b.exr"), "{listed}");
    batch(&scratch, "list.json", &["--range", "1..2"]).good();
    assert!(
        scratch.path("out/scan/left/b.exr").exists() && !scratch.path("out/scan/a.exr").exists()
    );
    let args = ["batch", "scan.ply", "--cameras", "list.json", "--aov", "P,primid", "--spp", "1"];
    let again = scratch.run(&[&args[..], &["--resume"]].concat()).good().stderr();
    assert!(again.contains("2 frames rendered, 1 kept"), "{again}");
    let job = json!({ "inputs": ["scan.ply"], "cameras": "list.json", "layers": ["P", "primid"],
                      "set": { "/spp": 1 } });
    scratch.write("job.json", &job.to_string());
    let again = scratch.run(&["batch", "job.json", "--resume"]).good().stderr();
    assert!(again.contains("0 frames rendered, 3 kept"), "{again}");
}

/// A mesh that any camera of the list sees is not outside of the view.
#[test]
fn a_mesh_that_no_camera_sees_is_told() {
    let scratch = scratch();
    for (away, told) in [(1, false), (3, true)] {
        let mut list = own_list();
        let cameras = list["cameras"].as_array_mut().unwrap();
        for camera in cameras.iter_mut() {
            camera["camera"].as_object_mut().unwrap().remove("distortion");
        }
        for camera in &mut cameras[..away] {
            // It looks along -z.
            camera["camera"]["camera_to_world"] =
                json!([[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, -50], [0, 0, 0, 1]]);
        }
        scratch.write("away.json", &list.to_string());
        let args = ["batch", "scan.ply", "--cameras", "away.json", "--spp", "1", "-o", "away"];
        let said = scratch.run(&args).good().stderr();
        assert_eq!(said.contains("lies outside the view of all 3 cameras"), told, "{said}");
        assert_eq!(said.contains("lies outside"), told, "{said}");
    }
}

/// The points are in a hole of the file. Nothing reads them.
#[test]
fn a_model_may_have_more_points_than_memory() {
    let scratch = scratch();
    let bytes = images_bin();
    // The last picture has no points.
    let (all, count) = bytes.split_at(bytes.len() - 8);
    assert_eq!(count, 0u64.to_le_bytes());
    let points = (1u64 << 36) / 24;
    std::fs::write(scratch.path("binary/images.bin"), [all, &points.to_le_bytes()].concat())
        .unwrap();
    let file =
        std::fs::File::options().append(true).open(scratch.path("binary/images.bin")).unwrap();
    file.set_len(bytes.len() as u64 + 24 * points).unwrap();
    batch(&scratch, "binary", &["-o", "out"]).good();
    assert!(scratch.path("out/scan/a.exr").is_file());
}

#[test]
fn shapes_keep_their_materials_in_any_order() {
    let scratch = Scratch::new();
    let camera = json!({ "type": "pinhole", "width": 48, "height": 16, "fov": 40,
        "position": [0, 0, 6], "target": [0, 0, 0], "up": [0, 1, 0] });
    let ball = |x: f64, material: Value| json!({ "type": "sphere", "center": [x, 0, 0], "radius": 0.8, "material": material });
    let paint = |color: [f64; 3]| json!({ "ka": 1, "diffusecolor": color });
    scratch.write(
        "balls.json",
        &json!({ "camera": camera.clone(), "scene": { "ambient": [1, 1, 1], "lightsources": [],
            "materials": { "c": paint([1.0, 0.0, 0.0]), "a": paint([0.0, 1.0, 0.0]),
                "b": paint([0.0, 0.0, 1.0]) },
            "shapes": [ball(-2.0, json!("c")), ball(0.0, paint([1.0, 1.0, 0.0])),
                ball(2.0, json!("a")), ball(4.0, json!("b"))] } })
        .to_string(),
    );
    scratch.write(
        "list.json",
        &json!({ "cameras": [{ "image": "x.png", "camera": camera }] }).to_string(),
    );
    scratch.run(&["render", "balls.json", "-o", "alone"]).good();
    scratch.run(&["batch", "balls.json", "--cameras", "list.json", "-o", "out"]).good();
    scratch.run(&["compare", "alone.exr", "out/balls/x.exr", "--fail-above", "max=0"]).good();
}

/// The pictures of a list have names, not numbers.
#[test]
fn a_frame_stays_when_others_join_its_list() {
    let scratch = scratch();
    let mut list = own_list();
    let cameras = list["cameras"].as_array_mut().unwrap();
    let first = cameras.remove(0);
    scratch.write("some.json", &json!({ "cameras": cameras.clone() }).to_string());
    cameras.insert(0, first);
    scratch.write("all.json", &list.to_string());
    let run = |list: &str| {
        let args = ["batch", "scan.ply", "--cameras", list, "--spp", "1", "--resume"];
        scratch.run(&args).good().stderr()
    };
    run("some.json");
    let said = run("all.json");
    assert!(said.contains("1 frame rendered, 2 kept"), "{said}");
    for name in NAMES {
        let path = scratch.path(&format!("out/scan/{name}.exr"));
        let meta = exr::meta::MetaData::read_from_file(path, false).unwrap();
        let other = &meta.headers[0].own_attributes.other;
        assert!(!other.iter().any(|(name, _)| *name == *"imageCounter"), "{name}");
    }
    assert!(run("all.json").contains("0 frames rendered, 3 kept"));
}

#[test]
fn a_camera_without_pictures_may_have_any_model() {
    let scratch = scratch();
    let text = cameras_txt() + "9 RAD_TAN_THIN_PRISM_FISHEYE 8 8 1 2\n";
    scratch.write("text/cameras.txt", &text);
    let mut binary = cameras_bin();
    binary[0] = 4;
    for (number, model) in [(9u32, 7i32), (8, 11)] {
        let words = if model == 7 { 7 } else { 18 };
        binary.splice(8..8, vec![0; 8 * words]);
        binary.splice(8..8, [number.to_le_bytes(), model.to_le_bytes()].concat());
    }
    binary[0] = 5;
    std::fs::write(scratch.path("binary/cameras.bin"), binary).unwrap();
    for list in ["text", "binary"] {
        batch(&scratch, list, &["--dry-run"]).good();
    }
}

/// Only the cameras of frames that are rendered are checked.
#[test]
fn a_bad_camera_outside_of_the_range_is_no_error() {
    let scratch = scratch();
    scratch.write("other.ply", PYRAMID);
    let mut list = own_list();
    list["cameras"][1]["camera"]["distortion"]["k1"] = json!(-9);
    scratch.write("list.json", &list.to_string());
    for (range, code) in
        [("0..1", 0), ("1..2", 2), ("2..4", 0), ("0..3", 2), ("5..6", 0), ("3..5", 2)]
    {
        let done = batch(&scratch, "list.json", &["other.ply", "--range", range]);
        assert_eq!(done.code(), code, "{range}: {}", done.stderr());
    }
    assert!(scratch.path("out/scan/left/c d.exr").is_file());
    assert!(scratch.path("out/other/left/c d.exr").is_file());
}

/// The first camera has more pixels than are allowed; its film would take 745 GiB.
#[test]
fn a_large_camera_outside_of_the_range_takes_no_memory() {
    let scratch = scratch();
    let mut list = own_list();
    for side in ["width", "height"] {
        list["cameras"][0]["camera"][side] = json!(200_000);
    }
    scratch.write("list.json", &list.to_string());
    for (range, code) in [("1..3", 0), ("0..1", 2)] {
        let more = ["--range", range, "--max-memory", "64G"];
        let done = batch(&scratch, "list.json", &more);
        assert_eq!(done.code(), code, "{range}: {}", done.stderr());
    }
}

#[test]
fn flags_of_turntables_and_framing_are_refused() {
    let scratch = scratch();
    let shape = json!({ "type": "trimesh", "path": "scan.ply", "material": {} });
    let template = json!({ "camera": { "type": "pinhole", "width": 8, "height": 8, "fov": 40,
        "position": [0, 0, 6], "target": [0, 0, 0], "up": [0, 1, 0] }, "scene": { "shapes": [shape] } });
    scratch.write("template.json", &template.to_string());
    let refused = |more: &[&str], part: &str| {
        let done = batch(&scratch, "list.json", &[&["--dry-run"], more].concat());
        assert_eq!(done.code(), 2, "{more:?}: {}", done.stderr());
        assert!(done.stderr().contains(part), "{more:?}: {}", done.stderr());
    };
    for flag in
        [["--pivot", "0,0,0"], ["--start", "9"], ["--turn", "camera"], ["--lights", "object"]]
    {
        refused(&flag, &format!("'--cameras <FILE>' cannot be used with '{} ", flag[0]));
    }
    refused(&["--margin", "0.2"], "margin: found with a list of cameras");
    let placed = "found with a list of cameras and a template";
    for flag in [["--up", "z"], ["--rotate", "0,0,9"]] {
        batch(&scratch, "list.json", &[&["--dry-run"], &flag[..]].concat()).good();
        refused(&[&["--template", "template.json"], &flag[..]].concat(), placed);
    }
    let mut job = json!({ "inputs": [{ "path": "scan.ply", "up": "z" }], "cameras": "list.json" });
    scratch.write("job.json", &job.to_string());
    scratch.run(&["batch", "job.json", "--dry-run"]).good();
    job["template"] = json!("template.json");
    scratch.write("job.json", &job.to_string());
    let done = scratch.run(&["batch", "job.json", "--dry-run"]);
    assert!(done.code() == 2 && done.stderr().contains("(/inputs/0/up): "), "{}", done.stderr());
}

#[test]
fn bad_lists_are_refused_with_their_place() {
    let scratch = scratch();
    let refused = |list: &str, more: &[&str], parts: &[&str]| {
        let done = batch(&scratch, list, more);
        assert_eq!(done.code(), 2, "{list}: {}", done.stderr());
        for part in parts {
            assert!(done.stderr().contains(part), "{part:?} is not in {}", done.stderr());
        }
        assert!(!scratch.path("out").exists());
    };
    refused("none", &[], &["none: found no such file"]);
    refused("scan.ply", &[], &["found no ", "cameras.txt, expected a COLMAP model"]);
    refused("text", &["--size", "8x8"], &["camera: found with a list of cameras"]);
    refused("text", &["--name", "{imgae}"], &["{imgae}", "did you mean `image`?"]);
    refused("text", &["--name", "same"], &["found \"same\" for 3 frames"]);
    let done = scratch.run(&["batch", "scan.ply", "--name", "{image}"]);
    assert!(
        done.code() == 2 && done.stderr().contains("{image} without a list"),
        "{}",
        done.stderr()
    );

    let text = |name: &str, from: &str, to: &str, parts: &[&str]| {
        scratch.write("bad/cameras.txt", &cameras_txt());
        scratch.write("bad/images.txt", &images_txt());
        let whole = String::from_utf8(scratch.read(&format!("bad/{name}"))).unwrap();
        assert!(whole.contains(from), "{from:?} is not in {whole}");
        scratch.write(&format!("bad/{name}"), &whole.replacen(from, to, 1));
        refused("bad", &[], parts);
    };
    text(
        "cameras.txt",
        "5 OPENCV",
        "5 OPENCVV",
        &["bad/cameras.txt:2: ", "did you mean `OPENCV`?"],
    );
    text("cameras.txt", "5 OPENCV", "5 FOV", &["\"FOV\"", "SIMPLE_RADIAL_FISHEYE"]);
    text(
        "cameras.txt",
        "40 30 44",
        "40 30",
        &["cameras.txt:2: found the end of the line, expected 8"],
    );
    text("cameras.txt", "40 30 44", "40 30 nan", &["found NaN, expected 8 parameters of OPENCV"]);
    text("cameras.txt", "40 30 44", "40 30 -44", &["images.txt:", "(/camera/fx): found -44"]);
    text("cameras.txt", "5 OPENCV 40", "5 OPENCV 0", &["(/camera/width): found 0"]);
    text("cameras.txt", "-0.1 0.02", "-9 0.02", &["(/camera/distortion/k1): ", "folds inside"]);
    text("cameras.txt", "\n6 OPENCV", "\n5 OPENCV", &["txt:3: found camera 5 a second time"]);
    text(
        "images.txt",
        "7 left/c d.png",
        "8 left/c d.png",
        &["images.txt:2: ", "of camera 8", "5, 6, 7"],
    );
    text("images.txt", "7 left/c d.png", "7", &["expected the name of a picture"]);
    text("images.txt", "left/b.png", "../b.png", &["\"../b.png\"", "stays in its folder"]);
    text("images.txt", "left/b.png", "a.png", &["would both be written", "'{stem}/{frame:04}'"]);

    // Three words of a name and nine numbers look like four points.
    text("images.txt", "1.5 2.5 -1 3 4 7", "1.5 2.5 -1 3 four 7", &["three numbers each"]);

    let cut = |name: &str, bytes: &[u8], parts: &[&str]| {
        std::fs::create_dir_all(scratch.path("cut")).unwrap();
        std::fs::write(scratch.path("cut/cameras.bin"), cameras_bin()).unwrap();
        std::fs::write(scratch.path("cut/images.bin"), images_bin()).unwrap();
        std::fs::write(scratch.path(&format!("cut/{name}")), bytes).unwrap();
        refused("cut", &[], parts);
    };
    let (cameras, images) = (cameras_bin(), images_bin());
    for bytes in [&cameras[..cameras.len() - 1], &cameras[..30], &cameras[..3]] {
        cut("cameras.bin", bytes, &["cut/cameras.bin: byte ", "the file is cut short"]);
    }
    for length in [images.len() - 1, images.len() - 30, 80, 9] {
        cut("images.bin", &images[..length], &["cut/images.bin: byte ", "the file is cut short"]);
    }
    cut("cameras.bin", &[&cameras[..], &[0]].concat(), &["1 byte after the last entry"]);
    let mut many = images.clone();
    many[..8].copy_from_slice(&u64::MAX.to_le_bytes());
    cut("images.bin", &many, &["the file is cut short"]);
    let mut fov = cameras.clone();
    fov[12] = 7;
    // It has 5 parameters instead of 8.
    fov.drain(72..96);
    let mut twice = cameras.clone();
    twice[96] = 5;
    cut("cameras.bin", &twice, &["byte 96: found camera 5 a second time"]);
    cut(
        "cameras.bin",
        &fov,
        &["byte 12: found the camera model 7, expected one of 0 SIMPLE_PINHOLE"],
    );

    let json = |list: Value, parts: &[&str]| {
        scratch.write("bad.json", &list.to_string());
        refused("bad.json", &[], parts);
    };
    json(json!({ "images": [] }), &["bad.json: found neither `cameras` nor `frames`"]);
    json(json!({ "cameras": [] }), &["found no camera, expected at least one"]);
    let with = |mut list: Value, pointer: &str, value: Value| {
        *list.pointer_mut(pointer).unwrap() = value;
        list
    };
    json(with(transforms(), "/frames/1/fl_x", json!("x")), &["/frames/1/fl_x", "found \"x\""]);
    json(with(transforms(), "/frames/1/w", json!(1.5)), &["/frames/1/w", "found 1.5"]);
    json(with(transforms(), "/frames/1/w", json!(-4)), &["/frames/1/w", "found -4"]);
    let matrix = "/frames/0/transform_matrix";
    json(with(transforms(), matrix, json!([1, 2])), &[matrix, "4 rows of 4 numbers"]);
    json(with(transforms(), &format!("{matrix}/0/0"), json!(9)), &["no rotation"]);
    let longer = json!([1, null, 0, 0, 5]);
    let row = format!("{matrix}/0");
    json(with(transforms(), &row, longer), &[&row, "a row of 4 numbers"]);
    json(with(transforms(), "/camera_model", json!("FOV")), &["(/camera_model): found \"FOV\""]);
    json(with(own_list(), "/cameras/2/camera/axes", json!("up")), &["/cameras/2/camera/axes"]);
    let folded = with(own_list(), "/cameras/0/camera/distortion/k1", json!(-9));
    json(folded, &["k1", "folds inside"]);
}

/// NeRF's files have one angle, no size and no endings.
#[test]
fn names_of_pictures_count_only_where_they_name_frames() {
    let scratch = scratch();
    let mut own = own_list();
    own["cameras"][1]["image"] = json!("../b.png");
    let mut nerf = transforms();
    nerf["frames"][1]["file_path"] = json!("../b.png");
    for (list, pointer) in [(own, "(/cameras/1/image)"), (nerf, "(/frames/1/file_path)")] {
        scratch.write("up.json", &list.to_string());
        let done = batch(&scratch, "up.json", &["--dry-run"]);
        assert_eq!(done.code(), 2, "{}", done.stderr());
        for part in [pointer, "found the picture \"../b.png\"", "--name '{stem}/{frame:04}'"] {
            assert!(done.stderr().contains(part), "{}", done.stderr());
        }
        let named = batch(&scratch, "up.json", &["--name", "{stem}/{frame:04}", "--dry-run"]);
        assert_eq!(named.good().stdout().lines().count(), 3);
    }
}

#[test]
fn sizes_come_from_pictures_where_the_list_has_none() {
    let scratch = scratch();
    let view = &views()[2];
    let angle = 2.0 * (12.0 / view.focal[0]).atan();
    let list = json!({ "camera_angle_x": angle, "frames": [
        { "file_path": "train/r_0", "rotation": 0.01, "transform_matrix": view.transform() }] });
    scratch.write("nerf.json", &list.to_string());
    let done = batch(&scratch, "nerf.json", &[]);
    assert!(done.code() == 2 && done.stderr().contains("missing key `w`"), "{}", done.stderr());
    write_picture(&scratch, [24, 28]);
    batch(&scratch, "nerf.json", &[]).good();
    let floats = scratch.floats("out/scan/train/r_0.exr");
    assert_eq!(floats["P.X"].len(), 24 * 28);
    let square = View {
        corner: [12.0, 14.0],
        focal: [view.focal[0]; 2],
        ..views().into_iter().nth(2).unwrap()
    };
    for pixel in (0..24 * 28).filter(|&pixel| floats["P.Z"][pixel] != 0.0) {
        let p = ["P.X", "P.Y", "P.Z"].map(|c| f64::from(floats[c][pixel]));
        let [u, v] = square.project(DVec3::from(p));
        let (i, j) = ((pixel % 24) as f64, (pixel / 24) as f64);
        assert!((u - i).abs() < 1e-3 && (v - j).abs() < 1e-3, "{u} {v} at {i} {j}");
    }
}

/// Writes `train/r_0.png`.
fn write_picture(scratch: &Scratch, [width, height]: [u32; 2]) {
    scratch.write("train/x", "");
    let file = std::fs::File::create(scratch.path("train/r_0.png")).unwrap();
    let mut encoder = png::Encoder::new(file, width, height);
    encoder.set_color(png::ColorType::Grayscale);
    let pixels = vec![0; (width * height) as usize];
    encoder.write_header().unwrap().write_image_data(&pixels).unwrap();
}

#[test]
fn a_picture_of_another_size_than_its_calibration_is_refused() {
    let scratch = scratch();
    write_picture(&scratch, [24, 28]);
    let with = |more: Value| {
        let mut list = json!({ "fl_x": 30, "frames": [{ "file_path": "train/r_0.png",
            "transform_matrix": views()[2].transform() }] });
        list.as_object_mut().unwrap().extend(more.as_object().unwrap().clone());
        scratch.write("list.json", &list.to_string());
        batch(&scratch, "list.json", &[])
    };
    with(json!({ "w": 24, "h": 28, "cx": 40 })).good();
    with(json!({ "cx": 24, "cy": 0 })).good();
    std::fs::remove_dir_all(scratch.path("out")).unwrap();
    for (more, expected) in [
        (json!({ "w": 48, "h": 56 }), "(/w): found 48 x 56, but train/r_0.png is 24 x 28"),
        (json!({ "cx": 24.5 }), "(/cx): found 24.5, outside of train/r_0.png, which is 24 x 28"),
        (json!({ "cy": -1 }), "(/cy): found -1, outside of train/r_0.png, which is 24 x 28"),
    ] {
        let done = with(more);
        assert!(done.code() == 2 && done.stderr().contains(expected), "{}", done.stderr());
        assert!(!scratch.path("out").exists());
    }
}

/// Two cameras: one above the middle of the pyramid's base, from below, and one from the side.
fn two_poses() -> Value {
    let camera = |position: [f64; 3], lookat: [f64; 3], up: [f64; 3]| {
        json!({ "type": "pinhole", "width": 80, "height": 60, "fov": 50, "position": position,
                "lookat": lookat, "up": up })
    };
    let below = camera([0.0, -5.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]);
    let beside = camera([0.0, 0.2, 6.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]);
    json!({ "cameras": [{ "image": "below.png", "camera": below },
                        { "image": "beside", "camera": beside }] })
}

#[test]
fn info_says_how_much_of_the_mesh_each_camera_sees() {
    let scratch = scratch();
    scratch.write("two.json", &two_poses().to_string());
    let run = scratch.run(&["info", "scan.ply", "--cameras", "two.json", "--json"]);
    let facts: Value = serde_json::from_str(&run.good().stdout()).unwrap();
    let cameras = facts["cameras"].as_array().unwrap();
    assert_eq!(cameras[0]["image"], "below");
    assert_eq!(cameras[0]["size"], json!([80, 60]));
    // The base is a square of two triangles. Each of the four sides is a triangle with base 2.
    let triangles = facts["triangles"].as_u64().unwrap() as f64;
    assert_eq!(cameras[0]["visible_faces"], 2);
    assert_eq!(cameras[1]["visible_faces"], 1);
    let share = |camera: &Value, key: &str| camera[key].as_f64().unwrap();
    assert!((share(&cameras[0], "faces") - 2.0 / triangles).abs() < 1e-12);
    // The apex is 2 above the base, so the height of a side is the root of 5.
    let side = 5f64.sqrt();
    let whole = 4.0 + 4.0 * side;
    assert!((share(&cameras[0], "area") - 4.0 / whole).abs() < 1e-6, "{facts}");
    assert!((share(&cameras[1], "area") - side / whole).abs() < 1e-6, "{facts}");
    assert!((share(&facts["seen"], "area") - (4.0 + side) / whole).abs() < 1e-6);
    // The directions are at right angles.
    let poses = &facts["poses"];
    assert_eq!(poses["count"], 2);
    assert_eq!(poses["bounds"], json!([[0.0, -5.0, 0.0], [0.0, 0.2, 6.0]]));
    assert!((poses["widest_angle"].as_f64().unwrap() - 45.0).abs() < 1e-9);
    let focal = 30.0 / 25f64.to_radians().tan();
    assert!((poses["focal_length"][0].as_f64().unwrap() - focal).abs() < 1e-9);

    let text = scratch.run(&["info", "scan.ply", "--cameras", "text"]).good().stdout();
    assert!(text.contains("3 cameras, between") && text.contains("left/c d: 24 x 28"), "{text}");

    scratch.write("s.json", "{}");
    let run = scratch.run(&["info", "s.json", "--cameras", "two.json"]);
    assert_eq!(run.code(), 2);
    let message = "--cameras: found with s.json, expected with a PLY mesh";
    assert!(run.stderr().contains(message), "{}", run.stderr());
    let run = scratch.run(&["info", "scan.ply", "--cameras", "none.json"]);
    assert_eq!(run.code(), 2);
    assert!(run.stderr().contains("none.json"), "{}", run.stderr());
}

#[test]
fn a_cloud_has_no_faces_to_see() {
    let scratch = scratch();
    scratch.write("cloud.ply", POINT);
    let run = scratch.run(&["info", "cloud.ply", "--cameras", "list.json"]);
    assert_eq!((run.code(), run.stdout().as_str()), (2, ""));
    let message = "--cameras: found with cloud.ply, which has no faces, expected with a PLY mesh";
    assert!(run.stderr().contains(message), "{}", run.stderr());
}

/// Returns a PLY with every vertex moved by `far` along each axis.
fn moved(ply: &str, far: f64) -> String {
    let (header, rest) = ply.split_once("end_header\n").unwrap();
    let line = |line: &str| match line.split(' ').count() {
        3 => {
            let at = line.split(' ').map(|x| (x.parse::<f64>().unwrap() + far).to_string());
            at.collect::<Vec<_>>().join(" ") + "\n"
        }
        _ => format!("{line}\n"),
    };
    format!("{header}end_header\n{}", rest.lines().map(line).collect::<String>())
}

/// Lights of every studio move to the mesh, and lights of the user stay where they are: far away,
/// all is as at the origin.
#[test]
fn every_studio_lights_a_mesh_at_its_coordinates() {
    let places = [0.0, 1e6].map(|far| {
        let scratch = scratch();
        scratch.write("scan.ply", &moved(PYRAMID, far));
        let mut list = own_list();
        for camera in list["cameras"].as_array_mut().unwrap() {
            let pose = camera["camera"]["camera_to_world"].as_array_mut().unwrap();
            for row in &mut pose[..3] {
                row[3] = (row[3].as_f64().unwrap() + far).into();
            }
        }
        scratch.write("list.json", &list.to_string());
        (scratch, far)
    });
    for studio in ["lamps", "soft", "clay"] {
        let pictures = places.each_ref().map(|(scratch, far)| {
            let at = [*far, far + 9.0, *far];
            let lamp = json!({ "type": "pointlight", "position": at, "id": [9, 9, 9] });
            let [added, alone] =
                [format!("/scene/lightsources/-={lamp}"), format!("/scene/lightsources=[{lamp}]")];
            [&[][..], &["--set", &added], &["--set", &alone]].map(|more| {
                let flags = ["-o", "out", "--no-sheet", "--light-samples", "2", "--studio", studio];
                batch(scratch, "list.json", &[&flags[..], more].concat()).good();
                scratch.floats("out/scan/a.exr")
            })
        });
        let [near, far] = pictures;
        assert!(near[0] != near[1] && near[1] != near[2], "{studio}");
        for (case, (near, far)) in near.iter().zip(&far).enumerate() {
            for channel in ["R", "G", "B"] {
                let worst = near[channel].iter().zip(&far[channel]).map(|(a, b)| (a - b).abs());
                let worst = worst.fold(0.0, f32::max);
                assert!(worst < 2e-3, "{studio}, {case}, {channel}: {worst}");
            }
        }
    }
    // One point is as large as its sphere: some 3 pixels in radius.
    let (scratch, far) = &places[1];
    scratch.write("scan.ply", &moved(POINT, *far));
    batch(scratch, "list.json", &["-o", "out", "--points", "0.3"]).good();
    let hits = scratch.floats("out/scan/a.exr")["primid.id"].iter().filter(|id| **id > 0.0).count();
    assert!((20..50).contains(&hits), "{hits}");
}
