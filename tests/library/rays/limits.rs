//! Limits of rays, `tnear < t < tfar`, where surfaces or their ends are nearer to each other than
//! rounding to f32. The query for all hits decides each of them in f64.

use lightpath::{Limits, Mesh, Monitor, Positions, RayBatch, RayScene};

use super::edges::cube;
use super::queries::{around, ball, difference, scene};

/// The limit of a ray.
fn value(limits: Limits, i: usize) -> f64 {
    match limits {
        Limits::All(limit) => limit,
        Limits::Each(all) => all[i],
    }
}

/// Compares `closest` and `occluded` with all hits. Each neighbour at a vertex has a t of its own,
/// up to rounding, and a ray that only touches a surface has no hits among all. So the closest hit
/// may be nearer than the first of all, but not farther, unless this one is at a limit. Returns
/// the number of rays whose t differs, and of those that are occluded without a closest hit.
fn disagreeing(scene: &RayScene, rays: &RayBatch, [tnear, tfar]: [Limits; 2]) -> [usize; 2] {
    let monitor = Monitor::default();
    let rays = &rays.with_limits(tnear, tfar).expect("rays");
    let closest = scene.closest(rays, &monitor).expect("hits");
    let occluded = scene.occluded(rays, &monitor).expect("answers");
    let counts = scene.count(rays, &monitor).expect("counts");
    let all = scene.all_hits(rays, &monitor).expect("hits");
    let mut others = [0; 2];
    for i in 0..rays.len() {
        let hits = &all.t[all.offsets[i] as usize..all.offsets[i + 1] as usize];
        let (t, first) = (closest.t[i], hits.first().map_or(f64::INFINITY, |&t| t));
        assert_eq!(counts[i] as usize, hits.len());
        let limits = [tnear, tfar].map(|limits| value(limits, i));
        let inside = |t: &&f64| limits.iter().all(|limit| (*t - limit).abs() > 1e-12);
        let beyond = hits.iter().find(inside).map_or(f64::INFINITY, |&t| t);
        assert!(t <= beyond + 1e-12, "ray {i}: {t} {beyond}");
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
        assert_eq!(disagreeing(&scene, &rays, [tnear, tfar]), [0; 2]);
    }
    // At vertices, with ends there.
    let directions = to(&|i| vertices[i * 31 % vertices.len()]);
    let rays = RayBatch::new(&origins, &directions).expect("rays");
    let first = scene.closest(&rays, &monitor).expect("hits").t;
    let first: Vec<_> = first.iter().map(|t| if t.is_finite() { *t } else { 1.0 }).collect();
    let one = Limits::All(1.0);
    for (tnear, tfar) in [(nothing, one), (one, far), (Limits::Each(&first), far)] {
        let others = disagreeing(&scene, &rays, [tnear, tfar]);
        assert_eq!(others[1], 0, "{others:?}");
    }
}

/// Rays almost along a face. Rounding moves their hits farther than limits are from t.
#[test]
fn limits_hold_on_grazing_faces() {
    let corners = [[-0.27, -1.3, 2.16], [0.5, 0.23, 0.91], [-2.31, -0.18, -0.28]];
    let [a, b, c] = corners;
    let scene =
        scene(Mesh::new(Positions::F64(corners.to_vec()), vec![[0, 1, 2]]).expect("a mesh"));
    let (e1, e2) = (difference(b, a), difference(c, a));
    let normal = [1, 2, 0].map(|k| e1[k] * e2[(k + 1) % 3] - e1[(k + 1) % 3] * e2[k]);
    let mut origins = vec![[-0.429, -1.327, 2.097], [0.25, 0.181, 0.818]];
    let mut directions = vec![[0.1331, 1.3726, -1.4482], [-0.5406, -1.4371, 1.2812]];
    for i in 0..1000 {
        let weight = |step: f64| (f64::from(i) * step).fract();
        let (u, v) = (0.1 + 0.4 * weight(0.618_034), 0.1 + 0.3 * weight(0.754_878));
        let (x, y) = (weight(0.569_84) - 0.5, weight(0.438_579) - 0.5);
        let lift = 10f64.powf(-1.0 - 4.0 * weight(0.362_94));
        let direction = [0, 1, 2].map(|k| e1[k] * x + e2[k] * y + normal[k] * lift);
        origins.push([0, 1, 2].map(|k| a[k] + e1[k] * u + e2[k] * v - 0.7 * direction[k]));
        directions.push(direction);
    }
    let rays = RayBatch::new(&origins, &directions).expect("rays");
    let (count, monitor) = (origins.len(), Monitor::default());
    let t = scene.closest(&rays, &monitor).expect("hits").t;
    assert!(t.iter().all(|t| t.is_finite()));
    let scaled = |factor: f64| t.iter().map(|t| t * factor).collect::<Vec<_>>();
    let (nothing, far) = (Limits::All(0.0), Limits::All(f64::INFINITY));
    for part in [1e-3, 1e-5, 1e-7, 1e-10] {
        let (before, after) = (scaled(1.0 - part), scaled(1.0 + part));
        let (before, after) = (Limits::Each(&before), Limits::Each(&after));
        for (tnear, tfar, hit) in [
            (nothing, before, false),
            (nothing, Limits::Each(&t), false),
            (nothing, after, true),
            (before, far, true),
            (Limits::Each(&t), far, false),
            (after, far, false),
            (before, after, true),
        ] {
            let limited = rays.with_limits(tnear, tfar).expect("rays");
            let hits = scene.closest(&limited, &monitor).expect("hits").t;
            let expected = |t: &f64| if hit { *t } else { f64::INFINITY };
            assert_eq!(hits, t.iter().map(expected).collect::<Vec<_>>(), "{part:e}");
            let occluded = scene.occluded(&limited, &monitor).expect("answers");
            assert_eq!(occluded, vec![hit; count], "{part:e}");
            let counts = scene.count(&limited, &monitor).expect("counts");
            assert_eq!(counts, vec![u32::from(hit); count], "{part:e}");
            let all = scene.all_hits(&limited, &monitor).expect("hits");
            assert_eq!(all.t, if hit { t.clone() } else { Vec::new() }, "{part:e}");
        }
    }
}

