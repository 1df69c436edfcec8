//! Faces without area in files: those that close a T-junction belong to the scene, others do not.

use std::fmt::Write as _;

use lightpath::mesh::{ReadOptions, read_ply_bytes};
use lightpath::{Mesh, Monitor, RayBatch, RayScene};

/// Twelve faces of the unit cube around (0.5, 0.5, 0.5).
pub(super) const CUBE: [[u32; 3]; 12] = [
    [0, 2, 1],
    [1, 2, 3],
    [4, 5, 6],
    [5, 7, 6],
    [0, 1, 4],
    [1, 5, 4],
    [2, 6, 3],
    [3, 6, 7],
    [0, 4, 2],
    [2, 4, 6],
    [1, 3, 5],
    [3, 7, 5],
];

/// The cube as a file, moved by `middle`. With `split`, one side of an edge has a vertex on it, and
/// a face without area lies between. With `stray`, the first face is a line far away.
fn read(middle: [f64; 3], split: bool, stray: bool) -> Mesh {
    let mut vertices: Vec<[f64; 3]> =
        (0..8u8).map(|i| [0, 1, 2].map(|k| middle[k] + f64::from(i >> k & 1) - 0.5)).collect();
    vertices.push([middle[0], middle[1] - 0.5, middle[2] - 0.5]);
    vertices.extend([[5.0, 0.0, 0.0], [6.0, 0.0, 0.0], [7.0, 0.0, 0.0]]);
    let mut faces = if stray { vec![[9, 10, 11]] } else { vec![] };
    faces.extend(if split { vec![[0, 8, 1], [0, 2, 8], [8, 2, 1]] } else { vec![CUBE[0]] });
    faces.extend(&CUBE[1..]);
    parse(&vertices, &faces)
}

/// Reads a file of these vertices and faces.
pub(super) fn parse(vertices: &[[f64; 3]], faces: &[[u32; 3]]) -> Mesh {
    let mut ply = format!(
        "ply\nformat ascii 1.0\nelement vertex {}\nproperty double x\nproperty double y\n\
         property double z\nelement face {}\nproperty list uchar int vertex_indices\nend_header\n",
        vertices.len(),
        faces.len()
    );
    for [x, y, z] in vertices {
        writeln!(ply, "{x} {y} {z}").expect("text");
    }
    for [a, b, c] in faces {
        writeln!(ply, "3 {a} {b} {c}").expect("text");
    }
    read_ply_bytes(ply.as_bytes(), "cube.ply", ReadOptions::default()).expect("a mesh")
}

#[test]
fn a_scene_of_a_file_has_stitches_but_no_stray_lines() {
    let monitor = Monitor::default();
    for middle in [[0.5; 3], [4e5, 5.6e6, 100.0]] {
        for (split, stray) in [(false, true), (true, false), (true, true)] {
            let mesh = read(middle, split, stray);
            let expected: &[[u32; 3]] = if split { &[[0, 8, 1]] } else { &[] };
            assert_eq!(mesh.stitches, expected);
            assert_eq!(mesh.notes.degenerate_dropped, u64::from(split) + u64::from(stray));
            let scene = RayScene::new(vec![Box::new(mesh)], &monitor).expect("a scene");
            assert_eq!(scene.meshes()[0].faces().len(), 12 + 2 * usize::from(split));
            assert_eq!(scene.closed(&monitor), Ok(&[true][..]));
            let corners = [-0.5, 0.5].map(|side| middle.map(|x| x + side));
            assert_eq!(scene.bounds(), corners);
            // Along z through the cube, and through the edge with the vertex on it.
            let from = |x: f64, y: f64| [middle[0] + x, middle[1] + y, middle[2] - 3.0];
            let mut origins: Vec<_> = (0..500)
                .map(|i| f64::from(i) * 0.001_99 - 0.498)
                .map(|x| from(x, (7.0 * x).sin() * 0.49))
                .collect();
            let rays = RayBatch::new(&origins, &[[0.0, 0.0, 1.0]; 500]).expect("rays");
            assert_eq!(scene.count(&rays, &monitor), Ok(vec![2; 500]));
            origins.iter_mut().for_each(|origin| *origin = from(origin[0] - middle[0], -3.5));
            let rays = RayBatch::new(&origins, &[[0.0, 1.0, 1.0]; 500]).expect("rays");
            let counts = scene.count(&rays, &monitor).expect("counts");
            assert!(counts.iter().all(|count| count % 2 == 0), "{counts:?}");
        }
    }
    let scene = RayScene::new(vec![Box::new(read([0.5; 3], true, true))], &monitor);
    let near = scene.expect("a scene").closest_point(&[[6.0, 0.0, 0.1]], &monitor);
    assert_eq!(near.expect("a point").distance, [5.0]);
}
