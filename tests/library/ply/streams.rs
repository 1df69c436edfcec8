//! Files that are compressed, come through a pipe, are truncated during reading, or whose reading
//! is stopped.

use crate::support::program;
use std::fs::{self, File};
use std::io::Write;
use std::path::Path;
use std::time::{Duration, Instant};

use crate::support::ply_writer::{ALL, Encoding, Ply, V, lists, numbers};
use flate2::{Compression, write::GzEncoder};
use lightpath::error::{ErrorKind, Result};
use lightpath::mesh::{Mesh, ReadOptions, read_ply, read_ply_bytes};
use lightpath::monitor::Monitor;

fn gzip(bytes: &[u8]) -> Vec<u8> {
    let mut out = GzEncoder::new(Vec::new(), Compression::fast());
    out.write_all(bytes).unwrap();
    out.finish().unwrap()
}

/// A sheet of `side * side` cells, alternately split into a quad, two triangles, or a quad and a
/// line.
fn sheet(side: i64, triangles: bool) -> Ply {
    let row = side + 1;
    let points: Vec<[f64; 3]> =
        (0..row * row).map(|i| [(i % row) as f64, (i / row) as f64, (i * i % 17) as f64]).collect();
    let mut faces = Vec::new();
    for i in 0..side * side {
        let a = i / side * row + i % side;
        let [b, c, d] = [a + 1, a + row + 1, a + row];
        match i % 3 {
            0 if !triangles => faces.push(vec![a, b, c, d]),
            1 if !triangles => faces.extend([vec![a, b, c, d], vec![a, b]]),
            _ => faces.extend([vec![a, b, c], vec![a, c, d]]),
        }
    }
    let faces: Vec<&[i64]> = faces.iter().map(Vec::as_slice).collect();
    Ply::new().element("vertex", &["float x", "float y", "float z"], numbers(&points)).faces(&faces)
}

#[track_caller]
fn same(found: Result<Mesh>, expected: &str, what: &str) {
    let found = found.unwrap_or_else(|error| panic!("{what}: {error}"));
    assert!(shown(found) == expected, "{what}");
}

/// All of a mesh but the stamp, which a file has and bytes in memory do not have.
fn shown(mut mesh: Mesh) -> String {
    mesh.notes.stamp = None;
    format!("{mesh:?}")
}

#[test]
fn many_windows_give_the_same_mesh() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.ply");
    for triangles in [true, false] {
        let ply = sheet(120, triangles);
        for encoding in ALL {
            let bytes = ply.write(encoding);
            let expected = read_ply_bytes(&bytes, "a.ply", ReadOptions::default()).unwrap();
            let expected = shown(expected);
            fs::write(&path, &bytes).unwrap();
            for window in [5000, 65_536, 1 << 30] {
                let options = ReadOptions::default().mmap(false).window(window);
                let what = format!("{encoding:?} {window}");
                same(read_ply(&path, options), &expected, &what);
                same(read_ply_bytes(&gzip(&bytes), "a.ply", options), &expected, &what);
            }
        }
    }
}

#[test]
fn rows_and_lines_have_their_numbers_behind_the_first_window() {
    let ply = |last: &[i64]| {
        let faces: Vec<Vec<i64>> = (0..300).map(|i| vec![i, i + 1, i + 2]).collect();
        let mut faces: Vec<&[i64]> = faces.iter().map(Vec::as_slice).collect();
        faces.push(last);
        Ply::new().curve(400).faces(&faces)
    };
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.ply");
    for (encoding, last) in ALL.iter().flat_map(|e| [(*e, [1i64, 2, 999]), (*e, [1, 2, -1])]) {
        let bytes = ply(&last).write(encoding);
        let expected = read_ply_bytes(&bytes, &path.display().to_string(), ReadOptions::default());
        fs::write(&path, &bytes).unwrap();
        let found = read_ply(&path, ReadOptions::default().mmap(false).window(500));
        assert_eq!(found.unwrap_err(), expected.unwrap_err());
    }
    let text = String::from_utf8(ply(&[1, 2, 3]).write(Encoding::Ascii)).unwrap();
    let wrong = text.replace("3 200 201 202", "3 200 x 202");
    let expected = read_ply_bytes(wrong.as_bytes(), "a.ply", ReadOptions::default()).unwrap_err();
    assert!(expected.to_string().contains("face 200: 'x' is not a number"), "{expected}");
    let options = ReadOptions::default().window(500);
    let found = read_ply_bytes(&gzip(wrong.as_bytes()), "a.ply", options).unwrap_err();
    assert_eq!(found, expected);
}

