//! Edge cases of the trait's contract: segments, inactive lanes, the primitive that a ray leaves.

use glam::DVec3;
use lightpath::geometry::{Geometry, Sphere, TriangleMesh};
use lightpath::ray::{LANES, Rays};

use super::tiers::{ALL, Tiers, put};

/// A wall of squares at z = 1 and z = 2 for x and y in -8 .. 8, a quad at z = 3, a sphere at z = 6.
fn walls() -> Geometry {
    let mut vertices = Vec::new();
    let mut triangles = Vec::new();
    for z in [1.0, 2.0] {
        for x in -8..8 {
            for y in -8..8 {
                let first = vertices.len() as u32;
                let (x, y) = (x as f32, y as f32);
                vertices.extend([
                    [x, y, z],
                    [x + 1.0, y, z],
                    [x + 1.0, y + 1.0, z],
                    [x, y + 1.0, z],
                ]);
                triangles.extend([[first, first + 1, first + 2], [first, first + 2, first + 3]]);
            }
        }
    }
    let mesh = TriangleMesh::new(vertices, triangles, false);
    let quad = [[-8.0, -8.0, 3.0], [8.0, -8.0, 3.0], [8.0, 8.0, 3.0], [-8.0, 8.0, 3.0]];
    let sphere = Sphere { center: DVec3::new(0.0, 0.0, 6.0), radius: 2.0 };
    Geometry::new(DVec3::ZERO, vec![mesh], vec![quad], vec![sphere]).expect("few")
}

/// Returns 16 rays along z, through the insides of triangles.
fn along_z() -> Rays {
    let mut rays = Rays::EMPTY;
    for i in 0..LANES {
        put(&mut rays, i, [0.375 + (i % 4) as f32 * 0.03125, 0.0625, 0.0], [0.0, 0.0, 1.0]);
    }
    rays
}

#[test]
fn segments_are_open_and_any_float_may_end_them() {
    let geometry = walls();
    let tiers = Tiers::new(&geometry);
    let next = |x: f32| f32::from_bits(x.to_bits() + 1);
    let last = |x: f32| f32::from_bits(x.to_bits() - 1);
    let far = f32::INFINITY;
    let cases: &[(f32, f32, Option<f32>)] = &[
        (0.0, far, Some(1.0)),
        (-0.0, f32::MAX, Some(1.0)),
        (0.0, next(1.0), Some(1.0)),
        (0.0, 1.0, None),
        (last(1.0), far, Some(1.0)),
        (1.0, far, Some(2.0)),
        (1.0, 2.0, None),
        (next(1.0), next(2.0), Some(2.0)),
        (2.0, far, Some(3.0)),
        (0.5, 0.5, None),
        (0.0, 0.0, None),
        (0.0, f32::from_bits(1), None),
        (1e30, far, None),
        (f32::MAX, far, None),
        (far, far, None),
    ];
    for exponent in [-126, -60, -1, 0, 1, 60] {
        // t is 2^-exponent times as large.
        let scale = f64::from(exponent).exp2() as f32;
        for &(tnear, tfar, expected) in cases {
            let mut rays = along_z();
            rays.dir[2] = [scale; LANES];
            (rays.tnear, rays.tfar) = ([tnear / scale; LANES], [tfar / scale; LANES]);
            let active = rays.possible(&ALL);
            assert_eq!(active, ALL);
            let found = tiers.trace(&active, &rays);
            // Ends beyond the range of f32 become infinite.
            let expected = expected.map(|t| t / scale).filter(|&t| t < rays.tfar[0]);
            for hit in found {
                assert_eq!(hit.map(|hit| hit.t), expected, "({tnear}, {tfar}) {exponent}");
            }
        }
    }
}

