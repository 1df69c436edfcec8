//! Finds the primitives that a ray passes so closely that a test in f32 may decide otherwise.
//!
//! The model is the watertight test of Woop et al. 2013. It shears the corners along the ray onto
//! the plane across the ray's dominant axis, in f32. Let A be a corner as seen from the ray's
//! origin, S the shear with |S_k| <= 1, and u = 2^-24. Each sheared coordinate has an error of at
//! most u(2|A_k| + 4|S_k||A_z|), which is less than 6u max|A|. So a corner moves within a square of
//! that half side. Distances here are therefore the larger of the two coordinates (maximum norm).

use glam::{DVec2, DVec3};

use super::blocks::{Blocks, ROUNDING};
use crate::accel::lane::LaneRay;
use crate::geometry::{Geometry, GeometryKind, Sphere};

/// 6u: error bound of a sheared corner, in units of its largest coordinate from the origin.
const SHEAR: f64 = 6.0 / (1u64 << 24) as f64;

/// A primitive that a ray hits or nearly hits.
#[derive(Debug, Clone)]
pub struct Near {
    /// Geometry id, as [`Geometry::place`] returns it.
    pub geom: u32,
    /// Index of the primitive within its geometry.
    pub prim: u32,
    /// Ray parameter where the ray hits the plane of the triangle, clamped to the range of its
    /// corners. On a sphere it is one of the two roots.
    pub t: f64,
    /// Bound on the distance between `t` and the t of a test whose corners have moved. Includes the
    /// rounding of t to f32.
    pub t_error: f64,
    /// The shape as the ray sees it.
    pub outline: Outline,
}

/// A shape in the plane across the ray's dominant axis. The ray is at the origin.
#[derive(Debug, Clone)]
pub enum Outline {
    /// A triangle, or one of the two triangles of a quad.
    Triangle {
        /// Its corners in space, to recognise edges that two triangles share.
        corners: [DVec3; 3],
        /// Its corners sheared onto the plane.
        sheared: [DVec2; 3],
        /// How far each sheared corner may move: its error bound times the caller's `factor`.
        tolerance: [f64; 3],
    },
    /// A sphere. True if the ray's line certainly hits it.
    Sphere(bool),
}

/// Returns the entries of [`super::Brute::near`] from the oracle's boxes.
pub(super) fn near(
    geometry: &Geometry,
    blocks: &Blocks,
    ray: &LaneRay,
    factor: f64,
    most: usize,
) -> Option<Vec<Near>> {
    let mut found = Vec::new();
    let all = [f64::NEG_INFINITY, f64::INFINITY];
    let plane = Plane::across(ray);
    // A corner that moves by the error bound stays in a box widened by that bound.
    blocks.each(ray, factor * SHEAR * 1.001 + ROUNDING, all, |primitive| {
        if found.len() <= most {
            add_near(geometry, ray, &plane, primitive, factor, &mut found);
        }
    });
    (found.len() <= most).then_some(found)
}

/// Returns the entries of [`super::Brute::near`] for one primitive, found without the oracle's
/// boxes.
pub fn near_primitive(
    geometry: &Geometry,
    ray: &LaneRay,
    geom: u32,
    prim: u32,
    factor: f64,
) -> Vec<Near> {
    let mut found = Vec::new();
    let primitive = geometry.primitive(geom, prim);
    add_near(geometry, ray, &Plane::across(ray), primitive, factor, &mut found);
    found
}

fn add_near(
    geometry: &Geometry,
    ray: &LaneRay,
    plane: &Plane,
    primitive: u32,
    factor: f64,
    found: &mut Vec<Near>,
) {
    let (geom, prim) = geometry.place(primitive);
    let leaving = primitive == ray.leaving;
    let mut add = |corners: [DVec3; 3]| {
        let at = triangle(ray, plane, corners, factor * SHEAR);
        found.extend(at.map(|(t, t_error, outline)| Near { geom, prim, t, t_error, outline }));
    };
    match geometry.kind(geom) {
        GeometryKind::Spheres => {
            let sphere = &geometry.spheres[prim as usize];
            roots(ray, sphere, leaving, |t, t_error, sure| {
                let outline = Outline::Sphere(sure);
                found.push(Near { geom, prim, t, t_error, outline });
            });
        }
        _ if leaving => {}
        _ => geometry.triangles(geom, prim).for_each(|(corners, _)| add(corners)),
    }
}

/// Returns four f32 ulp of `t`: more than rounding t to f32 can change.
fn ulps(t: f64) -> f64 {
    4.0 * f64::from(f32::EPSILON) * t.abs() + f64::from(f32::MIN_POSITIVE)
}

/// The plane across a ray's dominant axis.
struct Plane {
    /// The two axes of the plane, then the dominant one.
    axes: [usize; 3],
    /// Direction of the ray in the plane's axes, divided by its dominant coordinate.
    shear: DVec2,
}

impl Plane {
    fn across(ray: &LaneRay) -> Self {
        let d = ray.direction.to_array();
        let z = (0..3).max_by(|&a, &b| d[a].abs().total_cmp(&d[b].abs())).unwrap_or(2);
        let axes = [(z + 1) % 3, (z + 2) % 3, z];
        Self { axes, shear: DVec2::new(d[axes[0]], d[axes[1]]) / d[z] }
    }

    /// Permutes a vector into the order of `axes`.
    fn turn(&self, v: DVec3) -> DVec3 {
        DVec3::from(self.axes.map(|axis| v[axis]))
    }
}

