//! When points span an area. Tolerances are relative to the longest edge, so that scenes in
//! millimetres and in kilometres are judged alike. Corners are finite: the ranges see to that.

use glam::DVec3;

/// Area / longest edge^2 below which an area is rounding noise of f64 subtraction.
const NO_AREA: f64 = 1e-14;
/// How far corners may lie out of the mean plane, in longest edges; from
/// docs/guide/scene-format.md.
const OUT_OF_PLANE: f64 = 1e-4;
/// Turn / longest edge^2 that counts as straight: rounding, not a concave corner.
const STRAIGHT: f64 = 1e-9;

/// What is wrong with a quad.
#[derive(Debug, PartialEq)]
pub enum QuadFault {
    /// Nothing is spanned (or the halves of a bow tie cancel).
    NoArea,
    /// This corner equals the next.
    Coincident(usize),
    /// This corner is that many longest edges out of plane.
    OutOfPlane(usize, f64),
    /// The outline turns back at this corner.
    Concave(usize),
}

/// True if `a x b` is no area.
pub fn is_flat(a: DVec3, b: DVec3) -> bool {
    let longest = a.length_squared().max(b.length_squared()).max((a - b).length_squared());
    a.cross(b).length() <= NO_AREA * longest
}

/// The first fault of the quad, if it has one.
pub fn quad_fault(corners: &[DVec3; 4]) -> Option<QuadFault> {
    let [v0, v1, v2, v3] = *corners;
    let edges = [v1 - v0, v2 - v1, v3 - v2, v0 - v3];
    let longest = edges.iter().map(|e| e.length()).fold(0.0, f64::max);
    // Newell's normal of a quad: half the cross product of its diagonals.
    let normal = (v2 - v0).cross(v3 - v1);
    if normal.length() <= NO_AREA * longest * longest {
        return Some(QuadFault::NoArea);
    }
    if let Some(i) = edges.iter().position(|e| e.length() <= NO_AREA * longest) {
        return Some(QuadFault::Coincident(i));
    }
    let normal = normal.normalize();
    let centre = v0 + ((v1 - v0) + (v2 - v0) + (v3 - v0)) / 4.0;
    let off = corners.map(|v| (v - centre).dot(normal).abs() / longest);
    if let Some(i) =
        (0..4).max_by(|a, b| off[*a].total_cmp(&off[*b])).filter(|i| off[*i] > OUT_OF_PLANE)
    {
        return Some(QuadFault::OutOfPlane(i, off[i]));
    }
    let turn = |i: usize| edges[(i + 3) % 4].cross(edges[i]).dot(normal);
    (0..4).find(|i| turn(*i) < -STRAIGHT * longest * longest).map(QuadFault::Concave)
}
