//! Where a perspective camera with a fixed direction must stand to see every point.
//!
//! Exact, in one pass: a frustum plane through the camera holds a point back or not, so for each of
//! the four planes only the extreme point counts. Framing by a bounding box wastes up to a half of
//! the picture, framing by the largest side clips.

use glam::DVec3;

/// The position from which all points lie within the picture, `margin` (a fraction of its width
/// and height) away from its borders, and touch that margin in at least one axis, centred in both.
/// Where the nearest point alone decides (one point, a line of sight, a very wide angle), the camera
/// stands clear of it instead.
///
/// `direction` and `up` have any length and are not parallel; `fov_deg` is the full vertical angle;
/// `aspect` is width / height. `None` without points or where they are not finite.
pub fn frame(
    points: impl Iterator<Item = DVec3>,
    direction: DVec3,
    up: DVec3,
    fov_deg: f64,
    aspect: f64,
    margin: f64,
) -> Option<DVec3> {
    let z = direction.normalize();
    let x = z.cross(up).normalize();
    let y = x.cross(z);
    let ty = (fov_deg.to_radians() / 2.0).tan() * (1.0 - 2.0 * margin);
    let tx = ty * aspect;
    // A point is inside the right plane of a camera at c if p.x - c.x <= tx (p.z - c.z), that is if
    // c.x - tx c.z >= p.x - tx p.z: the largest right-hand side decides. So for all four planes.
    let mut planes = [f64::NEG_INFINITY; 4];
    let (mut near, mut far) = (f64::INFINITY, f64::NEG_INFINITY);
    for p in points {
        let (px, py, pz) = (p.dot(x), p.dot(y), p.dot(z));
        let reach = [px - tx * pz, -px - tx * pz, py - ty * pz, -py - ty * pz];
        for (plane, reach) in planes.iter_mut().zip(reach) {
            *plane = plane.max(reach);
        }
        near = near.min(pz);
        far = far.max(pz);
    }
    let [right, left, top, bottom] = planes;
    let back = (-(right + left) / (2.0 * tx)).min(-(top + bottom) / (2.0 * ty));
    // Exact would be on the nearest point itself: stand clear of it.
    let depth = far - near;
    let back = match near - back > 1e-9 * (depth + near.abs()) {
        true => back,
        false => near - depth.max(1.0),
    };
    let position = x * ((right - left) / 2.0) + y * ((top - bottom) / 2.0) + z * back;
    position.is_finite().then_some(position)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Points of a lopsided cloud, without randomness.
    fn cloud() -> Vec<DVec3> {
        let part = |i: u32, step: f64| (f64::from(i) * step).fract();
        (0..500)
            .map(|i| {
                let p = DVec3::new(part(i, 0.618), part(i, 0.414), part(i, 0.732));
                DVec3::new(3.0 * p.x, p.y * p.x, 2.0 * p.z - p.y) + DVec3::new(7.0, -2.0, 11.0)
            })
            .collect()
    }

    /// Picture coordinates in [-1, 1] of the picture without its margin.
    fn project(p: DVec3, at: DVec3, direction: DVec3, up: DVec3, t: [f64; 2]) -> [f64; 2] {
        let z = direction.normalize();
        let x = z.cross(up).normalize();
        let y = x.cross(z);
        let d = p - at;
        assert!(d.dot(z) > 0.0);
        [d.dot(x) / d.dot(z) / t[0], d.dot(y) / d.dot(z) / t[1]]
    }

    #[test]
    fn everything_is_inside_and_two_opposite_sides_touch() {
        let views = [
            (DVec3::new(-1.0, -0.5, -2.0), DVec3::Y),
            (DVec3::new(1.0, 0.3, 0.1), DVec3::Z),
            (DVec3::new(0.1, -5.0, 0.0), DVec3::new(0.3, 0.2, 1.0)),
        ];
        for (direction, up) in views {
            for aspect in [0.3, 1.0, 2.5] {
                for fov in [5.0, 30.0, 120.0] {
                    let at = frame(cloud().into_iter(), direction, up, fov, aspect, 0.08).unwrap();
                    let t = (f64::to_radians(fov) / 2.0).tan() * 0.84;
                    let seen: Vec<_> = cloud()
                        .into_iter()
                        .map(|p| project(p, at, direction, up, [t * aspect, t]))
                        .collect();
                    let ends = |axis: usize| {
                        let values = || seen.iter().map(|s| s[axis]);
                        (values().fold(1e9, f64::min), values().fold(-1e9, f64::max))
                    };
                    let (horizontal, vertical) = (ends(0), ends(1));
                    for (low, high) in [horizontal, vertical] {
                        assert!(low >= -1.0 - 1e-9 && high <= 1.0 + 1e-9, "{low} {high}");
                    }
                    let touches = |(low, high): (f64, f64)| low < -1.0 + 1e-9 && high > 1.0 - 1e-9;
                    // Through a very wide angle one near point may hide all others: no side then.
                    assert!(touches(horizontal) || touches(vertical) || fov > 100.0);
                }
            }
        }
    }

    #[test]
    fn a_point_a_line_and_nothing() {
        let see =
            |points: Vec<DVec3>| frame(points.into_iter(), DVec3::NEG_Z, DVec3::Y, 30.0, 1.0, 0.08);
        assert!(see(vec![DVec3::ONE]).unwrap().z > 1.0);
        assert!(see(vec![DVec3::ZERO, DVec3::Z]).unwrap().z > 1.0);
        assert_eq!(see(vec![]), None);
        assert_eq!(see(vec![DVec3::NAN]), None);
    }
}
