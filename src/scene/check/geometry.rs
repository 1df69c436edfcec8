//! Tests whether points span an area. Tolerances are relative to the longest edge, so scenes in
//! millimetres and in kilometres get the same result. Range checks have ensured that corners are
//! finite.

use glam::DVec3;

/// An area up to this fraction of the longest edge^2 is rounding noise of f64 subtractions.
const NO_AREA: f64 = 1e-14;
/// Maximum distance of a corner from the mean plane, as a fraction of the longest edge; from
/// docs/guide/scene-format.md.
const OUT_OF_PLANE: f64 = 1e-4;
/// A corner that turns back by up to this fraction of the longest edge^2 counts as straight. That
/// is rounding, not a concave corner. The turn is the cross product of its two edges.
const STRAIGHT: f64 = 1e-9;

/// A reason why a quad is invalid.
#[derive(Debug, PartialEq)]
pub enum QuadFault {
    /// The area is zero, or the halves of a bow tie cancel.
    NoArea,
    /// This corner equals the next one.
    Coincident(usize),
    /// The corners are out of the mean plane by this fraction of the longest edge. All four have
    /// the same distance: two are above the plane and two below. So none is the wrong one.
    OutOfPlane(f64),
    /// The outline turns back at this corner.
    Concave(usize),
}

/// Returns true if the vectors `a` and `b` span no area.
pub fn is_flat(a: DVec3, b: DVec3) -> bool {
    let longest = a.length_squared().max(b.length_squared()).max((a - b).length_squared());
    a.cross(b).length() <= NO_AREA * longest
}

/// Returns the first fault of the quad, or `None` for a valid quad.
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
    let off = off.into_iter().fold(0.0, f64::max);
    if off > OUT_OF_PLANE {
        return Some(QuadFault::OutOfPlane(off));
    }
    let turn = |i: usize| edges[(i + 3) % 4].cross(edges[i]).dot(normal);
    (0..4).find(|i| turn(*i) < -STRAIGHT * longest * longest).map(QuadFault::Concave)
}