#[test]
fn faces_before_vertices_wait_for_them() {
    let faces = lists(&[&[0, 1, 2], &[1, 2, 3]]);
    let property = ["list uchar int vertex_indices"];
    let ply = Ply::new().element("face", &property, faces).curve(4);
    for encoding in ALL {
        let bytes = ply.write(encoding);
        let options = ReadOptions::default().window(10);
        let packed = read_ply_bytes(&gzip(&bytes), "a.ply", options);
        let expected = read_ply_bytes(&bytes, "a.ply", options).unwrap();
        same(packed, &shown(expected), "faces first");
    }
}

#[test]
fn a_row_may_be_longer_than_the_window() {
    let corners: Vec<f64> = (0..5000).map(f64::from).collect();
    let face = vec![vec![V::L(corners)]];
    let circle: Vec<[f64; 3]> = (0..5000)
        .map(|i| (f64::from(i) / 5000.0 * std::f64::consts::TAU).sin_cos())
        .map(|(sin, cos)| [cos, sin, 0.0])
        .collect();
    let ply = Ply::new()
        .element("vertex", &["double x", "double y", "double z"], numbers(&circle))
        .element("face", &["list ushort ushort vertex_index"], face);
    for encoding in ALL {
        let bytes = ply.write(encoding);
        let options = ReadOptions::default().window(100);
        let packed = read_ply_bytes(&gzip(&bytes), "a.ply", options);
        let expected = read_ply_bytes(&bytes, "a.ply", options).unwrap();
        same(packed, &shown(expected), "one long row");
    }
}

#[test]
fn blank_lines_lie_across_windows() {
    let head = "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\n\
                property float z\nelement face 1\nproperty list uchar int vertex_indices\nend_header\n";
    let rows = ["0 0 0", "1 0 0", "0 1 0", "3 0 1 2", "left over", " ", "3 2 1 0"];
    for blank in ["", "\n", "\r\n \n", " \n\t\n\n\n"] {
        let text = rows.iter().fold(head.to_owned(), |text, row| text + blank + row + "\n" + blank);
        let expected = read_ply_bytes(text.as_bytes(), "a.ply", ReadOptions::default()).unwrap();
        let left = text.len() - text.find("left over").unwrap();
        assert_eq!(expected.notes.trailing_bytes, left as u64);
        let expected = shown(expected);
        for window in 1..text.len() {
            let options = ReadOptions::default().window(window);
            let found = read_ply_bytes(&gzip(text.as_bytes()), "a.ply", options);
            same(found, &expected, &format!("{blank:?} in windows of {window}"));
        }
    }
}

#[test]
fn truncated_files_name_the_place() {
    let bytes = sheet(30, true).write(Encoding::Little);
    let cut = gzip(&bytes[..bytes.len() - 5]);
    let error = read_ply_bytes(&cut, "a.ply", ReadOptions::default()).unwrap_err().to_string();
    let expected =
        "the header declares 1800 faces, but only 1799 are in the file: the data ends after";
    assert!(error.contains(expected), "{error}");
}

#[test]
fn packed_meshes_render_under_their_own_name() {
    let scratch = program::Scratch::new();
    let bytes = Ply::new().curve(4).faces(&[&[0, 1, 2], &[1, 2, 3]]).write(Encoding::Little);
    fs::write(scratch.path("scan.ply.gz"), gzip(&bytes)).unwrap();
    let args =
        ["render", "scan.ply.gz", "--size", "8x8", "--spp", "1", "--backend", "bvh", "--quiet"];
    let done = scratch.run(&args);
    assert_eq!(done.code(), 0, "{}", done.stderr());
    assert_eq!(scratch.names(), ["scan.exr", "scan.ply.gz", "scan.png"]);
    let info = scratch.run(&["info", "scan.ply.gz", "--no-mmap"]);
    let said = info.stdout();
    for expected in
        ["packed with gzip", "2 triangles", "missing: normals, texture", "memory in the"]
    {
        assert!(said.contains(expected), "{said}");
    }
}

/// The program survives, and does not take a part of the file for the whole.
#[test]
fn a_file_truncated_while_it_is_read_is_refused() {
    let bytes = sheet(700, false).write(Encoding::Little);
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.ply");
    let mut refused = 0;
    for wait in (0..40).map(|i| Duration::from_micros(250 * i)) {
        fs::write(&path, &bytes).unwrap();
        let read = std::thread::scope(|scope| {
            let reader = scope.spawn(|| read_ply(&path, ReadOptions::default()));
            std::thread::sleep(wait);
            File::options().write(true).open(&path).unwrap().set_len(5000).unwrap();
            reader.join().unwrap()
        });
        match read {
            Ok(mesh) => assert_eq!(mesh.notes.faces, 700 * 700 * 5 / 3),
            Err(error) => {
                // If it was truncated before it was opened, it is just too short.
                assert!(matches!(error.kind, ErrorKind::Retry | ErrorKind::Invalid), "{error}");
                refused += usize::from(error.kind == ErrorKind::Retry);
            }
        }
    }
    assert!(refused > 0);
}

