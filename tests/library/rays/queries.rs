//! `RayScene` compared with the renderer, and with closed forms where rays and points lie exactly
//! on vertices and edges. The Python tests compare it with an oracle in integers.

use std::sync::atomic::Ordering::Relaxed;
use std::time::Duration;

use lightpath::{
    ErrorKind, Faces, Limits, LoadedScene, Mesh, MeshArrays, Monitor, Positions, Ray, RayBackend,
    RayBatch, RayScene, Vertices,
};
use lightpath_reference::winding;
use rayon::prelude::*;

/// A bumpy ball: a cube whose faces are grids of `n` squares, moved to a sphere of radii 0.7 to 1.
pub(super) fn ball(n: i32, middle: [f64; 3]) -> Mesh {
    let (mut positions, mut triangles) = (Vec::<[f64; 3]>::new(), Vec::new());
    let mut index = std::collections::BTreeMap::new();
    let mut vertex = |p: [i32; 3]| {
        *index.entry(p).or_insert_with(|| {
            let [x, y, z] = p.map(|k| f64::from(k) / f64::from(n));
            let length = (x * x + y * y + z * z).sqrt();
            let hash = (p[0] * 73 + p[1] * 179 + p[2] * 283).rem_euclid(97);
            let radius = 0.7 + 0.3 * f64::from(hash) / 97.0;
            let at = |k: usize, x: f64| middle[k] + x / length * radius;
            positions.push([at(0, x), at(1, y), at(2, z)]);
            positions.len() as u32 - 1
        })
    };
    for axis in 0..3 {
        for side in [-n, n] {
            for i in (-n..n).step_by(2) {
                for j in (-n..n).step_by(2) {
                    let mut at = |i: i32, j: i32| {
                        let mut p = [0; 3];
                        (p[axis], p[(axis + 1) % 3], p[(axis + 2) % 3]) = (side, i, j);
                        vertex(p)
                    };
                    let [a, b, c, d] = [at(i, j), at(i + 2, j), at(i + 2, j + 2), at(i, j + 2)];
                    let quad = if side > 0 { [a, b, c, d] } else { [d, c, b, a] };
                    triangles.push([quad[0], quad[1], quad[2]]);
                    triangles.push([quad[0], quad[2], quad[3]]);
                }
            }
        }
    }
    Mesh::new(Positions::F64(positions), triangles).expect("a mesh")
}

pub(super) fn scene(mesh: Mesh) -> RayScene {
    RayScene::new(vec![Box::new(mesh)], &Monitor::default()).expect("a scene")
}

/// Points on a spiral around the origin, at a distance.
pub(super) fn around(count: usize, distance: f64) -> Vec<[f64; 3]> {
    let at = |i: usize| {
        let z = 1.0 - 2.0 * (i as f64 + 0.5) / count as f64;
        let (r, angle) = ((1.0 - z * z).sqrt(), i as f64 * 2.399_963);
        [r * angle.cos(), r * angle.sin(), z].map(|x| x * distance)
    };
    (0..count).map(at).collect()
}

pub(super) fn difference(a: [f64; 3], b: [f64; 3]) -> [f64; 3] {
    [a[0] - b[0], a[1] - b[1], a[2] - b[2]]
}

