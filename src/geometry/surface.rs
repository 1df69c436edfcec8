//! Turns hits into surface points: position, normal and a safe origin for secondary rays.
//!
//! Points are computed in f64 from the primitive itself, or with twice the bits where f64 has too
//! few digits. Then they are rounded to f32 once. The backend chooses the primitive, the half of a
//! quad and the root of a sphere. Its barycentrics count only for a ray in the triangle's plane,
//! its t only if a sphere has no root near it.

use glam::DVec3;

use super::ahead::is_after_start;
use super::doubles::doubles;
use super::gather::gather;
use super::passing::passing;
use super::primitives::{Geometry, GeometryKind};
use super::sphere::Sphere;
use super::triangle::{TrianglePoint, refine_triangle, sharpen_triangle};
use crate::ray::{LANES, Mask, NONE, RayPacket};

/// 16 surface points, relative to the scene's origin.
#[derive(Debug, Clone)]
#[repr(C, align(64))]
pub struct Surfaces {
    /// Position, rounded to nearest: within half an ulp per coordinate of the position in f64.
    pub position: [[f32; LANES]; 3],
    /// Position rounded away from the surface, to the side of the incoming ray: the origin of
    /// secondary rays. Per coordinate it is less than an ulp from the position in f64, near zero
    /// [`f32::MIN_POSITIVE`] at most. Never behind the tangent plane there. Near an inner edge the
    /// integrator replaces it by [`Crevice::origin`](super::Crevice::origin).
    pub outside: [[f32; LANES]; 3],
    /// Ray parameter of the hit, in units of the ray's direction; rounded once from f64.
    pub t: [f32; LANES],
    /// Unit geometric normal, on the side of the incoming ray.
    pub ng: [[f32; LANES]; 3],
    /// Barycentric weight of the second corner (of a quad's half), in [0, 1]. Kept in f64, because
    /// texture coordinates are computed from it.
    pub u: [f64; LANES],
    /// Barycentric weight of the third corner, in [0, 1].
    pub v: [f64; LANES],
    /// Scene-wide index of the primitive, by lane.
    pub primitive: [u32; LANES],
    /// Lanes that hit anything.
    pub hit: Mask,
    /// Hits of triangles and quads so close to an edge that a secondary ray may slip past the
    /// neighbour: see [`Crevice`](super::Crevice).
    pub at_edge: Mask,
    /// Hits of triangles and quads that are false or too imprecise. The nearest hit of these lanes
    /// must be found again. A hit that f64 does not confirm is doubtful if one of these holds:
    /// - The ray's distance from the triangle, or the error of the reported t, exceeds the error of
    ///   an f32 test ([`passing`]).
    /// - The hit does not lie after the ray's start ([`is_after_start`]).
    /// - The reported t is off by more than 2^-12 of t, so another hit may be nearer.
    /// - The triangle lies behind the primitive that the ray leaves
    ///   ([`Geometry::is_behind_leaving`]).
    pub doubtful: Mask,
}

impl Surfaces {
    /// No lane has a surface point.
    pub const EMPTY: Self = Self {
        position: [[0.0; LANES]; 3],
        outside: [[0.0; LANES]; 3],
        t: [0.0; LANES],
        ng: [[0.0; LANES]; 3],
        u: [0.0; LANES],
        v: [0.0; LANES],
        primitive: [NONE; LANES],
        hit: Mask::NONE,
        at_edge: Mask::NONE,
        doubtful: Mask::NONE,
    };

    /// Barycentric weights of lane `i`, each in [0, 1]. The lane must have hit a triangle or the
    /// half of a quad.
    #[inline(always)]
    pub fn weights(&self, i: usize) -> [f64; 3] {
        [(1.0 - self.u[i] - self.v[i]).max(0.0), self.u[i], self.v[i]]
    }
}

