//! Unit tests of crevices.

use super::*;

/// A floor (z = 0, x and y >= 0), and walls on the planes x = 0 and y = 0.
fn corner() -> Geometry {
    let quads = vec![
        [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [1.0, 1.0, 0.0], [0.0, 1.0, 0.0]],
        [[0.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 1.0, 1.0], [0.0, 0.0, 1.0]],
        [[0.0, 0.0, 0.0], [0.0, 0.0, 1.0], [1.0, 0.0, 1.0], [1.0, 0.0, 0.0]],
    ];
    Geometry::new(DVec3::ZERO, vec![], quads, vec![]).unwrap()
}

fn at(point: DVec3, origin: [f32; 3]) -> Option<Crevice> {
    let geometry = corner();
    let own = [DVec3::ZERO, DVec3::X, DVec3::Y];
    Crevice::new(&geometry, (point, origin), (own, DVec3::Z, 0), &[0, 1, 2])
}

#[test]
fn a_ray_into_the_wall_hits_it_even_from_the_edge() {
    let point = DVec3::new(0.0, 0.3, 0.0);
    let crevice = at(point, [-1e-8, 0.3, 1e-9]).unwrap();
    assert!(crevice.is_clear && crevice.origin[0] > 0.0 && crevice.origin[2] > 0.0);
    assert!(
        crevice.leaves(1, DVec3::X)
            && !crevice.leaves(1, -DVec3::X)
            && !crevice.leaves(0, DVec3::X)
    );
    let all = |_| true;
    let hit = crevice.meet(DVec3::new(-1.0, 0.0, 1e-6), 1.0, all).unwrap();
    assert!(hit.primitive == 1 && (0.0..1e-10).contains(&hit.t));
    assert!(crevice.meet(DVec3::new(1e-9, 0.0, 1.0), f64::INFINITY, all).is_none(), "off the wall");
    // From the vertex, both walls are hit.
    let crevice = at(DVec3::ZERO, [0.0; 3]).unwrap();
    for direction in [DVec3::new(-1.0, 0.5, 0.1), DVec3::new(0.5, -1.0, 0.1)] {
        assert!(crevice.meet(direction, 1.0, all).is_some());
    }
    assert!(crevice.meet(DVec3::ONE, 1.0, all).is_none());
}

#[test]
fn a_wall_is_hit_at_its_distance_from_the_point() {
    let point = DVec3::new(1e-7, 0.3, 0.0);
    let crevice = at(point, [1e-7, 0.3, 1e-9]).unwrap();
    assert!(crevice.is_clear);
    let hit = crevice.meet(DVec3::new(-1.0, 0.0, 0.5), 1.0, |_| true).unwrap();
    assert!((hit.t - 1e-7).abs() < 1e-10);
    let nearer = crevice.meet(DVec3::new(-1.0, 0.0, 0.5), 1e-8, |_| true);
    assert!(nearer.is_none(), "the light is nearer");
}

/// Two faces that hang from one edge, both on the viewer's side of it. The one in front hides
/// the other, also at the edge itself.
#[test]
fn the_face_in_front_hides_the_other_at_a_shared_edge() {
    let mesh = crate::geometry::TriangleMesh::new(
        vec![[0.0, 0.0, 0.0], [0.0, 1.0, 0.0], [-1.0, 0.5, -1.0], [-0.5, 0.5, -1.0]],
        vec![[0, 1, 2], [0, 1, 3]],
        false,
    );
    let geometry = Geometry::new(DVec3::ZERO, vec![mesh], vec![], vec![]).unwrap();
    let corners = |k| geometry.meshes[0].corners(k).map(doubles);
    let seen = |k, point, way| hides(&geometry, point, (corners(k), k), way, &[0, 1]);
    for point in [DVec3::new(0.0, 0.3, 0.0), DVec3::ZERO] {
        assert_eq!(seen(1, point, DVec3::X).map(|hit| hit.primitive), Some(0));
        assert!(seen(0, point, DVec3::X).is_none());
        assert_eq!(seen(0, point, -DVec3::X).map(|hit| hit.primitive), Some(1));
    }
    // Below the edge, the ray's two hits are far apart.
    let below = DVec3::new(-0.25, 0.5, -0.5);
    for length in [1e-3, 1.0, 1e3] {
        assert!(seen(1, below, DVec3::X * length).is_none());
        let at_edge = DVec3::new(0.0, 0.3, 0.0);
        let hit = seen(1, at_edge, DVec3::X * length);
        assert_eq!(hit.map(|hit| hit.primitive), Some(0), "{length}");
    }
}

#[test]
fn surfaces_behind_the_plane_are_no_walls() {
    let geometry = corner();
    let own = [DVec3::ZERO, DVec3::X, DVec3::Y];
    let point = DVec3::new(0.0, 0.3, 0.0);
    // Seen from below, the walls are behind the floor.
    let seen = Crevice::new(&geometry, (point, [0.0, 0.3, -1e-9]), (own, -DVec3::Z, 0), &[0, 1, 2]);
    assert!(seen.is_none());
}