#[test]
fn closest_hits_are_those_of_the_renderer() {
    let mesh = ball(12, [0.0; 3]);
    let loaded = LoadedScene::of_mesh(mesh.clone()).expect("a mesh");
    let renderer = loaded.renderer().expect("a tree");
    let origins = around(3000, 3.0);
    let targets: Vec<_> = (0..3000).map(|i| origins[(i * 7 + 5) % 3000].map(|x| x * 0.3)).collect();
    let directions: Vec<_> =
        origins.iter().zip(&targets).map(|(&o, &t)| difference(t, o)).collect();
    let rays: Vec<_> = origins.iter().zip(&directions).map(|(&o, &d)| Ray::new(o, d)).collect();
    let (scene, monitor) = (scene(mesh), Monitor::default());
    let batch = RayBatch::new(&origins, &directions).expect("rays");
    let hits = scene.closest(&batch, &monitor).expect("hits");
    let occluded = scene.occluded(&batch, &monitor).expect("answers");
    let all = scene.all_hits(&batch, &monitor).expect("hits");
    let mut met = 0;
    for (i, expected) in renderer.closest(&rays).into_iter().enumerate() {
        assert_eq!(occluded[i], expected.is_some());
        let first = all.offsets[i] as usize;
        assert_eq!(all.offsets[i + 1] > all.offsets[i], expected.is_some());
        let Some(expected) = expected else {
            assert_eq!((hits.t[i], hits.primitive[i]), (f64::INFINITY, -1));
            continue;
        };
        met += 1;
        assert_eq!(hits.primitive[i], expected.primitive as i64);
        assert!((hits.t[i] - expected.t).abs() < 1e-6);
        assert_eq!((all.primitive[first], all.t[first]), (hits.primitive[i], hits.t[i]));
    }
    assert!((1000..3000).contains(&met), "{met}");
}

/// Rays from the middle of the ball cross its surface once, whatever they pass through.
#[test]
fn each_crossing_at_a_vertex_or_an_edge_is_one_hit() {
    for middle in [[0.0; 3], [499_999.37, 4_100_000.71, 31.3]] {
        let mesh = ball(10, middle);
        let Positions::F64(vertices) = mesh.positions.clone() else { panic!("f64") };
        let corner = |i: u32| difference(vertices[i as usize], middle);
        let mut directions: Vec<_> = (0..vertices.len() as u32).map(corner).collect();
        for &[a, b, _] in &mesh.triangles {
            let ([ax, ay, az], [bx, by, bz]) = (corner(a), corner(b));
            directions.push([(ax + bx) * 0.5, (ay + by) * 0.5, (az + bz) * 0.5]);
        }
        let (scene, monitor) = (scene(mesh), Monitor::default());
        let inside = vec![middle; directions.len()];
        let rays = RayBatch::new(&inside, &directions).expect("rays");
        assert!(scene.count(&rays, &monitor).expect("counts").iter().all(|&count| count == 1));
        let outside: Vec<_> = directions
            .iter()
            .map(|d| [middle[0] + 4.0 * d[0], middle[1] + 4.0 * d[1], middle[2] + 4.0 * d[2]])
            .collect();
        let back: Vec<_> = directions.iter().map(|d| d.map(|x| -x)).collect();
        let rays = RayBatch::new(&outside, &back).expect("rays");
        assert!(scene.count(&rays, &monitor).expect("counts").iter().all(|&count| count == 2));
        assert!(scene.contains(&vertices, &monitor).expect("answers").iter().all(|&inside| inside));
        assert!(!scene.contains(&outside, &monitor).expect("answers").contains(&true));
    }
}

#[test]
fn a_stopped_monitor_ends_every_query() {
    let (scene, monitor) = (scene(ball(4, [0.0; 3])), Monitor::default());
    monitor.signal.store(2, std::sync::atomic::Ordering::Relaxed);
    let (points, directions) = (around(5000, 2.0), around(5000, 1.0));
    let rays = RayBatch::new(&points, &directions).expect("rays");
    let kinds = [
        scene.closest(&rays, &monitor).unwrap_err().kind,
        scene.occluded(&rays, &monitor).unwrap_err().kind,
        scene.count(&rays, &monitor).unwrap_err().kind,
        scene.all_hits(&rays, &monitor).unwrap_err().kind,
        scene.contains(&points, &monitor).unwrap_err().kind,
        scene.closest_point(&points, &monitor).unwrap_err().kind,
        scene.visible(&points, &directions, &monitor).unwrap_err().kind,
        scene.winding_number(&points, &monitor).unwrap_err().kind,
    ];
    assert_eq!(kinds, [ErrorKind::Interrupted(2); 8]);
}

