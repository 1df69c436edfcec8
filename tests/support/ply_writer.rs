//! Writes small PLY files of any layout in all three encodings.

use lightpath::error::{Error, ErrorKind};
use lightpath::mesh::{Mesh, Positions, ReadOptions, read_ply_bytes};

#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Encoding {
    Ascii,
    Little,
    Big,
}

pub const ALL: [Encoding; 3] = [Encoding::Ascii, Encoding::Little, Encoding::Big];

/// A single number or a list.
#[derive(Clone, Debug)]
pub enum V {
    N(f64),
    L(Vec<f64>),
}

pub type Rows = Vec<Vec<V>>;

/// Rows of single numbers.
pub fn numbers<const N: usize>(rows: &[[f64; N]]) -> Rows {
    rows.iter().map(|row| row.map(V::N).to_vec()).collect()
}

/// Rows of one list each.
pub fn lists(rows: &[&[i64]]) -> Rows {
    rows.iter().map(|row| vec![V::L(row.iter().map(|i| *i as f64).collect())]).collect()
}

/// A file of elements: name, properties as in the header (`float x`), rows.
#[derive(Clone, Default)]
pub struct Ply {
    pub comments: Vec<Vec<u8>>,
    pub elements: Vec<(String, Vec<String>, Rows)>,
}

impl Ply {
    pub fn new() -> Self {
        Self::default()
    }

    pub fn comment(mut self, line: &[u8]) -> Self {
        self.comments.push(line.to_vec());
        self
    }

    pub fn element(mut self, name: &str, properties: &[&str], rows: Rows) -> Self {
        let properties = properties.iter().map(|p| p.to_string()).collect();
        self.elements.push((name.into(), properties, rows));
        self
    }

    /// Adds vertices of float x y z on a curve, no three on a line.
    pub fn curve(self, count: usize) -> Self {
        let rows: Vec<[f64; 3]> = (0..count).map(|i| [i as f64, (i * i) as f64, 0.5]).collect();
        self.element("vertex", &["float x", "float y", "float z"], numbers(&rows))
    }

    pub fn faces(self, faces: &[&[i64]]) -> Self {
        self.element("face", &["list uchar int vertex_indices"], lists(faces))
    }

    pub fn write(&self, encoding: Encoding) -> Vec<u8> {
        let format = match encoding {
            Encoding::Ascii => "ascii",
            Encoding::Little => "binary_little_endian",
            Encoding::Big => "binary_big_endian",
        };
        let mut out = format!("ply\nformat {format} 1.0\n").into_bytes();
        for line in &self.comments {
            out.extend_from_slice(line);
            out.push(b'\n');
        }
        for (name, properties, rows) in &self.elements {
            out.extend(format!("element {name} {}\n", rows.len()).bytes());
            for property in properties {
                out.extend(format!("property {property}\n").bytes());
            }
        }
        out.extend(b"end_header\n");
        for (_, properties, rows) in &self.elements {
            for row in rows {
                write_row(&mut out, properties, row, encoding);
            }
        }
        out
    }
}

fn write_row(out: &mut Vec<u8>, properties: &[String], row: &[V], encoding: Encoding) {
    assert_eq!(properties.len(), row.len());
    for (property, value) in properties.iter().zip(row) {
        let words: Vec<&str> = property.split(' ').collect();
        match value {
            V::N(number) => put(out, words[0], *number, encoding),
            V::L(items) => {
                put(out, words[1], items.len() as f64, encoding);
                items.iter().for_each(|item| put(out, words[2], *item, encoding));
            }
        }
    }
    if encoding == Encoding::Ascii {
        out.pop();
        out.push(b'\n');
    }
}

fn put(out: &mut Vec<u8>, kind: &str, value: f64, encoding: Encoding) {
    if encoding == Encoding::Ascii {
        let text = match kind {
            "float" | "float32" => format!("{} ", value as f32),
            _ => format!("{value} "),
        };
        return out.extend(text.bytes());
    }
    let mut bytes = match kind {
        "char" | "int8" => (value as i8).to_le_bytes().to_vec(),
        "uchar" | "uint8" => (value as u8).to_le_bytes().to_vec(),
        "short" | "int16" => (value as i16).to_le_bytes().to_vec(),
        "ushort" | "uint16" => (value as u16).to_le_bytes().to_vec(),
        "int" | "int32" => (value as i32).to_le_bytes().to_vec(),
        "uint" | "uint32" => (value as u32).to_le_bytes().to_vec(),
        "float" | "float32" => (value as f32).to_le_bytes().to_vec(),
        "double" | "float64" => value.to_le_bytes().to_vec(),
        other => panic!("type {other}"),
    };
    if encoding == Encoding::Big {
        bytes.reverse();
    }
    out.extend(bytes);
}

/// Reads bytes as the file `t.ply`.
pub fn read(bytes: &[u8]) -> Result<Mesh, Error> {
    read_ply_bytes(bytes, "t.ply", ReadOptions::default())
}

/// Reads a mesh, which must be the same in all encodings.
pub fn read_all(ply: &Ply) -> Mesh {
    let [ascii, little, big] = ALL.map(|encoding| match read(&ply.write(encoding)) {
        Ok(mesh) => mesh,
        Err(error) => panic!("{encoding:?}: {error}"),
    });
    for mut other in [little, big] {
        other.notes.format = ascii.notes.format;
        assert_eq!(format!("{ascii:?}"), format!("{other:?}"));
    }
    ascii
}

/// Returns the error of a file that must be refused: its text without the leading `error: `.
pub fn refused(bytes: &[u8]) -> String {
    let error = read(bytes).expect_err("must be refused");
    assert_eq!(error.kind, ErrorKind::Invalid);
    assert_eq!(error.exit_code(), 2);
    error.to_string().trim_start_matches("error: ").to_string()
}

/// Returns the positions in f64.
pub fn points(mesh: &Mesh) -> Vec<[f64; 3]> {
    match &mesh.positions {
        Positions::F32(p) => p.iter().map(|p| p.map(f64::from)).collect(),
        Positions::F64(p) => p.clone(),
    }
}