#[test]
fn a_primitive_is_near_if_its_box_is() {
    let geometry = corner();
    let near = |primitive, point: DVec3| {
        is_near(&geometry, primitive, &Nearby::new(point, [DVec3::ZERO, DVec3::X, DVec3::Y]))
    };
    assert!(near(0, DVec3::new(0.5, 0.5, 1e-7)) && near(0, DVec3::new(1.0, 0.5, -1e-7)));
    for away in [[1.5, 0.5, 0.0], [0.5, 1.5, 0.0], [0.5, 0.5, 0.125], [0.5, -0.5, 0.0]] {
        assert!(!near(0, DVec3::from(away)), "{away:?}");
    }
}

/// A triangle away from the origin, and the ray to its point with the weights `u` and `v`.
fn meet(u: f64, v: f64, second_half: bool) -> Option<WallHit> {
    let corners = [[1.0, -1.0, 3.0], [3.0, 0.5, 3.5], [0.5, 3.0, 2.5]].map(DVec3::from);
    let [a, b, c] = corners;
    let normal = (b - a).cross(c - a);
    let triangle = Triangle { primitive: 7, corners, normal, second_half };
    let point = DVec3::new(0.5, 1.0, -1.0);
    let on_plane = a * (1.0 - u - v) + b * u + c * v;
    triangle.meet(point, (on_plane - point) * 0.25)
}

#[test]
fn a_wall_is_hit_at_the_point_that_the_ray_is_aimed_at() {
    let near = |a: f64, b: f64| (a - b).abs() < 1e-6;
    let hit = meet(0.25, 0.625, false).unwrap();
    assert!((hit.t - 4.0).abs() < 1e-12 && hit.primitive == 7);
    assert!(near(hit.u.into(), 0.25) && near(hit.v.into(), 0.625));
    let hit = meet(0.25, 0.625, true).unwrap();
    assert!(near(hit.u.into(), 0.75) && near(hit.v.into(), 0.375));
}

#[test]
fn edges_of_a_wall_are_hit_up_to_the_rounding_of_f64() {
    for (off, expected) in [(0.0, true), (1e-14, true), (1e-10, false), (1e-2, false)] {
        for (u, v) in [(-off, 0.5), (0.5, -off), (0.5, 0.5 + off)] {
            assert_eq!(meet(u, v, false).is_some(), expected, "{u} {v}");
        }
    }
}

/// Almost in the plane, weights are imprecise. The tolerance has a limit, and does not depend
/// on the unit of length.
#[test]
fn the_tolerance_grows_for_a_grazing_ray_up_to_a_limit() {
    for (unit, length) in [(1.0, 1.0), (1048576.0, 1.0), (1e-6, 1.0), (1.0, 1024.0), (1.0, 1e-3)] {
        let corners = [DVec3::ZERO, DVec3::X, DVec3::Y].map(|v| v * unit);
        let normal = DVec3::Z * unit * unit;
        let wall = Triangle { primitive: 0, corners, normal, second_half: false };
        for (slope, off, expected) in [
            (1e-8, 1e-6, true),
            (1e-8, 1e-4, false),
            (1e-13, 0.9 / 1024.0, true),
            (1e-13, 1.2 / 1024.0, false),
        ] {
            let point = DVec3::new(-1.0, -off, slope) * unit;
            let met = wall.meet(point, DVec3::new(1.25, 0.0, -slope) * length);
            assert_eq!(met.is_some(), expected, "{slope:e} {off:e} {unit:e} {length:e}");
        }
    }
}

#[test]
fn the_point_is_moved_into_its_triangle_by_little() {
    let moved = |point: DVec3, own| inside(point, own) - point;
    let own = [DVec3::ZERO, DVec3::X * 3.0, DVec3::Y * 3.0];
    // By 2^-36 of the way to the middle.
    let [share, of_coordinates] = INWARD;
    let way = moved(DVec3::X, own);
    assert!((way - DVec3::Y * share).length() < 0.01 * share, "{way}");
    // By a fraction of the coordinates if these are large.
    let far = DVec3::Z * 4096.0;
    let way = moved(far + DVec3::X * 4.0, own.map(|v| v * 2.0 + far));
    let expected = DVec3::new(-1.0, 1.0, 0.0) * 4096.0 * of_coordinates;
    assert!((way - expected).length() < 0.02 * expected.length(), "{way} {expected}");
    // By at most a quarter of the way.
    let tiny = own.map(|v| v * 2f64.powi(-40) + far);
    let way = moved(tiny[1], tiny);
    assert!((way - ((tiny[0] + tiny[1] + tiny[2]) / 3.0 - tiny[1]) * 0.25).length() < 1e-12);
}