/// Limits at vertices and edges: the faces that meet there are one place, whatever their t are.
#[test]
fn a_vertex_is_no_second_layer() {
    let mesh = ball(10, [0.0; 3]);
    let Positions::F64(vertices) = mesh.positions.clone() else { panic!("f64") };
    let middle = |i: usize, k: usize| {
        let [a, b, _] = mesh.triangles[i % mesh.triangles.len()].map(|v| vertices[v as usize][k]);
        a + (b - a) * (i as f64 * 0.618_034).fract()
    };
    let vertex = |i: usize, k: usize| vertices[i * 31 % vertices.len()][k];
    let (count, monitor) = (3000, Monitor::default());
    for goal in [&vertex as &dyn Fn(usize, usize) -> f64, &middle] {
        let origins = around(count, 3.0);
        let origins: Vec<_> = origins.iter().map(|o| o.map(|x| f64::from(x as f32))).collect();
        let directions: Vec<_> =
            (0..count).map(|i| difference([0, 1, 2].map(|k| goal(i, k)), origins[i])).collect();
        let scene = scene(mesh.clone());
        let rays = RayBatch::new(&origins, &directions).expect("rays");
        let (mut near, mut again, mut layers) = (vec![0.0; count], 0, 0);
        let mut occluded = 0;
        for _ in 0..12 {
            let peeled = rays.with_limits(Limits::Each(&near), Limits::All(f64::INFINITY));
            let hits = scene.closest(&peeled.expect("rays"), &monitor).expect("hits");
            let hit = |i: &usize| hits.t[*i].is_finite();
            layers += (0..count).filter(hit).count();
            let same = |i: &usize| near[*i] > 0.0 && hits.t[*i] - near[*i] < 1e-12;
            again += (0..count).filter(hit).filter(same).count();
            near = hits.t.iter().map(|&t| if t.is_finite() { t } else { f64::INFINITY }).collect();
            let before = rays.with_limits(Limits::All(0.0), Limits::Each(&near)).expect("rays");
            if layers <= count {
                let answers = scene.occluded(&before, &monitor).expect("answers");
                let closer = scene.closest(&before, &monitor).expect("hits");
                occluded += (0..count).filter(|&i| hit(&i) && answers[i]).count();
                occluded += (0..count).filter(|&i| hit(&i) && closer.t[i].is_finite()).count();
            }
        }
        assert!(layers > count && layers < 4 * count, "{layers}");
        assert_eq!((again, occluded), (0, 0), "of {layers}");
    }
}

