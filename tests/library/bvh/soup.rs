//! Random scenes over sixteen decades, and random bytes like those of the fuzzer.

use glam::DVec3;
use lightpath::geometry::{Geometry, Sphere, TriangleMesh};
use lightpath::ray::{LANES, Rays};

use super::tiers::{ALL, Tiers, put, ray};
use super::{case, reference};
use crate::support::random::Random;

#[test]
fn random_bytes_make_no_failing_case() {
    let mut random = Random(1);
    let mut hits = 0;
    for _ in 0..2_000 {
        // A scene takes up to 700 bytes, and its rays take up to 1,100. Zeros follow the bytes.
        let len = 400 + random.below(1400);
        let bytes: Vec<u8> = (0..len).map(|_| random.bits() as u8).collect();
        hits += case::run(&bytes);
    }
    assert!(hits > 10_000, "{hits}");
}

/// Either sign, magnitude 1e-8 to 1e8.
fn wide(random: &mut Random) -> f64 {
    let magnitude = 10f64.powf(random.within(-8.0, 8.0));
    if random.bits() & 1 == 0 { magnitude } else { -magnitude }
}

fn wide_point(random: &mut Random) -> DVec3 {
    DVec3::new(wide(random), wide(random), wide(random))
}

/// Primitives of every size at every distance, some of them crowded together.
fn soup(random: &mut Random) -> Geometry {
    let crowd = wide_point(random);
    let mut corners = |n: usize| -> Vec<[f32; 3]> {
        let base = if random.bits() & 1 == 0 { crowd } else { wide_point(random) };
        let size = wide(random).abs();
        let far = random.below(4) == 0;
        (0..n)
            .map(|_| {
                if far { wide_point(random) } else { base + wide_point(random).normalize() * size }
            })
            .map(|p| p.as_vec3().to_array())
            .collect()
    };
    let vertices: Vec<[f32; 3]> = (0..80).flat_map(|_| corners(3)).collect();
    let triangles = (0..80).map(|i| [3 * i, 3 * i + 1, 3 * i + 2]).collect();
    let quads = (0..10).map(|_| corners(4).try_into().expect("four")).collect();
    let spheres = (0..20)
        .map(|_| Sphere { center: wide_point(random), radius: wide(random).abs() })
        .collect();
    let mesh = TriangleMesh::new(vertices, triangles, false);
    Geometry::new(DVec3::ZERO, vec![mesh], quads, spheres).expect("few")
}

/// Returns a direction towards a point of some triangle, rarely past all of them.
fn aim(random: &mut Random, geometry: &Geometry) -> DVec3 {
    let mesh = &geometry.meshes[0];
    let [a, b, c] = mesh.corners(random.below(mesh.triangles().len()) as u32);
    let [a, b, c] = [a, b, c].map(|v| DVec3::from(v.map(f64::from)));
    let (u, v) = (random.unit(), random.unit());
    match random.below(4) {
        0 => a,
        1 => a + (b - a) * u,
        _ => a + (b - a) * u * v + (c - a) * u * (1.0 - v),
    }
}

#[test]
fn soups_over_sixteen_decades_are_hit_within_the_bound() {
    let mut random = Random(2);
    let mut hits = 0;
    for _ in 0..60 {
        let geometry = soup(&mut random);
        let tiers = Tiers::new(&geometry);
        for _ in 0..40 {
            let mut rays = Rays::EMPTY;
            let one = (random.bits() & 1 == 0).then(|| wide_point(&mut random).as_vec3());
            for i in 0..LANES {
                let origin = one.unwrap_or_else(|| wide_point(&mut random).as_vec3());
                let direction = (aim(&mut random, &geometry) - origin.as_dvec3()).as_vec3();
                put(&mut rays, i, origin.to_array(), direction.to_array());
            }
            let active = rays.possible(&ALL);
            let found = tiers.trace(&active, &rays);
            for i in 0..LANES {
                hits += usize::from(found[i].is_some());
                if let Err(wrong) = reference::check(&geometry, &rays, i, found[i]) {
                    panic!("{}: {wrong}", ray(&rays, i));
                }
            }
        }
    }
    // The rays are aimed, so most must hit.
    assert!(hits > 60 * 40 * LANES / 2, "{hits}");
}

/// Two corners are a few ulp apart near a plane through the origin. f64 hardly tells the normal of
/// such a triangle, whose other sides are of ordinary length.
#[test]
fn slivers_that_f64_cannot_tell_are_hit_beside_their_box_at_most() {
    let mut random = Random(3);
    let mut hits = 0;
    for _ in 0..300 {
        let mut number = || random.within(-8.0, 8.0) as f32;
        let (far, mut near) = ([number(), number(), number()], [number(), number(), number()]);
        let axis = random.below(3);
        near[axis] = 10f64.powf(random.within(-9.0, -4.0)) as f32;
        let mut next = near;
        next[axis] = f32::from_bits(near[axis].to_bits() + 1 + random.below(3) as u32);
        let mesh = TriangleMesh::new(vec![far, near, next], vec![[0, 1, 2]], false);
        let geometry = Geometry::new(DVec3::ZERO, vec![mesh], vec![], vec![]).expect("one");
        let mut rays = Rays::EMPTY;
        for i in 0..LANES {
            let mut direction = [0; 3].map(|_| random.within(-5.0, 5.0) as f32);
            let mut origin = if i % 2 == 0 { near } else { next };
            // A ray that starts at a corner hits nothing there. So some come from afar.
            if i % 4 < 2 {
                let along = (axis + 1 + i / 8) % 3;
                direction = [0; 3].map(|_| 0.0);
                direction[along] = if i % 8 < 4 { 1.0 } else { -0.3 };
                origin[along] = -10.0 * direction[along].signum();
            }
            put(&mut rays, i, origin, direction);
        }
        let found = Tiers::new(&geometry).trace(&ALL, &rays);
        hits += found.iter().flatten().count();
        for (i, hit) in found.into_iter().enumerate() {
            if let Err(wrong) = reference::check(&geometry, &rays, i, hit) {
                panic!("{}: {wrong}\n{geometry:?}", ray(&rays, i));
            }
        }
    }
    assert!(hits > 1000, "{hits}");
}
