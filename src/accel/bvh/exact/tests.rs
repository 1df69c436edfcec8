//! Unit tests of the exact tests of triangles.

use super::super::bounds::Bounds3;
use super::super::query::Query;
use super::*;

/// Shears the triangle `corners` for a ray. Calls `look` with the ray, the sheared triangle and
/// its depths by [`depth_range`].
fn shear<T>(
    corners: [[f32; 3]; 3],
    origin: [f32; 3],
    direction: [f32; 3],
    look: impl FnOnce(&Ray64, &ShearedTriangle, (f32, f32)) -> T,
) -> T {
    let mut block = Block::EMPTY;
    let mut rays = Rays::EMPTY;
    for axis in 0..3 {
        for k in 0..3 {
            block.vertices[axis][k] = corners[k][axis];
            block.corners[k][0] = k as u8;
        }
        (rays.org[axis][0], rays.dir[axis][0]) = (origin[axis], direction[axis]);
    }
    let query = Query::new(&rays, &Bounds3::from_points(&corners));
    let lane = query.lane(0);
    let ray = Ray64::new(&rays, 0, lane.axes[2]);
    look(&ray, &ShearedTriangle::new(&lane, &block, 0), depth_range(&lane, &block, 0))
}

/// The axes in cyclic order, forwards and backwards.
fn turned(v: [f32; 3], turn: usize) -> [f32; 3] {
    let sign = if turn < 3 { 1.0 } else { -1.0 };
    [0, 1, 2].map(|k| sign * v[(k + turn) % 3])
}

const SLOPING: [[f32; 3]; 3] = [[0.0, 0.0, 4.0], [4.0, 0.0, 6.0], [0.0, 4.0, 5.0]];

#[test]
fn depths_are_those_of_the_corners_along_the_ray() {
    for turn in 0..6 {
        let corners = SLOPING.map(|v| turned(v, turn));
        let (from, to) = (turned([1.0, 1.0, 1.0], turn), turned([0.25, -0.5, 2.0], turn));
        let (depths, ahead) = shear(corners, from, to, |r, t, d| (d, t.is_ahead(r)));
        assert_eq!((depths, ahead), ((3.0, 5.0), true), "{turn}");
        let back = to.map(|d| -d);
        let (depths, ahead) = shear(corners, from, back, |r, t, d| (d, t.is_ahead(r)));
        assert_eq!((depths, ahead), ((-5.0, -3.0), false), "{turn}");
        // A corner at the depth of the origin is not ahead.
        for depth in [4.0, 6.0] {
            let from = turned([1.0, 1.0, depth], turn);
            assert!(!shear(corners, from, to, |r, t, _| t.is_ahead(r)), "{turn}");
            assert!(!shear(corners, from, back, |r, t, _| t.is_ahead(r)), "{turn}");
        }
    }
}

#[test]
fn a_line_without_area_or_beside_an_edge_is_not_inside() {
    let inside = |corners, x: f32, y: f32| {
        shear(corners, [x, y, 0.0], [0.0, 0.0, 1.0], |_, t, _| t.inside())
    };
    let [a, b, c] = SLOPING;
    for corners in [[a, b, c], [a, c, b]] {
        for (x, y) in [(1.0, 1.0), (0.0, 0.0), (4.0, 0.0), (0.0, 2.0), (2.0, 2.0)] {
            assert!(inside(corners, x, y), "{x} {y}");
        }
        for (x, y) in [(-1e-6, 1.0), (1.0, -1e-6), (2.0, 2.0001), (5.0, -1.0)] {
            assert!(!inside(corners, x, y), "{x} {y}");
        }
    }
    assert!(!inside([a, a, b], 0.0, 0.0) && !inside([a, a, a], 0.0, 0.0));
}

/// Hits at up to 16 and down to 2^-30 of the scene's extent, before and behind the origin.
#[test]
fn a_far_hit_is_after_the_start() {
    let mut far = [0; 2];
    for turn in 0..6 {
        for offset in [0.0f32, 100.0, 65536.0] {
            let scene = Bounds3::from_points(&[[-4.0; 3], [offset + 8.0; 3]]);
            for exponent in -30..5 {
                let distance = f64::from(exponent).exp2();
                let mut rays = Rays::EMPTY;
                let direction = turned([0.25, -0.5, 2.0], turn);
                for axis in 0..3 {
                    (rays.org[axis][0], rays.dir[axis][0]) = (offset, direction[axis]);
                }
                let query = Query::new(&rays, &scene);
                let lane = query.lane(0);
                let ray = Ray64::new(&rays, 0, lane.axes[2]);
                let corners = SLOPING.map(|v| turned(v, turn).map(|x| x + offset));
                for t in [distance, -distance] {
                    let is_far = ray.is_far(t, &lane);
                    assert!(!is_far || ray.hit_is_after_start(t, corners), "{turn} {t}");
                    far[usize::from(t < 0.0)] += usize::from(is_far);
                }
                // 2 t is the depth; the corners are at most offset + 12 from the origin.
                let beyond = 2.0 * distance > NEAR_START * f64::from(offset + 13.0);
                assert_eq!(ray.is_far(distance, &lane), beyond, "{turn} {offset} {distance}");
            }
        }
    }
    assert!(far[0] > 0 && far[1] == 0);
}

