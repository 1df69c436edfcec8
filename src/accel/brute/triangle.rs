//! The exact test of a ray against a triangle.

use std::cmp::Ordering::{self, Equal, Greater, Less};

use glam::DVec3;

use super::exact::{
    BoundedDeterminant, Fraction, Integers, determinant, difference, integers, sign,
};
use crate::accel::lane::LaneRay;

/// Largest relative error of [`ExactCrossing::t`]. Integers take over where f64 cannot guarantee
/// it.
const T_ERROR: f64 = 1.0 / (1u64 << 40) as f64;

/// Largest error of the barycentric weights. Integers take over where f64 cannot guarantee it.
const WEIGHT_ERROR: f64 = 1.0 / (1u64 << 30) as f64;

/// The point where a ray hits a triangle.
#[derive(Debug, Clone, Copy)]
pub struct ExactCrossing {
    /// Ray parameter, with a relative error of at most 2^-40.
    pub t: f64,
    /// Barycentric weight of the second corner.
    pub u: f64,
    /// Barycentric weight of the third corner.
    pub v: f64,
    /// Geometric normal `(v1 - v0) x (v2 - v0)`.
    pub ng: DVec3,
}

impl ExactCrossing {
    /// Bound on the distance between `t` and the exact ray parameter.
    pub fn t_error(&self) -> f64 {
        self.t.abs() * T_ERROR
    }
}

/// Returns where `ray` hits the closed triangle at a t in (`tnear`, `tfar`). The decision is exact.
///
/// All coordinates are f32 values. A triangle seen edge-on, without area along the ray, is never
/// hit. Let A, B, C be the corners as seen from the ray's origin, and d the direction. The sign of
/// d . (A x B) is the side on which the line passes the edge AB. The line passes inside if no two
/// of the three signs are opposite. The three determinants add up to d . n, which is 0 for a
/// triangle seen edge-on.
#[inline(always)]
pub fn crossing(ray: &LaneRay, corners: &[DVec3; 3]) -> Option<ExactCrossing> {
    let [a, b, c] = corners.map(|corner| corner - ray.origin);
    let d = ray.direction;
    let edges = [
        BoundedDeterminant::of(d, b, c),
        BoundedDeterminant::of(d, c, a),
        BoundedDeterminant::of(d, a, b),
    ];
    let [bc, ca, ab] = edges.map(|edge| edge.sign());
    let differ = |x, y| matches!((x, y), (Some(Less), Some(Greater)) | (Some(Greater), Some(Less)));
    if differ(bc, ca) || differ(ca, ab) || differ(ab, bc) {
        return None;
    }
    decide(ray, corners, edges)
}

/// [`crossing`] without its f64 filter: integers decide.
#[cfg(test)]
pub fn integers_only(ray: &LaneRay, corners: &[DVec3; 3]) -> Option<ExactCrossing> {
    decide(ray, corners, [BoundedDeterminant { value: f64::NAN, error: f64::NAN }; 3])
}

#[inline(never)]
fn decide(
    ray: &LaneRay,
    corners: &[DVec3; 3],
    edges: [BoundedDeterminant; 3],
) -> Option<ExactCrossing> {
    let exact = Exact::new(ray, corners);
    let mut signs = [Equal; 3];
    for (i, edge) in edges.iter().enumerate() {
        signs[i] = edge.sign().unwrap_or_else(|| sign(&exact.edge(i)));
    }
    let (some_less, some_greater) = (signs.contains(&Less), signs.contains(&Greater));
    if some_less == some_greater {
        // Opposite signs: the line passes outside. Only zeros: the triangle is seen edge-on.
        return None;
    }
    let [a, b, c] = *corners;
    let (e1, e2, to_a) = (b - a, c - a, a - ray.origin);
    let ng = e1.cross(e2);
    let (n, d) =
        (BoundedDeterminant::of(to_a, e1, e2), BoundedDeterminant::of(ray.direction, e1, e2));
    let t = n.value / d.value;
    let error = (n.error + t.abs() * d.error) / (d.value.abs() - d.error) + f64::EPSILON * t.abs();
    // `sound` is false for a NaN, and if the sign of the denominator is unknown.
    let sum = edges.iter().map(|edge| edge.value).sum::<f64>();
    let weights_error = edges.iter().fold(0.0, |most: f64, edge| most.max(edge.error));
    let sound = d.value.abs() > d.error
        && error <= 0.5 * T_ERROR * t.abs()
        && weights_error <= WEIGHT_ERROR * d.value.abs()
        && !sum.is_nan();
    let crossing = if sound {
        ExactCrossing { t, u: edges[1].value / sum, v: edges[2].value / sum, ng }
    } else {
        let d = exact.facing();
        let quotient = |n| Fraction::new(n, d.clone()).to_f64();
        let t = quotient(exact.distance());
        ExactCrossing { t, u: quotient(exact.edge(1)), v: quotient(exact.edge(2)), ng }
    };
    let beyond = |limit: f64| {
        if limit.is_finite() && (crossing.t - limit).abs() <= crossing.t_error() {
            exact.t().cmp(&Fraction::of(limit))
        } else {
            crossing.t.total_cmp(&limit)
        }
    };
    (beyond(ray.tnear) == Greater && beyond(ray.tfar) == Less).then_some(crossing)
}

/// Compares the exact t of two triangles. The ray must hit both.
pub fn compare(ray: &LaneRay, a: &[DVec3; 3], b: &[DVec3; 3]) -> Ordering {
    Exact::new(ray, a).t().cmp(&Exact::new(ray, b).t())
}

/// A ray and a triangle whose determinants are computed in integers, on demand.
struct Exact<'a> {
    ray: &'a LaneRay,
    corners: &'a [DVec3; 3],
}

impl<'a> Exact<'a> {
    fn new(ray: &'a LaneRay, corners: &'a [DVec3; 3]) -> Self {
        Self { ray, corners }
    }

    /// Corner `i` modulo 3, relative to the ray's origin.
    fn corner(&self, i: usize) -> Integers {
        difference(&integers(self.corners[i % 3]), &integers(self.ray.origin))
    }

    /// The determinant `d . (B x C)` of the edge opposite corner `i`.
    fn edge(&self, i: usize) -> num_bigint::BigInt {
        let d = integers(self.ray.direction);
        determinant(&d, &self.corner(i + 1), &self.corner(i + 2))
    }

    fn sides(&self) -> [Integers; 2] {
        let a = integers(self.corners[0]);
        [1, 2].map(|i| difference(&integers(self.corners[i]), &a))
    }

    /// `d . n`, 0 for a triangle seen edge-on.
    fn facing(&self) -> num_bigint::BigInt {
        let [e1, e2] = self.sides();
        determinant(&integers(self.ray.direction), &e1, &e2)
    }

    /// `(a - origin) . n`, so t is `distance / facing`.
    fn distance(&self) -> num_bigint::BigInt {
        let [e1, e2] = self.sides();
        determinant(&self.corner(0), &e1, &e2)
    }

    fn t(&self) -> Fraction {
        Fraction::new(self.distance(), self.facing())
    }
}