#[test]
fn directions_may_have_any_length() {
    let geometry = walls();
    let tiers = Tiers::new(&geometry);
    // The smallest sum of magnitudes that counts as a direction, and the largest.
    let tiny = f32::MIN_POSITIVE;
    let large = f32::MAX;
    for [x, z] in [[0.4, 0.6], [0.0, 1.0], [0.25, 0.75]] {
        for size in [tiny, large, large / 2.0, large / 4.0] {
            let mut rays = along_z();
            for i in 0..LANES {
                (rays.dir[0][i], rays.dir[2][i]) = (x * size, z * size);
                rays.org[0][i] = 0.375;
            }
            // Between the first wall and the second, as precisely as f32 allows.
            let at = |depth: f64| (depth / f64::from(z * size)) as f32;
            (rays.tnear, rays.tfar) = ([at(1.25); LANES], [f32::INFINITY; LANES]);
            let active = rays.possible(&ALL);
            assert_eq!(active, ALL, "{x} {z} {size}");
            for hit in tiers.trace(&active, &rays) {
                let t = hit.map(|hit| f64::from(hit.t) * f64::from(z * size));
                // If t is denormal, 1.25 and 2 are equal.
                let apart = rays.tnear[0] < at(2.0);
                let right = !apart || t.is_some_and(|t| (t - 2.0).abs() < 0.2);
                assert!(right, "{t:?} for {x} {z} {size}, t from {}", rays.tnear[0]);
            }
        }
    }
}

#[test]
fn inactive_lanes_change_nothing() {
    let geometry = walls();
    let tiers = Tiers::new(&geometry);
    let clean = along_z();
    let expected = tiers.trace(&ALL, &clean);
    assert!(expected.iter().all(Option::is_some));
    let rubbish = [f32::NAN, f32::INFINITY, f32::NEG_INFINITY, f32::MAX, 0.0, -1.0];
    for (n, &value) in rubbish.iter().enumerate() {
        for pattern in [0x5555u32, 0x8001, 0xfffe, 0x0100, 0x7fff] {
            let mut rays = clean.clone();
            let mut active = ALL;
            for i in (0..LANES).filter(|i| (pattern >> i) & 1 == 0) {
                active.0[i] = 0;
                put(&mut rays, i, [value; 3], [value, rubbish[(n + i) % 6], value]);
                (rays.tnear[i], rays.tfar[i]) = (value, rubbish[(n + 1) % 6]);
            }
            let found = tiers.trace(&active, &rays);
            for i in 0..LANES {
                let expected = if active.0[i] == 0 { None } else { expected[i] };
                assert_eq!(found[i], expected, "{value} {pattern:x} {i}");
            }
        }
    }
}

#[test]
fn a_ray_hits_the_primitive_it_leaves_only_on_the_far_side_of_a_sphere() {
    let geometry = walls();
    let tiers = Tiers::new(&geometry);
    let mut rays = along_z();
    let first = tiers.trace(&ALL, &rays);
    // From the front of the first wall, and from slightly behind it, as rounding may place an
    // origin.
    for z in [0.0, 1.0, f32::from_bits(1.0f32.to_bits() - 1)] {
        for i in 0..LANES {
            rays.org[2][i] = z;
            rays.leaving[i] = first[i].expect("the first wall").primitive;
        }
        for hit in tiers.trace(&ALL, &rays) {
            let hit = hit.expect("the second wall");
            assert_eq!(hit.t, 2.0 - z);
        }
    }
    let quad = geometry.primitive(geometry.quads_id(), 0);
    let sphere = geometry.primitive(geometry.spheres_id(), 0);
    for i in 0..LANES {
        (rays.org[2][i], rays.leaving[i]) = (3.0, quad);
    }
    for hit in tiers.trace(&ALL, &rays) {
        assert_eq!(hit.map(|hit| hit.primitive), Some(sphere));
    }
    // From the near pole through the sphere to the far pole. Outwards there is no hit.
    for i in 0..LANES {
        put(&mut rays, i, [0.0, 0.0, 4.0], [0.0, 0.0, if i % 2 == 0 { 0.5 } else { 0.25 }]);
        rays.leaving[i] = sphere;
    }
    for (i, hit) in tiers.trace(&ALL, &rays).into_iter().enumerate() {
        let t = if i % 2 == 0 { 8.0 } else { 16.0 };
        assert_eq!(hit.map(|hit| (hit.primitive, hit.t)), Some((sphere, t)));
    }
    for i in 0..LANES {
        put(&mut rays, i, [0.0, 0.0, 8.0], [0.0, 0.0, 1.0]);
    }
    assert_eq!(tiers.trace(&ALL, &rays), [None; LANES]);
}

