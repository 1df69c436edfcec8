//! Files of many writers (`scripts/make_ply_corpus.py`). Valid files give the data that their
//! writers got, invalid ones the expected error. Truncated or changed files give an error or a
//! valid mesh, in bounded memory.

use std::fs;
use std::path::{Path, PathBuf};

use lightpath::mesh::{Colors, Mesh, ReadOptions, Uvs, read_ply, read_ply_bytes};
use peak_alloc::PeakAlloc;
use serde_json::Value;

#[global_allocator]
static ALLOCATED: PeakAlloc = PeakAlloc;

/// Returns all meshes of `tests/ply/FOLDER`, each with the content of the file that has the same
/// name and the ending `beside`.
fn corpus(folder: &str, beside: &str) -> Vec<(PathBuf, String)> {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/ply").join(folder);
    let paths = fs::read_dir(&folder).unwrap().map(|entry| entry.unwrap().path());
    let mut meshes: Vec<PathBuf> = paths.filter(|path| name(path).contains(".ply")).collect();
    meshes.sort();
    let expected = |path: &Path| {
        let name = name(path);
        let stem = name.split(".ply").next().unwrap();
        let path = folder.join(format!("{stem}.{beside}"));
        fs::read_to_string(&path).unwrap_or_else(|error| panic!("{}: {error}", path.display()))
    };
    meshes.into_iter().map(|path| (path.clone(), expected(&path))).collect()
}

fn name(path: &Path) -> String {
    path.file_name().unwrap().to_str().unwrap().to_string()
}

/// Sizes of the window in bytes. Small ones make small meshes span several windows.
const WINDOWS: [usize; 4] = [1, 17, 100, 1000];

/// Returns the mesh, which must be the same in every way of reading it.
fn read_in_all_ways(path: &Path) -> Mesh {
    let options = ReadOptions::default();
    let mut mesh = read_ply(path, options).unwrap_or_else(|error| panic!("{error}"));
    // Bytes in memory have no stamp.
    mesh.notes.stamp = None;
    let expected = format!("{mesh:?}");
    let bytes = fs::read(path).unwrap();
    let same = |other: lightpath::error::Result<Mesh>, how: &str| {
        let mut other = other.unwrap_or_else(|error| panic!("{how}: {error}"));
        other.notes.stamp = None;
        assert!(format!("{other:?}") == expected, "{how}: {}\n{other:?}", path.display());
    };
    same(read_ply_bytes(&bytes, &path.display().to_string(), options), "from memory");
    same(read_ply(path, options.mmap(false)), "not mapped");
    for window in WINDOWS {
        same(read_ply(path, options.mmap(false).window(window)), "through a window");
    }
    mesh
}

#[test]
fn valid_files_hold_the_data_of_their_writers() {
    let _alone = crate::alone();
    let files = corpus("valid", "json");
    assert!(files.len() > 40, "{}", files.len());
    for (path, expected) in files {
        let mesh = read_in_all_ways(&path);
        let expected: Value = serde_json::from_str(&expected).unwrap();
        let place = path.display();
        check_validity(&mesh);
        assert_eq!(mesh.positions.len() as u64, expected["vertices"], "{place}");
        assert_eq!(mesh.triangles.len() as u64, expected["triangles"], "{place}");
        if !expected["faces"].is_null() {
            assert_eq!(mesh.notes.faces, expected["faces"], "{place}");
        }
        assert_eq!(mesh.normals.is_some(), expected["normals"], "{place}");
        let uvs = mesh.uvs.as_ref().map(|uvs| match uvs {
            Uvs::PerVertex(_) => "vertex",
            Uvs::PerCorner(_) => "corner",
        });
        assert_eq!(serde_json::json!(uvs), expected["uvs"], "{place}");
        let colors = mesh.colors.as_ref().map(|colors| match colors {
            Colors::U8(_) => "uchar",
            Colors::U16(_) => "ushort",
            Colors::F32(_) => "float",
        });
        assert_eq!(serde_json::json!(colors), expected["colors"], "{place}");
        assert_eq!(serde_json::json!(mesh.texture_file), expected["texture"], "{place}");
        check_shape(&mesh, &expected, &place.to_string());
    }
}

/// Checks area and box as precisely as writers with few digits allow.
fn check_shape(mesh: &Mesh, expected: &Value, place: &str) {
    let corners = |t: &[u32; 3]| t.map(|v| mesh.positions.get(v as usize));
    let area = |t: &[u32; 3]| {
        let [a, b, c] = corners(t);
        (b - a).cross(c - a).length() / 2.0
    };
    let sum: f64 = mesh.triangles.iter().map(area).sum();
    let wanted = expected["area"].as_f64().unwrap();
    assert!((sum - wanted).abs() < 2e-5 * wanted, "{place}: area {sum}, expected {wanted}");
    let points = || mesh.triangles.iter().flat_map(corners);
    let low = points().reduce(|a, b| a.min(b)).unwrap().to_array();
    let high = points().reduce(|a, b| a.max(b)).unwrap().to_array();
    for (side, found) in [low, high].into_iter().enumerate() {
        for (axis, found) in found.into_iter().enumerate() {
            let wanted = expected["bounds"][side][axis].as_f64().unwrap();
            assert!((found - wanted).abs() < 1e-5, "{place}: {found}, expected {wanted}");
        }
    }
}

