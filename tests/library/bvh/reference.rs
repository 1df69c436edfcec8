//! The hits that a ray may and must have: every primitive in f64, with the error bound that `bvh`
//! documents.
//!
//! The tree's triangle test moves a vertex, in the plane normal to the ray's dominant axis, by at
//! most 6u max|v - o| in each coordinate (u = 2^-24). So a triangle whose sheared outline passes
//! the ray at a greater distance is certainly hit or certainly missed.
//!
//! A hit is where the ray meets the plane, if that is a place at the triangle, and where it passes
//! through the moved triangle, if not. So its place is always at the triangle.

use lightpath::geometry::Geometry;
use lightpath::ray::{LANES, Rays};

use super::tiers::Hit;

const U: f64 = 1.0 / (1u64 << 24) as f64;

/// Relative error of one f64 operation.
const U64: f64 = f64::EPSILON / 2.0;

/// A possible hit of one primitive.
#[derive(Debug, Clone, Copy)]
struct Meeting {
    primitive: u32,
    /// Bounds of t if it is hit, by the plane.
    t: (f64, f64),
    /// Bounds of t if the ray does not meet the plane at the triangle. `None` if it surely does.
    passing: Option<(f64, f64)>,
    certain: bool,
}

/// Returns whether `answer` is right for ray `i`: it must be a possible hit with a possible t, and
/// no certain hit may lie in front of it.
pub fn check(
    geometry: &Geometry,
    rays: &Rays,
    i: usize,
    answer: Option<Hit>,
) -> Result<(), String> {
    let all = meetings(geometry, rays, i);
    let (tnear, tfar) = (f64::from(rays.tnear[i]), f64::from(rays.tfar[i]));
    let certain = all
        .iter()
        .filter(|m| m.certain && m.t.0 > tnear && m.t.1 < tfar)
        .min_by(|a, b| a.t.1.total_cmp(&b.t.1));
    let Some(hit) = answer else {
        return certain.map_or(Ok(()), |m| Err(format!("found nothing, expected {m:?}")));
    };
    let possible = |m: &&Meeting| {
        let within = |(least, most): (f64, f64)| {
            most > tnear && least < tfar && (least as f32..=most as f32).contains(&hit.t)
        };
        m.primitive == hit.primitive && (within(m.t) || m.passing.is_some_and(within))
    };
    if !all.iter().any(|m| possible(&m)) {
        let same: Vec<_> = all.iter().filter(|m| m.primitive == hit.primitive).collect();
        return Err(format!("found {hit:?}, which may be {same:?}"));
    }
    match certain {
        Some(m) if (m.t.1 as f32) < hit.t => Err(format!("found {hit:?}, expected {m:?}")),
        _ => Ok(()),
    }
}

fn meetings(geometry: &Geometry, rays: &Rays, i: usize) -> Vec<Meeting> {
    let of = |v: &[[f32; LANES]; 3]| [0, 1, 2].map(|axis| f64::from(v[axis][i]));
    let (origin, direction) = (of(&rays.org), of(&rays.dir));
    let leaving = rays.leaving[i];
    let mut all = Vec::new();
    let mut flat = |primitive: u32, corners: [[f32; 3]; 3]| {
        if primitive != leaving {
            all.extend(triangle(primitive, corners.map(|v| v.map(f64::from)), origin, direction));
        }
    };
    for (geom, mesh) in geometry.meshes.iter().enumerate() {
        for prim in 0..mesh.triangles().len() as u32 {
            flat(geometry.primitive(geom as u32, prim), mesh.corners(prim));
        }
    }
    for (prim, &[v0, v1, v2, v3]) in geometry.quads.iter().enumerate() {
        let primitive = geometry.primitive(geometry.quads_id(), prim as u32);
        flat(primitive, [v0, v1, v3]);
        flat(primitive, [v2, v3, v1]);
    }
    for (prim, sphere) in geometry.spheres.iter().enumerate() {
        let primitive = geometry.primitive(geometry.spheres_id(), prim as u32);
        // Uses the tree's own formula: the check is only which spheres the tree reaches.
        let t = sphere.intersect(
            origin.into(),
            direction.into(),
            rays.tnear[i].into(),
            rays.tfar[i].into(),
            primitive == leaving,
        );
        if !t.is_nan() {
            all.push(Meeting { primitive, t: (t, t), passing: None, certain: true });
        }
    }
    all
}

