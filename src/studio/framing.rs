//! Computes where a perspective camera with a fixed direction must stand to see every point.
//!
//! The result is exact and takes one pass. For each of the four frustum planes only the extreme
//! point matters. Framing by a bounding box wastes up to half of the picture, and framing by the
//! longest side clips points.

use glam::DVec3;
use rayon::prelude::*;

/// The field of view of the camera, and the space to keep free around points.
#[derive(Debug, Clone, Copy)]
pub struct FieldOfView {
    /// Full vertical angle of view in degrees.
    pub fov_deg: f64,
    /// Width / height of the picture.
    pub aspect: f64,
    /// Margin to keep free at each border, as a fraction of the picture's width and height; >= 0
    /// and below 0.5.
    pub margin: f64,
    /// Radius of the spheres around all points; 0 for points alone.
    pub radius: f64,
}

/// Returns the camera position from which all points lie within the picture without its margin. The
/// points are centred in both axes and touch the margin in at least one. One exception: the nearest
/// point alone may determine the position (a single point, points on a line along the view, or a
/// very wide angle). Then the camera keeps a distance from it.
///
/// With a `target`, this point is in the middle of the picture, and the camera is as near to it as
/// the points allow.
///
/// `direction` and `up` have any length and are not parallel. Points that are NaN are ignored.
/// Returns `None` if there are no other points. A point with an infinite coordinate either makes
/// the result `None` or is ignored, which depends on the direction.
pub fn frame(
    points: impl ParallelIterator<Item = DVec3>,
    direction: DVec3,
    up: DVec3,
    lens: FieldOfView,
    target: Option<DVec3>,
) -> Option<DVec3> {
    let view = FramedView::new(direction, up, lens);
    // A sphere reaches its radius times |n| along n.
    let beyond = view.slants().map(|slant| lens.radius * slant.length());
    let extent = FrustumExtent::around(points, |p| (view.reach(p), view.depth(p), beyond));
    view.position(&extent, target)
}

/// Returns the position of [`frame`] for points that turn around an axis. The axis is a point and a
/// unit direction. Each point may be anywhere on its circle. So one position serves all frames of a
/// turntable, however many there are.
pub fn frame_turning(
    points: impl ParallelIterator<Item = DVec3>,
    (pivot, axis): (DVec3, DVec3),
    direction: DVec3,
    up: DVec3,
    lens: FieldOfView,
    target: Option<DVec3>,
) -> Option<DVec3> {
    let view = FramedView::new(direction, up, lens);
    // A circle of radius r around c reaches n.c + r |n across the axis| along n.
    let across = |n: DVec3| (n - axis * n.dot(axis)).length();
    let slants = view.slants();
    let (across, beyond) = (slants.map(across), slants.map(|slant| lens.radius * slant.length()));
    let extent = FrustumExtent::around(points, |p| {
        let offset = p - pivot;
        let centre = pivot + axis * offset.dot(axis);
        let radius = (p - centre).length();
        let reach = std::array::from_fn(|k| radius * across[k] + beyond[k]);
        (view.reach(centre), view.depth(centre), reach)
    });
    view.position(&extent, target)
}

/// The axes of a camera (right, up, forward), and the slopes of the frustum's sides after the
/// margin is subtracted.
struct FramedView {
    axes: [DVec3; 3],
    tx: f64,
    ty: f64,
}

/// The maximum extent of points towards the frustum's sides (right, left, top, bottom), and their
/// range of depths.
struct FrustumExtent {
    planes: [f64; 4],
    near: f64,
    far: f64,
}

impl FrustumExtent {
    const EMPTY: Self =
        Self { planes: [f64::NEG_INFINITY; 4], near: f64::INFINITY, far: f64::NEG_INFINITY };

    /// Returns the extent of all points. `measure` returns the reach of a point towards the four
    /// sides, its depth, and by how much it extends beyond these five values.
    fn around(
        points: impl ParallelIterator<Item = DVec3>,
        measure: impl Fn(DVec3) -> ([f64; 4], f64, [f64; 5]) + Sync,
    ) -> Self {
        let add = |extent: Self, p| {
            let (reach, depth, beyond) = measure(p);
            extent.union(Self {
                planes: std::array::from_fn(|k| reach[k] + beyond[k]),
                near: depth - beyond[4],
                far: depth + beyond[4],
            })
        };
        points.fold(|| Self::EMPTY, add).reduce(|| Self::EMPTY, Self::union)
    }

    /// Returns true if a camera at the depth `back` is nearer than every point, by more than the
    /// rounding of these values.
    fn is_before(&self, back: f64, view: &FramedView) -> bool {
        let largest = self.planes.iter().fold(self.near.abs(), |most, side| most.max(side.abs()));
        let rounding = 1e-15 * largest / view.tx.min(view.ty).min(1.0);
        self.near - back > 1e-9 * (self.far - self.near) + rounding
    }

    #[inline(always)]
    fn union(self, other: Self) -> Self {
        Self {
            planes: std::array::from_fn(|k| self.planes[k].max(other.planes[k])),
            near: self.near.min(other.near),
            far: self.far.max(other.far),
        }
    }
}

