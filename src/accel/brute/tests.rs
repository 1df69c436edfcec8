use proptest::prelude::*;

use super::*;
use crate::error::ErrorKind;
use crate::geometry::{NONE, Sphere, TriangleMesh, doubles};
use crate::ray::LANES;

const OPTIONS: BuildOptions = BuildOptions { threads: 1, max_bytes: None };

fn build(geometry: &Geometry) -> Brute<'_> {
    Brute::build(geometry, &OPTIONS, &Monitor::default()).unwrap()
}

fn mesh(vertices: Vec<[f32; 3]>, triangles: Vec<[u32; 3]>) -> Geometry {
    let mesh = TriangleMesh::new(vertices, triangles, false);
    Geometry::new(DVec3::ZERO, vec![mesh], vec![], vec![]).unwrap()
}

fn soup(triangles: &[[[f32; 3]; 3]]) -> Geometry {
    let indices = (0..triangles.len() as u32).map(|i| [0, 1, 2].map(|k| 3 * i + k));
    mesh(triangles.concat(), indices.collect())
}

fn ray(origin: [f32; 3], direction: [f32; 3]) -> LaneRay {
    let (origin, direction) = (doubles(origin), doubles(direction));
    LaneRay { origin, direction, tnear: 0.0, tfar: f64::INFINITY, leaving: NONE }
}

/// A closed sphere of radius about 1: an octahedron whose faces are split into four `depth` times.
fn ball(depth: u32) -> Geometry {
    let mut triangles: Vec<[[f32; 3]; 3]> = (0..8)
        .map(|bits: u32| {
            let sign = |axis: u32| if bits >> axis & 1 == 0 { 1.0 } else { -1.0 };
            [[sign(0), 0.0, 0.0], [0.0, sign(1), 0.0], [0.0, 0.0, sign(2)]]
        })
        .collect();
    let middle = |a: [f32; 3], b: [f32; 3]| {
        let m = doubles(a) + doubles(b);
        m.normalize().as_vec3().to_array()
    };
    for _ in 0..depth {
        triangles = triangles
            .into_iter()
            .flat_map(|[a, b, c]| {
                let (ab, bc, ca) = (middle(a, b), middle(b, c), middle(c, a));
                [[a, ab, ca], [b, bc, ab], [c, ca, bc], [ab, bc, ca]]
            })
            .collect();
    }
    soup(&triangles)
}

const TRIANGLE: [[f32; 3]; 3] = [[0.0, 0.0, 0.0], [4.0, 0.0, 0.0], [0.0, 2.0, 0.0]];

#[test]
fn known_hits() {
    let geometry = soup(&[TRIANGLE]);
    let brute = build(&geometry);
    let down = |x, y| brute.closest_hit(&ray([x, y, 3.0], [0.0, 0.0, -2.0]));
    let hit = down(1.0, 0.5).unwrap();
    assert_eq!((hit.geom, hit.prim, hit.t, hit.u, hit.v), (0, 0, 1.5, 0.25, 0.25));
    assert_eq!(hit.ng, DVec3::new(0.0, 0.0, 8.0));
    // Corners and edges belong to the triangle. A point one denormal outside does not.
    for (x, y) in [(0.0, 0.0), (4.0, 0.0), (0.0, 2.0), (2.0, 0.0), (0.0, 1.0), (2.0, 1.0)] {
        assert!(down(x, y).is_some(), "{x} {y}");
    }
    let tiny = f32::from_bits(1);
    for (x, y) in [(-tiny, 1.0), (1.0, -tiny), (2.0, 1.0 + f32::EPSILON), (-tiny, -tiny)] {
        assert!(down(x, y).is_none(), "{x} {y}");
    }
    // Seen edge-on, and behind.
    assert!(brute.closest_hit(&ray([-1.0, 0.5, 0.0], [1.0, 0.0, 0.0])).is_none());
    assert!(brute.closest_hit(&ray([1.0, 0.5, 3.0], [0.0, 0.0, 1.0])).is_none());
}

#[test]
fn triangles_without_area_are_never_hit() {
    let point = [1.0, 1.0, 0.0];
    let line = [[0.0, 0.0, 0.0], [1.0, 1.0, 0.0], [3.0, 3.0, 0.0]];
    let geometry = soup(&[[point; 3], line, [point, point, [2.0, 2.0, 0.0]]]);
    let brute = build(&geometry);
    assert!(brute.all_hits(&ray([1.0, 1.0, 3.0], [0.0, 0.0, -1.0])).is_empty());
}

