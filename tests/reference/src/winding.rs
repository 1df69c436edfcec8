//! Winding numbers by their definition.

use glam::DVec3;

/// The winding number of triangles around a point: their solid angles (van Oosterom and Strackee
/// 1983), in units of the sphere's.
pub fn number(triangles: &[[DVec3; 3]], point: DVec3) -> f64 {
    let angle = |corners: &[DVec3; 3]| {
        let [a, b, c] = corners.map(|corner| corner - point);
        let (la, lb, lc) = (a.length(), b.length(), c.length());
        let below = la * lb * lc + a.dot(b) * lc + b.dot(c) * la + c.dot(a) * lb;
        a.dot(b.cross(c)).atan2(below) / (2.0 * std::f64::consts::PI)
    };
    triangles.iter().map(angle).sum()
}
