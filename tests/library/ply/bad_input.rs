//! Every invalid PLY file gets its message, the messages are those of docs/notebook/bad-input.md,
//! and no sequence of bytes makes the reader panic.

use crate::support::program;
use std::path::Path;

use crate::support::ply_writer::{self, ALL, Encoding, Ply, V, numbers, read, refused};
use lightpath::mesh::{ReadOptions, TriangleCount, inspect_ply, read_ply, read_ply_bytes};
use proptest::prelude::*;

/// Returns a header of text lines, without data.
fn header(lines: &str) -> Vec<u8> {
    format!("ply\n{lines}\n").into_bytes()
}

/// Returns a text file of three vertices with these lines for its face element.
fn text(vertices: &str, faces: &str) -> Vec<u8> {
    format!(
        "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty uchar z\n\
         element face 1\nproperty list char int vertex_indices\nend_header\n{vertices}\n{faces}"
    )
    .into_bytes()
}

fn binary(ply: Ply) -> Vec<u8> {
    ply.write(Encoding::Little)
}

/// Returns a binary file whose header has `to` in place of `from`.
fn lie(ply: Ply, from: &str, to: &str) -> Vec<u8> {
    let bytes = binary(ply);
    let at = bytes.windows(from.len()).position(|w| w == from.as_bytes()).unwrap();
    [&bytes[..at], to.as_bytes(), &bytes[at + from.len()..]].concat()
}

fn good() -> Ply {
    Ply::new().curve(4).faces(&[&[0, 1, 2], &[1, 2, 3]])
}

const V: &str = "0 0 0\n1 0 0\n0 1 0";
const START: &str =
    "format ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\n";

/// Returns description, content, and first line of the message of each invalid file.
fn cases() -> Vec<(&'static str, Vec<u8>, &'static str)> {
    let mut cases = not_ply_cases();
    cases.extend(header_cases());
    cases.extend(mesh_cases());
    cases.extend(data_cases());
    cases
}

fn not_ply_cases() -> Vec<(&'static str, Vec<u8>, &'static str)> {
    let not = "t.ply: is not a PLY file: its first line is not 'ply'";
    vec![
        ("another file", b"\x89PNG\r\n\x1a\n".to_vec(), not),
        (
            "gzip data that ends early",
            b"\x1f\x8b\x08\x00".to_vec(),
            "t.ply: cannot unpack the gzip data: unexpected end of file",
        ),
        (
            "zstd frame that asks for too much memory",
            b"\x28\xb5\x2f\xfd\x00\xa8\x01\x00\x00".to_vec(),
            "t.ply: cannot unpack the zstd data: Frame requires too much memory for decoding",
        ),
        (
            "zstd data that ends early",
            b"\x28\xb5\x2f\xfd\x00".to_vec(),
            "t.ply: cannot unpack the zstd data: incomplete frame",
        ),
        ("lines that end in CR alone", b"ply\rformat ascii 1.0\r".to_vec(), not),
        (
            "header without its end",
            header("format ascii 1.0\nelement vertex 3"),
            "t.ply: the header has no end_header; the file ends after its line 3",
        ),
        (
            "no format line",
            header("element vertex 3\nend_header"),
            "t.ply: the header has no format line",
        ),
    ]
}

