//! A cone may be reported as empty only if none of its rays hits anything.

use glam::DVec3;
use lightpath::geometry::{Geometry, Sphere, TriangleMesh};
use lightpath::ray::{LANES, Mask, Rays};

use super::tiers::{ALL, Tiers, put, ray};
use crate::support::random::Random;

/// Triangles of `size` all over the cube from -1 to 1, some quads and a sphere.
fn scattered(random: &mut Random, size: f64, triangles: usize) -> Geometry {
    let mut point = |size: f64| DVec3::from_array([0; 3].map(|_| random.within(-size, size)));
    let mut corners = |n: usize, size: f64| {
        let base = point(1.0);
        (0..n).map(|_| (base + point(size)).as_vec3().to_array()).collect::<Vec<[f32; 3]>>()
    };
    let vertices: Vec<[f32; 3]> = (0..triangles).flat_map(|_| corners(3, size)).collect();
    let indices = (0..triangles as u32).map(|i| [3 * i, 3 * i + 1, 3 * i + 2]).collect();
    let quads = (0..triangles / 8)
        .map(|_| {
            let [a, b, c] = corners(3, size).try_into().expect("three");
            [a, b, [0, 1, 2].map(|k| b[k] + c[k] - a[k]), c]
        })
        .collect();
    let sphere = Sphere { center: point(1.0), radius: size };
    let mesh = TriangleMesh::new(vertices, indices, false);
    Geometry::new(DVec3::ZERO, vec![mesh], quads, vec![sphere]).expect("few")
}

/// Returns the corners of a square of directions, like those of a block of pixels.
fn square(random: &mut Random, origin: DVec3, width: f64) -> (Rays, [DVec3; 4]) {
    let to = DVec3::from_array([0; 3].map(|_| random.within(-1.0, 1.0)));
    let forward = (to - origin).normalize();
    let across = forward.any_orthonormal_vector();
    let down = forward.cross(across);
    let corners = [[0.0, 0.0], [1.0, 0.0], [0.0, 1.0], [1.0, 1.0]]
        .map(|[x, y]: [f64; 2]| forward + across * (x * width) + down * (y * width));
    let mut rays = Rays::EMPTY;
    for (i, corner) in corners.iter().enumerate() {
        put(&mut rays, i, origin.as_vec3().to_array(), corner.normalize().as_vec3().to_array());
    }
    (rays, corners)
}

const FOUR: Mask = Mask([-1, -1, -1, -1, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0]);

#[test]
fn no_ray_in_an_empty_cone_hits() {
    let mut random = Random(7);
    let (mut empty, mut cones) = (0, 0);
    for (size, triangles) in [(0.3, 12), (0.1, 60), (0.03, 400)] {
        for _ in 0..6 {
            let geometry = scattered(&mut random, size, triangles);
            let tiers = Tiers::new(&geometry);
            for _ in 0..300 {
                let width = 10f64.powf(random.within(-5.0, 0.3));
                let far = 10f64.powf(random.within(-1.0, 4.0));
                let origin = DVec3::from_array([0; 3].map(|_| random.within(-far, far)));
                let origin = origin.as_vec3().as_dvec3();
                let (rays, corners) = square(&mut random, origin, width);
                cones += 1;
                if tiers.reporting_empty(&FOUR, &rays) == 0 {
                    continue;
                }
                empty += 1;
                let mut inside = Rays::EMPTY;
                for round in 0..4 {
                    for i in 0..LANES {
                        // The first round goes along the edges.
                        let (x, y) = (random.unit(), random.unit());
                        let (x, y) = if round > 0 { (x, y) } else { (x.round(), y) };
                        let direction = corners[0]
                            + (corners[1] - corners[0]) * x
                            + (corners[2] - corners[0]) * y;
                        let direction = direction.normalize().as_vec3().to_array();
                        put(&mut inside, i, origin.as_vec3().to_array(), direction);
                    }
                    let hits = tiers.trace(&ALL, &inside);
                    let hit = hits.iter().position(Option::is_some);
                    assert_eq!(hit.map(|i| ray(&inside, i)), None, "between {:?}", rays.dir);
                }
            }
        }
    }
    assert!(3 * empty > cones && empty < cones, "{empty} of {cones} cones");
}

#[test]
fn every_tier_distinguishes_the_sky_from_a_wall() {
    let wall = [[-1.0, -1.0, 5.0], [1.0, -1.0, 5.0], [1.0, 1.0, 5.0], [-1.0, 1.0, 5.0]];
    let geometry = Geometry::new(DVec3::ZERO, vec![], vec![wall], vec![]).expect("few");
    let tiers = Tiers::new(&geometry);
    let all = lightpath::simd::Isa::available().count();
    let count_empty = |x0: f32, x1: f32, z: f32| {
        let mut rays = Rays::EMPTY;
        for (i, [x, y]) in [[x0, -0.5], [x1, -0.5], [x0, 0.5], [x1, 0.5]].into_iter().enumerate() {
            put(&mut rays, i, [0.0; 3], [x, y, z]);
        }
        tiers.reporting_empty(&FOUR, &rays)
    };
    // Beside the wall; behind the eye; the wall's edge inside the cone; the whole wall inside.
    assert_eq!(count_empty(1.01, 2.0, 5.0), all);
    assert_eq!(count_empty(-0.1, 0.1, -5.0), all);
    assert_eq!(count_empty(0.99, 2.0, 5.0), 0);
    assert_eq!(count_empty(-4.0, 4.0, 5.0), 0);
    // With rays of several dominant axes, no instruction set reports an empty cone.
    assert_eq!(count_empty(6.0, 7.0, 1.0), all);
    assert_eq!(count_empty(1.5, 7.0, 5.0), 0);
}