/// Computes the surface points of the lanes in `hit`, from a traced packet.
#[inline(always)]
pub fn refine(geometry: &Geometry, hit: &Mask, packet: &RayPacket, out: &mut Surfaces) {
    out.hit = *hit;
    let mut corners = [[[0.0f32; LANES]; 3]; 3];
    let mut weights = [packet.hits.u, packet.hits.v];
    let spheres =
        gather(geometry, &out.hit, packet, &mut corners, &mut weights, &mut out.primitive);
    let (mut unsure, mut coarse) = (Mask::NONE, Mask::NONE);
    for i in 0..LANES {
        let (origin, direction) = ray(packet, i);
        let triangle = [dvec(&corners[0], i), dvec(&corners[1], i), dvec(&corners[2], i)];
        let weights = (f64::from(weights[0][i]), f64::from(weights[1][i]));
        let point = refine_triangle(triangle, origin, direction, weights);
        let sure = put(out, i, &point, packet.rays.tfar[i], direction);
        let planar = out.hit.0[i] & !spheres.0[i];
        unsure.0[i] = planar & -i32::from(!sure);
        coarse.0[i] = planar & -i32::from(!point.sharp);
        out.at_edge.0[i] = planar & -i32::from(point.at_edge);
    }
    out.doubtful = Mask::NONE;
    if coarse.any() {
        sharpen(&coarse, &corners, &weights, packet, &mut unsure, out);
    }
    if unsure.any() {
        doubt(geometry, &unsure, &corners, packet, out);
    }
    if spheres.any() {
        refine_spheres(geometry, &spheres, packet, out);
    }
}

/// Corners of the triangle (or half of a quad) that lane `i` hit, and the barycentrics that the
/// backend reported. `None` for a sphere.
pub(super) fn hit_corners(
    geometry: &Geometry,
    packet: &RayPacket,
    i: usize,
) -> Option<([DVec3; 3], (f64, f64))> {
    let (geom, prim) = (packet.hits.geom[i], packet.hits.prim[i]);
    let (u, v) = (packet.hits.u[i], packet.hits.v[i]);
    let (corners, u, v) = match geometry.kind(geom) {
        GeometryKind::Mesh(mesh) => (geometry.meshes[mesh].corners(prim), u, v),
        GeometryKind::Quads => geometry.quad_half(prim, u, v),
        GeometryKind::Instance(index) => (geometry.instance_corners(index, prim), u, v),
        GeometryKind::Spheres => return None,
    };
    let corners = corners.map(doubles);
    Some((corners, (f64::from(u), f64::from(v))))
}

/// Triangle (or half of a quad) that lane `i` hit, and the refined point on it in f64. `None` for a
/// sphere.
pub fn hit_triangle(
    geometry: &Geometry,
    packet: &RayPacket,
    i: usize,
) -> Option<([DVec3; 3], TrianglePoint)> {
    let (corners, reported) = hit_corners(geometry, packet, i)?;
    let (origin, direction) = ray(packet, i);
    let point = refine_triangle(corners, origin, direction, reported);
    let point =
        if point.sharp { point } else { sharpen_triangle(corners, origin, direction, reported) };
    Some((corners, point))
}

/// Largest relative difference between the reported t and f64's t that needs no closer look.
const T_SLACK: f64 = 1.0 / (1u64 << 20) as f64;

/// A reported t with a larger relative error does not tell which hit is nearest.
const T_COARSE: f64 = 1.0 / (1u64 << 12) as f64;

/// Stores the point of a triangle in lane `i`. `reported` is the backend's t. Returns true if the
/// hit is beyond doubt.
#[inline(always)]
fn put(
    out: &mut Surfaces,
    i: usize,
    point: &TrianglePoint,
    reported: f32,
    direction: DVec3,
) -> bool {
    out.u[i] = point.u;
    out.v[i] = point.v;
    out.t[i] = point.t as f32;
    store(out, i, point.position, point.normal, direction);
    let off = (point.t - f64::from(reported)).abs();
    // For t <= 0 the comparison is false: a hit at or before the ray's start is always in doubt.
    point.met & (off < point.t * T_SLACK)
}

/// Recomputes the points of the lanes where f64 has too few digits.
#[cold]
#[inline(never)]
fn sharpen(
    coarse: &Mask,
    corners: &[[[f32; LANES]; 3]; 3],
    weights: &[[f32; LANES]; 2],
    packet: &RayPacket,
    unsure: &mut Mask,
    out: &mut Surfaces,
) {
    for i in (0..LANES).filter(|&i| coarse.0[i] != 0) {
        let (origin, direction) = ray(packet, i);
        let triangle = [dvec(&corners[0], i), dvec(&corners[1], i), dvec(&corners[2], i)];
        let weights = (f64::from(weights[0][i]), f64::from(weights[1][i]));
        let point = sharpen_triangle(triangle, origin, direction, weights);
        let sure = put(out, i, &point, packet.rays.tfar[i], direction);
        unsure.0[i] = -i32::from(!sure);
    }
}