#[test]
fn tnear_may_be_the_t_of_another_query() {
    let monitor = Monitor::default();
    let scene = RayScene::new(vec![Box::new(ball(5, [0.0; 3]))], &monitor).expect("a scene");
    // Half of the rays start inside.
    let origins: Vec<_> = [around(500, 3.0), around(500, 0.1)].concat();
    let directions: Vec<_> = around(1000, 1.0).into_iter().rev().collect();
    let rays = RayBatch::new(&origins, &directions).expect("rays");
    let t = scene.closest(&rays, &monitor).expect("hits").t;
    let misses = t.iter().filter(|t| t.is_infinite()).count();
    assert!(misses > 100 && misses < 600, "{misses}");
    let next = rays.with_limits(Limits::Each(&t), Limits::All(f64::INFINITY)).expect("rays");
    let count = |rays| scene.count(rays, &monitor).expect("counts");
    let fewer: Vec<u32> = count(&rays).iter().map(|n| n.saturating_sub(1)).collect();
    assert_eq!(count(&next), fewer);
    let hit: Vec<bool> = fewer.iter().map(|&n| n > 0).collect();
    assert_eq!(scene.occluded(&next, &monitor).expect("answers"), hit);
    let found = scene.closest(&next, &monitor).expect("hits").t;
    assert_eq!(found.iter().map(|t| t.is_finite()).collect::<Vec<_>>(), hit);
    let never = rays.with_limits(Limits::All(f64::INFINITY), Limits::All(f64::INFINITY));
    assert!(count(&never.expect("rays")).iter().all(|&n| n == 0));
}

#[test]
fn wrong_rays_are_refused_with_their_place() {
    fn place<T>(result: lightpath::Result<T>) -> String {
        result.map(|_| ()).unwrap_err().problems[0].place.clone()
    }
    let (good, short) = ([[0.0, 0.0, 1.0]; 2000], [[0.0, 0.0, 1.0]; 2]);
    assert_eq!(place(RayBatch::new(&good, &short)), "directions");
    let rays = RayBatch::new(&good, &good).expect("rays");
    assert_eq!(place(rays.with_limits(Limits::All(0.0), Limits::Each(&[1.0]))), "tfar");

    let monitor = Monitor::default();
    let scene = RayScene::new(vec![Box::new(ball(5, [0.0; 3]))], &monitor).expect("a scene");
    let refused = |rays: RayBatch| {
        let places = [
            place(scene.closest(&rays, &monitor)),
            place(scene.occluded(&rays, &monitor)),
            place(scene.count(&rays, &monitor)),
            place(scene.all_hits(&rays, &monitor)),
        ];
        assert!(places.iter().all(|place| *place == places[0]), "{places:?}");
        places[0].clone()
    };
    // Two tasks find a wrong direction. The error is that of the first one.
    let mut wrong = good;
    (wrong[1], wrong[1999]) = ([0.0; 3], [f64::INFINITY; 3]);
    assert_eq!(refused(RayBatch::new(&good, &wrong).expect("rays")), "directions[1]");
    wrong[1500][0] = f64::NAN;
    assert_eq!(refused(RayBatch::new(&wrong, &good).expect("rays")), "origins[1500]");
    let limited = |tnear, tfar| refused(rays.with_limits(tnear, tfar).expect("as many values"));
    assert_eq!(limited(Limits::All(f64::NAN), Limits::All(1.0)), "tnear");
    let mut ends = [1.0; 2000];
    ends[1700] = -1.0;
    assert_eq!(limited(Limits::All(0.0), Limits::Each(&ends)), "tfar[1700]");
    let none = RayBatch::new(&[], &[]).expect("no rays");
    let negative = none.with_limits(Limits::All(0.0), Limits::All(-1.0)).expect("a value");
    assert_eq!(refused(negative), "tfar");
}