#[test]
fn the_segment_is_open_to_the_last_bit() {
    // A plane z = x / 3 + y / 7: t is not an f32 value.
    let triangle = [[-9.0, 0.0, -3.0], [9.0, 0.0, 3.0], [0.0, 63.0, 9.0]];
    let geometry = soup(&[triangle]);
    let brute = build(&geometry);
    let base = ray([0.25, 0.5, 100.0], [0.0, 0.0, -3.0]);
    let t = brute.closest_hit(&base).unwrap().t;
    let nearest = t as f32;
    let (below, above) = if f64::from(nearest) < t {
        (nearest, f32::from_bits(nearest.to_bits() + 1))
    } else {
        (f32::from_bits(nearest.to_bits() - 1), nearest)
    };
    let hits = |tnear: f32, tfar: f32| {
        let ray = LaneRay { tnear: tnear.into(), tfar: tfar.into(), ..base };
        brute.closest_hit(&ray).is_some()
    };
    assert!(hits(below, above) && !hits(0.0, below) && !hits(above, f32::INFINITY));
    // A hit exactly at an end of the segment does not count.
    let geometry = soup(&[TRIANGLE]);
    let brute = build(&geometry);
    let at = |tnear, tfar| {
        let ray = LaneRay { tnear, tfar, ..ray([1.0, 0.5, 3.0], [0.0, 0.0, -2.0]) };
        brute.closest_hit(&ray).is_some()
    };
    assert!(at(1.0, 2.0) && !at(1.5, 2.0) && !at(1.0, 1.5));
}

#[test]
fn ties_go_to_the_lowest_number_and_nearly_equal_t_are_no_tie() {
    // Four parallel triangles; the second and fourth are nearer by 2^-149.
    let lift = |z: f32| TRIANGLE.map(|[x, y, _]| [x, y, z]);
    let tiny = f32::from_bits(1);
    let geometry = soup(&[lift(0.0), lift(tiny), lift(0.0), lift(tiny)]);
    let brute = build(&geometry);
    let found = |z: f32| {
        let hits = brute.all_hits(&ray([1.0, 0.5, z], [0.0, 0.0, -1.0]));
        hits.iter().map(|hit| hit.prim).collect::<Vec<_>>()
    };
    assert_eq!(found(1e30), [1, 3, 0, 2]);
    assert_eq!(found(2.0 * tiny), [1, 3, 0, 2]);
    // tnear = 0 is not in the segment.
    assert_eq!(found(tiny), [0, 2]);
}

#[test]
fn a_ray_that_leaves_a_sphere_hits_only_its_far_side() {
    let sphere = Sphere { center: DVec3::ZERO, radius: 1.0 };
    let quad = [[-1.0, -1.0, -3.0], [1.0, -1.0, -3.0], [1.0, 1.0, -3.0], [-1.0, 1.0, -3.0]];
    let geometry = Geometry::new(DVec3::ZERO, vec![], vec![quad], vec![sphere]).unwrap();
    let brute = build(&geometry);
    let base = ray([0.0, 0.0, 1.0], [0.0, 0.0, -1.0]);
    let hits = brute.all_hits(&LaneRay { leaving: geometry.primitive(1, 0), ..base });
    assert_eq!(hits.iter().map(|hit| (hit.geom, hit.t)).collect::<Vec<_>>(), [(1, 2.0), (0, 4.0)]);
    // A ray through the diagonal hits the quad once.
    assert_eq!((hits[1].u, hits[1].v), (0.5, 0.5));
    let leaving = LaneRay { leaving: geometry.primitive(0, 0), ..base };
    assert_eq!(brute.all_hits(&leaving).len(), 1);
}

#[test]
fn quads_report_weights_as_embree_does() {
    let quad = [[0.0, 0.0, 0.0], [4.0, 0.0, 0.0], [4.0, 2.0, 0.0], [0.0, 2.0, 0.0]];
    let geometry = Geometry::new(DVec3::ZERO, vec![], vec![quad], vec![]).unwrap();
    let brute = build(&geometry);
    for (x, y) in [(1.0, 0.5), (3.0, 1.5), (3.5, 0.25), (0.0, 2.0), (4.0, 2.0)] {
        let hit = brute.closest_hit(&ray([x, y, 1.0], [0.0, 0.0, -1.0])).unwrap();
        assert_eq!((hit.u, hit.v), (f64::from(x) / 4.0, f64::from(y) / 2.0));
    }
}