/// Returns `None` for a triangle that is certainly missed.
fn triangle(
    primitive: u32,
    corners: [[f64; 3]; 3],
    origin: [f64; 3],
    direction: [f64; 3],
) -> Option<Meeting> {
    let [x, y, z] = direction.map(f64::abs);
    let kz = if z >= x.max(y) { 2 } else { usize::from(y >= x) };
    let (kx, ky) = ((kz + 1) % 3, (kz + 2) % 3);
    let to = corners.map(|v| [v[0] - origin[0], v[1] - origin[1], v[2] - origin[2]]);
    let reach = to.as_flattened().iter().fold(0.0, |m: f64, x| m.max(x.abs()));
    // In both coordinates, plus the error of underflow below the range of normal numbers.
    let bound = 6.0 * U * reach * std::f64::consts::SQRT_2 * 1.001 + 1e-44;
    let along = direction[kz];
    let [a, b, c] =
        to.map(|v| [v[kx] - direction[kx] / along * v[kz], v[ky] - direction[ky] / along * v[kz]]);
    let cross = |p: [f64; 2], q: [f64; 2]| p[0] * q[1] - p[1] * q[0];
    // The sign of an edge function, or 0 where f64 cannot decide: near the line through two
    // corners, which is outside, or near the edge between them. The latter is tested below.
    let side = |p: [f64; 2], q: [f64; 2]| {
        let noise = 16.0 * U64 * (p[0].hypot(p[1]) * q[0].hypot(q[1]));
        let edge = cross(p, q);
        i32::from(edge > noise) - i32::from(edge < -noise)
    };
    let inside = (side(c, b) + side(a, c) + side(b, a)).abs() == 3;
    let away = distance(a, b).min(distance(b, c)).min(distance(c, a)) > bound;
    if away && !inside {
        return None;
    }
    let depths = to.map(|v| v[kz] / along);
    let (mut first, mut last) = (least(depths), most(depths));
    for k in (0..3).filter(|&k| direction[k] != 0.0) {
        let widened = 64.0 * U * reach + f64::from(f32::MIN_POSITIVE);
        let along = to.map(|v| v[k]);
        let ends = [least(along) - widened, most(along) + widened].map(|x| x / direction[k]);
        (first, last) = (first.max(ends[0].min(ends[1])), last.min(ends[0].max(ends[1])));
    }
    // The tree's slack is 64u along each axis, so less than 128u across the ray.
    let seen = [(a, to[0]), (b, to[1]), (c, to[2])].map(|([x, y], v)| [x, y, v[kz] / along]);
    if let Some((least, most)) = part_within(seen, 129.0 * U * reach + 1e-37) {
        let widened = 64.0 * U * reach / along.abs() + f64::from(f32::MIN_POSITIVE);
        (first, last) = (first.max(least - widened), last.min(most + widened));
    }
    let (least, most) = plane(to, direction).unwrap_or((f64::NEG_INFINITY, f64::INFINITY));
    // The tree keeps t in the widened box and between the corners' depths, up to u. It rounds these
    // to f32, another u.
    let down = |t: f64| t - t.abs() * 2.0 * U;
    let up = |t: f64| t + t.abs() * 2.0 * U;
    let t = (least.clamp(down(first), down(last)), most.clamp(up(first), up(last)));
    let certain = away && inside;
    let passing = part_within(seen, bound).filter(|_| !certain);
    let passing = passing.map(|(least, most)| (down(least), up(most)));
    Some(Meeting { primitive, t, passing, certain })
}

/// Returns the smallest and the largest t of the part of a triangle that is at most `bound` away
/// from the ray along both axes across it. Corners are their ways from the ray, then t.
fn part_within(corners: [[f64; 3]; 3], bound: f64) -> Option<(f64, f64)> {
    let mut part = corners.to_vec();
    for (axis, sign) in [(0, 1.0), (0, -1.0), (1, 1.0), (1, -1.0)] {
        let mut cut = Vec::new();
        for (i, &p) in part.iter().enumerate() {
            let q = part[(i + 1) % part.len()];
            let [p_off, q_off] = [p, q].map(|v| v[axis] * sign - bound);
            if p_off <= 0.0 {
                cut.push(p);
            }
            if (p_off <= 0.0) != (q_off <= 0.0) {
                let share = p_off / (p_off - q_off);
                cut.push([0, 1, 2].map(|k| p[k] + share * (q[k] - p[k])));
            }
        }
        part = cut;
    }
    let t = |part: &[[f64; 3]], pick: fn(f64, f64) -> f64| part.iter().map(|v| v[2]).reduce(pick);
    t(&part, f64::min).zip(t(&part, f64::max))
}

/// Returns where the ray hits the triangle's plane, or `None` where f64 cannot decide.
fn plane([a, b, c]: [[f64; 3]; 3], direction: [f64; 3]) -> Option<(f64, f64)> {
    let (mut above, mut towards) = (0.0, 0.0);
    let (mut above_error, mut towards_error) = (0.0, 0.0);
    for k in 0..3 {
        let (l, m) = ((k + 1) % 3, (k + 2) % 3);
        let (p, q) = ((b[l] - a[l]) * (c[m] - a[m]), (b[m] - a[m]) * (c[l] - a[l]));
        // Subtracting the origin has cost the corners digits.
        let size = |i: usize| a[i].abs() + b[i].abs() + c[i].abs();
        let lost = 2.0 * U64 * (size(l) * size(m));
        let error = 10.0 * U64 * (p.abs() + q.abs()) + lost;
        above += (p - q) * a[k];
        towards += (p - q) * direction[k];
        above_error += error * a[k].abs() + 4.0 * U64 * ((p - q) * a[k]).abs();
        towards_error += error * direction[k].abs() + 4.0 * U64 * ((p - q) * direction[k]).abs();
    }
    // Twice, because the tree's own arithmetic has the same error.
    let (above_error, towards_error) = (2.0 * above_error, 2.0 * towards_error);
    if !(towards.abs() > 2.0 * towards_error) {
        return None;
    }
    let t = above / towards;
    let error = (above_error + t.abs() * towards_error) / (towards.abs() - towards_error);
    Some((t - error, t + error))
}

fn least(v: [f64; 3]) -> f64 {
    v[0].min(v[1]).min(v[2])
}

fn most(v: [f64; 3]) -> f64 {
    v[0].max(v[1]).max(v[2])
}

/// Returns the distance from the origin to the segment.
fn distance(p: [f64; 2], q: [f64; 2]) -> f64 {
    let along = [q[0] - p[0], q[1] - p[1]];
    let square = along[0] * along[0] + along[1] * along[1];
    let s = -(p[0] * along[0] + p[1] * along[1]) / square;
    // A segment without length gives NaN; then take its first end.
    let s = if s > 0.0 { s.min(1.0) } else { 0.0 };
    (p[0] + along[0] * s).hypot(p[1] + along[1] * s)
}