#[test]
fn a_corner_rises_if_it_is_above_the_plane_by_more_than_rounding() {
    let up = DVec3::Z;
    // The size is 3 + 4 + 12 in all.
    let (point, own) = (DVec3::X * 12.0, DVec3::new(12.0, 4.0, 0.0));
    for (height, expected) in [(1.1, true), (0.9, false), (-1.1, false)] {
        let corner = DVec3::new(15.0, 0.0, height * EQUAL * 19.0);
        assert_eq!(rises(corner, point, own, up), expected, "{height}");
        // A plane away from zero: the size grows by its height.
        let above = DVec3::Z * 5.0;
        let corner = DVec3::new(15.0, 0.0, 5.0 + height * EQUAL * 20.0);
        assert_eq!(rises(corner, point + above, own + above, up), expected, "{height}");
    }
}

fn mesh(vertices: Vec<[f32; 3]>, triangles: Vec<[u32; 3]>) -> Geometry {
    let mesh = crate::geometry::TriangleMesh::new(vertices, triangles, false);
    Geometry::new(DVec3::ZERO, vec![mesh], vec![], vec![]).unwrap()
}

/// The other triangle lies in the plane x + y + z = 0, and the point below it.
#[test]
fn hits_are_tied_up_to_twice_the_diagonal_of_what_is_near() {
    let vertices = vec![[8.0, -4.0, -4.0], [-4.0, 8.0, -4.0], [-4.0, -4.0, 8.0], [-4.0; 3]];
    let geometry = mesh(vertices, vec![[3, 0, 1], [0, 1, 2]]);
    let own = geometry.meshes[0].corners(0).map(doubles);
    let across = DVec3::ONE / 3f64.sqrt();
    let size = Nearby::new(DVec3::ZERO, own).reach([DVec3::splat(-4.0), DVec3::splat(8.0)]);
    for (share, expected) in [(0.5, true), (1.5, true), (3.4, true), (3.6, false)] {
        let point = across * -share * size.unwrap();
        for length in [0.01, 1.0, 100.0] {
            let hit = hides(&geometry, point, (own, 0), across * -length, &[0, 1]);
            assert_eq!(hit.is_some(), expected, "{share} {length}");
        }
    }
}

/// A ceiling at 1.002 times the height of the origin is too close, at 1.005 times it is not.
#[test]
fn an_origin_keeps_away_from_a_ceiling_by_more_than_rounding() {
    let height = 2f32.powi(-22);
    for (share, is_kept) in [(0.5, false), (1.002, false), (1.005, true), (1.9, true)] {
        let at = |z: f32| [[0.0, 0.0, z], [1.0, 0.0, z], [0.0, 1.0, z]];
        let vertices = [at(0.0), at(share * height)].concat();
        let geometry = mesh(vertices, vec![[0, 1, 2], [3, 4, 5]]);
        let own = geometry.meshes[0].corners(0).map(doubles);
        let (point, origin) = (DVec3::new(0.25, 0.25, 0.0), [0.25, 0.25, height]);
        let crevice = Crevice::new(&geometry, (point, origin), (own, DVec3::Z, 0), &[0, 1]);
        let crevice = crevice.unwrap();
        assert!(crevice.is_clear && crevice.origin[2] > 0.0, "{share}");
        assert_eq!(crevice.origin == origin, is_kept, "{share}");
    }
}

#[test]
fn points_around_a_point_are_up_to_two_steps_away_along_each_axis() {
    let points: Vec<_> = around(DVec3::new(1.0 + 1e-9, -4.0, 0.0)).collect();
    let steps = [f32::EPSILON, 4.0 * f32::EPSILON, f32::MIN_POSITIVE];
    for k in -2..=2 {
        for j in -2..=2 {
            for i in -2..=2 {
                let [x, y, z] = [(i, steps[0]), (j, steps[1]), (k, steps[2])]
                    .map(|(n, step): (i32, f32)| n as f32 * step);
                assert!(points.contains(&[1.0 + x, y - 4.0, z]), "{i} {j} {k}");
            }
        }
    }
    assert_eq!(points.len(), 125);
}

#[test]
fn normals_are_across_both_edges() {
    let corners = [[1.0, -1.0, 3.0], [3.0, 0.5, 3.5], [0.5, 3.0, 2.5]];
    let geometry = mesh(corners.to_vec(), vec![[0, 1, 2]]);
    let [found] = triangles(&geometry, 0).collect::<Vec<_>>()[..] else { panic!() };
    let [a, b, c] = found.corners;
    assert_eq!((found.normal.dot(b - a), found.normal.dot(c - a)), (0.0, 0.0));
    assert_eq!(found.normal, DVec3::new(-2.75, 0.75, 8.75));
}

/// At the first corner, the ray is almost at its end. Weights are rounded there, too.
#[test]
fn edges_are_hit_up_to_the_rounding_next_to_the_first_corner() {
    let corners = [DVec3::ZERO, DVec3::X, DVec3::Y];
    let wall = Triangle { primitive: 0, corners, normal: DVec3::Z, second_half: false };
    for (off, expected) in [(0.5, true), (2.0, false)] {
        let point = DVec3::new(-off * EQUAL, 1e-10, 1e-10);
        assert_eq!(wall.meet(point, -DVec3::Z).is_some(), expected, "{off}");
    }
}
