//! A box as eight f32 that one instruction joins with another.

use super::simd::min8;

/// An axis-aligned box. Lane 3 and 7 carry what the owner likes.
#[derive(Debug, Clone, Copy)]
#[repr(C, align(32))]
pub struct Bounds3(pub [f32; 8]);

impl Bounds3 {
    /// No point.
    pub const EMPTY: Self = Self([f32::INFINITY; 8]);

    /// The box from `lower` to `upper`.
    #[inline(always)]
    pub fn new(lower: [f32; 3], upper: [f32; 3]) -> Self {
        let ([a, b, c], [x, y, z]) = (lower, upper);
        Self([a, b, c, 0.0, -x, -y, -z, 0.0])
    }

    /// The smallest box around points.
    #[inline(always)]
    pub fn of(points: &[[f32; 3]]) -> Self {
        points.iter().fold(Self::EMPTY, |b, &p| b.union(Self::new(p, p)))
    }

    /// The smallest box around both.
    #[inline(always)]
    #[must_use]
    pub fn union(self, other: Self) -> Self {
        Self(min8(self.0, other.0))
    }

    /// Least corner.
    #[inline(always)]
    pub fn lower(&self) -> [f32; 3] {
        [self.0[0], self.0[1], self.0[2]]
    }

    /// Greatest corner.
    #[inline(always)]
    pub fn upper(&self) -> [f32; 3] {
        [-self.0[4], -self.0[5], -self.0[6]]
    }

    /// Twice the centre.
    #[inline(always)]
    pub fn center2(&self) -> [f32; 3] {
        [self.0[0] - self.0[4], self.0[1] - self.0[5], self.0[2] - self.0[6]]
    }

    /// Twice the centre, as a box.
    #[inline(always)]
    pub fn center2_point(&self) -> Self {
        let mut point = Self::EMPTY;
        for i in 0..4 {
            let center2 = self.0[i] - self.0[i + 4];
            (point.0[i], point.0[i + 4]) = (center2, -center2);
        }
        point
    }

    /// This box, or none: without a branch.
    #[inline(always)]
    #[must_use]
    pub fn or_empty(self, keep: bool) -> Self {
        let least = [f32::INFINITY, f32::NEG_INFINITY][usize::from(keep)];
        let mut kept = self;
        for x in &mut kept.0 {
            *x = if *x > least { *x } else { least };
        }
        kept
    }

    /// Extents, negative for an empty box.
    #[inline(always)]
    pub fn extent(&self) -> [f32; 3] {
        [-self.0[4] - self.0[0], -self.0[5] - self.0[1], -self.0[6] - self.0[2]]
    }

    /// Half the surface area; 0 for an empty box. f64: squares of large coordinates.
    #[inline(always)]
    pub fn half_area(&self) -> f64 {
        let [x, y, z] = self.extent().map(|e| f64::from(e.max(0.0)));
        x * y + y * z + z * x
    }
}