/// Marks the doubtful hits ([`Surfaces::doubtful`]) among those that [`put`] does not confirm. At
/// an edge, f32 and f64 may see a ray on different sides; at a small angle, the reported t is
/// imprecise.
#[cold]
#[inline(never)]
fn doubt(
    geometry: &Geometry,
    unsure: &Mask,
    corners: &[[[f32; LANES]; 3]; 3],
    packet: &RayPacket,
    out: &mut Surfaces,
) {
    for i in (0..LANES).filter(|&i| unsure.0[i] != 0) {
        let (origin, direction) = ray(packet, i);
        let triangle = [dvec(&corners[0], i), dvec(&corners[1], i), dvec(&corners[2], i)];
        let reported = f64::from(packet.rays.tfar[i]);
        let passing = passing(triangle, origin, direction);
        let leaving = packet.rays.leaving[i];
        let passing = passing
            .filter(|passing| passing.explains(reported))
            .filter(|passing| is_after_start(triangle, origin, direction, passing.t))
            // If the reported t is far from f64's t, something else may be nearer.
            .filter(|passing| (passing.t - reported).abs() <= passing.t.abs() * T_COARSE)
            .filter(|_| !geometry.is_behind_leaving(leaving, origin, direction, triangle));
        match passing {
            Some(passing) => out.t[i] = passing.t as f32,
            None => out.doubtful.0[i] = -1,
        }
    }
}

#[inline(never)]
fn refine_spheres(geometry: &Geometry, lanes: &Mask, packet: &RayPacket, out: &mut Surfaces) {
    for i in (0..LANES).filter(|&i| lanes.0[i] != 0) {
        let sphere = geometry.spheres[packet.hits.prim[i] as usize];
        let (t, normal) = on_sphere(&sphere, packet, i);
        let (_, direction) = ray(packet, i);
        out.t[i] = t as f32;
        store(out, i, sphere.center + normal * sphere.radius, normal, direction);
    }
}

/// Ray parameter and outward normal where lane `i` hits its sphere.
pub(super) fn on_sphere(sphere: &Sphere, packet: &RayPacket, i: usize) -> (f64, DVec3) {
    let (origin, direction) = ray(packet, i);
    // The reported t selects one of the two roots, which is computed again. If no root is that
    // near, the reported t stays; the point is then projected to the sphere along its radius.
    let reported = f64::from(packet.rays.tfar[i]);
    let slack = reported.abs() * 1e-6;
    let root = sphere.intersect(origin, direction, reported - slack, reported + slack, false);
    let t = if root.is_nan() { reported } else { root };
    let near = origin + direction * t;
    (t, (near - sphere.center).normalize_or(DVec3::Z))
}

#[inline(always)]
pub(super) fn ray(packet: &RayPacket, i: usize) -> (DVec3, DVec3) {
    (dvec(&packet.rays.org, i), dvec(&packet.rays.dir, i))
}

#[inline(always)]
fn dvec(v: &[[f32; LANES]; 3], i: usize) -> DVec3 {
    DVec3::new(f64::from(v[0][i]), f64::from(v[1][i]), f64::from(v[2][i]))
}

/// Rounds a point and its unit normal into lane `i`. The normal is turned against `direction`.
#[inline(always)]
fn store(out: &mut Surfaces, i: usize, position: DVec3, normal: DVec3, direction: DVec3) {
    let turn = if normal.dot(direction) > 0.0 { -1.0 } else { 1.0 };
    let (p, n) = (position.to_array(), (normal * turn).to_array());
    for axis in 0..3 {
        let rounded = p[axis] as f32;
        out.position[axis][i] = rounded;
        out.outside[axis][i] = round_towards(p[axis], rounded, n[axis]);
        out.ng[axis][i] = n[axis] as f32;
    }
}

/// Returns `rounded`, or its neighbour if `rounded` lies on the wrong side of `exact`. The result
/// minus `exact` is zero or has the sign of `towards`. So the sum over three axes, the dot product
/// with the normal, is never negative.
#[inline(always)]
pub fn round_towards(exact: f64, rounded: f32, towards: f64) -> f32 {
    let wrong = (f64::from(rounded) - exact) * towards < 0.0;
    let step = if (rounded > 0.0) == (towards > 0.0) { 1 } else { -1 };
    let next = f32::from_bits((rounded.to_bits() as i32).wrapping_add(step) as u32);
    // The neighbours of zero are denormal; the smallest normal number serves as well.
    let next = if rounded == 0.0 { f32::MIN_POSITIVE.copysign(towards as f32) } else { next };
    if wrong { next } else { rounded }
}

