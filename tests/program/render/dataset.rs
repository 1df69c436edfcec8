//! Files for data sets: visible faces and ids as pictures.

use std::collections::BTreeMap;
use std::io::Cursor;

use crate::support::program::{Refusals, Scratch};

const SCENE: &str = r#"{
  "camera": { "type": "pinhole", "width": 48, "height": 40, "fov": 40,
              "position": [2, 2.5, 5], "target": [0, 0.6, 0], "up": [0, 1, 0] },
  "scene": {
    "lightsources": [{ "type": "pointlight", "position": [2, 3, 4], "id": [3, 3, 3] }],
    "shapes": [
      { "type": "plane", "v0": [-2, 0, 2], "v1": [2, 0, 2], "v2": [2, 0, -2], "v3": [-2, 0, -2],
        "material": {}, "semantic": 7 },
      { "type": "trimesh", "path": "p.ply", "material": {}, "semantic": 40000 },
      { "type": "sphere", "center": [-1.4, 0.4, 1], "radius": 0.4, "material": {} },
      { "type": "sphere", "center": [1.4, 0.4, 1], "radius": 0.4, "material": {}, "semantic": 7 }]
  }
}"#;

/// A face: id of its shape (index + 1), index of the face in the shape.
type Face = (u32, u32);

/// Reads an array of `--visible-faces`: samples and pixels of each face.
#[track_caller]
fn faces(scratch: &Scratch, name: &str) -> BTreeMap<Face, (u64, u32)> {
    let bytes = scratch.read(name);
    assert_eq!(&bytes[..8], b"\x93NUMPY\x01\x00");
    let end = 10 + usize::from(u16::from_le_bytes([bytes[8], bytes[9]]));
    let header = std::str::from_utf8(&bytes[10..end]).unwrap();
    assert!(end % 64 == 0 && header.ends_with('\n'), "{header:?}");
    let rows: Vec<_> = bytes[end..].chunks(20).collect();
    let expected = format!(
        "{{'descr': [('object', '<u4'), ('face', '<u4'), ('samples', '<u8'), ('pixels', '<u4')], \
         'fortran_order': False, 'shape': ({},), }}",
        rows.len()
    );
    assert_eq!(header.trim_end(), expected);
    let word = |row: &[u8], at: usize| u32::from_le_bytes(row[at..at + 4].try_into().unwrap());
    let read = |row: &&[u8]| {
        let samples = u64::from_le_bytes(row[8..16].try_into().unwrap());
        ((word(row, 0), word(row, 4)), (samples, word(row, 16)))
    };
    let found: Vec<_> = rows.iter().map(read).collect();
    assert!(found.is_sorted_by_key(|(face, _)| *face));
    found.into_iter().collect()
}

/// The face of an id of the layer `primid`. Ids follow the order mesh, quad, spheres.
fn face(primitive: u32, triangles: u32) -> Face {
    match primitive - 1 {
        triangle if triangle < triangles => (2, triangle),
        other => ([1, 3, 4][(other - triangles) as usize], 0),
    }
}