#[test]
fn t_of_a_steep_ray_is_that_of_the_plane() {
    for turn in 0..6 {
        for length in [1.0, 0.125, 8.0] {
            let corners = SLOPING.map(|v| turned(v, turn));
            let direction = turned([0.0, 0.0, length], turn);
            let t = |r: &Ray64, t: &ShearedTriangle, _| (t.inside(), t.t(r, corners));
            let (inside, t) = shear(corners, turned([1.0, 2.0, -1.0], turn), direction, t);
            assert_eq!((inside, t), (true, 6.0 / f64::from(length)), "{turn}");
        }
    }
}

/// The depths of the corners are rounded to f32. The plane's t is more exact, and stays.
#[test]
fn t_of_a_plane_across_the_ray_is_not_rounded_to_the_depths_of_the_corners() {
    let (mut up, mut down) = (0, 0);
    for step in 1..40u8 {
        let start = f32::from(step) / 41.0;
        let exact = 5.0 - f64::from(start);
        for (turn, length) in (0..6).flat_map(|turn| [1.0, 0.25, -4.0].map(|l| (turn, l))) {
            let corners = [[-1.0, -1.0, 5.0], [2.0, -1.0, 5.0], [0.0, 3.0, 5.0]];
            let corners = corners.map(|v| turned(v, turn));
            let (from, to) = (turned([0.0, 0.0, start], turn), turned([0.0, 0.0, length], turn));
            shear(corners, from, to, |ray, triangle, _| {
                let depth = triangle.t(ray, corners) * ray.dominant_component;
                assert_eq!(depth.abs(), exact, "{start} {turn} {length}");
                let (rounded, _) = triangle.depth_range();
                up += u32::from(rounded.abs() > exact);
                down += u32::from(rounded.abs() < exact);
            });
        }
    }
    assert!(up > 100 && down > 100, "{up} {down}");
}

/// Almost in the plane, rounding moves the plane's t far beyond the triangle. A far origin
/// makes the shear round. Every hit lies in the widened box, and near the depths of the
/// corners.
#[test]
fn hits_of_grazing_rays_lie_in_the_box_of_the_triangle() {
    let (mut hits, mut moved) = (0, 0);
    for i in 0..6000u32 {
        let noise = |k: u32| {
            let bits = (i * 16 + k).wrapping_mul(0x9e37_79b9);
            (bits ^ (bits >> 15)).wrapping_mul(0x85eb_ca6b) as f32 / 2f32.powi(31) - 1.0
        };
        let flat = 2f32.powi(-(i as i32 % 40));
        let turn = i as usize % 6;
        // All points lie near one plane, which is parallel to no axis.
        let near_plane = |x: f32, y: f32, k: u32| [x, y, 0.3 * x - 0.7 * y + flat * noise(k)];
        let corners = [0, 3, 6].map(|k| near_plane(noise(k), noise(k + 1), k + 2));
        let [a, b, c] = corners;
        let target: [f32; 3] = std::array::from_fn(|k| 0.25 * a[k] + 0.5 * b[k] + 0.25 * c[k]);
        let away = near_plane(7.3, noise(9) * 5.1, 10);
        let scale = if i % 3 == 0 { -3.0 } else { 0.75 };
        let origin = std::array::from_fn(|k| target[k] - away[k]);
        let direction = turned(away.map(|x| x * scale), turn);
        let (corners, origin) = (corners.map(|v| turned(v, turn)), turned(origin, turn));
        shear(corners, origin, direction, |ray, triangle, _| {
            if !triangle.inside() {
                return;
            }
            hits += 1;
            let t = triangle.t(ray, corners);
            let plane = TrianglePlane::new(corners);
            moved += u32::from(t != plane.intersect(ray.origin, ray.direction).0);
            let farthest = corners.iter().flatten().zip(origin.iter().cycle());
            let reach = farthest
                .fold(0.0, |far: f64, (v, o)| far.max((f64::from(*v) - f64::from(*o)).abs()));
            for axis in 0..3 {
                let of_corners = corners.map(|v| f64::from(v[axis]) - ray.origin[axis]);
                let low = of_corners.into_iter().fold(f64::INFINITY, f64::min);
                let high = of_corners.into_iter().fold(f64::NEG_INFINITY, f64::max);
                let (at, slack) = (t * ray.direction[axis], 1.001 * BOX_SLACK * reach);
                assert!(at >= low - slack && at <= high + slack, "{i}: {at} {low} {high}");
            }
            let (low, high) = triangle.depth_range();
            let depth = t * ray.dominant_component;
            let slack = 1.001 * DEPTH_SLACK * depth.abs();
            assert!(depth >= low - slack && depth <= high + slack, "{i}: {depth}");
        });
    }
    assert!(hits > 2000 && moved > 200, "{hits} {moved}");
}

