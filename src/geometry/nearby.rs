//! What is near a point of a triangle: what a test in f32 may put on the other side of the point.
//!
//! Such a test moves the corners of a primitive by a share of their distance from the ray's
//! origin. So the farther a primitive extends, the farther from the point it may lie. The size of
//! the point's own triangle is only a limit: on a plane of many kilometres all small things in
//! some centimetres would be near otherwise.

use glam::DVec3;

use super::triangle::REACH;

/// A point, for the search of its neighbours.
#[derive(Debug, Clone, Copy)]
pub struct Nearby {
    point: DVec3,
    /// Largest distance along an axis that counts for the size of a neighbour.
    far: f64,
}

impl Nearby {
    /// The search around `point`, which lies on a triangle with these corners.
    pub fn new(point: DVec3, corners: [DVec3; 3]) -> Self {
        let distance = |corner: DVec3| (corner - point).abs().max_element();
        Self { point, far: corners.into_iter().map(distance).fold(0.0, f64::max) }
    }

    /// The search among primitives that all lie in the box from `low` to `high`.
    #[must_use]
    pub fn within(&self, [low, high]: [DVec3; 2]) -> Self {
        let far = (low - self.point).abs().max((high - self.point).abs()).max_element();
        Self { far: self.far.min(far), ..*self }
    }

    /// How far from the point, along each axis, something as large as the box from `low` to `high`
    /// may be. Returns `None` if the box is farther away. Then everything in it is.
    pub fn reach(&self, [low, high]: [DVec3; 2]) -> Option<f64> {
        let reach = self.within([low, high]).most();
        let gap = (low - self.point).max(self.point - high).max_element();
        (gap <= reach).then_some(reach)
    }

    /// A box in f32 that contains a part of each neighbour: lower and upper corner.
    pub fn bounds(&self) -> [[f32; 3]; 2] {
        let outward = |sign: f64| {
            let moved = self.point + sign * self.most();
            (moved + sign * moved.abs() * f64::from(f32::EPSILON)).as_vec3().to_array()
        };
        [outward(-1.0), outward(1.0)]
    }

    /// How far from the point the largest neighbours may be.
    fn most(&self) -> f64 {
        let size = self.point.abs().max_element() + self.far;
        2.0 * REACH * size + f64::from(f32::MIN_POSITIVE)
    }
}

#[cfg(test)]
mod tests {
    use super::super::doubles::doubles;
    use super::*;

    #[test]
    fn the_box_around_a_point_is_as_large_as_the_rounding() {
        // Not all coordinates are f32.
        for unit in [1.0, 1000.1, 0.001] {
            let point = DVec3::new(1.1, -2.1, 3.0) * unit;
            let corners = [point - DVec3::X * unit, point + DVec3::Y * 4.0 * unit, point];
            let reach = 2.0 * REACH * (3.0 + 4.0) * unit * (1.0 - 1e-6);
            let [low, high] = Nearby::new(point, corners).bounds().map(doubles);
            for (below, above, size) in
                [0, 1, 2].map(|k| (point[k] - low[k], high[k] - point[k], point[k].abs()))
            {
                let largest = reach + 2.0 * f64::from(f32::EPSILON) * size;
                assert!((reach..=largest).contains(&below), "{below:e} {reach:e}");
                assert!((reach..=largest).contains(&above), "{above:e} {reach:e}");
            }
        }
    }

    #[test]
    fn a_point_at_zero_is_near_itself() {
        let zero = [DVec3::ZERO; 2];
        let reach = Nearby::new(DVec3::ZERO, [DVec3::ZERO; 3]).reach(zero);
        assert_eq!(reach, Some(f64::from(f32::MIN_POSITIVE)));
    }

    /// Boxes beside, above and below a point of a triangle of size 4, on each axis.
    #[test]
    fn the_larger_a_neighbour_is_the_farther_it_may_be() {
        let point = DVec3::new(1.0, -2.0, 3.0);
        let corners = [point - DVec3::X, point + DVec3::Y * 4.0, point];
        let nearby = Nearby::new(point, corners);
        for (size, counted) in [(0.5, 0.5), (2.0, 2.0), (4.0, 4.0), (100.0, 4.0)] {
            let reach = 2.0 * REACH * (3.0 + counted);
            for (axis, sign) in [0, 1, 2].into_iter().flat_map(|axis| [(axis, 1.0), (axis, -1.0)]) {
                let found = |gap: f64| {
                    let (mut low, mut high) = (point - size, point + size);
                    if sign > 0.0 {
                        low[axis] = point[axis] + gap
                    } else {
                        high[axis] = point[axis] - gap
                    }
                    nearby.reach([low, high])
                };
                let near = found(0.99 * reach).unwrap();
                assert!((near / reach - 1.0).abs() < 1e-6, "{near:e} {reach:e}");
                assert!(found(1.01 * reach).is_none(), "{size} {axis} {sign}");
            }
        }
    }

    /// So a tree may skip a node whose box is not near.
    #[test]
    fn what_lies_in_a_box_is_no_nearer_than_the_box() {
        let nearby = Nearby::new(DVec3::X, [DVec3::ZERO, DVec3::X * 1e6, DVec3::Y * 1e6]);
        let all = [DVec3::new(0.0, -1e4, 0.005), DVec3::new(1e4, 1e4, 1.0)];
        let part = [DVec3::new(0.5, -1.0, 0.005), DVec3::new(1.5, 1.0, 1.0)];
        assert!(nearby.reach(all).is_some() && nearby.reach(part).is_none());
        assert_eq!(nearby.within(all).reach(part), nearby.reach(part));
        assert_eq!(nearby.within(all).reach(all), nearby.reach(all));
    }
}
