//! Reads a PLY file for each line on stdin, and prints the seconds until the arrays are ready. This
//! is the Rust half of `benches/ply_readers.py`.
//!
//! `floor` is a lower bound for any reader of a file of float vertices and uchar/int triangles: all
//! threads copy the records of a mapped file into typed arrays, and nothing is checked.

use std::io::BufRead;
use std::path::Path;
use std::time::Instant;

use lightpath::mesh::{ReadOptions, read_ply};
use ply_rs_bw::parser::Parser;
use ply_rs_bw::ply::{Property, PropertyAccess};
use rayon::prelude::*;

fn main() {
    let arguments: Vec<String> = std::env::args().collect();
    let [_, reader, path] = &arguments[..] else {
        eprintln!("usage: ply-readers floor|lightpath|lightpath-no-mmap|ply-rs-bw FILE.ply");
        std::process::exit(2);
    };
    let path = Path::new(path);
    for _ in std::io::stdin().lock().lines() {
        let begun = Instant::now();
        let arrays = match reader.as_str() {
            "floor" => floor(path),
            "lightpath" => mesh(path, true),
            "lightpath-no-mmap" => mesh(path, false),
            "ply-rs-bw" => other(path),
            name => panic!("no reader {name}"),
        };
        let seconds = begun.elapsed().as_secs_f64();
        println!("{seconds} {}", arrays.triangles());
    }
}

/// The arrays that a reader makes. Kept alive until the clock stops, so that freeing is not timed.
enum Arrays {
    Plain(Vec<[f32; 3]>, Vec<[u32; 3]>),
    Mesh(Box<lightpath::mesh::Mesh>),
}

impl Arrays {
    fn triangles(&self) -> usize {
        match self {
            Self::Plain(vertices, triangles) => triangles.len().max(vertices.len().min(1)),
            Self::Mesh(mesh) => mesh.triangles.len(),
        }
    }
}

fn mesh(path: &Path, mmap: bool) -> Arrays {
    let mesh = read_ply(path, ReadOptions::default().mmap(mmap)).expect("a mesh");
    Arrays::Mesh(Box::new(mesh))
}

fn floor(path: &Path) -> Arrays {
    let file = std::fs::File::open(path).expect("a file");
    // SAFETY: nobody writes to the file of a benchmark.
    let map = unsafe { memmap2::Mmap::map(&file) }.expect("a map");
    let head = String::from_utf8_lossy(&map[..map.len().min(2000)]).into_owned();
    let count = |name: &str| -> usize {
        let words = head.split(&format!("element {name} ")).nth(1).expect("an element");
        words.split_whitespace().next().and_then(|w| w.parse().ok()).expect("a count")
    };
    let data = &map[head.find("end_header\n").expect("a header") + 11..];
    let (vertices, faces) = data.split_at(12 * count("vertex"));
    let number = |bytes: &[u8], i: usize| {
        [bytes[4 * i], bytes[4 * i + 1], bytes[4 * i + 2], bytes[4 * i + 3]]
    };
    assert_eq!(faces.len(), 13 * count("face"), "only for binary triangles");
    let grain = 1 << 14;
    let point = |row: &[u8]| [0, 1, 2].map(|i| f32::from_le_bytes(number(row, i)));
    let vertices = vertices.par_chunks_exact(12).with_min_len(grain).map(point).collect();
    let corner = |row: &[u8]| [0, 1, 2].map(|i| u32::from_le_bytes(number(&row[1..], i)));
    let faces = faces.par_chunks_exact(13).with_min_len(grain);
    Arrays::Plain(vertices, faces.map(corner).collect())
}

#[derive(Default)]
struct Vertex([f32; 3]);

impl PropertyAccess for Vertex {
    fn new() -> Self {
        Self::default()
    }

    fn set_property(&mut self, key: &str, property: Property) {
        let axis = ["x", "y", "z"].iter().position(|axis| *axis == key);
        match (axis, property) {
            (Some(axis), Property::Float(value)) => self.0[axis] = value,
            (Some(axis), Property::Double(value)) => self.0[axis] = value as f32,
            _ => {}
        }
    }
}

#[derive(Default)]
struct Face(Vec<u32>);

impl PropertyAccess for Face {
    fn new() -> Self {
        Self::default()
    }

    fn set_property(&mut self, _: &str, property: Property) {
        match property {
            Property::ListInt(corners) => self.0 = corners.iter().map(|c| *c as u32).collect(),
            Property::ListUInt(corners) => self.0 = corners,
            _ => {}
        }
    }
}

fn other(path: &Path) -> Arrays {
    let mut file = std::io::BufReader::new(std::fs::File::open(path).expect("a file"));
    let (vertices, faces) = (Parser::<Vertex>::new(), Parser::<Face>::new());
    let header = vertices.read_header(&mut file).expect("a header");
    let (mut points, mut triangles) = (Vec::new(), Vec::new());
    for (name, element) in &header.elements {
        match name.as_str() {
            "vertex" => {
                let rows = vertices.read_payload_for_element(&mut file, element, &header);
                points = rows.expect("vertices").into_iter().map(|v| v.0).collect();
            }
            _ => {
                let rows = faces.read_payload_for_element(&mut file, element, &header);
                for face in rows.expect("faces") {
                    let fan = |i: usize| [face.0[0], face.0[i], face.0[i + 1]];
                    triangles.extend((1..face.0.len().saturating_sub(1)).map(fan));
                }
            }
        }
    }
    Arrays::Plain(points, triangles)
}