#[test]
fn reading_stops_on_a_signal() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.ply");
    let monitor = Monitor::default();
    monitor.signal.store(2, std::sync::atomic::Ordering::Relaxed);
    for triangles in [true, false] {
        for encoding in ALL {
            let bytes = sheet(50, triangles).write(encoding);
            fs::write(&path, &bytes).unwrap();
            for mmap in [true, false] {
                let options = ReadOptions::default().mmap(mmap).monitor(&monitor);
                let error = read_ply(&path, options).unwrap_err();
                assert_eq!(error.kind, ErrorKind::Interrupted(2));
            }
            let packed = gzip(&bytes);
            let error = read_ply_bytes(&packed, "a.ply", ReadOptions::default().monitor(&monitor));
            assert_eq!(error.unwrap_err().kind, ErrorKind::Interrupted(2));
        }
    }
}

/// Reading stops even if the pipe sends nothing more.
#[cfg(unix)]
#[test]
fn reading_a_silent_pipe_can_be_stopped() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("pipe.ply");
    assert!(make_pipe(&path), "the program `mkfifo`");
    let bytes = sheet(50, true).write(Encoding::Little);
    let monitor = Monitor::default();
    std::thread::scope(|scope| {
        let reader = scope.spawn(|| {
            let begun = Instant::now();
            let read = read_ply(&path, ReadOptions::default().monitor(&monitor));
            (read, begun.elapsed())
        });
        let mut pipe = File::options().write(true).open(&path).unwrap();
        pipe.write_all(&bytes[..bytes.len() / 2]).unwrap();
        std::thread::sleep(Duration::from_millis(200));
        monitor.signal.store(15, std::sync::atomic::Ordering::Relaxed);
        let (read, took) = reader.join().unwrap();
        assert_eq!(read.unwrap_err().kind, ErrorKind::Interrupted(15));
        assert!(took < Duration::from_secs(5), "{took:?}");
        drop(pipe);
    });
    // A pipe that sends everything is read completely.
    let path = folder.path().join("other.ply");
    assert!(make_pipe(&path));
    std::thread::scope(|scope| {
        let reader = scope.spawn(|| read_ply(&path, ReadOptions::default()));
        File::options().write(true).open(&path).unwrap().write_all(&bytes).unwrap();
        let expected = read_ply_bytes(&bytes, "", ReadOptions::default()).unwrap();
        same(reader.join().unwrap(), &shown(expected), "a pipe");
    });
}

#[cfg(unix)]
fn make_pipe(path: &Path) -> bool {
    std::process::Command::new("mkfifo").arg(path).status().is_ok_and(|status| status.success())
}

/// `TextureFile` applies to a material without `tPath`, in scenes, too.
#[test]
fn the_texture_of_the_file_is_used_where_the_material_has_none() {
    let scratch = program::Scratch::new();
    let properties = ["float x", "float y", "float z", "float s", "float t"];
    let rows =
        numbers(&[[-9., -9., 0., 0.5, 0.5], [9., -9., 0., 0.5, 0.5], [0., 9., 0., 0.5, 0.5]]);
    let ply = |name: &[u8]| {
        let ply = Ply::new().comment(name).element("vertex", &properties, rows.clone());
        ply.faces(&[&[0, 1, 2]]).write(Encoding::Little)
    };
    let picture = image::RgbImage::from_pixel(2, 2, image::Rgb([0, 255, 0]));
    picture.save(scratch.path("green.png")).unwrap();
    fs::write(scratch.path("a.ply"), ply(b"comment TextureFile green.png")).unwrap();
    fs::write(scratch.path("b.ply"), ply(b"comment TextureFile missing.png")).unwrap();
    let scene = |mesh: &str| {
        format!(
            r#"{{ "camera": {{ "type": "pinhole", "width": 4, "height": 4, "fov": 20,
              "position": [0, 0, 9], "lookat": [0, 0, -1], "up": [0, 1, 0] }},
              "scene": {{ "ambient": [1, 1, 1], "lightsources": [], "shapes": [
              {{ "type": "trimesh", "path": "{mesh}",
                 "material": {{ "ka": 1, "kd": 1, "ks": 0, "diffusecolor": [1, 1, 1] }} }}] }} }}"#
        )
    };
    scratch.write("a.json", &scene("a.ply"));
    scratch.write("b.json", &scene("b.ply"));
    let render = |file: &str| scratch.run(&["render", file, "--backend", "bvh", "--quiet"]);
    let done = render("a.json");
    assert_eq!(done.code(), 0, "{}", done.stderr());
    let pixel = |file: &str| image::open(scratch.path(file)).unwrap().to_rgb8().get_pixel(2, 2).0;
    let [red, green, blue] = pixel("a.png");
    assert!(green > red.max(blue) + 100, "{red} {green} {blue}");
    assert_eq!(render("b.json").code(), 0);
    let [red, green, blue] = pixel("b.png");
    assert!(red == green && green == blue && red > 0, "{red} {green} {blue}");
    let info = scratch.run(&["info", "b.json"]);
    assert!(info.stderr().contains("there is no file missing.png"), "{}", info.stderr());
    // A file whose name only looks like that of the comment.
    fs::copy(scratch.path("green.png"), scratch.path("gr\u{fffd}n.png")).unwrap();
    fs::write(scratch.path("b.ply"), ply(b"comment TextureFile gr\xfcn.png")).unwrap();
    assert_eq!(render("b.json").code(), 0);
    let [red, green, blue] = pixel("b.png");
    assert!(red == green && green == blue && red > 0, "{red} {green} {blue}");
    let info = scratch.run(&["info", "b.json"]);
    assert!(info.stderr().contains("its name is not UTF-8"), "{}", info.stderr());
}