/// A scene whose vertices are doubles far from 0, and rays from around it through its inside.
#[test]
#[cfg_attr(not(lightpath_embree), ignore = "needs Embree")]
fn embree_finds_the_same_hits_and_refuses_all_other_queries() {
    let (middle, monitor) = ([499_999.37, 4_100_000.71, 31.3], Monitor::default());
    let meshes = || -> Vec<Box<dyn MeshArrays>> {
        vec![Box::new(ball(12, middle)), Box::new(ball(5, middle.map(|x| x + 1.0)))]
    };
    let bvh = RayScene::new(meshes(), &monitor).expect("a scene");
    let embree = RayScene::with_backend(meshes(), RayBackend::Embree, &monitor).expect("a scene");
    assert!(embree.bytes() > 0 && embree.bytes() <= embree.peak_bytes());
    let add = |p: [f64; 3]| [middle[0] + p[0], middle[1] + p[1], middle[2] + p[2]];
    let origins: Vec<_> = around(3000, 3.0).into_iter().map(add).collect();
    let targets: Vec<_> = around(3000, 0.9).into_iter().rev().map(add).collect();
    let directions: Vec<_> =
        origins.iter().zip(&targets).map(|(&o, &t)| difference(t, o)).collect();
    let rays = RayBatch::new(&origins, &directions).expect("rays");
    for tfar in [f64::INFINITY, 0.9] {
        let rays = rays.with_limits(Limits::All(0.01), Limits::All(tfar)).expect("rays");
        let hits = embree.closest(&rays, &monitor).expect("hits");
        let expected = bvh.closest(&rays, &monitor).expect("hits");
        assert_eq!((&hits.primitive, &hits.mesh), (&expected.primitive, &expected.mesh));
        assert_eq!((&hits.t, &hits.normal), (&expected.t, &expected.normal));
        let occluded = embree.occluded(&rays, &monitor).expect("answers");
        assert_eq!(occluded, bvh.occluded(&rays, &monitor).expect("answers"));
        let count = occluded.iter().filter(|&&is| is).count();
        assert!(hits.mesh.contains(&1) && (1000..3000).contains(&count), "{count}");
    }
    let kinds = [
        embree.count(&rays, &monitor).unwrap_err().kind,
        embree.all_hits(&rays, &monitor).unwrap_err().kind,
        embree.contains(&origins, &monitor).unwrap_err().kind,
        embree.closest_point(&origins, &monitor).unwrap_err().kind,
        embree.visible(&origins, &targets, &monitor).unwrap_err().kind,
        embree.winding_number(&origins, &monitor).unwrap_err().kind,
    ];
    assert_eq!(kinds, [ErrorKind::Unsupported; 6]);
    assert_eq!(embree.closed(&monitor), bvh.closed(&monitor));
}

/// While a query waits for tasks of its own, its thread may begin another query.
#[test]
fn queries_on_a_new_scene_do_not_wait_for_each_other() {
    let (answered, waiting) = std::sync::mpsc::channel();
    std::thread::spawn(move || {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(2).build().expect("a pool");
        let whole = ball(40, [0.0; 3]);
        let mut open = whole.clone();
        open.triangles.pop();
        for mesh in [whole, open] {
            let (scene, monitor) = (scene(mesh), Monitor::default());
            let inside = |_| scene.contains(&[[0.0; 3], [2.0; 3]], &monitor).expect("answers");
            let all: Vec<_> = pool.install(|| (0..64).into_par_iter().map(inside).collect());
            answered.send(all).expect("a receiver");
        }
    });
    for _ in 0..2 {
        let answers = waiting.recv_timeout(Duration::from_secs(60)).expect("no deadlock");
        assert_eq!(answers, vec![[true, false]; 64]);
    }
}