#[test]
fn a_closed_mesh_has_no_holes_at_vertices_edges_and_anywhere() {
    let geometry = ball(4);
    let brute = build(&geometry);
    let mesh = &geometry.meshes[0];
    let origins = [[0.013f32, -0.027, 0.009], [0.0; 3], [0.1, 0.1, 0.1]];
    let mut shared = 0;
    for prim in 0..mesh.triangles().len() as u32 {
        let [a, b, c] = mesh.corners(prim).map(doubles);
        for target in [a, (a + b) / 2.0, (a + b + c) / 3.0, a * 0.3 + b * 0.7] {
            for origin in origins {
                let direction = (target - doubles(origin)).as_vec3().to_array();
                let hits = brute.all_hits(&ray(origin, direction));
                assert!(!hits.is_empty(), "{origin:?} {direction:?}");
                shared += usize::from(hits.len() > 1);
            }
        }
    }
    // Rays from the centre are exact differences, so many hit shared edges exactly.
    assert!(shared > 1000, "{shared}");
}

#[test]
fn rays_along_grid_lines_hit_all_they_touch() {
    // The unit squares of [0, 8]^2, two triangles each.
    let mut vertices = Vec::new();
    let mut triangles = Vec::new();
    for y in 0..9u32 {
        for x in 0..9u32 {
            vertices.push([x as f32, y as f32, 0.5]);
            if x < 8 && y < 8 {
                let i = y * 9 + x;
                triangles.extend([[i, i + 1, i + 10], [i, i + 10, i + 9]]);
            }
        }
    }
    let geometry = mesh(vertices, triangles);
    let brute = build(&geometry);
    for (x, y, expected) in
        [(4.0, 4.0, 6), (4.0, 4.5, 2), (4.5, 4.5, 2), (4.5, 4.25, 1), (0.0, 0.0, 2)]
    {
        let hits = brute.all_hits(&ray([x, y, 2.0], [0.0, 0.0, -1.0]));
        assert_eq!(hits.len(), expected, "{x} {y}");
        assert!(hits.windows(2).all(|pair| pair[0].prim < pair[1].prim));
    }
    // A ray in the plane of all triangles.
    assert!(brute.all_hits(&ray([-1.0, 4.0, 0.5], [1.0, 0.0, 0.0])).is_empty());
}

#[test]
fn tiny_and_huge_coordinates_are_tested_exactly() {
    for scale in [1e-45f32, 1e-40, 1e-30, 1e30, 1e37] {
        // Few significant bits: products with the triangle's small integers are exact.
        let scale = f32::from_bits(scale.to_bits() & 0xffff_0000).max(f32::from_bits(1));
        let geometry = soup(&[TRIANGLE.map(|v| v.map(|x| x * scale))]);
        let brute = build(&geometry);
        for direction in [1e-38f32, 1.0, 1e38] {
            let at =
                |x: f32, y: f32| ray([x * scale, y * scale, 3.0 * scale], [0.0, 0.0, -direction]);
            let hit = brute.closest_hit(&at(2.0, 1.0)).unwrap();
            let t = 3.0 * f64::from(scale) / f64::from(direction);
            assert!((hit.t / t - 1.0).abs() < 1e-11, "{scale} {direction}: {} {t}", hit.t);
            assert_eq!((hit.u, hit.v), (0.5, 0.5));
            assert!(brute.closest_hit(&at(3.0, 1.0)).is_none());
        }
    }
}