/// Returns t, its error and the outline of a triangle, or `None` if the ray passes it by more than
/// `scale` times the corners' coordinates.
fn triangle(
    ray: &LaneRay,
    plane: &Plane,
    corners: [DVec3; 3],
    scale: f64,
) -> Option<(f64, f64, Outline)> {
    let seen = corners.map(|corner| plane.turn(corner - ray.origin));
    let sheared = seen.map(|a| a.truncate() - plane.shear * a.z);
    let tolerance = seen.map(|a| a.abs().max_element() * scale);
    let moves = tolerance[0].max(tolerance[1]).max(tolerance[2]);
    let least = sheared[0].min(sheared[1]).min(sheared[2]);
    let most = sheared[0].max(sheared[1]).max(sheared[2]);
    if least.max_element() > moves || most.min_element() < -moves {
        return None; // The bounding square alone is too far away. This is the common case.
    }
    let outside = !contains(&sheared);
    let edges = [(0, 1), (1, 2), (2, 0)];
    if outside && edges.iter().all(|&(i, j)| !(distance(sheared[i], sheared[j]) <= moves)) {
        return None;
    }
    let direction = plane.turn(ray.direction);
    let depths = seen.map(|a| a.z / direction.z);
    let low = depths[0].min(depths[1]).min(depths[2]);
    let high = depths[0].max(depths[1]).max(depths[2]);
    let normal = (seen[1] - seen[0]).cross(seen[2] - seen[0]);
    let facing = normal.dot(direction);
    let t = normal.dot(seen[0]) / facing;
    let t = if t.is_nan() { low } else { t.clamp(low, high) };
    // The plane's slope: if the plane moves by (x, y), t changes by n.(x, y, 0) / n.d.
    let slope = (normal.x.abs() + normal.y.abs()) / facing.abs();
    let slid = moves * slope;
    let t_error = if slid.is_nan() { high - low } else { slid.min(high - low) } + ulps(t);
    Some((t, t_error, Outline::Triangle { corners, sheared, tolerance }))
}

/// Returns whether the origin lies in the triangle, to f64 rounding.
///
/// The origin must lie in the bounding box too: all sides of a triangle seen edge-on are 0, even
/// for an origin beyond its ends.
fn contains(p: &[DVec2; 3]) -> bool {
    let (least, most) = (p[0].min(p[1]).min(p[2]), p[0].max(p[1]).max(p[2]));
    if least.max_element() > 0.0 || most.min_element() < 0.0 {
        return false;
    }
    let sides = [p[0].perp_dot(p[1]), p[1].perp_dot(p[2]), p[2].perp_dot(p[0])];
    sides.iter().all(|&side| side >= 0.0) || sides.iter().all(|&side| side <= 0.0)
}

/// Returns the distance from the origin to the segment `pq` in the maximum norm.
///
/// The norm is convex along the segment, and piecewise linear. The linear pieces end where the
/// coordinates have equal magnitude or one of them is zero. So the nearest point is one of these
/// points, or an end.
pub(super) fn distance(p: DVec2, q: DVec2) -> f64 {
    let along = q - p;
    let candidates = [
        (p.x - p.y, along.x - along.y),
        (p.x + p.y, along.x + along.y),
        (p.x, along.x),
        (p.y, along.y),
    ];
    let at = |s: f64| (p + along * s).abs().max_element();
    let ends = p.abs().max_element().min(q.abs().max_element());
    candidates
        .into_iter()
        .map(|(value, change)| -value / change)
        .filter(|s| (0.0..=1.0).contains(s))
        .fold(ends, |least, s| least.min(at(s)))
}

impl Outline {
    /// Returns the distance of the ray from edge `i`, minus how far the edge may move. Infinite for
    /// a sphere.
    ///
    /// Edge `i` joins corners `i` and `i + 1`, modulo 3.
    pub fn clearance(&self, i: usize) -> f64 {
        match self {
            Self::Triangle { sheared, tolerance, .. } => {
                let (i, j) = (i % 3, (i + 1) % 3);
                distance(sheared[i], sheared[j]) - tolerance[i].max(tolerance[j])
            }
            Self::Sphere(_) => f64::INFINITY,
        }
    }
}

/// Finds the roots of a sphere that the ray hits or nearly hits. Calls `found` with each t, its
/// error bound, and whether the hit is certain.
fn roots(ray: &LaneRay, sphere: &Sphere, leaving: bool, mut found: impl FnMut(f64, f64, bool)) {
    let LaneRay { origin, direction: d, .. } = *ray;
    let f = origin - sphere.center;
    let a = d.length_squared();
    let b = -f.dot(d);
    let r2 = sphere.radius * sphere.radius;
    let discriminant = r2 - (f + d * (b / a)).length_squared();
    // 64u (u = 2^-53) of the terms that are subtracted: several times their rounding.
    let error = 32.0 * f64::EPSILON * (f.length_squared() + r2);
    if leaving {
        let t = 2.0 * b / a;
        let t_error = 2.0 * (error / a).sqrt().min(error / b.abs()) + ulps(t);
        return found(t, t_error, t.abs() > t_error);
    }
    if discriminant < -error {
        return;
    }
    let half = (discriminant.max(0.0) / a).sqrt();
    // sqrt(x + e) - sqrt(x) is at most e / sqrt(x), and at most sqrt(e).
    let t_error = (error / a).sqrt().min(error / (a * half));
    for t in [b / a - half, b / a + half] {
        let rounding = ulps(t) + 4.0 * f64::EPSILON * (b / a).abs();
        found(t, t_error + rounding, discriminant > error);
    }
}