#[test]
fn a_stopped_monitor_ends_queries_and_what_they_prepare() {
    let (monitor, points) = (Monitor::default(), [[0.0; 3]]);
    let mut open = ball(4, [0.0; 3]);
    open.triangles.pop();
    let scene = scene(open);
    monitor.signal.store(2, Relaxed);
    let errors = [
        scene.closed(&monitor).unwrap_err(),
        scene.contains(&points, &monitor).unwrap_err(),
        scene.winding_number(&points, &monitor).unwrap_err(),
    ];
    assert_eq!(errors.map(|error| error.kind), [ErrorKind::Interrupted(2); 3]);
    // Nothing half-made was kept.
    let monitor = Monitor::default();
    assert_eq!(scene.closed(&monitor), Ok(&[false][..]));
    assert_eq!(scene.contains(&points, &monitor), Ok(vec![true]));
}

/// Squares of these distances are below the smallest number of f32.
#[test]
fn the_nearest_of_faces_at_tiny_distances_is_found() {
    let far = [[5.9, 0.0, 0.0], [6.0, 0.1, 0.0], [6.0, 0.0, 0.1]];
    let near = [[3.0, 3.0, 3.0], [3.1, 3.0, 3.1], [3.0, 3.1, 3.1]];
    for faces in [[far, near], [near, far]] {
        let corners = faces.as_flattened().iter().map(|corner| corner.map(|x| x * 1e-23));
        let positions = Positions::F64(corners.collect());
        let scene = scene(Mesh::new(positions, vec![[0, 1, 2], [3, 4, 5]]).expect("a mesh"));
        let found = scene.closest_point(&[[0.0; 3]], &Monitor::default()).expect("a point");
        assert_eq!(found.point[0], [3.0 * 1e-23; 3], "{found:?}");
    }
}

#[test]
fn winding_numbers_have_the_promised_error() {
    for name in ["spot", "teapot"] {
        let path = format!("{}/assets/{name}.ply", env!("CARGO_MANIFEST_DIR"));
        let mesh = Mesh::read(path).expect("a mesh");
        let scene = scene(mesh.clone());
        let ([low, high], size) = (scene.bounds(), 500);
        // Fractions of powers of an irrational number fill the box and its surroundings evenly.
        let within = |i: usize, k: usize| {
            let fraction = (i as f64 * 1.220_744_f64.powi(k as i32 + 1).recip()).fract();
            low[k] + (high[k] - low[k]) * (1.2 * fraction - 0.1)
        };
        let points: Vec<_> = (0..size).map(|i| [0, 1, 2].map(|k| within(i, k))).collect();
        let found = scene.winding_number(&points, &Monitor::default()).expect("numbers");
        let at = |index: u32| mesh.positions.get(index as usize);
        let triangles: Vec<_> = mesh.triangles.iter().map(|t| t.map(at)).collect();
        let errors = points
            .iter()
            .zip(&found)
            .map(|(&point, found)| (found - winding::number(&triangles, point.into())).abs());
        let errors: Vec<f64> = errors.collect();
        let (worst, mean) =
            (errors.iter().fold(0.0, |a: f64, &b| a.max(b)), errors.iter().sum::<f64>() / 500.0);
        assert!(worst < 0.002 && mean < 0.0003, "{name}: {worst} {mean}");
    }
}