/// A vertex of a turned cube, one of whose faces the ray sees at a slope of down to 1e-3: its t is
/// less sure.
#[test]
fn a_vertex_of_a_grazing_face_is_no_second_layer() {
    let monitor = Monitor::default();
    let ((corners, faces), mut found) = (cube(), 0);
    for i in 0..400 {
        let slope = 10f64.powi(-(i % 4));
        let turn = |v: [f64; 3]| {
            let angles = [0.7, 1.9, 4.3].map(|x| x * f64::from(i) * 0.37);
            angles.into_iter().enumerate().fold(v, |mut v, (axis, angle)| {
                let ((sin, cos), j, k) = (angle.sin_cos(), (axis + 1) % 3, (axis + 2) % 3);
                (v[j], v[k]) = (cos * v[j] - sin * v[k], sin * v[j] + cos * v[k]);
                v
            })
        };
        let vertices: Vec<_> = corners.iter().map(|&corner| turn(corner)).collect();
        let corner = vertices[7];
        let scene = scene(Mesh::new(Positions::F64(vertices), faces.clone()).expect("a mesh"));
        let direction = turn([-slope, -0.6, -0.8]);
        let origin = [0, 1, 2].map(|k| corner[k] - 1.7 * direction[k]);
        let ray = ([origin], [direction]);
        let ray = RayBatch::new(&ray.0, &ray.1).expect("a ray");
        let t = scene.closest(&ray, &monitor).expect("hits").t[0];
        if (t - 1.7).abs() > 1e-6 {
            continue;
        }
        found += 1;
        let behind = ray.with_limits(Limits::All(t), Limits::All(f64::INFINITY)).expect("limits");
        let next = scene.closest(&behind, &monitor).expect("hits").t[0];
        assert!(next - t > 1e-6, "{i} {slope:e}: {t} {next}");
        let before = ray.with_limits(Limits::All(0.0), Limits::All(t)).expect("limits");
        assert!(!scene.occluded(&before, &monitor).expect("answers")[0], "{i} {slope:e}: {t}");
    }
    assert!(found > 200, "{found}");
}

/// Faces that share a vertex are one place at one limit, not at both.
#[test]
fn two_limits_at_faces_that_meet_are_two_places() {
    let monitor = Monitor::default();
    for height in [1.0, 1e-6] {
        let corners = vec![[0.0; 3], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.2, 0.2, height]];
        let faces = vec![[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]];
        let scene = scene(Mesh::new(Positions::F64(corners), faces).expect("a mesh"));
        let origins: Vec<_> = (0..50)
            .map(|i| [0.1 + 0.011 * f64::from(i), 0.07 + 0.003 * f64::from(i), 2.0])
            .collect();
        let rays = RayBatch::new(&origins, &[[0.01, 0.02, -0.9]; 50]).expect("rays");
        let all = scene.all_hits(&rays, &monitor).expect("hits");
        let both = |i: &usize| all.offsets[*i + 1] - all.offsets[*i] == 2;
        for i in (0..50).filter(both) {
            let first = all.offsets[i] as usize;
            let (near, far) = (all.t[first], all.t[first + 1]);
            // The next smaller and the next larger number.
            let below = f64::from_bits(near.to_bits() - 1);
            let above = f64::from_bits(far.to_bits() + 1);
            for (tnear, tfar, t) in
                [(near, above, far), (below, far, near), (near, far, f64::INFINITY)]
            {
                let ray = RayBatch::new(&origins[i..=i], &[[0.01, 0.02, -0.9]]).expect("a ray");
                let ray = ray.with_limits(Limits::All(tnear), Limits::All(tfar)).expect("limits");
                let hits = scene.closest(&ray, &monitor).expect("hits");
                let occluded = scene.occluded(&ray, &monitor).expect("answers");
                assert_eq!((hits.t[0], occluded[0]), (t, t.is_finite()), "{height} {i}");
            }
        }
        assert!((0..50).filter(both).count() > 20);
    }
}

/// Two faces with a common edge, whose t differ by little at some distance from the edge.
#[test]
fn layers_that_share_an_edge_are_two() {
    let monitor = Monitor::default();
    for gap in [1e-12, 1e-9, 6e-8, 1e-3] {
        for split in [false, true] {
            let mut corners = vec![[0.0, 0.0, 0.0], [0.0, 1.0, 0.0], [1.0, 0.5, 0.0]];
            corners.push([1.0, 0.5, gap]);
            corners.extend([corners[0], corners[1]]);
            let faces = vec![[0, 1, 2], if split { [4, 5, 3] } else { [0, 1, 3] }];
            let scene = scene(Mesh::new(Positions::F64(corners), faces).expect("a mesh"));
            let origins: Vec<_> = (1..9).map(|i| [f64::from(i) / 9.0, 0.5, -2.0]).collect();
            let rays = RayBatch::new(&origins, &[[0.0, 0.0, 1.0]; 8]).expect("rays");
            let limited = |tnear, tfar| {
                let rays = rays.with_limits(Limits::All(tnear), tfar).expect("rays");
                let occluded = scene.occluded(&rays, &monitor).expect("answers");
                (scene.closest(&rays, &monitor).expect("hits"), occluded)
            };
            let (next, occluded) = limited(2.0, Limits::All(f64::INFINITY));
            for (i, origin) in origins.iter().enumerate() {
                let expected = 2.0 + gap * origin[0];
                assert!((next.t[i] - expected).abs() < 1e-15, "{gap} {split}: {:?}", next.t);
            }
            assert!(next.primitive.iter().all(|&face| face == 1));
            assert_eq!(occluded, [true; 8]);
            let (first, occluded) = limited(0.0, Limits::Each(&next.t));
            assert_eq!((first.t, occluded), (vec![2.0; 8], vec![true; 8]), "{gap} {split}");
        }
    }
}