fn header_cases() -> Vec<(&'static str, Vec<u8>, &'static str)> {
    let h = header;
    vec![
        ("unknown format", h("format binary 1.0"), "t.ply:2: unknown format 'binary'"),
        ("format without version", h("format ascii"), "t.ply:2: the format has no version"),
        (
            "unknown version",
            h("format ascii 2.0"),
            "t.ply:2: format version '2.0' is unknown: only 1.0 exists",
        ),
        ("two formats", h("format ascii 1.0\nformat ascii 1.0"), "t.ply:3: a second format line"),
        (
            "unknown header word",
            h("format ascii 1.0\nelements vertex 3"),
            "t.ply:3: unknown header word 'elements'",
        ),
        (
            "empty line in the header",
            h("format ascii 1.0\n\nend_header"),
            "t.ply:3: an empty line in the header",
        ),
        (
            "element without count",
            h("format ascii 1.0\nelement vertex"),
            "t.ply:3: expected `element NAME COUNT`",
        ),
        (
            "count that is no number",
            h("format ascii 1.0\nelement vertex -3"),
            "t.ply:3: the count '-3' of element vertex is not a whole number >= 0",
        ),
        (
            "count beyond 64 bits",
            h("format ascii 1.0\nelement vertex 99999999999999999999"),
            "t.ply:3: the count '99999999999999999999' of element vertex is not a whole number >= 0",
        ),
        (
            "the same element twice",
            h("element face 1\nelement face 1"),
            "t.ply:3: a second element 'face'",
        ),
        (
            "the same property twice",
            h("element face 1\nproperty int a\nproperty int a"),
            "t.ply:4: element face has a second property 'a'",
        ),
        (
            "property before any element",
            h("property float x"),
            "t.ply:2: property 'x' comes before any element",
        ),
        ("unknown type", h("element vertex 3\nproperty half x"), "t.ply:3: unknown type 'half'"),
        (
            "incomplete property",
            h("element vertex 3\nproperty list uchar int"),
            "t.ply:3: expected `property TYPE NAME` or `property list COUNT_TYPE ITEM_TYPE NAME`",
        ),
        (
            "list counted in floats",
            h("element face 3\nproperty list float int a"),
            "t.ply:3: the list 'a' is counted in float: not an integer type",
        ),
        (
            "endless line",
            h(&format!("comment {}", "x".repeat(70_000))),
            "t.ply:2: the line is longer than 65536 bytes",
        ),
        (
            "endless header",
            h(&"comment\n".repeat(10_001)),
            "t.ply:10001: the header is longer than 10000 lines or 16777216 bytes",
        ),
    ]
}

fn mesh_cases() -> Vec<(&'static str, Vec<u8>, &'static str)> {
    let h = |lines: &str| header(&format!("{}\nend_header", lines.trim_end()));
    vec![
        (
            "no vertices declared",
            h("format ascii 1.0\nelement point 3\nproperty float x"),
            "t.ply: has no element 'vertex', only: [point]",
        ),
        (
            "no z",
            h("format ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y"),
            "t.ply: element vertex has no scalar property 'z'",
        ),
        ("point cloud", h(START), "t.ply: has no faces: it is a point cloud of 3 points"),
        (
            "zero faces",
            h(&format!("{START}element face 0\nproperty list uchar int vertex_indices")),
            "t.ply: has no faces: it is a point cloud of 3 points",
        ),
        (
            "faces without corners",
            h(&format!("{START}element face 1\nproperty int vertex_indices")),
            "t.ply: element face has no list of integers 'vertex_indices' or 'vertex_index'",
        ),
        (
            "too many vertices",
            h(&START.replace(" 3\n", " 4294967296\n")),
            "t.ply: has 4294967296 vertices; the most is 4294967295",
        ),
        (
            "only lines and points",
            binary(Ply::new().curve(4).faces(&[&[0, 1], &[1], &[]])),
            "t.ply: no triangle is left of 3 faces: 3 have fewer than 3 corners, 0 triangles have no area or \
          repeat a vertex, 0 use missing or non-finite vertices",
        ),
        (
            "only triangles without area",
            binary(Ply::new().curve(4).faces(&[&[0, 1, 1]])),
            "t.ply: no triangle is left of 1 face: 0 have fewer than 3 corners, 1 triangle has no area or \
          repeats a vertex, 0 use missing or non-finite vertices",
        ),
    ]
}