#[test]
fn packets_get_hits_and_builds_respect_limits_and_signals() {
    let geometry = soup(&[TRIANGLE]);
    let brute = build(&geometry);
    let mut packet = RayPacket::EMPTY;
    packet.rays.org[2] = [3.0; LANES];
    packet.rays.dir[2] = [-2.0; LANES];
    packet.rays.org[0] = std::array::from_fn(|i| i as f32 - 1.0);
    let mut active = Mask::ALL;
    active.0[2] = 0;
    let mut shadow = packet.rays.clone();
    brute.closest(&active, &mut packet, Coherence::Coherent);
    brute.occluded(&active, &mut shadow, Coherence::Coherent);
    for i in 0..LANES {
        let expected = [1, 3, 4, 5].contains(&i);
        assert_eq!(packet.hits.geom[i] == 0, expected, "lane {i}");
        assert_eq!(shadow.tfar[i] == f32::NEG_INFINITY, expected, "lane {i}");
    }
    assert_eq!((packet.rays.tfar[1], packet.hits.ng[2][1]), (1.5, 1.0));
    let error = |options: &BuildOptions, monitor: &Monitor| {
        Brute::build(&geometry, options, monitor).err().unwrap().kind
    };
    let little = BuildOptions { max_bytes: Some(10), ..OPTIONS };
    assert_eq!(error(&little, &Monitor::default()), ErrorKind::Limit);
    let monitor = Monitor::default();
    monitor.signal.store(15, std::sync::atomic::Ordering::Relaxed);
    assert_eq!(error(&OPTIONS, &monitor), ErrorKind::Interrupted(15));
}

/// Points with small integer coordinates mixed with any, so that exact contacts are common.
fn point() -> impl Strategy<Value = [f32; 3]> {
    let grid = prop::array::uniform3((-3i8..=3).prop_map(f32::from));
    prop_oneof![grid.clone(), grid, prop::array::uniform3(-3f32..3.0)]
}

/// A triangle and a ray that is aimed at the line through two of its corners.
fn triangle_and_ray() -> impl Strategy<Value = ([[f32; 3]; 3], [f32; 3], [f32; 3])> {
    let away = prop_oneof![Just(1f32), 1f32..1e7];
    (prop::array::uniform3(point()), point(), -0.2f32..1.2, 1e-3f32..1e3, away).prop_map(
        |(triangle, origin, s, scale, away)| {
            let [a, b, _] = triangle;
            let target = [0, 1, 2].map(|k| a[k] + (b[k] - a[k]) * s);
            let origin = [0, 1, 2].map(|k| target[k] + (origin[k] - target[k]) * away);
            (triangle, origin, [0, 1, 2].map(|k| (target[k] - origin[k]) * scale))
        },
    )
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(3000))]
    #[test]
    fn the_f64_filter_agrees_with_integers((triangle, origin, direction) in triangle_and_ray()) {
        prop_assume!(direction != [0.0; 3]);
        let (ray, corners) = (ray(origin, direction), triangle.map(doubles));
        let found = crossing(&ray, &corners);
        prop_assert_eq!(found.map(|at| at.t).is_some(), triangle::integers_only(&ray, &corners).is_some());
        if let (Some(at), Some(exact)) = (found, triangle::integers_only(&ray, &corners)) {
            prop_assert!((at.t - exact.t).abs() <= at.t_error());
            prop_assert!((at.u - exact.u).abs() < 1e-6 && (at.v - exact.v).abs() < 1e-6);
        }
    }

    #[test]
    fn blocks_skip_no_hit(
        triangles in prop::collection::vec(prop::array::uniform3(point()), 1..120),
        rays in prop::collection::vec((point(), point()), 6),
    ) {
        let geometry = soup(&triangles);
        let brute = build(&geometry);
        for (origin, direction) in rays.into_iter().filter(|(_, d)| *d != [0.0; 3]) {
            let ray = ray(origin, direction);
            let mut found: Vec<u32> = brute.all_hits(&ray).iter().map(|hit| hit.prim).collect();
            found.sort_unstable();
            // The hits that were found are tests of their primitives.
            let mut others = (0..triangles.len() as u32).filter(|p| !found.contains(p));
            prop_assert!(others.all(|p| brute.test(&ray, p).is_none()));
            // Every primitive that is hit is also near.
            let near: Vec<u32> = brute.near(&ray, 1.0, 1000).unwrap().iter().map(|near| near.prim).collect();
            prop_assert!(found.iter().all(|prim| near.contains(prim)));
        }
    }

    #[test]
    fn the_distance_to_a_segment_is_the_minimum_over_its_points(p in prop::array::uniform2(-2f64..2.0), q in prop::array::uniform2(-2f64..2.0)) {
        let (p, q) = (glam::DVec2::from(p), glam::DVec2::from(q));
        let found = near::distance(p, q);
        let sampled = (0..=2000).map(|i| p.lerp(q, f64::from(i) / 2000.0).abs().max_element());
        let sampled = sampled.fold(f64::INFINITY, f64::min);
        prop_assert!(found <= sampled + 1e-12 && found >= sampled - 3e-3);
    }
}