#[test]
fn visible_faces_are_those_of_all_samples() {
    let scratch = Scratch::with(SCENE);
    let render = |flags: &[&str]| {
        scratch.run(&[&["render", "s.json", "--quiet", "-o", "o"], flags].concat()).good();
    };
    // One sample a pixel: as the layer says. The pyramid has six triangles.
    render(&["--aov", "primid", "--visible-faces", "f.npy"]);
    let mut expected: BTreeMap<Face, (u64, u32)> = BTreeMap::new();
    for (_, words) in scratch.channels("o.exr").iter().filter(|(name, _)| name == "primid.id") {
        for &primitive in words.iter().filter(|&&primitive| primitive > 0) {
            let counts = expected.entry(face(primitive, 6)).or_default();
            *counts = (counts.0 + 1, counts.1 + 1);
        }
    }
    assert!(expected.len() >= 5);
    assert_eq!(faces(&scratch, "f.npy"), expected);

    // Many samples, no layers: the same for any number of threads, and the sum of coverages.
    for (name, threads) in [("a.npy", "1"), ("b.npy", "3")] {
        render(&["--spp", "32", "--threads", threads, "--visible-faces", name]);
    }
    let all = faces(&scratch, "a.npy");
    assert_eq!(all, faces(&scratch, "b.npy"));
    assert!(expected.keys().all(|face| all.contains_key(face)));
    assert!(all.values().all(|&(samples, pixels)| samples >= pixels.into() && pixels > 0));
    render(&["--spp", "32", "--transparent", "--float"]);
    let hits: f32 = scratch.floats("o.exr")["A"].iter().sum();
    let samples: u64 = all.values().map(|(samples, _)| samples).sum();
    assert_eq!(samples as f32, 32.0 * hits);
    // Each pixel of a face is counted once, though it may be seen by many samples.
    let most = all.values().map(|(_, pixels)| *pixels).max().unwrap();
    assert!(most > 300 && most < 48 * 40);

    // A crop counts its own pixels. Adaptive sampling counts the samples that were taken.
    render(&["--spp", "32", "--crop", "10", "10", "30", "30", "--visible-faces", "crop.npy"]);
    for (face, (samples, pixels)) in faces(&scratch, "crop.npy") {
        let (whole_samples, whole_pixels) = all[&face];
        assert!(samples <= whole_samples && pixels <= whole_pixels && pixels <= 400);
    }
    let noise = ["--noise", "0.05", "--max-spp", "64", "--transparent", "--float"];
    render(&[&noise[..], &["--aov", "samples", "--visible-faces", "n.npy"]].concat());
    let layers = scratch.floats("o.exr");
    let hits: f32 = layers["A"].iter().zip(&layers["samples.Y"]).map(|(a, n)| a * n).sum();
    let samples: u64 = faces(&scratch, "n.npy").values().map(|(samples, _)| samples).sum();
    assert!((samples as f32 - hits).abs() < 1.0, "{samples} {hits}");
}

#[test]
fn points_of_a_cloud_are_numbered_beside_other_spheres() {
    let scratch = Scratch::new();
    let points = "-1 0 0\n-0.5 0.4 0\n0 0 0\n0.5 0.4 0\n1 0 0\n";
    let header = "ply\nformat ascii 1.0\nelement vertex 5\nproperty float x\nproperty float y\n\
                  property float z\nend_header\n";
    scratch.write("p.ply", &format!("{header}{points}"));
    let cloud = |y: f64| {
        format!(
            r#"{{ "type": "trimesh", "path": "p.ply", "points": 0.2, "size": 1,
                      "center": [0, {y}, 0], "material": {{}} }}"#
        )
    };
    let sphere = |x: f64| {
        let center = format!("[{x}, 0, 0]");
        format!(r#"{{ "type": "sphere", "center": {center}, "radius": 0.4, "material": {{}} }}"#)
    };
    let shapes = [cloud(-1.0), sphere(-2.0), cloud(1.0), sphere(2.0)].join(", ");
    scratch.write(
        "s.json",
        &format!(
            r#"{{ "camera": {{ "type": "pinhole", "width": 60, "height": 40, "fov": 50,
                               "position": [0, 0, 6], "target": [0, 0, 0], "up": [0, 1, 0] }},
                  "scene": {{ "shapes": [{shapes}] }} }}"#
        ),
    );
    let flags = ["--visible-faces", "f.npy", "--aov", "primid,objectid", "--quiet", "-o", "o"];
    scratch.run(&[&["render", "s.json"], &flags[..]].concat()).good();
    let channels = scratch.channels("o.exr");
    let words = |name: &str| &channels.iter().find(|(channel, _)| channel == name).unwrap().1;
    // Ids of primitives: the two spheres, then the points of both clouds.
    let mut expected: BTreeMap<Face, (u64, u32)> = BTreeMap::new();
    for (&primitive, &object) in words("primid.id").iter().zip(words("objectid.id")) {
        let face = match primitive {
            0 => continue,
            1 | 2 => 0,
            point => (point - 3) % 5,
        };
        let counts = expected.entry((object, face)).or_default();
        *counts = (counts.0 + 1, counts.1 + 1);
    }
    assert_eq!(expected.len(), 12);
    assert_eq!(faces(&scratch, "f.npy"), expected);
}