fn data_cases() -> Vec<(&'static str, Vec<u8>, &'static str)> {
    let nan = numbers(&[[0., 0., 0.], [1., f64::NAN, 0.], [f64::INFINITY, 1., 0.]]);
    let nan = Ply::new().element("vertex", &["float x", "float y", "float z"], nan);
    let cut = |bytes: Vec<u8>, n: usize| bytes[..bytes.len() - n].to_vec();
    let uv = |n: usize| vec![vec![V::L(vec![0., 1., 2.]), V::L(vec![0.5; n])]];
    vec![
        (
            "count that the file cannot hold",
            lie(good(), "vertex 4\n", "vertex 4000000000\n"),
            "t.ply: the header declares 4000000000 vertices, but only 6 are in the file: they need 48000000000 bytes, 74 are left",
        ),
        (
            "count beyond any file",
            lie(good(), "face 2\n", "face 18446744073709551615\n"),
            "t.ply: the header declares 18446744073709551615 faces, but only 2 are in the file: 26 bytes of data were left for them",
        ),
        (
            "binary file cut in its vertices",
            cut(binary(good()), 30),
            "t.ply: the header declares 4 vertices, but only 3 are in the file: they need 48 bytes, 44 are left",
        ),
        (
            "binary file cut in its faces",
            cut(binary(good()), 1),
            "t.ply: the header declares 2 faces, but only 1 is in the file: 25 bytes of data were left for them",
        ),
        (
            "text file cut between lines",
            text(V, ""),
            "t.ply: the header declares 1 face, but only 0 are in the file: 3 lines of data in all",
        ),
        (
            "text file cut inside a line",
            text(V, "3 0 1"),
            "t.ply: the header declares 1 face, but only 0 are in the file: its last line is incomplete",
        ),
        (
            "line with too few values",
            text("0 0\n1 0 0\n0 1 0", "3 0 1 2"),
            "t.ply:10: vertex 0: the line has too few values",
        ),
        (
            "line with too many values",
            text(V, "3 0 1 2 5"),
            "t.ply:13: face 0: the line has too many values, from '5' on",
        ),
        (
            "word for a number",
            text("0 zero 0\n1 0 0\n0 1 0", "3 0 1 2"),
            "t.ply:10: vertex 0: 'zero' is not a number",
        ),
        (
            "value beyond its type",
            text("0 0 0\n\n1 0 256\n0 1 0", "3 0 1 2"),
            "t.ply:12: vertex 1: '256' does not fit type uchar",
        ),
        (
            "fraction for an integer",
            text(V, "3 0 1 1.5"),
            "t.ply:13: face 0: '1.5' does not fit type int",
        ),
        ("negative count, text", text(V, "-3 0 1 2"), "t.ply:13: face 0: a list of -3 values"),
        (
            "negative count, binary",
            lie(
                Ply::new().curve(4).element(
                    "face",
                    &["list uchar int vertex_index"],
                    vec![vec![V::L(vec![0.0; 200])]],
                ),
                "list uchar int",
                "list char int",
            ),
            "t.ply: face 0: the list 'vertex_index' has -56 values",
        ),
        (
            "index out of range",
            binary(Ply::new().curve(4).faces(&[&[0, 1, 2], &[0, 9, -1], &[4, 1, 2]])),
            "t.ply: face 1: vertex index 9 is out of range: the file has 4 vertices (0 to 3); indices out of range in all: 3",
        ),
        (
            "strip with an index out of range",
            binary(Ply::new().curve(4).element(
                "tristrips",
                &["list int int vertex_indices"],
                vec![vec![V::L(vec![0., 1., 2., -1., 2., 1., -2.])]],
            )),
            "t.ply: tristrips 0: vertex index -2 is out of range: the file has 4 vertices (0 to 3); indices out of range in all: 1",
        ),
        (
            "vertex that is not finite",
            binary(nan.faces(&[&[0, 1, 2]])),
            "t.ply: vertex 1: (1, NaN, 0) is not finite, and face 0 uses it; such vertices in all: 2",
        ),
        (
            "texcoord that does not match the face",
            binary(Ply::new().curve(4).element(
                "face",
                &["list uchar int vertex_indices", "list uchar float texcoord"],
                uv(5),
            )),
            "t.ply: face 0: texcoord has 5 values for 3 corners; expected 6 or none",
        ),
        (
            "huge polygon that is not convex",
            binary(dented(16_385)),
            "t.ply: face 0: a polygon of 16385 corners that is not convex; the most is 16384",
        ),
    ]
}

/// A polygon around a circle with one corner in the centre.
fn dented(corners: usize) -> Ply {
    let point = |i: usize| {
        let (sin, cos) = (i as f64 / corners as f64 * std::f64::consts::TAU).sin_cos();
        if i == 3 { [0.0; 3] } else { [cos, sin, 0.0] }
    };
    let points: Vec<[f64; 3]> = (0..corners).map(point).collect();
    let face = V::L((0..corners).map(|i| i as f64).collect());
    Ply::new().element("vertex", &["double x", "double y", "double z"], numbers(&points)).element(
        "face",
        &["list int int vertex_index"],
        vec![vec![face]],
    )
}

#[test]
fn every_bad_file_has_its_message() {
    for (what, bytes, message) in cases() {
        let found = refused(&bytes);
        assert_eq!(found.lines().next(), Some(message), "{what}");
    }
}

#[cfg(unix)]
#[test]
fn the_program_refuses_every_bad_file() {
    let refusals = program::Refusals::new();
    // `info` describes a cloud of points.
    let cases = cases().into_iter().filter(|(_, _, message)| !message.contains("point cloud"));
    for (what, bytes, message) in cases {
        let done = refusals.file("t.ply", &bytes);
        let stderr = done.stderr();
        assert_eq!(stderr.lines().next(), Some(&*format!("error: {message}")), "{what}");
        assert_eq!((done.code(), done.stdout()), (2, String::new()), "{what}");
    }
}

