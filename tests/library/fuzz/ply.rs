//! Reads bytes as PLY. The result must be an error or a valid mesh. It must be the same mesh, or an
//! error of the same kind, if the bytes are compressed and read through a small window.

use std::io::Write;

use flate2::{Compression, write::GzEncoder};
use lightpath::mesh::{Mesh, ReadOptions, Uvs, read_ply_bytes};

/// Runs one input. Returns whether it is a mesh.
pub fn run(bytes: &[u8]) -> bool {
    let Some((&choice, bytes)) = bytes.split_last() else { return false };
    let options = ReadOptions::default().repair(choice & 1 == 1);
    let whole = read_ply_bytes(bytes, "f", options);
    let is_mesh = whole.is_ok();
    if let Ok(mesh) = &whole {
        check(mesh);
    }
    if choice & 2 == 2 && bytes.starts_with(b"ply") {
        let mut packed = GzEncoder::new(Vec::new(), Compression::none());
        packed.write_all(bytes).expect("memory");
        let packed = packed.finish().expect("memory");
        let window = 1 + (choice as usize >> 2) * 8;
        match (whole, read_ply_bytes(&packed, "f", options.window(window))) {
            (Ok(a), Ok(b)) => assert_eq!(format!("{a:?}"), format!("{b:?}")),
            (Err(a), Err(b)) => assert_eq!(a.kind, b.kind, "{a} {b}"),
            (a, b) => panic!("{:?} {:?}", a.err(), b.err()),
        }
    }
    is_mesh
}

fn check(mesh: &Mesh) {
    let count = mesh.positions.len();
    for &[a, b, c] in &mesh.triangles {
        assert!(a != b && b != c && c != a);
        for vertex in [a, b, c] {
            assert!(mesh.positions.get(vertex as usize).is_finite());
        }
    }
    assert!(!mesh.triangles.is_empty());
    assert!(mesh.normals.as_ref().is_none_or(|normals| normals.len() == count));
    match &mesh.uvs {
        Some(Uvs::PerCorner(uvs)) => assert_eq!(uvs.len(), mesh.triangles.len()),
        Some(Uvs::PerVertex(uvs)) => assert_eq!(uvs.len(), count),
        None => {}
    }
}