/// A triangle and the direction of a ray from the origin.
type NarrowCase = ([[f32; 3]; 3], [f32; 3]);

/// Shears each triangle for its ray, turned in all ways, and calls `look` with the turned corners.
fn in_all_turns(
    cases: [NarrowCase; 4],
    mut look: impl FnMut(&Ray64, &ShearedTriangle, [[f32; 3]; 3]),
) {
    for ((corners, direction), turn) in
        cases.into_iter().flat_map(|case| (0..6).map(move |turn| (case, turn)))
    {
        let corners = corners.map(|v| turned(v, turn));
        shear(corners, [0.0; 3], turned(direction, turn), |ray, triangle, _| {
            look(ray, triangle, corners);
        });
    }
}

/// In the plane of a narrow triangle, the line crosses the box at a side. There, an error of t
/// leaves the box within the depths of the corners.
#[test]
fn a_hit_beside_the_box_of_a_narrow_triangle_moves_into_the_triangle() {
    let cases: [NarrowCase; 4] = [
        (
            [
                [3.6118023, 3.999046, 4.3324785],
                [3.9863052, 3.998962, 5.7323728],
                [3.8114007, 4.0003376, 5.0755134],
            ],
            [1.9, 2.0, 2.5168395],
        ),
        (
            [
                [3.6278367, 3.997651, 4.399482],
                [3.9653184, 3.9951446, 5.7962847],
                [3.836752, 4.002608, 5.2469926],
            ],
            [1.9, 2.0, 2.5512393],
        ),
        (
            [
                [3.7800047, 3.9989173, 3.378285],
                [4.133324, 3.9955413, 4.7748423],
                [3.9766667, 4.002107, 4.1410995],
            ],
            [0.99, 1.0001497, 1.02],
        ),
        (
            [
                [3.77913, 4.0000277, 3.3798304],
                [4.1403503, 3.9998364, 4.7796354],
                [3.991538, 4.000562, 4.2011333],
            ],
            [0.99, 1.0000485, 1.02],
        ),
    ];
    in_all_turns(cases, |ray, triangle, corners| {
        assert!(triangle.inside());
        let is_between = |t: f64| {
            let (low, high) = triangle.depth_range();
            let depth = t * ray.dominant_component;
            depth >= low && depth <= high
        };
        let is_in_box = |t: f64| {
            let reach =
                corners.iter().flatten().fold(0.0, |far: f64, &x| far.max(f64::from(x).abs()));
            let slack = 1.001 * BOX_SLACK * reach;
            (0..3).all(|axis| {
                let at = t * ray.direction[axis];
                let [a, b, c] = corners.map(|v| f64::from(v[axis]));
                at >= min3(a, b, c) - slack && at <= max3(a, b, c) + slack
            })
        };
        let (plane, _) = TrianglePlane::new(corners).intersect(ray.origin, ray.direction);
        assert!(is_between(plane) && !is_in_box(plane), "{plane}");
        let t = triangle.t(ray, corners);
        let [u, v, w] = triangle.edges;
        let [a, b, c] = triangle.depths.map(f64::from);
        assert!(is_between(t) && is_in_box(t), "{t} {plane}");
        // It moves to where the weights are.
        let passing = (u * a + v * b + w * c) / (u + v + w);
        assert!((t * ray.dominant_component - passing).abs() < 1e-14, "{t} {passing}");
    });
}

