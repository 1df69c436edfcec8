//! A frustum around coherent rays. None of the rays hits anything outside the frustum.

use crate::ray::{LANES, Mask};

use super::bounds::Bounds3;
use super::query::{Lane, Query, max, min};

/// Largest magnitude of a side plane's slope. That of a ray is at most 1, before rounding.
const STEEPEST: f32 = 1.5;

/// How far the planes of a frustum are moved outwards, in units of [`Query::box_slack`]: see
/// [`Frustum`].
const SLACKS: f32 = 2.5;

/// Computes minima of 16 lanes. No lane may be NaN.
pub trait HorizontalMin: Copy {
    /// Returns the minimum of 16 lanes.
    fn horizontal_min(self, v: &[f32; LANES]) -> f32;

    /// Returns the minimum of each of 8 rows.
    #[inline(always)]
    fn horizontal_min_rows(self, rows: &[[f32; LANES]; 8]) -> [f32; 8] {
        let mut minima = [0.0; 8];
        for (minimum, row) in minima.iter_mut().zip(rows) {
            *minimum = self.horizontal_min(row);
        }
        minima
    }
}

/// A side plane of the frustum: `x = a + b z`.
///
/// z runs along the dominant axis, x along one of the two axes after it.
#[derive(Debug, Clone, Copy)]
pub struct Side {
    /// x at z = 0.
    pub a: f32,
    /// Slope, of magnitude [`STEEPEST`] at most.
    pub b: f32,
    /// Row of [`super::node::Node::planes`] with the z at which the plane lies outermost: the lower
    /// or the upper end of a box along z.
    pub row: usize,
}

/// A conservative bound of all active rays: four side planes, a start and an end. All rays have the
/// same dominant axis, and their directions have the same sign along it.
///
/// Between two depths, the smallest coordinate of the rays is a concave function of z, because it
/// is the minimum of linear functions. So it lies above its chord. The largest coordinate lies
/// below its chord. Therefore four planes through the chords bound the rays. They are tight if the
/// rays share an origin or an end point.
///
/// The planes are moved outwards by [`SLACKS`] times the largest [`Query::box_slack`], which is
/// 165u R + 10u|o| (u = 2^-24), where R is the largest |v - o| of the scene's box and a ray's
/// origin. So no plane leaves out a triangle that a ray hits, for 45u R + 10u|o| suffice:
///
/// - Where the ray's line passes through the sheared triangle of [`super::exact`], it is within
///   6u R of the triangle. Its depth is rounded by u R, which is 1.5u R along the slope `b`.
/// - Coordinates are below |o| + R, and `b` is at most [`STEEPEST`]. The roundings are u|o| + 4u R
///   of the ends; 1.5u of `b z` and 2.5u of each difference for `a`, times |o| + R; 1.5u (|o| + R)
///   of `b z` and u|o| + 4u R of the sum where `a + b z` is used. Together: 10u|o| + 16u R.
/// - The |o| of two rays differ by at most 2R, which is 20u R.
///
/// `b` need not be exact: whatever it is, `a` is chosen so that the plane is outside all rays at
/// both ends.
#[derive(Debug, Clone, Copy)]
pub struct Frustum {
    /// The two axes after the dominant one, then the dominant one.
    pub axes: [usize; 3],
    /// Octant of the first ray. Bit a is set if its direction is negative along axis a.
    pub octant: usize,
    /// [`Side::a`] of the four sides: two low, then two high.
    a: [f32; 4],
    /// [`Side::b`] of the four sides.
    b: [f32; 4],
    /// [`Side::row`] of the four sides.
    rows: [u32; 4],
    /// Sign of the directions along the dominant axis: 1 or -1. So `forward` z, the product, grows
    /// along every ray.
    pub forward: f32,
    /// No ray starts at a smaller `forward` z.
    pub start: f32,
    /// Row of the plane through which rays enter a box along the dominant axis.
    pub enter: usize,
    /// Row of the plane through which rays leave a box along the dominant axis.
    pub leave: usize,
    /// How far the planes were moved outwards.
    slack: f32,
    /// Largest `forward` z of the scene, moved outwards by `slack`.
    scene_end: f32,
}