#[test]
fn the_table_in_the_docs_matches_the_program() {
    let docs = include_str!("../../../docs/notebook/bad-input.md");
    let table = docs.split("\n## Meshes\n").nth(1).unwrap().split("\n## ").next().unwrap();
    let rows = cases().into_iter().map(|(what, _, message)| (what, message)).chain(path_cases());
    let rows: Vec<String> = rows
        .map(|(what, message)| format!("| {what} | `{}` | 2 |", message.replace('`', "'")))
        .collect();
    let found: Vec<&str> =
        table.lines().filter(|l| l.starts_with("| ") && l.ends_with(" 2 |")).collect();
    assert_eq!(found, rows, "expected:\n{}", rows.join("\n"));
}

fn path_cases() -> [(&'static str, &'static str); 4] {
    [
        ("missing file", "t.ply: cannot read: No such file or directory (os error 2)"),
        ("folder", "t.ply: is a folder, not a PLY file"),
        ("empty file", "t.ply: is empty (0 bytes)"),
        ("device", "/dev/null: is a device, not a PLY file"),
    ]
}

#[cfg(unix)]
#[test]
fn bad_paths() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("t.ply");
    let said = |path: &Path| {
        let all: Vec<String> = [true, false]
            .iter()
            .map(|mmap| read_ply(path, ReadOptions::default().mmap(*mmap)).unwrap_err())
            .chain([inspect_ply(path).unwrap_err()])
            .map(|error| {
                assert_eq!(error.exit_code(), 2);
                error
                    .to_string()
                    .lines()
                    .next()
                    .unwrap()
                    .replace(&format!("{}/", folder.path().display()), "")
            })
            .collect();
        assert!(all.iter().all(|s| *s == all[0]), "{all:?}");
        all[0].trim_start_matches("error: ").to_string()
    };
    let [missing, folder_case, empty, device] = path_cases().map(|(_, message)| message);
    assert_eq!(said(&path), missing);
    std::fs::create_dir(&path).unwrap();
    assert_eq!(said(&path), folder_case);
    std::fs::remove_dir(&path).unwrap();
    std::fs::write(&path, "").unwrap();
    assert_eq!(said(&path), empty);
    assert_eq!(said(Path::new("/dev/null")), device);
}

#[test]
fn both_kinds_of_invalid_vertex_are_reported_at_once_with_help() {
    let rows = numbers(&[[0., 0., 0.], [1., f64::NAN, 0.], [1., 1., 0.]]);
    let ply = Ply::new()
        .element("vertex", &["float x", "float y", "float z"], rows)
        .faces(&[&[0, 1, 2], &[0, 2, 7]]);
    let said = refused(&binary(ply));
    assert_eq!(said.lines().count(), 3, "{said}");
    assert!(said.ends_with("help: --repair drops the 2 triangles that use them"), "{said}");
}

/// Small files in which every byte matters.
fn samples() -> Vec<Ply> {
    let vertex = |x: f64, y: f64| vec![V::N(x), V::N(y), V::N(3.0), V::N(1.0)];
    let properties = ["float x", "float y", "float z", "uchar red"];
    let vertices = vec![vertex(0., 0.), vertex(1., 0.), vertex(0., 1.), vertex(1., 1.)];
    let start =
        || Ply::new().comment(b"comment c").element("vertex", &properties, vertices.clone());
    vec![
        start().faces(&[&[0, 1, 2], &[1, 2, 3]]),
        start().faces(&[&[0, 1, 2, 3], &[1, 2, 3], &[]]),
        start().element(
            "tristrips",
            &["list int int vertex_indices"],
            vec![vec![V::L(vec![0., 1., 2., 3.])]],
        ),
        start()
            .element(
                "face",
                &["list uchar int vertex_index", "list uchar float texcoord"],
                vec![vec![V::L(vec![0., 1., 2.]), V::L(vec![0.; 6])]],
            )
            .element("edge", &["int a", "uchar b"], numbers(&[[1., 2.], [3., 4.]])),
    ]
}

#[test]
fn a_file_cut_at_any_byte_is_refused() {
    for ply in samples() {
        for encoding in ALL {
            let bytes = ply.write(encoding);
            assert!(read(&bytes).is_ok());
            // A text file may lack its last line end.
            let last = bytes.len() - usize::from(encoding == Encoding::Ascii);
            for length in 0..last {
                assert!(
                    read(&bytes[..length]).is_err(),
                    "{encoding:?} cut to {length} of {}",
                    bytes.len()
                );
            }
        }
    }
}