impl FramedView {
    fn new(direction: DVec3, up: DVec3, lens: FieldOfView) -> Self {
        let z = direction.normalize();
        let x = z.cross(up).normalize();
        let y = x.cross(z);
        let ty = (lens.fov_deg.to_radians() / 2.0).tan() * (1.0 - 2.0 * lens.margin);
        Self { axes: [x, y, z], tx: ty * lens.aspect, ty }
    }

    /// Returns the extent of a point towards the four planes. A point p is inside the right plane
    /// of a camera at c if p.x - c.x <= tx (p.z - c.z). That is c.x - tx c.z >= p.x - tx p.z, so
    /// the largest right-hand side decides. The other planes are alike.
    #[inline(always)]
    fn reach(&self, p: DVec3) -> [f64; 4] {
        let [x, y, z] = self.axes;
        let (px, py, pz) = (p.dot(x), p.dot(y), p.dot(z));
        let (sx, sy) = (self.tx * pz, self.ty * pz);
        [px - sx, -px - sx, py - sy, -py - sy]
    }

    /// The vectors whose dot products with a point are [`Self::reach`] and [`Self::depth`].
    fn slants(&self) -> [DVec3; 5] {
        let [x, y, z] = self.axes;
        [x - z * self.tx, -x - z * self.tx, y - z * self.ty, -y - z * self.ty, z]
    }

    #[inline(always)]
    fn depth(&self, p: DVec3) -> f64 {
        p.dot(self.axes[2])
    }

    fn position(&self, extent: &FrustumExtent, target: Option<DVec3>) -> Option<DVec3> {
        let position = match target {
            None => self.centred(extent),
            Some(target) => self.towards(extent, target),
        };
        position.is_finite().then_some(position)
    }

    /// Returns the position from which the points are centred in both axes.
    fn centred(&self, extent: &FrustumExtent) -> DVec3 {
        let &FrustumExtent { planes: [right, left, top, bottom], near, far } = extent;
        let Self { axes: [x, y, z], tx, ty } = *self;
        let back = (-(right + left) / (2.0 * tx)).min(-(top + bottom) / (2.0 * ty));
        let position = x * ((right - left) / 2.0) + y * ((top - bottom) / 2.0);
        let back = if extent.is_before(back, self) { back } else { near - (far - near).max(1.0) };
        position + z * back
    }

