//! Limits of rays, `tnear < t < tfar`, where surfaces or their ends are nearer to each other than
//! rounding to f32. The query for all hits decides each of them in f64.

use lightpath::{Limits, Mesh, Monitor, Positions, RayBatch, RayScene};

use super::queries::{around, ball, difference, scene};

/// Compares `closest` and `occluded` with all hits. Each neighbour at a vertex has a t of its own,
/// up to rounding, and a ray that only touches a surface has no hits among all. So the closest hit
/// may be nearer than the first of all, but not farther. Returns the number of rays whose t
/// differs, and of those that are occluded without a closest hit.
fn disagreeing(scene: &RayScene, rays: &RayBatch) -> [usize; 2] {
    let monitor = Monitor::default();
    let closest = scene.closest(rays, &monitor).expect("hits");
    let occluded = scene.occluded(rays, &monitor).expect("answers");
    let counts = scene.count(rays, &monitor).expect("counts");
    let all = scene.all_hits(rays, &monitor).expect("hits");
    let mut others = [0; 2];
    for i in 0..rays.len() {
        let hits = &all.t[all.offsets[i] as usize..all.offsets[i + 1] as usize];
        let (t, first) = (closest.t[i], hits.first().map_or(f64::INFINITY, |&t| t));
        assert_eq!(counts[i] as usize, hits.len());
        assert!(t <= first + 1e-12, "ray {i}: {t} {first}");
        assert!(occluded[i] || t == f64::INFINITY, "ray {i}");
        others[0] += usize::from(t != first);
        others[1] += usize::from(occluded[i] && t == f64::INFINITY);
    }
    others
}

/// Two unit squares, and rays through points of a grid on them, borders and corners included.
#[test]
fn the_next_layer_is_found_behind_the_last_one() {
    let monitor = Monitor::default();
    let corner = |i: usize, z: f64| [(i & 1) as f64, (i >> 1 & 1) as f64, z];
    for gap in [1e-12, 1e-9, 6e-8, 2e-7, 1e-6, 1e-3] {
        let corners = (0..8).map(|i| corner(i, if i < 4 { 0.0 } else { gap })).collect();
        let faces = vec![[4, 5, 6], [5, 7, 6], [0, 1, 2], [1, 3, 2]];
        let scene = scene(Mesh::new(Positions::F64(corners), faces).expect("a mesh"));
        for z in [-0.7, -1.9, -3.0, -50.0] {
            let origins: Vec<_> =
                (0..25).map(|i| [f64::from(i % 5) / 4.0, f64::from(i / 5) / 4.0, z]).collect();
            let rays = RayBatch::new(&origins, &[[0.0, 0.0, 1.0]; 25]).expect("rays");
            let closest = |tnear: f64, tfar: f64| {
                let rays = rays.with_limits(Limits::All(tnear), Limits::All(tfar)).expect("rays");
                let occluded = scene.occluded(&rays, &monitor).expect("answers");
                let hits = scene.closest(&rays, &monitor).expect("hits");
                assert!(hits.t.iter().zip(occluded).all(|(t, hit)| t.is_finite() == hit));
                hits
            };
            let (near, far, middle) = (-z, gap - z, 0.5 * gap - z);
            for hits in [closest(near, f64::INFINITY), closest(middle, 99.0)] {
                assert!(hits.t.iter().all(|&t| t == far), "{gap} {z}: {:?}", hits.t);
                assert!(hits.primitive.iter().all(|&face| face < 2));
            }
            for hits in [closest(0.5, far), closest(0.0, middle)] {
                assert!(hits.t.iter().all(|&t| t == near), "{gap} {z}: {:?}", hits.t);
                assert!(hits.primitive.iter().all(|&face| face >= 2));
            }
            for hits in [closest(far, f64::INFINITY), closest(near, far), closest(0.0, near)] {
                assert!(hits.primitive.iter().all(|&face| face == -1), "{gap} {z}");
            }
        }
    }
}

#[test]
fn limited_rays_have_the_first_of_all_hits() {
    let mesh = ball(10, [0.0; 3]);
    let Positions::F64(vertices) = mesh.positions.clone() else { panic!("f64") };
    let scene = scene(mesh);
    let (count, monitor) = (4000, Monitor::default());
    let origins = around(count, 3.0);
    let to = |goal: &dyn Fn(usize) -> [f64; 3]| -> Vec<[f64; 3]> {
        (0..count).map(|i| difference(goal(i), origins[i])).collect()
    };
    // Through the inside, with ends anywhere, and at the first hit.
    let directions = to(&|i| origins[(i * 7 + 5) % count].map(|x| x * 0.3));
    let rays = RayBatch::new(&origins, &directions).expect("rays");
    let first = scene.closest(&rays, &monitor).expect("hits").t;
    let finite: Vec<_> = first.iter().map(|t| if t.is_finite() { *t } else { 1.0 }).collect();
    let ends: Vec<_> = (0..count).map(|i| (i as f64 * 0.618_034).fract() * 2.0).collect();
    let (nothing, far) = (Limits::All(0.0), Limits::All(f64::INFINITY));
    for (tnear, tfar) in [
        (Limits::Each(&ends), far),
        (nothing, Limits::Each(&ends)),
        (Limits::Each(&finite), far),
        (nothing, Limits::Each(&finite)),
    ] {
        assert_eq!(disagreeing(&scene, &rays.with_limits(tnear, tfar).expect("rays")), [0; 2]);
    }
    // At vertices, with ends there.
    let directions = to(&|i| vertices[i * 31 % vertices.len()]);
    let rays = RayBatch::new(&origins, &directions).expect("rays");
    let first = scene.closest(&rays, &monitor).expect("hits").t;
    let first: Vec<_> = first.iter().map(|t| if t.is_finite() { *t } else { 1.0 }).collect();
    let one = Limits::All(1.0);
    for (tnear, tfar) in [(nothing, one), (one, far), (Limits::Each(&first), far)] {
        let others = disagreeing(&scene, &rays.with_limits(tnear, tfar).expect("rays"));
        // Grazing faces: their t of the rounded ray is off by more than occlusion allows for.
        assert!(others[1] <= count / 1000, "{others:?}");
    }
}