/// Names from Windows, and with folders of another computer.
#[test]
fn a_texture_is_found_by_slashes_and_without_its_folders() {
    let scratch = program::Scratch::new();
    let properties = ["float x", "float y", "float z", "float s", "float t"];
    let rows = numbers(&[[-9., -9., 0., 0., 0.], [9., -9., 0., 1., 0.], [0., 9., 0., 0., 1.]]);
    fs::create_dir(scratch.path("sub dir")).unwrap();
    let save = |place: &str, color: [u8; 3]| {
        image::RgbImage::from_pixel(2, 2, image::Rgb(color)).save(scratch.path(place)).unwrap();
    };
    save("sub dir/c.png", [255, 0, 0]);
    save("d.png", [0, 255, 0]);
    save("c.png", [0, 0, 255]);
    scratch.write(
        "s.json",
        r#"{ "camera": { "type": "pinhole", "width": 4, "height": 4, "fov": 20,
              "position": [0, 0, 9], "target": [0, 0, 0], "up": [0, 1, 0] },
              "scene": { "shapes": [{ "type": "trimesh", "path": "m.ply", "material": {} }] } }"#,
    );
    for (name, color) in [
        (r"sub dir\c.png", [1, 0, 0]),
        (r"C:\scans\d.png", [0, 1, 0]),
        ("/no such folder/d.png", [0, 1, 0]),
        ("moved/d.png", [0, 1, 0]),
        (r"other\e.png", [0, 0, 0]),
    ] {
        let comment = format!("comment TextureFile {name}");
        let ply = Ply::new().comment(comment.as_bytes());
        let ply = ply.element("vertex", &properties, rows.clone()).faces(&[&[0, 1, 2]]);
        fs::write(scratch.path("m.ply"), ply.write(Encoding::Little)).unwrap();
        for input in ["s.json", "m.ply"] {
            let flags = ["--aov", "albedo", "--size", "4x4", "-o", "o"];
            let done = scratch.run(&[&["render", input], &flags[..]].concat()).good();
            let said = done.stderr();
            let warns = said.contains(&format!("the texture \"{name}\" is not used"));
            assert_eq!(warns, color == [0; 3], "{input}, {name}: {said}");
            if warns {
                continue;
            }
            // Without the folders it may be another image.
            let moved = said.contains(&format!("there is no texture \"{name}\"; "));
            assert_eq!(moved, !name.starts_with("sub dir"), "{input}, {name}: {said}");
            let channels = scratch.channels("o.exr");
            // The pixel of a mesh alone shows a little of the ground, too.
            let half = 0x3800;
            for (k, value) in ["albedo.R", "albedo.G", "albedo.B"].into_iter().zip(color) {
                let found = &channels.iter().find(|(name, _)| name == k).unwrap().1;
                assert_eq!(found[2 * 4 + 2] > half, value == 1, "{input}, {name}, {k}");
            }
        }
    }
    // A picture of a render is not the missing image.
    for _ in 0..2 {
        let said = scratch.run(&["render", "s.json", "-o", "e"]).good().stderr();
        assert!(said.contains("is not used: there is no file other\\e.png"), "{said}");
    }
    let quiet = scratch.run(&["render", "s.json", "-o", "e", "--quiet"]).good().stderr();
    assert_eq!(quiet, "");
}
