//! A ray has one hit, alone and among 15 others, with which the tree traces it together.

use lightpath::{FirstHits, Limits, Mesh, Monitor, Positions, RayBatch};

use super::queries::{difference, scene};
use crate::support::random::Random;

/// Returns the hits of equal rays with a triangle, and whether each hits it again behind its t.
fn hits(corners: [[f64; 3]; 3], ray: [[f64; 3]; 2], count: usize) -> (FirstHits, Vec<bool>) {
    let mesh = Mesh::new(Positions::F64(corners.to_vec()), vec![[0, 1, 2]]).expect("a mesh");
    let (scene, monitor) = (scene(mesh), Monitor::default());
    let (origins, directions) = (vec![ray[0]; count], vec![ray[1]; count]);
    let rays = RayBatch::new(&origins, &directions).expect("rays");
    let hits = scene.closest(&rays, &monitor).expect("hits");
    let behind = rays.with_limits(Limits::Each(&hits.t), Limits::All(f64::INFINITY));
    let again = scene.closest(&behind.expect("rays"), &monitor).expect("hits");
    (hits, again.primitive.iter().map(|&face| face != -1).collect())
}

/// Checks the hit of a ray alone against that in a packet. Returns whether it hits.
///
/// # Panics
/// If t or the weights differ by `error` or more, or if they name places that far apart.
fn check(corners: [[f64; 3]; 3], ray: [[f64; 3]; 2], error: f64) -> bool {
    let (alone, _) = hits(corners, ray, 1);
    let (together, again) = hits(corners, ray, 16);
    let [a, b, c] = corners;
    for i in 0..16 {
        let case = || format!("{corners:?} {ray:?}: {alone:?}, lane {i} {together:?}");
        assert_eq!(together.primitive[i], alone.primitive[0], "{}", case());
        if alone.primitive[0] == -1 {
            return false;
        }
        let (t, [u, v]) = (together.t[i], together.barycentrics[i]);
        let [expected_u, expected_v] = alone.barycentrics[0];
        let off = [t - alone.t[0], u - expected_u, v - expected_v];
        assert!(off.iter().all(|off| off.abs() < error), "{}", case());
        for k in 0..3 {
            let place = a[k] * (1.0 - u - v) + b[k] * u + c[k] * v;
            assert!((ray[0][k] + t * ray[1][k] - place).abs() < error, "{}", case());
        }
        // 0 is no limit.
        assert!(!again[i] || t == 0.0, "{}", case());
    }
    true
}

/// A triangle of decimal numbers, and a ray to a point of its plane.
fn in_plane(random: &mut Random) -> ([[f64; 3]; 3], [[f64; 3]; 2]) {
    let mut tenths = |size: usize| (random.below(2 * size + 1) as f64 - size as f64) / 10.0;
    let corners @ [a, b, c] = [0; 3].map(|_| [0; 3].map(|_| tenths(20)));
    let (p, q) = (tenths(20), tenths(20));
    let (e1, e2) = (difference(b, a), difference(c, a));
    let direction = [0, 1, 2].map(|k| p * e1[k] + q * e2[k]);
    let goal = [0, 1, 2].map(|k| a[k] + 0.4 * e1[k] + 0.4 * e2[k]);
    (corners, [difference(goal, direction), direction])
}

