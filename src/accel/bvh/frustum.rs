//! 16 coherent rays as one frustum: what lies outside of it, none of them meets.

use crate::ray::{LANES, Mask};

use super::Bounds3;
use super::query::{Query, max, min};

/// What finds the least of 16 numbers, none of them NaN.
pub trait Least: Copy {
    /// That number.
    fn least(self, v: &[f32; LANES]) -> f32;
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

/// What holds all active rays of one octant and one dominant axis k.
///
/// Between two depths the least coordinate of any ray is a concave function of z, as the least of
/// linear functions is, and lies above its chord; the greatest lies below its own. So four planes
/// bound the rays, tightly so where they leave from or run to a common point.
///
/// The planes are moved outwards by four times the largest [`Query::margin`]: one is what the exact
/// test's rounding asks for, the others pay for the rounding of the ends (8u max|v - o| + u|o|), of
/// `a` (3u(max|v - o| + |o|)), and of `a + b z` where it is used. Whatever `b` is, `a` is such that
/// the plane is outside of all rays at both ends.
#[derive(Debug, Clone, Copy)]
pub struct Frustum {
    /// The two axes after the dominant one, then the dominant one.
    pub axes: [usize; 3],
    /// Bit a: directions negative along axis a.
    pub octant: usize,
    /// No ray is below.
    pub low: [Side; 2],
    /// No ray is above.
    pub high: [Side; 2],
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
    /// Around the active rays of a query, which are coherent ([`Query::coherent`]), in a tree over
    /// `scene`; `tfar` holds the ends of their segments as boxes see them.
    #[inline(always)]
    pub fn new(
        tier: impl Least,
        query: &Query,
        active: &Mask,
        tfar: &[f32; LANES],
        scene: &Bounds3,
    ) -> Self {
        let lane = query.lane(active.first());
        let axes = lane.axes;
        let k = axes[2];
        let slack = 4.0 * greatest(tier, active, &query.margin);
        let negative = (lane.octant >> k) & 1 != 0;
        let (forward, scene_end) =
            if negative { (-1.0, -scene.lower()[k]) } else { (1.0, scene.upper()[k]) };
        let mut starts = [0.0; LANES];
        for i in 0..LANES {
            starts[i] = forward * query.origin[2][i];
        }
        let side = Side { a: 0.0, b: 0.0, row: k };
        let mut frustum = Self {
            axes,
            octant: lane.octant,
            low: [side; 2],
            high: [side; 2],
            forward,
            start: least(tier, active, &starts) - slack,
            enter: k + 3 * usize::from(negative),
            leave: k + 3 - 3 * usize::from(negative),
            slack,
            scene_end: scene_end + slack,
        };
        let end = max(frustum.end(tier, query, tfar), frustum.start);
        let (z0, z1) = (forward * frustum.start, forward * end);
        let inverse = 1.0 / (z1 - z0);
        for axis in 0..2 {
            let (mut x0, mut x1) = ([0.0; LANES], [0.0; LANES]);
            for i in 0..LANES {
                let (x, z, s) = (query.origin[axis][i], query.origin[2][i], query.shear[axis][i]);
                x0[i] = x + s * (z0 - z);
                x1[i] = x + s * (z1 - z);
            }
            let (low0, low1) = (least(tier, active, &x0), least(tier, active, &x1));
            let (high0, high1) = (greatest(tier, active, &x0), greatest(tier, active, &x1));
            let b = slope((low1 - low0) * inverse);
            let a = min(low0 - b * z0, low1 - b * z1) - slack;
            frustum.low[axis] = Side { a, b, row: if b < 0.0 { k + 3 } else { k } };
            let b = slope((high1 - high0) * inverse);
            let a = max(high0 - b * z0, high1 - b * z1) + slack;
            frustum.high[axis] = Side { a, b, row: if b < 0.0 { k } else { k + 3 } };
        }
        frustum
    }

    /// Where the last ray ends, in units of `forward` z; -inf if all `tfar` are.
    #[inline(always)]
    pub fn end(&self, tier: impl Least, query: &Query, tfar: &[f32; LANES]) -> f32 {
        let mut minus = [0.0; LANES];
        for i in 0..LANES {
            let end = self.forward * query.origin[2][i] + tfar[i] * query.along[i].abs();
            // A lane without a ray may hold anything. (A condition that asks for `tfar` alone becomes 16 jumps.)
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

/// The least value of the active lanes.
#[inline(always)]
fn least(tier: impl Least, active: &Mask, v: &[f32; LANES]) -> f32 {
    let mut selected = [f32::INFINITY; LANES];
    for i in 0..LANES {
        selected[i] = if active.0[i] != 0 { v[i] } else { f32::INFINITY };
    }
    tier.least(&selected)
}

/// The greatest value of the active lanes.
#[inline(always)]
fn greatest(tier: impl Least, active: &Mask, v: &[f32; LANES]) -> f32 {
    let mut minus = [f32::INFINITY; LANES];
    for i in 0..LANES {
        minus[i] = if active.0[i] != 0 { -v[i] } else { f32::INFINITY };
    }
    -tier.least(&minus)
}