#[test]
fn summaries() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.ply");
    for (index, ply) in samples().iter().enumerate() {
        for encoding in ALL {
            let bytes = ply.write(encoding);
            std::fs::write(&path, &bytes).unwrap();
            let summary = inspect_ply(&path).unwrap();
            let mesh = read(&bytes).unwrap();
            assert_eq!((summary.vertices, summary.file_bytes), (4, bytes.len() as u64));
            assert_eq!((&summary.used, &summary.ignored), (&mesh.notes.used, &mesh.notes.ignored));
            assert_eq!(summary.uvs, (index == 3).then_some("corner"));
            if summary.triangles_are == TriangleCount::Exact {
                assert_eq!(summary.triangles, mesh.triangles.len() as u64);
                assert_eq!(summary.array_bytes, 4 * 12 + 12 * summary.triangles);
            }
            assert_eq!(
                summary.triangles_are == TriangleCount::Exact,
                index == 0 && encoding != Encoding::Ascii
            );
            let json = serde_json::to_value(&summary).unwrap();
            assert_eq!(json["elements"][0]["properties"][3]["kind"], "uchar");
        }
    }
}

/// Polygons with many corners beside faces with none, and strips of different lengths.
#[test]
fn no_mesh_has_more_triangles_than_its_summary_promises() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.ply");
    let write = |element: &str, rows: &[&[i32]]| {
        let header = format!(
            "ply\nformat binary_little_endian 1.0\nelement vertex 6\nproperty float x\n\
             property float y\nproperty float z\nelement {element} {}\n\
             property list uchar int vertex_indices\nend_header\n",
            rows.len()
        );
        let mut bytes = header.into_bytes();
        for (x, y) in [(0, 0), (2, 0), (3, 1), (2, 2), (0, 2), (-1, 1)] {
            [x, y, x * y].iter().for_each(|&v| bytes.extend((v as f32).to_le_bytes()));
        }
        for row in rows {
            bytes.push(row.len() as u8);
            row.iter().for_each(|index| bytes.extend(index.to_le_bytes()));
        }
        std::fs::write(&path, &bytes).unwrap();
        let summary = inspect_ply(&path).unwrap();
        let mesh = read_ply_bytes(&bytes, "a.ply", ReadOptions::default()).unwrap();
        (summary.triangles, summary.triangles_are, mesh.triangles.len() as u64)
    };
    let hexagon: &[i32] = &[0, 1, 2, 3, 4, 5];
    for short in 1..9 {
        let rows = [&[hexagon][..], &vec![&[][..]; short]].concat();
        let (promised, reliable, triangles) = write("face", &rows);
        let bound = if reliable == TriangleCount::Exact { 3 * promised - 1 } else { promised };
        assert!(triangles == 4 && bound >= 4, "{short}: {promised}");
        let (promised, _, triangles) = write("tristrips", &rows);
        assert!(promised >= triangles && triangles > 0, "{short}: {promised}, {triangles}");
    }
    assert_eq!(write("face", &[hexagon]), (4, TriangleCount::Exact, 4));
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 400, failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn random_data_never_panics(
        which in 0..4usize, encoding in 0..3usize, data in prop::collection::vec(any::<u8>(), 0..300), repair: bool,
    ) {
        let bytes = samples()[which].write(ALL[encoding]);
        let end = bytes.windows(11).position(|w| w == b"end_header\n").unwrap() + 11;
        for start in [b"ply\n", &bytes[..end]] {
            let bytes = [start, &data].concat();
            let _ = read_ply_bytes(&bytes, "t.ply", ReadOptions::default().repair(repair));
        }
    }

    #[test]
    fn changed_bytes_give_an_error_or_a_valid_mesh(
        which in 0..4usize, encoding in 0..3usize, repair: bool,
        changes in prop::collection::vec((any::<prop::sample::Index>(), any::<u8>()), 1..4),
    ) {
        let mut bytes = samples()[which].write(ALL[encoding]);
        for (at, value) in changes {
            let at = at.index(bytes.len());
            bytes[at] = value;
        }
        if let Ok(mesh) = read_ply_bytes(&bytes, "t.ply", ReadOptions::default().repair(repair)) {
            let points = ply_writer::points(&mesh);
            for [a, b, c] in mesh.triangles {
                prop_assert!(a != b && b != c && c != a);
                for vertex in [a, b, c] {
                    prop_assert!(points[vertex as usize].iter().all(|c| c.is_finite()));
                }
            }
        }
    }
}