#[test]
fn the_sides_of_thin_walls_do_not_cancel_out() {
    // Five plates of 2 x 2, 0.02 thick and 0.04 apart.
    let (size, across) = (32, 33u32);
    let (mut corners, mut faces) = (Vec::new(), Vec::new());
    for side in 0..10u32 {
        let first = corners.len() as u32;
        let at = |i: u32| f64::from(i) * 2.0 / f64::from(size) - 1.0;
        let rows = (0..across).flat_map(|i| (0..across).map(move |j| (i, j)));
        corners.extend(rows.map(|(i, j)| [at(i), at(j), 0.02 * f64::from(side)]));
        for (i, j) in (0..size).flat_map(|i| (0..size).map(move |j| (i, j))) {
            let [a, b] = [first + i * across + j, first + (i + 1) * across + j];
            let [upper, lower] =
                [[[a, b, b + 1], [a, b + 1, a + 1]], [[a, b + 1, b], [a, a + 1, b + 1]]];
            faces.extend(if side % 2 == 0 { lower } else { upper });
        }
    }
    let triangles: Vec<_> =
        faces.iter().map(|face: &[u32; 3]| face.map(|i| corners[i as usize].into())).collect();
    let scene = scene(Mesh::new(Positions::F64(corners), faces).expect("a mesh"));
    let points: Vec<_> = (0..60)
        .map(|i| [[0.3, 0.7], [-0.2, 0.1], [0.8, -0.9]][i % 3])
        .zip((0..60).map(|i| 0.003 * f64::from(i) + 0.0013))
        .map(|([x, y], z)| [x, y, z])
        .collect();
    let found = scene.winding_number(&points, &Monitor::default()).expect("numbers");
    for (&point, found) in points.iter().zip(found) {
        let expected = winding::number(&triangles, point.into());
        assert!((found - expected).abs() < 0.005, "{point:?}: {found} {expected}");
    }
}

/// The angle of a face whose corners lie on a line is 0, however near the point is.
#[test]
fn a_face_without_area_has_no_winding_number() {
    // Sums and products of these are exact.
    has_no_winding_number([3.0, 2.25, 2.5], [2.375, 2.09375, 2.1875], 18);
    // Rounding moves these corners off the line by some 1e-16, an angle of 1e-4 from 1e-12.
    has_no_winding_number([3.0, 2.3, 2.2], [2.37, 2.111, 2.074], 13);
}

/// Checks that a face from (2, 2, 2) to `end`, with a third corner on its edge, adds nothing to the
/// numbers of points near to it: 1 to 10^(1 - `decades`) away.
fn has_no_winding_number(end: [f64; 3], third: [f64; 3], decades: i32) {
    let [_, slope_y, slope_z] = difference(end, [2.0; 3]);
    let corners = vec![[2.0; 3], end, third, [0.0; 3], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]];
    let on_line: Vec<[f64; 3]> = (0..200)
        .map(|i| {
            let (s, off) = (0.005 * f64::from(i), 10f64.powi(-(i % decades)));
            [2.0 + s + off, 2.0 + slope_y * s - 0.5 * off, 2.0 + slope_z * s + 0.3 * off]
        })
        .collect();
    let numbers = |faces: Vec<[u32; 3]>| {
        let mesh = Mesh::new(Positions::F64(corners.clone()), faces).expect("a mesh");
        scene(mesh).winding_number(&on_line, &Monitor::default()).expect("numbers")
    };
    let (with, without) = (numbers(vec![[0, 1, 2], [3, 4, 5]]), numbers(vec![[3, 4, 5]]));
    for ((with, without), point) in with.into_iter().zip(without).zip(&on_line) {
        assert!((with - without).abs() < 1e-4, "{point:?}: {with} {without}");
    }
}

/// A product with the normal overflows: the hit is not the first corner.
#[test]
fn long_directions_near_a_corner_have_their_hit() {
    let corners = vec![[0.0; 3], [1e10, 0.0, 0.0], [0.0, 1e10, 0.0]];
    let scene = scene(Mesh::new(Positions::F64(corners), vec![[0, 1, 2]]).expect("a mesh"));
    let rays = ([[1e4, 2e4, 1e4]], [[0.0, 0.0, -1e300]]);
    let rays = RayBatch::new(&rays.0, &rays.1).expect("a ray");
    let hits = scene.closest(&rays, &Monitor::default()).expect("hits");
    assert!((hits.t[0] / 1e-296 - 1.0).abs() < 1e-12, "{:?}", hits.t);
    let [u, v] = hits.barycentrics[0];
    assert!((u - 1e-6).abs() < 1e-12 && (v - 2e-6).abs() < 1e-12, "{u} {v}");
}

