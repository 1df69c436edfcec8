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
const BESIDE_THE_BOX: [NarrowCase; 4] = [
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

#[test]
fn a_hit_beside_the_box_of_a_narrow_triangle_moves_into_the_triangle() {
    in_all_turns(BESIDE_THE_BOX, |ray, triangle, corners| {
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

/// Seen from either side, also beyond the range of f32.
#[test]
fn weights_are_the_shares_of_the_edge_functions() {
    for scale in [1.0, -1.0, 1e60, -1e-60] {
        assert_eq!(weights_of([1.0, 2.0, 5.0].map(|x| x * scale)), [0.25, 0.625], "{scale:e}");
    }
}

#[test]
fn a_ray_that_starts_on_the_triangle_does_not_hit_it_there() {
    let corners = SLOPING.map(|v| turned(v, 0));
    for (depth, expected) in [(4.0, true), (5.0, false), (6.0, false)] {
        let is_after = |ray: &Ray64, _: &ShearedTriangle, _| {
            ray.hit_is_after_start(5.0 - f64::from(depth), corners)
        };
        let is_after = shear(corners, [1.0, 2.0, depth], [0.0, 0.0, 1.0], is_after);
        assert_eq!(is_after, expected, "{depth}");
    }
}

/// The corners of a triangle whose edges have different lengths, and are parallel to no axis.
const SLANTED: [[f32; 3]; 3] = [[1.0, -1.0, 3.0], [3.0, 0.5, 3.5], [0.5, 3.0, 2.5]];

#[test]
fn products_with_the_edges_are_weights() {
    for turn in 0..6 {
        let plane = TrianglePlane::new(SLANTED.map(|v| turned(v, turn)));
        let [e1, e2] = plane.edges;
        let products = plane.weights().map(|w| [dot(w, e1), dot(w, e2), dot(w, plane.normal)]);
        for (product, expected) in
            products.as_flattened().iter().zip([1.0, 0.0, 0.0, 0.0, 1.0, 0.0])
        {
            assert!((product - expected).abs() < 1e-14, "{turn}: {products:?}");
        }
    }
}

/// Places with weights on, beside and beyond the triangle, some of them above its plane.
#[test]
fn a_place_is_near_if_it_is_near_the_point_of_its_clamped_weights() {
    let weights = [-0.5, 0.0, 0.25, 0.75, 1.0, 1.5];
    let places = weights.into_iter().flat_map(|v| weights.map(|w| (v, w)));
    for ((v, w), turn) in places.flat_map(|place| (0..6).map(move |turn| (place, turn))) {
        let plane = TrianglePlane::new(SLANTED.map(|v| turned(v, turn)));
        let ([e1, e2], n) = (plane.edges, plane.normal);
        let (on_v, on_w) = (f64::max(v, 0.0), f64::max(w, 0.0));
        let sum = f64::max(on_v + on_w, 1.0);
        for height in [0.0, 0.125, -2.0] {
            let at = |v: f64, w: f64, k: usize| plane.point[k] + v * e1[k] + w * e2[k];
            let place = [0, 1, 2].map(|k| at(v, w, k) + height * n[k]);
            let off = [0, 1, 2].map(|k| (place[k] - at(on_v / sum, on_w / sum, k)).abs());
            let farthest = off.into_iter().fold(0.0, f64::max);
            let (direction, t) = ([0.25, -0.5, 2.0], 3.0);
            let origin = [0, 1, 2].map(|k| place[k] - t * direction[k]);
            let is_near =
                |t, slack| plane.is_near(&plane.weights(), (origin, direction), (t, slack));
            assert!(is_near(t, 1.001 * farthest + 1e-12), "{v} {w} {height} {turn}");
            assert!(!is_near(t, 0.999 * farthest - 1e-12), "{v} {w} {height} {turn}");
            assert!(!is_near(f64::NAN, 100.0));
        }
    }
}

/// The edge functions are 1, 2 and 5, or have the same ratios.
#[test]
fn a_depth_is_near_where_the_line_passes_through_the_triangle() {
    let near = |edges, depths, depth| ShearedTriangle { edges, depths }.passes_near(depth);
    for (depths, passing, reach) in [
        ([3.0, 5.0, 11.0], 8.5, 11.0),
        ([-3.0, -5.0, -11.0], -8.5, 11.0),
        ([-1.0, 5.0, 11.0], 8.0, 11.0),
        ([1.0, -5.0, -11.0], -8.0, 11.0),
    ] {
        let slack = 0.5 * BOX_SLACK * reach;
        for edges in [1.0, -1.0, 1e9].map(|scale| [1.0, 2.0, 5.0].map(|x| x * scale)) {
            for slack in [slack, -slack] {
                assert!(near(edges, depths, passing + 0.99 * slack), "{edges:?} {depths:?}");
                assert!(!near(edges, depths, passing + 1.01 * slack), "{edges:?} {depths:?}");
            }
        }
    }
}

/// The edges have the lengths 8 and 2.
#[test]
fn no_hit_on_a_triangle_that_is_too_thin_is_steep() {
    for unit in [1.0, 1024.0, 1.0 / 1024.0] {
        for (share, is_thin) in [(0.0, true), (0.99, true), (1.01, false), (4.0, false)] {
            let corners = [[0.0; 3], [8.0, 0.0, 0.0], [2.0, 2.0 * share * THIN as f32, 0.0]];
            let l1 = TrianglePlane::new(corners.map(|v| v.map(|x| x * unit))).normal_l1();
            assert_eq!(l1.is_infinite(), is_thin, "{unit} {share}");
        }
    }
}

/// Powers of two, which round nothing. `|n|` is about 1e-3 for triangles of unit size.
#[test]
fn t_scales_with_the_triangle_and_the_direction() {
    in_all_turns(BESIDE_THE_BOX, |ray, triangle, corners| {
        let t = triangle.t(ray, corners);
        let direction = ray.direction.map(|x| x as f32);
        for (unit, length) in [(0, 70), (40, 70), (0, -40), (-20, 0)] {
            let (unit, length) = (2f32.powi(unit), 2f32.powi(length));
            let corners = corners.map(|v| v.map(|x| x * unit));
            let direction = direction.map(|x| x * length);
            let scaled = shear(corners, [0.0; 3], direction, |r, t, _| t.t(r, corners));
            assert_eq!(scaled * f64::from(length), t * f64::from(unit), "{unit} {length}");
        }
    });
}

/// The plane's t is near the triangle, outside the depths of the corners by a few roundings.
#[test]
fn a_hit_near_the_triangle_moves_only_to_the_depths_of_the_corners() {
    let cases: [NarrowCase; 2] = [
        (
            [
                [3.615635, 3.643195, 6.371281],
                [3.6154766, 3.6432717, 6.3712816],
                [3.6150017, 3.6434932, 6.371272],
            ],
            [0.56746435, 0.57182723, 1.0],
        ),
        (
            [
                [-6.8520417, -5.918576, 0.41619557],
                [-6.8521104, -5.918644, 0.41616467],
                [-6.85203, -5.9185433, 0.4162844],
            ],
            [-1.0, -0.86376685, 0.06074583],
        ),
    ];
    for (corners, direction) in cases {
        shear(corners, [0.0; 3], direction, |ray, triangle, _| {
            assert!(triangle.inside());
            let (low, high) = triangle.depth_range();
            let plane = TrianglePlane::new(corners).intersect(ray.origin, ray.direction).0;
            let depth = plane * ray.dominant_component;
            let slack = depth * DEPTH_SLACK;
            let nearer = if depth + slack < low { low } else { high };
            assert!(nearer == low || depth - slack > high, "{depth} {low} {high}");
            assert_eq!(triangle.t(ray, corners) * ray.dominant_component, nearer, "{depth}");
        });
    }
}

#[test]
fn t_of_a_steep_ray_is_that_of_the_plane_if_it_is_beyond_the_corners_by_rounding() {
    let corners = [
        [8.276669, 3.358447, 1.7434754],
        [8.276668, 3.2467306, 1.7434753],
        [8.276669, 3.255501, 1.7434754],
    ];
    shear(corners, [0.0; 3], [1.0, 0.40013915, 0.21064942], |ray, triangle, _| {
        let plane = TrianglePlane::new(corners).intersect(ray.origin, ray.direction).0;
        assert!(triangle.inside() && plane > triangle.depth_range().1, "{plane}");
        assert_eq!(triangle.t(ray, corners), plane);
    });
}

/// The sheared triangle lies beside the box, much farther than rounding puts it.
#[test]
fn t_moves_into_the_box_even_if_the_line_passes_through_the_sheared_triangle_outside_of_it() {
    for (y, expected) in [([4.0, 4.25, 4.5], 4.5), ([4.9, 4.95, 5.0], 4.9)] {
        for (turn, length) in (0..6).flat_map(|turn| [1.0, 0.25].map(|l| (turn, l))) {
            let corners = [[4.0, y[0], 2.0], [5.0, y[1], 2.5], [4.5, y[2], 2.125]];
            let corners = corners.map(|v| turned(v, turn));
            let direction = turned([length, 0.9999 * length, 0.5 * length], turn);
            shear(corners, [0.0; 3], direction, |ray, _, _| {
                let sign = ray.dominant_component.signum() as f32;
                let depths = [4.4, 4.8, 5.2].map(|depth| sign * depth);
                let triangle = ShearedTriangle { edges: [1.0; 3], depths };
                let t = triangle.clamped(ray, 4.8 / f64::from(length), true, corners);
                let y = 0.9999f32 * length;
                let off = (t * f64::from(y) - expected).abs();
                assert!(off <= 1.001 * 5.0 * BOX_SLACK, "{turn}: {off:e}");
            });
        }
    }
}