impl Frustum {
    /// Bounds the active rays of a query, in a tree over `scene`. Also returns where they end: see
    /// [`Frustum::end_depth`].
    ///
    /// The rays must be aligned ([`Query::aligned`]), and `lane` must be one of them. `tfar` holds
    /// the ends of their segments, scaled like [`Query::tfar`], and -inf in inactive lanes.
    #[inline(always)]
    pub fn new(
        tier: impl HorizontalMin,
        lane: Lane,
        active: &Mask,
        tfar: &[f32; LANES],
        scene: &Bounds3,
    ) -> (Self, f32) {
        let (query, axes) = (lane.query, lane.axes);
        let k = axes[2];
        let (mut starts, mut box_slacks) = ([0.0; LANES], [0.0; LANES]);
        let negative = (lane.octant >> k) & 1 != 0;
        let (forward, scene_end) =
            if negative { (-1.0, -scene.lower()[k]) } else { (1.0, scene.upper()[k]) };
        for i in 0..LANES {
            starts[i] = forward * query.origin[2][i];
            box_slacks[i] = -query.box_slack[i];
        }
        let slack = -SLACKS * tier.horizontal_min(&select(active, &box_slacks));
        let start = tier.horizontal_min(&select(active, &starts)) - slack;
        let mut frustum =
            Self::without_sides(axes, lane.octant, forward, [start, scene_end + slack, slack]);
        let end = frustum.end_depth(tier, query, tfar);
        let (z0, z1) = (forward * frustum.start, forward * max(end, frustum.start));
        // The coordinates of the rays at z0 and at z1, and their negatives for the high sides. The
        // minimum of each row is the bound.
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
        frustum.set_sides([z0, z1], &tier.horizontal_min_rows(&ends));
        (frustum, end)
    }

    /// Returns a frustum along the last of `axes`, to be completed by [`Self::set_sides`]. `start`,
    /// `scene_end` and `slack` are the fields of the same names.
    #[inline(always)]
    pub fn without_sides(
        axes: [usize; 3],
        octant: usize,
        forward: f32,
        [start, scene_end, slack]: [f32; 3],
    ) -> Self {
        let (k, backward) = (axes[2], usize::from(forward < 0.0));
        Self {
            axes,
            octant,
            a: [0.0; 4],
            b: [0.0; 4],
            rows: [0; 4],
            forward,
            start,
            enter: k + 3 * backward,
            leave: k + 3 - 3 * backward,
            slack,
            scene_end,
        }
    }

    /// Sets the side planes. `minima` holds four values at z0, then four at z1: the smallest
    /// coordinates of the rays along the two axes, and the negatives of the largest ones.
    #[inline(always)]
    pub fn set_sides(&mut self, [z0, z1]: [f32; 2], minima: &[f32; 8]) {
        let inverse = 1.0 / (z1 - z0);
        for side in 0..4 {
            let (x0, x1) = (minima[side], minima[4 + side]);
            let b = slope((x1 - x0) * inverse);
            let a = min(x0 - b * z0, x1 - b * z1) - self.slack;
            let high = side >= 2;
            self.a[side] = if high { -a } else { a };
            self.b[side] = if high { -b } else { b };
            // The end of a box along z at which the plane lies outermost.
            let far = (b < 0.0) | (high & (b == 0.0));
            self.rows[side] = self.axes[2] as u32 + if far { 3 } else { 0 };
        }
    }

    /// Returns the planes below all rays.
    #[inline(always)]
    pub fn low(&self) -> [Side; 2] {
        [self.side(0), self.side(1)]
    }

    /// Returns the planes above all rays.
    #[inline(always)]
    pub fn high(&self) -> [Side; 2] {
        [self.side(2), self.side(3)]
    }

    #[inline(always)]
    fn side(&self, i: usize) -> Side {
        Side { a: self.a[i], b: self.b[i], row: self.rows[i] as usize }
    }

    /// Returns the `forward` z of the farthest end of a ray, or of the scene if that is nearer,
    /// moved outwards by `slack`. Returns -inf if all `tfar` are -inf.
    #[inline(always)]
    pub fn end_depth(&self, tier: impl HorizontalMin, query: &Query, tfar: &[f32; LANES]) -> f32 {
        let mut minus = [0.0; LANES];
        for i in 0..LANES {
            let end =
                self.forward * query.origin[2][i] + tfar[i] * query.dominant_component[i].abs();
            // `end` is -inf or NaN in inactive lanes. (A condition on `tfar` alone compiles to 16
            // jumps.)
            minus[i] = if end > f32::NEG_INFINITY { -end } else { f32::INFINITY };
        }
        min(self.slack - tier.horizontal_min(&minus), self.scene_end)
    }
}

/// Returns the slope, or 0 if rounding made it larger than [`STEEPEST`] or NaN.
#[inline(always)]
fn slope(b: f32) -> f32 {
    if b.abs() <= STEEPEST { b } else { 0.0 }
}

/// Returns the values of the active lanes, and infinity in the others.
///
/// A loop that also computes the values would compile to 16 jumps, so this has a loop of its own.
#[inline(always)]
pub fn select(active: &Mask, v: &[f32; LANES]) -> [f32; LANES] {
    let mut selected = [f32::INFINITY; LANES];
    for i in 0..LANES {
        selected[i] = if active.0[i] != 0 { v[i] } else { f32::INFINITY };
    }
    selected
}
