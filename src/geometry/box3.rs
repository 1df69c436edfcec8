//! Axis-aligned boxes in f64.

use glam::DVec3;

/// An axis-aligned box between two corners.
#[derive(Debug, Clone, Copy)]
pub struct Box3 {
    /// Corner of the smallest coordinates.
    pub min: DVec3,
    /// Corner of the largest coordinates.
    pub max: DVec3,
}

impl Box3 {
    /// The box without points, neutral for [`Self::union`].
    pub const EMPTY: Self = Self { min: DVec3::INFINITY, max: DVec3::NEG_INFINITY };

    /// Returns the smallest box around points.
    #[inline]
    pub fn of(points: &[DVec3]) -> Self {
        points.iter().fold(Self::EMPTY, |b, &p| b.union(Self { min: p, max: p }))
    }

    /// Returns the box around a sphere.
    pub fn of_sphere(center: DVec3, radius: f64) -> Self {
        Self { min: center - radius, max: center + radius }
    }

    /// Returns the smallest box around both boxes.
    #[must_use]
    #[inline]
    pub fn union(self, other: Self) -> Self {
        Self { min: self.min.min(other.min), max: self.max.max(other.max) }
    }

    /// Returns the smallest box around all boxes.
    pub fn around(boxes: impl IntoIterator<Item = Self>) -> Self {
        boxes.into_iter().fold(Self::EMPTY, Self::union)
    }

    /// Middle of the box.
    pub fn center(&self) -> DVec3 {
        (self.min + self.max) / 2.0
    }
}

/// Returns whether a ray is in all three slabs of a box at once, at a t between `near` and `far`.
///
/// `first` and `second` are, by axis, the t at which the ray crosses the two planes, in any order.
/// A NaN is dropped: the other plane of its axis then counts as both, and two NaN bound nothing.
#[inline(always)]
pub fn slabs_meet(first: DVec3, second: DVec3, [mut near, mut far]: [f64; 2]) -> bool {
    for (a, b) in first.to_array().into_iter().zip(second.to_array()) {
        near = near.max(a.min(b));
        far = far.min(a.max(b));
    }
    near <= far
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_box_lies_around_its_sphere_and_has_its_middle() {
        let center = DVec3::new(1.0, 2.0, 3.0);
        let around = Box3::of_sphere(center, 0.5);
        assert_eq!((around.min, around.max), (center - 0.5, center + 0.5));
        assert_eq!(around.center(), center);
    }

    #[test]
    fn slabs_meet_only_where_all_three_overlap() {
        let (first, second) = (DVec3::new(1.0, 4.0, 3.0), DVec3::new(5.0, 2.0, 4.5));
        // The ray is in all slabs from 3 to 4.
        let meet = |near, far| {
            let ends = [near, far];
            assert_eq!(slabs_meet(first, second, ends), slabs_meet(second, first, ends));
            slabs_meet(first, second, ends)
        };
        assert!(meet(0.0, 9.0) && meet(0.0, 3.0) && meet(4.0, 9.0));
        assert!(!meet(0.0, 2.9) && !meet(4.1, 9.0));
    }
}