#[cfg(test)]
mod tests {
    use super::super::mesh::TriangleMesh;
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn rounding_never_goes_behind_the_plane(
            p in prop::array::uniform3(-1e6f64..1e6), n in prop::array::uniform3(-1f64..1.0),
        ) {
            let mut above = 0.0;
            for axis in 0..3 {
                let rounded = p[axis] as f32;
                let safe = round_towards(p[axis], rounded, n[axis]);
                prop_assert!((f64::from(safe) - p[axis]).abs() <= 1.5 * f64::from(rounded.abs() * f32::EPSILON) + 1e-37);
                above += (f64::from(safe) - p[axis]) * n[axis];
            }
            prop_assert!(above >= 0.0);
        }
    }

    #[test]
    fn a_number_on_the_right_side_stays() {
        for towards in [-0.5, 0.0, 0.5] {
            assert_eq!(round_towards(1.0, 1.0, towards), 1.0);
        }
        // Both are rounded away from zero. Without a component of the normal no side is wrong.
        for exact in [1.0 / 3.0, -1.0 / 3.0] {
            let rounded = exact as f32;
            assert_eq!(round_towards(exact, rounded, 0.0), rounded);
            assert_eq!(round_towards(exact, rounded, exact), rounded);
            assert!(round_towards(exact, rounded, -exact).abs() < rounded.abs());
        }
    }

    /// All rays on one quad take a special path in `gather`; a single ray does not.
    #[test]
    fn a_packet_on_one_quad_equals_its_single_rays() {
        let quads = vec![
            [[9.0, 9.0, 9.0], [8.0, 9.0, 9.0], [8.0, 8.0, 9.0], [9.0, 8.0, 9.0]],
            [[0.0, 0.0, 1.0], [1.0, 0.0, 1.5], [1.0, 1.0, 1.5], [0.0, 1.0, 1.0]],
        ];
        let geometry = Geometry::new(DVec3::ZERO, Vec::new(), quads, Vec::new()).unwrap();
        let mut packet = RayPacket::EMPTY;
        for i in 0..LANES {
            let (u, v) = ((i % 4) as f32 * 0.3 + 0.05, (i / 4) as f32 * 0.3 + 0.05);
            (packet.rays.org[0][i], packet.rays.org[1][i]) = (u - 0.25, v);
            (packet.rays.dir[0][i], packet.rays.dir[2][i]) = (0.25, 1.0 + 0.5 * u);
            (packet.hits.u[i], packet.hits.v[i]) = (u, v);
            (packet.hits.geom[i], packet.hits.prim[i]) = (geometry.quads_id(), 1);
            packet.rays.tfar[i] = 1.0;
        }
        let (mut together, mut alone) = (Surfaces::EMPTY, Surfaces::EMPTY);
        refine(&geometry, &Mask::ALL, &packet, &mut together);
        for i in 0..LANES {
            let mut one = Mask::NONE;
            one.0[i] = -1;
            refine(&geometry, &one, &packet, &mut alone);
            let point = |s: &Surfaces| {
                let vectors = [&s.position, &s.outside, &s.ng];
                let scalars = [f64::from(s.t[i]), s.u[i], s.v[i]].map(f64::to_bits);
                (
                    vectors.map(|v| [0, 1, 2].map(|axis| v[axis][i].to_bits())),
                    scalars,
                    s.primitive[i],
                )
            };
            assert_eq!(point(&together), point(&alone));
            assert!(together.hit.0[i] != 0 && together.doubtful.0[i] == 0);
            let x = f64::from(packet.hits.u[i]);
            assert!((f64::from(together.position[0][i]) - x).abs() < 1e-6);
        }
        let first = (0..LANES).filter(|&i| packet.hits.u[i] + packet.hits.v[i] <= 1.0).count();
        assert!((4..=12).contains(&first), "both halves are hit");
    }

    /// The triangles that the tests below hit: one in the plane z = 0, one far to the side, a steep
    /// one of slope 1000, and the needle of `triangle.rs`.
    fn triangles() -> TriangleMesh {
        let triangles: [[[f32; 3]; 3]; 4] = [
            [[0.0; 3], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]],
            [[9.0, 0.0, 0.0], [10.0, 0.0, 0.0], [9.0, 1.0, 0.0]],
            [[0.0; 3], [1.0, 0.0, 1000.0], [0.0, 1.0, 0.0]],
            [
                [3e-8, 1e-8, -2e-8],
                [67108864.0, 33554432.0, 16777216.0],
                [134217728.0, 67108864.0, 33554434.0],
            ],
        ];
        let indices = (0..4).map(|i| [3 * i, 3 * i + 1, 3 * i + 2]).collect();
        TriangleMesh::new(triangles.concat(), indices, false)
    }

    /// [`triangles`], a quad and a sphere of radius 2 around (0, 0, 10), behind an unused one.
    fn shapes() -> Geometry {
        let quad = [[0.0, 0.0, 1.0], [1.0, 0.0, 1.0], [1.0, 1.0, 1.0], [0.0, 1.0, 1.0]];
        let sphere = |radius| Sphere { center: DVec3::Z * 10.0, radius };
        let spheres = vec![sphere(1.0), sphere(2.0)];
        Geometry::new(DVec3::ZERO, vec![triangles()], vec![quad], spheres).unwrap()
    }

    /// Lets lane `i` hit primitive `prim` of geometry `geom` at `t`.
    fn aim(packet: &mut RayPacket, i: usize, [geom, prim]: [u32; 2], ray: [[f32; 3]; 2], t: f32) {
        packet.rays.set(i, ray[0].into(), ray[1].into());
        (packet.hits.geom[i], packet.hits.prim[i], packet.rays.tfar[i]) = (geom, prim, t);
    }

    fn refined(packet: &RayPacket) -> Surfaces {
        let mut points = Surfaces::EMPTY;
        refine(&shapes(), &packet.hit(&Mask::ALL), packet, &mut points);
        points
    }

    const DOWN: [f32; 3] = [0.0, 0.0, -1.0];

    #[test]
    fn weights_have_the_sum_one_and_none_is_negative() {
        let mut points = Surfaces::EMPTY;
        (points.u[3], points.v[3]) = (0.25, 0.5);
        assert_eq!(points.weights(3), [0.25, 0.25, 0.5]);
        (points.u[3], points.v[3]) = (0.75, 0.5);
        assert_eq!(points.weights(3), [0.0, 0.75, 0.5]);
    }

    #[test]
    fn only_hits_of_triangles_near_an_edge_are_at_an_edge() {
        let mut packet = RayPacket::EMPTY;
        aim(&mut packet, 2, [0, 0], [[0.25, 0.25, 1.0], DOWN], 1.0);
        aim(&mut packet, 5, [0, 0], [[0.25, 0.0, 1.0], DOWN], 1.0);
        aim(&mut packet, 6, [2, 1], [[0.0, 0.0, 20.0], DOWN], 8.0);
        aim(&mut packet, 9, [1, 0], [[0.5, 0.5, 2.0], DOWN], 1.0);
        let points = refined(&packet);
        let lanes = |set: &[usize]| Mask(std::array::from_fn(|i| -i32::from(set.contains(&i))));
        assert_eq!(points.hit, lanes(&[2, 5, 6, 9]));
        // The diagonal of the quad is an edge of its halves.
        assert_eq!(points.at_edge, lanes(&[5, 9]));
        assert_eq!(points.doubtful, Mask::NONE);
    }

    #[test]
    fn a_triangle_that_the_ray_misses_or_starts_on_is_doubtful() {
        let mut packet = RayPacket::EMPTY;
        aim(&mut packet, 1, [0, 1], [[0.25, 0.25, 1.0], DOWN], 1.0);
        aim(&mut packet, 2, [0, 0], [[0.25, 0.25, 1.0], DOWN], 1.0);
        aim(&mut packet, 3, [0, 0], [[0.25, 0.25, 0.0], DOWN], 0.0);
        let doubtful = refined(&packet).doubtful.0;
        assert_eq!([doubtful[1], doubtful[2], doubtful[3]], [-1, 0, -1]);
    }

    /// The slope lets a test in f32 err by 2.9, so only the limit of t itself counts.
    #[test]
    fn a_reported_t_that_is_far_off_is_doubtful() {
        let exact = 2000.0 - 250.0;
        let limit = exact * T_COARSE as f32;
        for (share, doubtful) in [(-1.1, -1), (-0.9, 0), (0.9, 0), (1.1, -1)] {
            let mut packet = RayPacket::EMPTY;
            let reported = exact + share * limit;
            aim(&mut packet, 7, [0, 2], [[0.25, 0.25, 2000.0], DOWN], reported);
            let points = refined(&packet);
            assert_eq!((points.doubtful.0[7], points.t[7]), (doubtful, exact), "{share}");
        }
        assert_eq!(T_COARSE, 2f64.powi(-12));
    }

    #[test]
    fn a_hit_is_sure_if_f64_confirms_it() {
        let point = |t, met| TrianglePoint {
            position: DVec3::ZERO,
            normal: DVec3::Z,
            u: 0.25,
            v: 0.5,
            t,
            met,
            sharp: true,
            at_edge: false,
        };
        let mut points = Surfaces::EMPTY;
        let mut sure = |t, met, reported| put(&mut points, 4, &point(t, met), reported, DVec3::Z);
        // The limit is 2^-17 at t = 8.
        let ulp = 2f32.powi(-20);
        for side in [1.0, -1.0] {
            assert!(sure(8.0, true, 8.0 + side * 7.0 * ulp));
            assert!(!sure(8.0, false, 8.0 + side * 7.0 * ulp));
            assert!(!sure(8.0, true, 8.0 + side * 8.0 * ulp));
            assert!(!sure(8.0, true, 8.0 + side * 9.0 * ulp));
        }
        assert!(!sure(0.0, true, 0.0) && !sure(-8.0, true, -8.0) && !sure(-8.0, false, 8.0));
        assert_eq!((points.t[4], points.u[4], points.v[4]), (-8.0, 0.25, 0.5));
    }

    /// The ray passes through the second corner at t = 2^26. f64 has too few digits for that.
    #[test]
    fn needles_are_refined_and_doubted_with_twice_the_bits() {
        let (origin, t) = ([0.0, 1048576.0, 4194304.0], 67108864.0);
        let ray = [origin, [1.0, 0.484375, 0.1875]];
        let mut packet = RayPacket::EMPTY;
        aim(&mut packet, 3, [0, 3], ray, t);
        aim(&mut packet, 4, [0, 3], ray, 0.5 * t);
        aim(&mut packet, 5, [0, 0], [[0.25, 0.25, 1.0], DOWN], 1.0);
        let points = refined(&packet);
        for i in [3, 4] {
            assert!((points.u[i] - 1.0).abs() < 1e-12 && points.v[i].abs() < 1e-12);
            assert_eq!(points.t[i], t);
        }
        assert_eq!([3, 4, 5].map(|i| points.doubtful.0[i]), [0, -1, 0]);
        let (corners, point) = hit_triangle(&shapes(), &packet, 3).unwrap();
        assert_eq!(corners, triangles().corners(3).map(doubles));
        assert_eq!((point.u, point.v), (points.u[3], points.v[3]));
    }

    #[test]
    fn the_reported_t_selects_the_root_of_a_sphere() {
        let mut packet = RayPacket::EMPTY;
        let mut found = |t: f32| {
            aim(&mut packet, 6, [2, 1], [[0.0; 3], [0.0, 0.0, 2.0]], t);
            let points = refined(&packet);
            (points.t[6], points.position[2][6])
        };
        for slack in [-5e-7, 5e-7] {
            assert_eq!(found(4.0 * (1.0 + slack)), (4.0, 8.0));
            assert_eq!(found(6.0 * (1.0 + slack)), (6.0, 12.0));
        }
        // No root is near: the reported t stays, and the point moves along the radius.
        for t in [4.0 * (1.0 - 3e-6), 4.0 * (1.0 + 3e-6), 4.5] {
            assert_eq!(found(t), (t, 8.0));
        }
        aim(&mut packet, 6, [2, 1], [[1.5, 0.0, 2.0], [0.0, 0.0, 2.0]], 3.0);
        let (t, normal) = on_sphere(&shapes().spheres[1], &packet, 6);
        assert!(t == 3.0 && normal.distance(DVec3::new(0.6, 0.0, -0.8)) < 1e-12, "{normal}");
    }
}
