//! What is near a point depends on the sizes of the neighbours, not only on that of the point's own
//! triangle.

use crate::support::backends::{self, on_both};
use glam::{DMat3, DVec3};
use lightpath::geometry::{Geometry, Instance, Nearby, Placement, TriangleMesh, is_near};
use lightpath::scene::Backend;
use lightpath::simd::Isa;

/// Half the side of the ground.
const FAR: f32 = 20_000.0;

/// Cells of the small mesh on a side of 4 cm.
const CELLS: u32 = 32;

/// A curved surface of many small triangles, up to 2 cm above the ground.
fn small() -> TriangleMesh {
    let place = |k: u32| 0.04 * (k as f32 / CELLS as f32 - 0.5);
    let vertex = |i: u32, j: u32| {
        let (x, y) = (place(i), place(j));
        [x, y, 0.02 - 20.0 * (x * x + y * y)]
    };
    let vertices = (0..=CELLS).flat_map(|i| (0..=CELLS).map(move |j| vertex(i, j))).collect();
    let cells = (0..CELLS).flat_map(|i| (0..CELLS).map(move |j| i * (CELLS + 1) + j));
    let halves = |a: u32| [[a, a + CELLS + 1, a + 1], [a + 1, a + CELLS + 1, a + CELLS + 2]];
    TriangleMesh::new(vertices, cells.flat_map(halves).collect(), false)
}

/// A ground quad, a wall as large that stands on its diagonal, and the small mesh; for a backend
/// that traces instances also an instance of it.
fn huge_ground(backend: Backend) -> Geometry {
    let ground = [[-FAR, -FAR, 0.0], [FAR, -FAR, 0.0], [FAR, FAR, 0.0], [-FAR, FAR, 0.0]];
    let above = |[x, y, _]: [f32; 3]| [x, y, FAR];
    let [_, a, _, b] = ground;
    let wall = [a, b, above(b), above(a)];
    let all = Geometry::new(DVec3::ZERO, vec![small()], vec![ground, wall], vec![]).unwrap();
    if !matches!(backend, Backend::Bvh(_)) {
        return all;
    }
    let shared = Geometry::new(DVec3::ZERO, vec![small()], vec![], vec![]).unwrap();
    let placement = Placement::new(DMat3::from_rotation_z(1.0), DVec3::ZERO);
    let bounds = [DVec3::new(-0.02, -0.02, 0.0), DVec3::new(0.02, 0.02, 0.02)];
    all.with_instances(vec![shared], vec![Instance::new(0, placement, bounds)]).unwrap()
}

/// Calls `judge` with the primitives found around points of the ground's diagonal, and with those
/// that are near.
fn search(backend: Backend, judge: impl Fn(&[u32], &[u32])) {
    let geometry = huge_ground(backend);
    let accelerator = backends::build(&geometry, backend);
    let (ground, _) = geometry.triangles(geometry.quads_id(), 0).next().unwrap();
    for x in [0.0, 0.001, 0.013, -0.0199, 5.0] {
        // A little beside the diagonal.
        let nearby = Nearby::new(DVec3::new(x, -x - 0.002, 0.0), ground);
        let mut found = Vec::new();
        accelerator.near(&geometry, &nearby, &mut |primitive| found.push(primitive));
        let all = 0..geometry.count() as u32;
        let near: Vec<u32> = all.filter(|&prim| is_near(&geometry, prim, &nearby)).collect();
        judge(&found, &near);
    }
}

on_both! {
    fn all_neighbours_of_a_point_on_a_huge_plane_are_found(backend: Backend) {
        search(backend, |found, near| {
            assert!(near.len() < 10, "{}", near.len());
            assert!(near.iter().all(|prim| found.contains(prim)), "{near:?}");
        });
    }
}

/// Trees skip small things on a huge plane. Embree finds all in the box of the largest.
#[test]
fn trees_skip_small_things_on_a_huge_plane() {
    for backend in [Backend::Bvh(Isa::detect()), Backend::Coursework] {
        search(backend, |found, near| {
            assert!(near.iter().all(|prim| found.contains(prim)), "{near:?}");
            assert!(found.len() < 100, "{}", found.len());
        });
    }
}
