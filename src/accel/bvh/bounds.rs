//! Axis-aligned boxes of eight f32. The union of two boxes is one minimum in eight lanes.

use super::simd::min8::min8;

/// An axis-aligned box: the lower corner in lanes 0 to 2, the negated upper corner in lanes 4 to 6.
/// Lanes 3 and 7 are free for the owner.
#[derive(Debug, Clone, Copy)]
#[repr(C, align(32))]
pub struct Bounds3(pub [f32; 8]);

impl Bounds3 {
    /// The box without points, neutral for [`Self::union`].
    pub const EMPTY: Self = Self([f32::INFINITY; 8]);

    #[inline(always)]
    pub fn new(lower: [f32; 3], upper: [f32; 3]) -> Self {
        let ([a, b, c], [x, y, z]) = (lower, upper);
        Self([a, b, c, 0.0, -x, -y, -z, 0.0])
    }

    /// Returns the smallest box around points.
    #[inline(always)]
    pub fn from_points(points: &[[f32; 3]]) -> Self {
        points.iter().fold(Self::EMPTY, |b, &p| b.union(Self::new(p, p)))
    }

    /// Returns the smallest box around both boxes.
    #[inline(always)]
    #[must_use]
    pub fn union(self, other: Self) -> Self {
        Self(min8(self.0, other.0))
    }

    #[inline(always)]
    pub fn lower(&self) -> [f32; 3] {
        [self.0[0], self.0[1], self.0[2]]
    }

    #[inline(always)]
    pub fn upper(&self) -> [f32; 3] {
        [-self.0[4], -self.0[5], -self.0[6]]
    }

    /// Returns twice the centre of the box.
    #[inline(always)]
    pub fn center2(&self) -> [f32; 3] {
        [self.0[0] - self.0[4], self.0[1] - self.0[5], self.0[2] - self.0[6]]
    }

    /// Returns twice the centre as a box without extent.
    #[inline(always)]
    pub fn center2_point(&self) -> Self {
        let mut point = Self::EMPTY;
        for i in 0..4 {
            let center2 = self.0[i] - self.0[i + 4];
            (point.0[i], point.0[i + 4]) = (center2, -center2);
        }
        point
    }

    /// Returns this box if `keep`, else the empty box. Has no branch.
    #[inline(always)]
    #[must_use]
    pub fn or_empty(self, keep: bool) -> Self {
        let limit = [f32::INFINITY, f32::NEG_INFINITY][usize::from(keep)];
        let mut kept = self;
        for x in &mut kept.0 {
            *x = if *x > limit { *x } else { limit };
        }
        kept
    }

    /// Returns the extent along each axis; negative for an empty box.
    #[inline(always)]
    pub fn extent(&self) -> [f32; 3] {
        [-self.0[4] - self.0[0], -self.0[5] - self.0[1], -self.0[6] - self.0[2]]
    }

    /// Returns half the surface area; 0 for an empty box. In f64, because squares of large
    /// coordinates overflow f32.
    #[inline(always)]
    pub fn half_area(&self) -> f64 {
        let [x, y, z] = self.extent().map(|e| f64::from(e.max(0.0)));
        x * y + y * z + z * x
    }
}