    /// Returns the position on the line through `target` along the view. A camera there is at
    /// c = target - s z, so the condition of [`Self::reach`] is s >= (the largest reach of a point
    /// - the reach of the target) / t for each plane.
    fn towards(&self, extent: &FrustumExtent, target: DVec3) -> DVec3 {
        let (own, slopes) = (self.reach(target), [self.tx, self.tx, self.ty, self.ty]);
        let needed = (0..4).map(|k| (extent.planes[k] - own[k]) / slopes[k]);
        let (depth, at) = (extent.far - extent.near, self.depth(target));
        // The target is in front of the camera, also where the points are far behind it.
        let least = 1e-2 * depth.max((extent.near - at).abs());
        let distance = needed.fold(least, f64::max);
        let distance = match extent.is_before(at - distance, self) {
            true => distance,
            false => at - extent.near + depth.max(1.0),
        };
        target - self.axes[2] * distance
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn lens(fov_deg: f64, aspect: f64) -> FieldOfView {
        FieldOfView { fov_deg, aspect, margin: 0.08, radius: 0.0 }
    }

    /// An asymmetric cloud of points, without randomness.
    fn cloud() -> Vec<DVec3> {
        let part = |i: u32, step: f64| (f64::from(i) * step).fract();
        (0..500)
            .map(|i| {
                let p = DVec3::new(part(i, 0.618), part(i, 0.414), part(i, 0.732));
                DVec3::new(3.0 * p.x, p.y * p.x, 2.0 * p.z - p.y) + DVec3::new(7.0, -2.0, 11.0)
            })
            .collect()
    }

    /// Projects a point to coordinates that are in [-1, 1] within the picture without its margin.
    fn project(p: DVec3, at: DVec3, direction: DVec3, up: DVec3, t: [f64; 2]) -> [f64; 2] {
        let z = direction.normalize();
        let x = z.cross(up).normalize();
        let y = x.cross(z);
        let d = p - at;
        assert!(d.dot(z) > 0.0);
        [d.dot(x) / d.dot(z) / t[0], d.dot(y) / d.dot(z) / t[1]]
    }

    #[test]
    fn all_points_are_inside_and_touch_two_opposite_borders() {
        let views = [
            (DVec3::new(-1.0, -0.5, -2.0), DVec3::Y),
            (DVec3::new(1.0, 0.3, 0.1), DVec3::Z),
            (DVec3::new(0.1, -5.0, 0.0), DVec3::new(0.3, 0.2, 1.0)),
        ];
        for (direction, up) in views {
            for aspect in [0.3, 1.0, 2.5] {
                for fov in [5.0, 30.0, 120.0] {
                    let at = frame(cloud().into_par_iter(), direction, up, lens(fov, aspect), None)
                        .unwrap();
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
                    // With a very wide angle one near point may decide alone: then no border is
                    // touched.
                    assert!(touches(horizontal) || touches(vertical) || fov > 100.0);
                }
            }
        }
    }

    #[test]
    fn a_turning_cloud_stays_inside_and_touches_two_opposite_borders() {
        let (direction, up) = (DVec3::new(-1.0, -0.5, -2.0), DVec3::Y);
        let (pivot, aspect) = (DVec3::new(7.5, 0.0, 12.0), 1.6);
        let lens = lens(35.0, aspect);
        let cloud_of = cloud().into_par_iter();
        let at = frame_turning(cloud_of, (pivot, DVec3::Y), direction, up, lens, None);
        let at = at.unwrap();
        let t = (f64::to_radians(35.0) / 2.0).tan() * 0.84;
        let (mut low, mut high) = ([1e9_f64; 2], [-1e9_f64; 2]);
        for degree in 0..720 {
            let turn = glam::DMat3::from_rotation_y(f64::from(degree).to_radians() / 2.0);
            for p in cloud() {
                let p = turn * (p - pivot) + pivot;
                let seen = project(p, at, direction, up, [t * aspect, t]);
                for axis in 0..2 {
                    low[axis] = low[axis].min(seen[axis]);
                    high[axis] = high[axis].max(seen[axis]);
                }
            }
        }
        assert!(low.iter().all(|&v| v >= -1.0 - 1e-9) && high.iter().all(|&v| v <= 1.0 + 1e-9));
        // The samples are half a degree apart, so the touching point may be missed by that much.
        let touches = |axis: usize| low[axis] < -0.999 && high[axis] > 0.999;
        assert!(touches(0) || touches(1), "{low:?} {high:?}");
    }

    #[test]
    fn a_target_is_in_the_middle_and_points_touch_one_border() {
        let (direction, up, lens) = (DVec3::new(-1.0, -0.5, -2.0), DVec3::Y, lens(30.0, 1.3));
        let t = (f64::to_radians(30.0) / 2.0).tan() * 0.84;
        let middle = cloud().iter().sum::<DVec3>() / 500.0;
        for away in [DVec3::ZERO, DVec3::new(5.0, -2.0, 1.0), DVec3::new(0.0, 40.0, 0.0)] {
            let target = middle + away;
            let at = frame(cloud().into_par_iter(), direction, up, lens, Some(target)).unwrap();
            let seen = |p| project(p, at, direction, up, [t * 1.3, t]);
            assert!(seen(target).iter().all(|v| v.abs() < 1e-9));
            let all = cloud().into_iter().flat_map(seen);
            let largest = all.fold(0.0, |largest: f64, v| largest.max(v.abs()));
            assert!((largest - 1.0).abs() < 1e-9, "{largest}");
        }
        // Far in front of the points, the target itself limits the position.
        let target = middle - direction * 100.0;
        let at = frame(cloud().into_par_iter(), direction, up, lens, Some(target)).unwrap();
        assert!((target - at).dot(direction) > 0.0);
        let inside = |p| project(p, at, direction, up, [t * 1.3, t]).iter().all(|v| v.abs() < 1.0);
        assert!(cloud().into_iter().all(inside));
        // A single point has no size of its own.
        for away in [0.0, 1e-3, 100.0] {
            let (points, target) = (vec![middle], middle - direction * away);
            let at = frame(points.into_par_iter(), direction, up, lens, Some(target)).unwrap();
            assert!((target - at).dot(direction) > 0.0 && (middle - at).dot(direction) > 0.0);
        }
    }

    #[test]
    fn points_far_from_zero_are_framed_as_near_it() {
        let (direction, up) = (DVec3::new(0.3, -0.5, -2.0), DVec3::Y);
        let near = frame(cloud().into_par_iter(), direction, up, lens(40.0, 1.0), None).unwrap();
        for shift in [DVec3::new(0.0, 1e10, 0.0), DVec3::new(5e6, -3e9, 1e9), DVec3::splat(1e11)] {
            let there = cloud().into_par_iter().map(|p| p + shift);
            let far = frame(there, direction, up, lens(40.0, 1.0), None).unwrap();
            let rounding = 1e-14 * shift.length();
            assert!((far - shift - near).length() < rounding, "{}", far - shift - near);
        }
    }

    #[test]
    fn a_point_and_a_line_get_a_distance_and_no_points_give_none() {
        let see = |points: Vec<DVec3>| {
            frame(points.into_par_iter(), DVec3::NEG_Z, DVec3::Y, lens(30.0, 1.0), None)
        };
        assert!(see(vec![DVec3::ONE]).unwrap().z > 1.0);
        assert!(see(vec![DVec3::ZERO, DVec3::Z]).unwrap().z > 1.0);
        assert_eq!(see(vec![]), None);
        assert_eq!(see(vec![DVec3::NAN]), None);
    }
}
