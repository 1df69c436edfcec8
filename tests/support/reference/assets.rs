//! Textures and meshes of the test scenes, generated so that none needs to be stored.

use image::{ImageBuffer, Rgb, Rgba};
use std::f64::consts::TAU;
use std::fmt::Write as _;
use std::path::Path;

/// Writes every asset into `folder`.
pub fn write_all(folder: &Path) {
    textures(folder);
    std::fs::write(folder.join("torus.ply"), torus(72, 36)).expect("torus.ply");
    std::fs::write(folder.join("ball.ply"), ball(10, 5)).expect("ball.ply");
    std::fs::write(folder.join("vase.ply"), vase()).expect("vase.ply");
    std::fs::write(folder.join("box.ply"), textured_box()).expect("box.ply");
}

/// Returns a texel's 8-bit colour: all texels of a small image differ, neighbours strongly.
pub fn texel(i: u32, j: u32) -> [u8; 3] {
    let checker = if (i + j) % 2 == 0 { 0 } else { 120 };
    [
        (20 + 13 * i % 130 + checker) as u8,
        (30 + 17 * j % 130 + checker / 2) as u8,
        (5 * i + 9 * j) as u8,
    ]
}

/// Writes the same picture in every kind of file that the format distinguishes.
fn textures(folder: &Path) {
    let (width, height) = (16, 12);
    let rgb8 = ImageBuffer::from_fn(width, height, |i, j| Rgb(texel(i, j)));
    rgb8.save(folder.join("rgb8.png")).expect("rgb8.png");
    let rgba8 = ImageBuffer::from_fn(width, height, |i, j| {
        let [r, g, b] = texel(i, j);
        Rgba([r, g, b, (10 * i) as u8])
    });
    rgba8.save(folder.join("rgba8.png")).expect("rgba8.png");
    let rgb16 =
        ImageBuffer::from_fn(
            width,
            height,
            |i, j| Rgb(texel(i, j).map(|x| u16::from(x) * 251 + 3)),
        );
    rgb16.save(folder.join("rgb16.png")).expect("rgb16.png");
    let grey8 = image::GrayImage::from_fn(width, height, |i, j| image::Luma([texel(i, j)[0]]));
    grey8.save(folder.join("grey8.png")).expect("grey8.png");
    let float =
        ImageBuffer::from_fn(width, height, |i, j| Rgb(texel(i, j).map(|x| f32::from(x) / 100.0)));
    float.save(folder.join("float.hdr")).expect("float.hdr");
}

/// A bumpy torus around z: binary, triangles, 8-bit colours, no normals, and one vertex that no
/// face uses, which `fit` must ignore.
fn torus(around: u32, across: u32) -> Vec<u8> {
    let (vertices, faces) = (around * across + 1, around * across * 2);
    let mut out = format!(
        "ply\nformat binary_little_endian 1.0\ncomment bumpy torus\nelement vertex {vertices}\n\
         property float x\nproperty float y\nproperty float z\n\
         property uchar red\nproperty uchar green\nproperty uchar blue\n\
         element face {faces}\nproperty list uchar int vertex_indices\nend_header\n"
    )
    .into_bytes();
    let mut vertex = |position: [f64; 3], color: [f64; 3]| {
        for x in position {
            out.extend((x as f32).to_le_bytes());
        }
        out.extend(color.map(|c| (255.0 * c) as u8));
    };
    for a in 0..around {
        for b in 0..across {
            let (s, t) = (f64::from(a) / f64::from(around), f64::from(b) / f64::from(across));
            let ((sin_s, cos_s), (sin_t, cos_t)) = ((TAU * s).sin_cos(), (TAU * t).sin_cos());
            let tube = 4.0 + 0.7 * (TAU * 5.0 * s).sin() * (TAU * 2.0 * t).cos();
            let ring = 11.0 + tube * cos_t;
            let color = [0.55 + 0.45 * sin_s, 0.55 + 0.45 * cos_t, 0.5 - 0.4 * cos_s];
            vertex([ring * cos_s + 30.0, ring * sin_s - 7.0, tube * sin_t + 2.0], color);
        }
    }
    vertex([900.0, -900.0, 900.0], [1.0; 3]);
    let at = |a: u32, b: u32| (a % around) * across + b % across;
    for a in 0..around {
        for b in 0..across {
            let (p, q, r, s) = (at(a, b), at(a + 1, b), at(a + 1, b + 1), at(a, b + 1));
            for triangle in [[p, q, r], [p, r, s]] {
                out.push(3);
                out.extend(triangle.iter().flat_map(|k| k.to_le_bytes()));
            }
        }
    }
    out
}

