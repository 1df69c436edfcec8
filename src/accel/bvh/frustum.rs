//! 16 coherent rays as one frustum: what lies outside of it, none of them meets.

use crate::ray::{LANES, Mask};

use super::Bounds3;
use super::query::{Query, max, min};

/// What finds the least of 16 numbers, none of them NaN.
pub trait Least: Copy {
    /// That number.
    fn least(self, v: &[f32; LANES]) -> f32;

    /// That of each row.
    #[inline(always)]
    fn least_of_rows(self, rows: &[[f32; LANES]; 8]) -> [f32; 8] {
        let mut least = [0.0; 8];
        for (least, row) in least.iter_mut().zip(rows) {
            *least = self.least(row);
        }
        least
    }
}

/// A plane `x = a + b z` across one of the axes after the dominant one, z along that one.
#[derive(Debug, Clone, Copy)]
pub struct Side {
    /// Where z = 0.
    pub a: f32,
    /// Slope, of magnitude 1.5 at most.
    pub b: f32,
    /// For a box the row of [`super::node::Node::planes`] with the end of its range of z where the
    /// plane is outermost.
    pub row: usize,
}

/// What holds all active rays of one dominant axis k and one direction along it.
///
/// Between two depths the least coordinate of any ray is a concave function of z, as the least of
/// linear functions is, and lies above its chord; the greatest lies below its own. So four planes
/// bound the rays, tightly so where they leave from or run to a common point.
///
/// The planes are moved outwards by 1.5 times the largest [`Query::margin`], 99u max|v - o| +
/// 6u|o|: a hit may lie 64u max|v - o| outside of its box, 13u pay for the rounding of the ends (8u
/// max|v - o| + u|o|), of `a` (3u(max|v - o| + |o|)), and of `a + b z` where it is used. Whatever
/// `b` is, `a` is such that the plane is outside of all rays at both ends.
#[derive(Debug, Clone, Copy)]
pub struct Frustum {
    /// The two axes after the dominant one, then the dominant one.
    pub axes: [usize; 3],
    /// Bit a: the first ray's direction is negative along axis a.
    pub octant: usize,
    /// Of the four sides [`Side::a`]: low and low, high and high.
    a: [f32; 4],
    /// [`Side::b`].
    b: [f32; 4],
    /// [`Side::row`].
    rows: [u32; 4],
    /// 1 or -1: the direction along the dominant axis.
    pub forward: f32,
    /// No ray starts before, in units of `forward` z.
    pub start: f32,
    /// The row of a box's planes that it is entered through along the dominant axis.
    pub enter: usize,
    /// The row that it is left through.
    pub leave: usize,
    /// How far everything was moved outwards.
    slack: f32,
    /// The scene ends here, in units of `forward` z.
    scene_end: f32,
}

impl Frustum {
    /// Around the active rays of a query, which are aligned ([`Query::aligned`]), in a tree over
    /// `scene`; `tfar` holds the ends of their segments as boxes see them. With it where it ends:
    /// see [`Frustum::end`].
    #[inline(always)]
    pub fn new(
        tier: impl Least,
        query: &Query,
        active: &Mask,
        tfar: &[f32; LANES],
        scene: &Bounds3,
    ) -> (Self, f32) {
        let lane = query.lane(active.first());
        let axes = lane.axes;
        let k = axes[2];
        let (mut starts, mut margins) = ([0.0; LANES], [0.0; LANES]);
        let negative = (lane.octant >> k) & 1 != 0;
        let (forward, scene_end) =
            if negative { (-1.0, -scene.lower()[k]) } else { (1.0, scene.upper()[k]) };
        for i in 0..LANES {
            starts[i] = forward * query.origin[2][i];
            margins[i] = -query.margin[i];
        }
        let slack = -1.5 * tier.least(&select(active, &margins));
        let mut frustum = Self {
            axes,
            octant: lane.octant,
            a: [0.0; 4],
            b: [0.0; 4],
            rows: [0; 4],
            forward,
            start: tier.least(&select(active, &starts)) - slack,
            enter: k + 3 * usize::from(negative),
            leave: k + 3 - 3 * usize::from(negative),
            slack,
            scene_end: scene_end + slack,
        };
        let end = frustum.end(tier, query, tfar);
        let (z0, z1) = (forward * frustum.start, forward * max(end, frustum.start));
        // Where the rays are at z0 and at z1, and the same negated for the high sides: the least of
        // each.
        let mut ends = [[f32::INFINITY; LANES]; 8];
        for axis in 0..2 {
            for i in 0..LANES {
                let (x, z, s) = (query.origin[axis][i], query.origin[2][i], query.shear[axis][i]);
                let (x0, x1) = (x + s * (z0 - z), x + s * (z1 - z));
                let is_active = active.0[i] != 0;
                ends[axis][i] = if is_active { x0 } else { f32::INFINITY };
                ends[2 + axis][i] = if is_active { -x0 } else { f32::INFINITY };
                ends[4 + axis][i] = if is_active { x1 } else { f32::INFINITY };
                ends[6 + axis][i] = if is_active { -x1 } else { f32::INFINITY };
            }
        }
        let least = tier.least_of_rows(&ends);
        let inverse = 1.0 / (z1 - z0);
        for side in 0..4 {
            let (x0, x1) = (least[side], least[4 + side]);
            let b = slope((x1 - x0) * inverse);
            let a = min(x0 - b * z0, x1 - b * z1) - slack;
            let high = side >= 2;
            frustum.a[side] = if high { -a } else { a };
            frustum.b[side] = if high { -b } else { b };
            // Of a box that end of its range of z where the plane is outermost.
            let far = (b < 0.0) | (high & (b == 0.0));
            frustum.rows[side] = k as u32 + if far { 3 } else { 0 };
        }
        (frustum, end)
    }

    /// No ray is below these.
    #[inline(always)]
    pub fn low(&self) -> [Side; 2] {
        [self.side(0), self.side(1)]
    }

    /// No ray is above these.
    #[inline(always)]
    pub fn high(&self) -> [Side; 2] {
        [self.side(2), self.side(3)]
    }

    #[inline(always)]
    fn side(&self, i: usize) -> Side {
        Side { a: self.a[i], b: self.b[i], row: self.rows[i] as usize }
    }

    /// Where the last ray ends, in units of `forward` z; -inf if all `tfar` are.
    #[inline(always)]
    pub fn end(&self, tier: impl Least, query: &Query, tfar: &[f32; LANES]) -> f32 {
        let mut minus = [0.0; LANES];
        for i in 0..LANES {
            let end = self.forward * query.origin[2][i] + tfar[i] * query.along[i].abs();
            // A lane without a ray may hold anything. (A condition that asks for `tfar` alone
            // becomes 16 jumps.)
            minus[i] = if end > f32::NEG_INFINITY { -end } else { f32::INFINITY };
        }
        min(self.slack - tier.least(&minus), self.scene_end)
    }
}

/// A slope, or 0 for one that rounding made.
#[inline(always)]
fn slope(b: f32) -> f32 {
    if b.abs() <= 1.5 { b } else { 0.0 }
}

/// The values of the active lanes, infinite for the others. (A loop of its own: where it computes
/// the values, too, it becomes 16 jumps.)
#[inline(always)]
fn select(active: &Mask, v: &[f32; LANES]) -> [f32; LANES] {
    let mut selected = [f32::INFINITY; LANES];
    for i in 0..LANES {
        selected[i] = if active.0[i] != 0 { v[i] } else { f32::INFINITY };
    }
    selected
}