#[test]
fn rays_in_the_plane_of_a_face_have_one_hit() {
    let corners = [[-1.7, 0.8, -1.9], [-1.6, 1.1, -0.8], [1.9, 0.3, 1.2]];
    assert!(check(corners, [[2.2, 1.2, 4.5], [-2.42, -0.48, -4.72]], 1e-4));
    let corners = [[1.3, 1.2, 1.6], [1.0, -1.5, 1.4], [-0.5, 1.0, -1.2]];
    assert!(check(corners, [[-0.8, -1.7, -1.4], [0.96, 2.24, 1.28]], 1e-4));
    // Rounding tilts this face enough for weights in f32.
    let corners = [[-0.325, -1.319, 1.252], [-1.591, -1.832, 1.136], [0.939, -0.429, 1.367]];
    assert!(check(corners, [[0.9401, -0.63635, 1.36755], [-1.2656, -0.5884, -0.1158]], 1e-6));
    let (mut random, mut hits) = (Random(1), 0);
    for _ in 0..500 {
        let (corners, ray) = in_plane(&mut random);
        let [origin, direction] = ray;
        if direction.iter().all(|x| x.abs() < 1e-9) {
            continue;
        }
        hits += usize::from(check(corners, ray, 1e-4));
        // Almost in the plane.
        let tilt = 1e-8 * 1e5f64.powf(random.unit());
        let direction = [direction[0] + tilt, direction[1], direction[2]];
        hits += usize::from(check(corners, [origin, direction], 1e-3));
    }
    assert!(hits > 150, "{hits}");
}

/// A hit that does not count lies before a face in whose plane the ray runs.
#[test]
fn a_face_along_the_ray_is_hit_once_behind_another() {
    let faces = [
        [[-5.06, -1.94, -5.46], [-4.98, -1.98, -5.51], [-5.0, -1.89, -5.54]],
        [[0.371, 1.814, 0.918], [0.556, 0.92, -0.606], [-0.67, 1.376, 0.169]],
        [[-5.56, -2.97, -4.7], [-5.57, -2.98, -4.68], [-5.58, -2.97, -4.69]],
        [[-4.54, -3.45, -4.63], [-4.53, -3.43, -4.64], [-4.54, -3.43, -4.63]],
        [[-4.87, -3.3, -4.66], [-4.88, -3.29, -4.66], [-4.87, -3.31, -4.66]],
        [[-0.24, 0.18, 1.1], [-0.26, 0.18, 1.1], [-0.25, 0.19, 1.08]],
    ];
    let indices = (0..6).map(|i| [0, 1, 2].map(|k| 3 * i + k)).collect();
    let mesh = Mesh::new(Positions::F64(faces.as_flattened().to_vec()), indices).expect("a mesh");
    let (scene, monitor) = (scene(mesh), Monitor::default());
    let layers = |count: usize| {
        let origins = vec![[-5.487183021759116, -2.2309054244560222, -5.9912]; count];
        let directions = vec![[0.919297170293186, 0.5853509040760038, 1.0]; count];
        let mut t = vec![0.0; count];
        let mut layers = Vec::new();
        for _ in 0..3 {
            let limits = (Limits::Each(&t), Limits::All(f64::INFINITY));
            let rays = RayBatch::new(&origins, &directions).expect("rays");
            let rays = rays.with_limits(limits.0, limits.1).expect("limits");
            let hits = scene.closest(&rays, &monitor).expect("hits");
            layers.push((hits.primitive[count - 1], hits.t[count - 1]));
            t = hits.t;
        }
        layers
    };
    let alone = layers(1);
    assert_eq!(alone.iter().map(|(face, _)| *face).collect::<Vec<_>>(), [0, 1, -1]);
    assert_eq!(layers(16), alone);
}

/// Slivers that the ray sees from the front, as those that close T-junctions.
#[test]
fn slivers_have_one_hit() {
    let (mut random, mut hits) = (Random(2), 0);
    for _ in 0..500 {
        let ([a, b, _], _) = in_plane(&mut random);
        let width = 1e-9 * 1e6f64.powf(random.unit());
        let (middle, at) = (random.unit(), random.unit());
        let mut along = |s: f64, width: f64| {
            let around = random.within(-width, width);
            [0, 1, 2].map(|k| a[k] + s * (b[k] - a[k]) + around)
        };
        let (c, goal) = (along(middle, width), along(at, 0.1 * width));
        let origin = [0; 3].map(|_| random.within(-5.0, 5.0));
        hits += usize::from(check([a, b, c], [origin, difference(goal, origin)], 1e-3));
    }
    assert!(hits > 50, "{hits}");
}