#[test]
fn ids_are_pictures_of_16_bits() {
    let scratch = Scratch::with(SCENE);
    let flags = ["--aov", "objectid", "--png-ids", "--spp", "4"];
    scratch.run(&[&["render", "s.json", "--quiet", "-o", "o"], &flags[..]].concat()).good();
    let ids = scratch.channels("o.exr").into_iter().find(|(name, _)| name == "objectid.id");
    let ids = ids.unwrap().1;
    let read = |name: &str| {
        let bytes = Cursor::new(scratch.read(name));
        let mut reader = png::Decoder::new(bytes).read_info().unwrap();
        let mut bytes = vec![0; reader.output_buffer_size().unwrap()];
        let info = reader.next_frame(&mut bytes).unwrap();
        assert_eq!(
            (info.bit_depth, info.color_type),
            (png::BitDepth::Sixteen, png::ColorType::Grayscale)
        );
        let pairs = bytes.chunks_exact(2);
        pairs.map(|two| u32::from(u16::from_be_bytes([two[0], two[1]]))).collect::<Vec<_>>()
    };
    assert_eq!(read("o.instance.png"), ids);
    let classes: Vec<u32> = ids.iter().map(|&id| [0, 7, 40000, 0, 7][id as usize]).collect();
    assert_eq!(read("o.semantic.png"), classes);
    assert!((0..5).all(|id| ids.contains(&id)));
}

#[test]
fn contradictions_are_refused() {
    let refusals = Refusals::new();
    refusals.scratch.write("s.json", SCENE);
    refusals.scratch.write("p.ply", crate::support::program::PYRAMID);
    let refused = |flags: &[&str], expected: &[&str]| {
        let done = refusals.render("s.json", flags);
        assert_eq!(done.code(), 2, "{}", done.stderr());
        for text in expected {
            assert!(done.stderr().contains(text), "{text}: {}", done.stderr());
        }
    };
    refused(&["--png-ids"], &["--png-ids: ", "`objectid`", "--aov objectid"]);
    let faces = ["--visible-faces", "out/f.npy"];
    refused(&[&faces[..], &["--tile", "1/2"]].concat(), &["--visible-faces: ", "part"]);
    refused(&[&faces[..], &["--time", "1"]].concat(), &["--visible-faces: ", "--time"]);
    refused(&["--visible-faces", "missing/f.npy"], &["missing"]);
    refused(&["--visible-faces", "s.json"], &["s.json"]);
    refused(&["--visible-faces", "out/x.png"], &["x.png"]);
    for value in ["65536", "-1", "1.5"] {
        let set = format!("/scene/shapes/0/semantic={value}");
        refused(&["--set", &set], &["/scene/shapes/0/semantic", "65535"]);
    }
}

/// With adaptive sampling a thread keeps the primitives of all samples of a tile.
#[test]
fn primitives_of_adaptive_samples_count_against_the_memory_limit() {
    let scratch = Scratch::with(SCENE);
    let run = |most: &str, flags: &[&str]| {
        let noise = ["--noise", "1", "--max-spp", most, "--threads", "4", "--max-memory", "600M"];
        scratch.run(&[&["render", "s.json", "--quiet", "-o", "o"], &noise[..], flags].concat())
    };
    let faces = ["--visible-faces", "f.npy"];
    let small = [&faces[..], &["--size", "16x16"]].concat();
    let large = [&faces[..], &["--size", "64x64"]].concat();
    run("65536", &large[2..]).good();
    run("1024", &large).good();
    // 4 threads * 1024 pixels * 65,536 samples * 4 bytes are 1 GiB.
    let refused = run("65536", &large);
    assert_eq!(refused.code(), 2, "{}", refused.stderr());
    assert!(refused.stderr().contains("--max-memory"), "{}", refused.stderr());
    // A picture of 256 pixels has no whole tile.
    run("65536", &small).good();
}
