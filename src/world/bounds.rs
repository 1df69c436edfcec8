//! Bounding boxes in world space, in f64.

use glam::{DAffine3, DVec3};

use crate::camera::sides;
use crate::math::absolute;
use crate::parallel;
use crate::scene::{CheckedCamera, ShapeKind};

/// An axis-aligned box; empty where `min > max`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Bounds {
    /// Corner with the lowest coordinates.
    pub min: DVec3,
    /// Corner with the highest coordinates.
    pub max: DVec3,
}

impl Bounds {
    /// The empty box, which contains nothing.
    pub const EMPTY: Self = Self { min: DVec3::INFINITY, max: DVec3::NEG_INFINITY };

    /// Returns the smallest box around the points that `point` returns for the indices below `n`,
    /// in parallel. `None` is skipped.
    pub fn from_points(n: usize, point: impl Fn(usize) -> Option<DVec3> + Sync) -> Self {
        let boxes = parallel::map(parallel::ranges(n, 1 << 16), |points| {
            points.filter_map(&point).fold(Self::EMPTY, Self::with)
        });
        boxes.into_iter().fold(Self::EMPTY, Self::union)
    }

    /// Returns the bounding box of a shape; empty for a mesh and its instances.
    pub fn from_shape(shape: &ShapeKind) -> Self {
        match shape {
            ShapeKind::Sphere { center, radius, .. } => {
                Self { min: *center - *radius, max: *center + *radius }
            }
            ShapeKind::Plane { corners } => corners.iter().copied().fold(Self::EMPTY, Self::with),
            ShapeKind::Triangle { corners } => {
                corners.iter().copied().fold(Self::EMPTY, Self::with)
            }
            ShapeKind::Trimesh(_) | ShapeKind::Instance { .. } => Self::EMPTY,
        }
    }

    /// Returns the box around the transformed box.
    pub fn transformed(self, transform: &DAffine3) -> Self {
        if self.min.cmpgt(self.max).any() {
            return Self::EMPTY;
        }
        let center = transform.transform_point3(self.center());
        let half = absolute(&transform.matrix3) * ((self.max - self.min) / 2.0);
        Self { min: center - half, max: center + half }
    }

    fn with(self, p: DVec3) -> Self {
        Self { min: self.min.min(p), max: self.max.max(p) }
    }

    /// Returns the smallest box around both boxes.
    pub fn union(self, other: Self) -> Self {
        Self { min: self.min.min(other.min), max: self.max.max(other.max) }
    }

    /// Returns the middle of the box; zero for an empty box.
    pub fn center(self) -> DVec3 {
        if self.min.cmple(self.max).all() {
            self.min + (self.max - self.min) / 2.0
        } else {
            DVec3::ZERO
        }
    }

    /// Returns an origin for coordinates in this box: the lower corner plus half of each side. The
    /// halves are rounded to steps of 2^-16 of the largest power of two that is not above the
    /// longest half. So they need few bits. If the box moves exactly in f64, the origin moves
    /// exactly with it, and all relative coordinates keep their bits.
    pub fn origin(self) -> DVec3 {
        let half = (self.max - self.min) / 2.0;
        let longest = half.max_element();
        // The largest power of two that is not above the longest half.
        let power = f64::from_bits(longest.to_bits() & (0x7ff << 52));
        let step = power / 65536.0;
        if step.is_normal() && longest > 0.0 {
            self.min + (half / step).round() * step
        } else {
            self.center()
        }
    }

    /// Returns the length of the longest side; negative for an empty box.
    pub fn longest_side(self) -> f64 {
        (self.max - self.min).max_element()
    }

    /// Returns the corners of the box.
    pub fn corners(self) -> [DVec3; 8] {
        std::array::from_fn(|i| {
            let pick = |bit: usize, low: f64, high: f64| if i & bit == 0 { low } else { high };
            DVec3::new(
                pick(1, self.min.x, self.max.x),
                pick(2, self.min.y, self.max.y),
                pick(4, self.min.z, self.max.z),
            )
        })
    }

    /// Returns true if the whole box lies behind the camera or outside of one side of its view. A
    /// box outside of the view may also give false.
    pub fn outside_view(self, camera: &CheckedCamera) -> bool {
        let corners = self.corners();
        let beyond = |(n, d): &(DVec3, f64)| {
            corners.iter().all(|corner| n.dot(*corner - camera.position) + d < 0.0)
        };
        sides(camera).iter().any(beyond)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_origin_moves_with_the_box_bit_for_bit() {
        let min = DVec3::new(-0.731, 0.1, 5.0).as_vec3().as_dvec3();
        let max = DVec3::new(1.377, 0.1, 5.000_001).as_vec3().as_dvec3();
        let still = Bounds { min, max };
        let shift = DVec3::new(4_500_000.0, 500_000.0, 120.0);
        let moved = Bounds { min: min + shift, max: max + shift };
        assert_eq!((moved.min - shift, moved.max - shift), (min, max), "the shift is exact");
        assert_eq!(moved.origin() - shift, still.origin());
        assert!((still.origin() - still.center()).abs().max_element() < 2e-5);
        let square = Bounds { min: DVec3::NEG_ONE, max: DVec3::ONE };
        assert_eq!(square.origin(), DVec3::ZERO);
        let point = Bounds { min: DVec3::ONE, max: DVec3::ONE };
        assert_eq!([point.origin(), Bounds::EMPTY.origin()], [DVec3::ONE, DVec3::ZERO]);
    }
}