/// A coarse unit ball: ascii, quads and triangles, float colours. The file's normals are tilted and
/// not unit, so the use of face normals would show.
fn ball(around: u32, down: u32) -> String {
    let vertices = around * (down - 1) + 2;
    let faces = around * down;
    let mut out = format!(
        "ply\nformat ascii 1.0\nelement vertex {vertices}\n\
         property float x\nproperty float y\nproperty float z\n\
         property float nx\nproperty float ny\nproperty float nz\n\
         property float red\nproperty float green\nproperty float blue\n\
         element face {faces}\nproperty list uchar uint vertex_index\nend_header\n"
    );
    let mut vertex = |[x, y, z]: [f64; 3]| {
        let (nx, ny, nz) = (2.0 * x + 0.2 * z, 2.0 * y, 2.0 * z);
        let (r, g, b) = (0.5 + 0.4 * x, 0.5 + 0.4 * y, 0.6 - 0.3 * z);
        writeln!(out, "{x:.6} {y:.6} {z:.6} {nx:.6} {ny:.6} {nz:.6} {r:.4} {g:.4} {b:.4}").unwrap();
    };
    vertex([0.0, 0.0, 1.0]);
    for row in 1..down {
        for column in 0..around {
            let (sin, cos) = (f64::from(row) / f64::from(down) * TAU / 2.0).sin_cos();
            let (sin_a, cos_a) = (f64::from(column) / f64::from(around) * TAU).sin_cos();
            vertex([sin * cos_a, sin * sin_a, cos]);
        }
    }
    vertex([0.0, 0.0, -1.0]);
    let at = |row: u32, column: u32| 1 + (row - 1) * around + column % around;
    for k in 0..around {
        writeln!(out, "3 0 {} {}", at(1, k), at(1, k + 1)).unwrap();
        writeln!(out, "3 {} {} {}", vertices - 1, at(down - 1, k + 1), at(down - 1, k)).unwrap();
        for row in 1..down - 1 {
            let upper = (at(row, k), at(row, k + 1));
            let lower = (at(row + 1, k), at(row + 1, k + 1));
            writeln!(out, "4 {} {} {} {}", upper.0, lower.0, lower.1, upper.1).unwrap();
        }
    }
    out
}

/// An open vase with `s t` beyond [0, 1] per vertex: binary, quads.
fn vase() -> Vec<u8> {
    let (around, up) = (24_u32, 10_u32);
    let (vertices, faces) = ((around + 1) * (up + 1), around * up);
    let mut out = format!(
        "ply\nformat binary_little_endian 1.0\nelement vertex {vertices}\n\
         property double x\nproperty double y\nproperty double z\n\
         property float s\nproperty float t\n\
         element face {faces}\nproperty list uchar ushort vertex_indices\nend_header\n"
    )
    .into_bytes();
    for b in 0..=up {
        for a in 0..=around {
            let (s, t) = (f64::from(a) / f64::from(around), f64::from(b) / f64::from(up));
            let radius = 0.6 + 0.25 * (TAU * 0.9 * t).sin();
            let (sin, cos) = (TAU * s).sin_cos();
            for x in [radius * cos, 2.0 * t - 1.0, radius * sin] {
                out.extend(x.to_le_bytes());
            }
            out.extend((2.0 * s as f32 - 0.3).to_le_bytes());
            out.extend((1.5 * t as f32 - 0.2).to_le_bytes());
        }
    }
    let at = |a: u32, b: u32| (b * (around + 1) + a) as u16;
    for b in 0..up {
        for a in 0..around {
            out.push(4);
            for k in [at(a, b), at(a + 1, b), at(a + 1, b + 1), at(a, b + 1)] {
                out.extend(k.to_le_bytes());
            }
        }
    }
    out
}

/// A unit box: ascii, quads of mixed winding (surfaces are two-sided), and a `texcoord` list per
/// face that shows the whole image on each side.
fn textured_box() -> String {
    let mut out = "ply\nformat ascii 1.0\nelement vertex 8\n\
                   property float x\nproperty float y\nproperty float z\n\
                   element face 6\nproperty list uchar int vertex_indices\n\
                   property list uchar float texcoord\nend_header\n"
        .to_owned();
    for k in 0..8 {
        let side = |bit: i32| if k & bit == 0 { -0.5 } else { 0.5 };
        writeln!(out, "{} {} {}", side(1), side(2), side(4)).unwrap();
    }
    for face in ["4 5 7 6", "1 0 2 3", "5 1 3 7", "0 4 6 2", "6 7 3 2", "0 1 5 4"] {
        writeln!(out, "4 {face} 8 0 0 1 0 1 1 0 1").unwrap();
    }
    out
}