/// Across the ray, a narrow triangle has little depth. There, an error of t leaves the depths
/// of the corners within the widened box.
#[test]
fn a_hit_outside_the_depths_of_the_corners_moves_to_the_nearer_depth() {
    let cases: [NarrowCase; 4] = [
        (
            [
                [3.7719917, 3.3, 5.1989694],
                [3.8280046, 4.699996, 5.198964],
                [3.8012023, 4.029935, 5.1989756],
            ],
            [1.9, 2.0, 2.5994847],
        ),
        (
            [
                [3.5981324, 3.2999938, 5.139388],
                [4.0018554, 4.6999936, 5.139388],
                [3.8135977, 4.047138, 5.1394057],
            ],
            [1.9, 2.0, 2.569698],
        ),
        (
            [
                [3.7222822, 3.2999997, 5.0633807],
                [3.8777175, 4.7, 5.0633807],
                [3.8181462, 4.1634417, 5.063381],
            ],
            [1.9, 2.0, 2.5316906],
        ),
        (
            [
                [3.692786, 3.2999997, 5.009739],
                [3.907213, 4.7, 5.009739],
                [3.805248, 4.0342665, 5.0097394],
            ],
            [1.9, 2.0, 2.5048697],
        ),
    ];
    let (mut before, mut beyond) = (0, 0);
    in_all_turns(cases, |ray, triangle, corners| {
        assert!(triangle.inside());
        let (low, high) = triangle.depth_range();
        let (plane, _) = TrianglePlane::new(corners).intersect(ray.origin, ray.direction);
        let of_plane = plane * ray.dominant_component;
        let slack = of_plane.abs() * DEPTH_SLACK;
        let nearer = if of_plane + slack < low { low } else { high };
        assert!(nearer == low || of_plane - slack > high, "{of_plane} {low} {high}");
        let depth = triangle.t(ray, corners) * ray.dominant_component;
        assert!((depth - nearer).abs() < 1e-14, "{depth} {nearer} {of_plane}");
        before += u32::from(nearer == low);
        beyond += u32::from(nearer == high);
    });
    assert!(before > 0 && beyond > 0);
}

/// Almost in the plane: the plane's t decides.
#[test]
fn t_of_a_ray_almost_in_the_plane_lies_within_the_triangle() {
    let corners = [[4.0, -1.0, 0.0], [6.0, 1.0, 0.0], [5.0, 0.5, 1e-9]];
    for length in [1.0, 4.0] {
        let t = shear(corners, [0.0; 3], [length, 0.0, 0.0], |r, t, _| t.t(r, corners));
        assert!((4.0..=6.0).contains(&(t * f64::from(length))), "{t}");
    }
}

/// Exactly along the plane, t of the plane is no number, or infinite. The depth at which the
/// line passes through the sheared triangle decides.
///
/// The corners lie in the plane z = 7x. Rounding alone gives the sheared triangle an area: 1/7
/// is rounded, so corners at x = 3 and x = 6 move by -4e and -8e along x, with e = 2^-24. Those
/// at x = 1 and x = 2 do not move.
#[test]
fn t_of_a_ray_along_the_plane_is_where_the_line_passes_through_the_sheared_triangle() {
    let e = 0.5 * f32::EPSILON;
    let corner = |x: f32, y: f32| [x, y, 7.0 * x];
    // The line passes through the middle of the edge from x = 1 to x = 2.
    let on_edge = [corner(1.0, -1.0), corner(2.0, 1.0), corner(3.0, 0.5)];
    // Seen from the second origin, the corner at x = 1 moves by 2e. So the sheared corners are
    // (2e, 1), (-4e, -5) and (-8e, 2). The line passes through 8/11, 2/11 and 1/11 of them.
    let through = [corner(1.0, 1.0), corner(3.0, -5.0), corner(6.0, 2.0)];
    let cases = [
        (on_edge, 0.0, 1.5, f64::is_nan as fn(f64) -> bool),
        (through, -1.5 * e, 20.0 / 11.0, f64::is_infinite),
    ];
    for (corners, x, expected, is_unusable) in cases {
        for (turn, length) in (0..6).flat_map(|turn| [1.0, 0.25, -4.0].map(|l| (turn, l))) {
            let direction = turned([length, 0.0, 7.0 * length], turn);
            let origin = turned([x, 0.0, 0.0], turn);
            for order in [[0, 1, 2], [1, 2, 0], [2, 1, 0]] {
                let corners = order.map(|k: usize| turned(corners[k], turn));
                shear(corners, origin, direction, |ray, triangle, _| {
                    let plane = TrianglePlane::new(corners);
                    assert!(is_unusable(plane.intersect(ray.origin, ray.direction).0));
                    assert!(triangle.inside(), "{turn} {order:?}");
                    let x = triangle.t(ray, corners) * f64::from(length);
                    assert!((x - expected).abs() < 1e-14, "{turn} {order:?}: {x} {expected}");
                });
            }
        }
    }
}

#[test]
fn the_sum_of_the_normal_counts_every_axis() {
    let corners = [[0.0; 3], [1.0, 0.0, 2.0], [0.0, 1.0, -3.0]];
    let plane = TrianglePlane::new(corners);
    assert_eq!(plane.normal_l1(), 6.0);
    let reversed = TrianglePlane::new([corners[0], corners[2], corners[1]]);
    assert_eq!(reversed.normal_l1(), 6.0);
}