#[test]
fn invalid_files_get_the_expected_error() {
    let _alone = crate::alone();
    let files = corpus("invalid", "txt");
    assert!(files.len() > 15, "{}", files.len());
    for (path, expected) in files {
        let (kind, message) = expected.trim_end().split_once('\n').unwrap();
        let called = format!("invalid/{}", name(&path));
        let bytes = fs::read(&path).unwrap();
        let error = read_ply_bytes(&bytes, &called, ReadOptions::default()).unwrap_err();
        let found = error.to_string();
        let found = found.lines().next().unwrap().trim_start_matches("error: ");
        assert_eq!(format!("{:?}", error.kind), kind, "{called}: {found}");
        let matches = match message.split_once('*') {
            Some((start, end)) => found.starts_with(start) && found.ends_with(end),
            None => found == message,
        };
        assert!(matches, "found    {found}\nexpected {message}");
        for window in WINDOWS {
            let options = ReadOptions::default().mmap(false).window(window);
            let error = read_ply(&path, options).unwrap_err();
            assert_eq!(format!("{:?}", error.kind), kind, "{called}: {error}");
        }
    }
}

/// Checks the invariants of `Mesh`.
fn check_validity(mesh: &Mesh) {
    let count = mesh.positions.len();
    for &[a, b, c] in &mesh.triangles {
        assert!(a != b && b != c && c != a);
        for vertex in [a, b, c] {
            assert!((vertex as usize) < count);
            assert!(mesh.positions.get(vertex as usize).is_finite());
        }
    }
    assert!(!mesh.triangles.is_empty());
    let per_vertex = |length: Option<usize>| assert!(length.is_none_or(|length| length == count));
    per_vertex(mesh.normals.as_ref().map(Vec::len));
    per_vertex(mesh.colors.as_ref().map(|colors| match colors {
        Colors::U8(all) => all.len(),
        Colors::U16(all) => all.len(),
        Colors::F32(all) => all.len(),
    }));
    match &mesh.uvs {
        Some(Uvs::PerCorner(uvs)) => assert_eq!(uvs.len(), mesh.triangles.len()),
        Some(Uvs::PerVertex(uvs)) => assert_eq!(uvs.len(), count),
        None => {}
    }
}

/// Reads `bytes`. Requires an error or a valid mesh, in at most 64 MiB and four times the file's
/// size.
fn survives(bytes: &[u8], what: &str) -> bool {
    let before = ALLOCATED.current_usage();
    ALLOCATED.reset_peak_usage();
    let read = read_ply_bytes(bytes, "t.ply", ReadOptions::default());
    let most = ALLOCATED.peak_usage().saturating_sub(before);
    assert!(most <= (64 << 20) + 4 * bytes.len(), "{what}: {most} bytes");
    read.as_ref().map(check_validity).is_ok()
}

#[test]
fn every_file_may_be_cut_anywhere() {
    let _alone = crate::alone();
    let mut cuts = 0;
    for (path, _) in corpus("valid", "json") {
        let bytes = fs::read(&path).unwrap();
        assert!(survives(&bytes, "whole"));
        for length in (0..bytes.len()).step_by(37) {
            survives(&bytes[..length], &format!("{} cut to {length}", path.display()));
            cuts += 1;
        }
    }
    assert!(cuts > 2000, "{cuts}");
}

#[test]
fn any_byte_may_be_changed() {
    let _alone = crate::alone();
    let mut seed = 20u64;
    let mut random = move |below: usize| {
        seed = seed.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
        (seed >> 33) as usize % below
    };
    let (mut read, mut refused) = (0, 0);
    for (path, _) in corpus("valid", "json") {
        let bytes = fs::read(&path).unwrap();
        for _ in 0..2000 {
            let at = random(bytes.len());
            let mut changed = bytes.clone();
            changed[at] ^= 1 + random(255) as u8;
            match survives(&changed, &format!("{} changed at {at}", path.display())) {
                true => read += 1,
                false => refused += 1,
            }
        }
    }
    assert!(read > 10_000 && refused > 10_000, "{read} read, {refused} refused");
}

/// A zstd frame with one uncompressed block, and a window in the form of RFC 8878.
fn frame(window: u8, data: &[u8]) -> Vec<u8> {
    let block = ((data.len() as u32) << 3 | 1).to_le_bytes();
    [&[0x28, 0xb5, 0x2f, 0xfd, 0, window][..], &block[..3], data].concat()
}

#[test]
fn a_window_takes_no_memory_until_data_fills_it() {
    let _alone = crate::alone();
    let ply =
        fs::read(Path::new(env!("CARGO_MANIFEST_DIR")).join("assets/octahedron.ply")).unwrap();
    let (first, second) = ply.split_at(ply.len() / 2);
    // 1 KiB, 8 MiB, 96 MiB and 128 MiB, then more than a small file may request.
    for window in [0x00, 0x68, 0x84, 0x88, 0x89, 0xff] {
        let packed = [frame(window, first), frame(window, second)].concat();
        assert_eq!(survives(&packed, &format!("window {window:#x}")), window <= 0x88);
    }
}