/// Errors of equal patches all around add up in the middle.
#[test]
fn winding_numbers_hold_in_the_middle_of_a_sphere() {
    let (size, across) = (40, 41u32);
    let (mut corners, mut faces) = (Vec::new(), Vec::new());
    for (axis, sign) in [(0, 1.0), (1, 1.0), (2, 1.0), (0, -1.0), (1, -1.0), (2, -1.0)] {
        let first = corners.len() as u32;
        let at = |i: u32| f64::from(i) * 2.0 / f64::from(size) - 1.0;
        for (i, j) in (0..across).flat_map(|i| (0..across).map(move |j| (i, j))) {
            let (u, v) = (sign * at(i), at(j));
            let length = (u * u + v * v + 1.0).sqrt();
            let mut corner = [sign / length; 3];
            (corner[(axis + 1) % 3], corner[(axis + 2) % 3]) = (u / length, v / length);
            corners.push(corner);
        }
        for (i, j) in (0..size).flat_map(|i| (0..size).map(move |j| (i, j))) {
            let [a, b] = [first + i * across + j, first + (i + 1) * across + j];
            faces.extend([[a, b, b + 1], [a, b + 1, a + 1]]);
        }
    }
    let scene = scene(Mesh::new(Positions::F64(corners), faces).expect("a mesh"));
    let points = [[0.0; 3], [0.1, 0.0, 0.0], [-0.2, 0.3, 0.1], [0.0, 0.0, -0.4]];
    for found in scene.winding_number(&points, &Monitor::default()).expect("numbers") {
        assert!((found - 1.0).abs() < 0.002, "{found}");
    }
}

#[test]
fn the_stitches_of_a_mesh_are_its_last_faces() {
    let corners = vec![[0.0; 3], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.5, 0.0, 0.0]];
    let mut mesh = Mesh::new(Positions::F64(corners), vec![[0, 1, 2]]).expect("a mesh");
    assert_eq!(mesh.faces().len(), 1);
    mesh.stitches = vec![[0, 3, 1]];
    let faces = mesh.faces();
    assert!(matches!(faces, Faces::U32Pair([[0, 1, 2]], [[0, 3, 1]])) && faces.len() == 2);
    let (scene, ray) = (scene(mesh), ([[0.2, 0.2, 1.0]], [[0.0, 0.0, -1.0]]));
    let rays = RayBatch::new(&ray.0, &ray.1).expect("a ray");
    let hits = scene.closest(&rays, &Monitor::default()).expect("hits");
    assert_eq!((hits.t, hits.primitive), (vec![1.0], vec![0]));
}

/// Arrays with signed indices.
struct Signed(Vec<[f32; 3]>, Vec<[i64; 3]>);

impl MeshArrays for Signed {
    fn vertices(&self) -> Vertices<'_> {
        Vertices::F32(&self.0)
    }

    fn faces(&self) -> Faces<'_> {
        Faces::I64(&self.1)
    }
}

#[test]
fn arrays_become_a_mesh_without_faces_that_repeat_a_vertex() {
    let mesh = |faces: &[[i64; 3]]| {
        let corners = vec![[0.0; 3], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]];
        Signed(corners, faces.to_vec()).to_mesh("box: ")
    };
    let made = mesh(&[[0, 0, 1], [0, 1, 2], [2, 1, 2]]).expect("a mesh");
    assert_eq!((made.triangles, made.notes.degenerate_dropped), (vec![[0, 1, 2]], 2));
    for (faces, message) in [
        ([[0, 1, 2], [1, -1, 2]], "box: faces[1, 1]: found vertex -1, expected 0 to 2"),
        ([[0, 1, 1], [2, 1, 2]], "box: faces: found no face of three different vertices"),
    ] {
        let error = mesh(&faces).unwrap_err();
        assert!(error.to_string().contains(message), "{error}");
    }
}