#[test]
fn a_ray_along_a_plane_meets_a_triangle_that_its_line_meets() {
    // In the sheared space the ray runs along the edge to the last corner. In f64 it is parallel to
    // the plane and beside it, so t of the plane is infinite.
    let (corner, far) = ([-1.0, -1.0, -1.0], [2.000_000_2, -3.0, 7.0]);
    let quad = [corner, [0.0, 3.0, 0.0], far, far];
    let geometry = Geometry::new(DVec3::ZERO, vec![], vec![quad], vec![]).expect("few");
    let mut rays = Rays::EMPTY;
    for i in 0..LANES {
        let scale = 1.0 / (1 << i) as f32;
        let direction = [3.000_000_2, -2.0, 8.0].map(|d: f32| d * scale);
        put(&mut rays, i, [-1.0, -1.0, -1.000_000_4], direction);
    }
    let hits = Tiers::new(&geometry).trace(&ALL, &rays);
    for (i, hit) in hits.into_iter().enumerate() {
        let t = hit.expect("a hit").t / (1 << i) as f32;
        assert!((0.0..=1.000_001).contains(&t), "{t}");
    }
}

#[test]
fn a_ray_along_a_plane_meets_nothing_beyond_where_its_line_leaves_the_triangle() {
    // The ray runs along the first edge, whose corner is moved by denormals, and past its end at t
    // = 1. The third corner lies at t = 2. Other rays of the packet enter the leaf.
    let vertices = vec![[-7.0, 4e-45, 4e-45], [-1.0, 2.0, 4.0], [5.0, -1.0, -1.0]];
    let mesh = TriangleMesh::new(vertices, vec![[0, 1, 2]], false);
    let geometry = Geometry::new(DVec3::ZERO, vec![mesh], vec![], vec![]).expect("few");
    let mut rays = Rays::EMPTY;
    for i in 0..LANES {
        put(&mut rays, i, [-7.0, 0.0, 0.0], [6.0, 2.0, 4.0]);
        rays.tnear[i] = if i % 2 == 0 { 0.25 } else { 1.5 };
    }
    let hits = Tiers::new(&geometry).trace(&ALL, &rays);
    for (i, hit) in hits.into_iter().enumerate() {
        assert_eq!(hit.map(|hit| hit.t), (i % 2 == 0).then_some(1.0), "{i}");
    }
}

#[test]
fn the_nearest_of_hits_that_are_nearer_than_any_f32_is_found() {
    // From 4e-45 before a corner that two quads share, with 2e12 per unit of t. Both are hit at t
    // below 1e-56.
    let corner = [0.0, 4.0, 5.0];
    let first = [corner, [3.0, 0.0, 3e-45], [-2.0, -4.000_000_5, -3.000_000_7], [-2.0, -4.0, -3.0]];
    let second = [[3.000_000_7, 4e-45, 1e-45], corner, [-2.0, -4.0, -3.0], [0.0, 4.000_001_4, 5.0]];
    let geometry = Geometry::new(DVec3::ZERO, vec![], vec![first, second], vec![]).expect("few");
    let mut rays = Rays::EMPTY;
    for i in 0..LANES {
        put(&mut rays, i, [4e-45, 4.0, 5.0], [-1_992_056_200_000.0, -1.0, 0.0]);
    }
    let hits = Tiers::new(&geometry).trace(&ALL, &rays);
    for hit in hits {
        assert_eq!(hit.map(|hit| hit.t), Some(0.0));
    }
}
