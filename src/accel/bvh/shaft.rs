//! Conservative test whether a [`Shaft`] is empty.

use super::bounds::Bounds3;
use super::frustum::{Frustum, HorizontalMin, select};
use super::leaves::{Leaf, Leaves};
use super::node::Block;
use super::packet::Bits;
use super::query::{max, min};
use super::simd::Tier;
use super::tree::Bvh;
use crate::accel::shaft::Shaft;
use crate::ray::LANES;
use crate::simd::Kernel;

/// Maximum number of triangles that a query tests. With more of them in the frustum, a shaft is
/// seldom empty, so the query returns true.
const MAX_TRIANGLES: u32 = 96;

/// Margin of the signs in [`Segments::may_hit`], relative to the largest magnitude of the terms:
/// 256u (u = 2^-24).
///
/// - An edge function is d.(a x b). Its terms are below 6 |d| m^2, where m is the largest
///   coordinate of a vertex relative to the origin. The test of [`super::exact`] moves a vertex by
///   at most 6u m, which changes the function by 72u |d| m^2. Rounding here adds 42u of it.
/// - A shadow ray's direction differs from the cone of the corners' directions by at most 6u of the
///   coordinates of light and origin. That changes the function by 36u of these times m^2.
const MARGIN: f32 = 128.0 * f32::EPSILON;

/// Margin of the signs in [`Segments::maybe_crossing`]: 512u. Let e be the largest coordinate of
/// the triangle's edges, m that of a vertex relative to a point, and f the distance of a vertex
/// from the origin. Rounding changes the point's side by at most 48u e^2 m. The test of
/// [`super::exact`] moves a vertex by at most 6u f. That changes the side by another
/// 180u e max(e, f) m.
const SIDE_MARGIN: f32 = 256.0 * f32::EPSILON;

/// Extent of points, light and scene from which a query returns true: the edge functions multiply
/// three coordinates, and f32 ends at 3e38.
const MAX_EXTENT: f32 = 1e12;

/// Returns false only if no shadow ray of a shaft hits anything.
pub struct MayHit<'a, T> {
    pub tier: T,
    pub bvh: &'a Bvh<'a>,
    pub shaft: &'a Shaft<'a>,
}

impl<T: Tier> Kernel for MayHit<'_, T> {
    type Output = bool;
    #[inline(always)]
    fn run(self) -> bool {
        let Self { tier, bvh, shaft } = self;
        let tree = &bvh.tree;
        let Some((frustum, end)) = Frustum::around(tier, shaft, &tree.bounds) else { return true };
        let mut segments = None;
        let mut left = MAX_TRIANGLES;
        for leaf in Leaves::new(tier, tree, (&frustum, end)) {
            let Leaf::Triangles(index, triangles) = leaf else { return true };
            let Some(rest) = left.checked_sub(triangles.count_ones()) else { return true };
            left = rest;
            let block = &tree.blocks[index];
            let segments = segments.get_or_insert_with(|| Segments::new(shaft));
            for slot in Bits(triangles) {
                if segments.may_hit(block, slot, tree.indices().of(block, slot)) {
                    return true;
                }
            }
        }
        false
    }
}

/// The segments of a shaft, for tests against single triangles.
struct Segments<'a> {
    shaft: &'a Shaft<'a>,
    /// [`MARGIN`] times a bound of |d| and of the coordinates that |d| is computed from, by lane.
    margin: [f32; LANES],
}

/// Three coordinates by lane.
type Lanes3 = [[f32; LANES]; 3];

impl<'a> Segments<'a> {
    #[inline(always)]
    fn new(shaft: &'a Shaft) -> Self {
        let [ox, oy, oz] = shaft.origins;
        let mut far = 0.0;
        for corner in shaft.corners {
            for x in corner {
                far = max(far, x.abs());
            }
        }
        let mut margin = [0.0; LANES];
        for i in 0..LANES {
            let origin = max(max(ox[i].abs(), oy[i].abs()), oz[i].abs());
            margin[i] = MARGIN * 2.0 * (origin + far);
        }
        Self { shaft, margin }
    }

    /// Returns the lanes whose segments may cross the triangle's plane: all bits are set. In other
    /// active lanes, origin and light lie on one side of the plane, or the ray leaves the triangle.
    /// This cheap test decides most triangles. If there are no such lanes, no ray that begins
    /// between the points crosses the plane either.
    #[inline(always)]
    fn maybe_crossing(&self, [p, q, r]: [[f32; 3]; 3], primitive: u32) -> [i32; LANES] {
        let from = |v: [f32; 3]| [v[0] - p[0], v[1] - p[1], v[2] - p[2]];
        let (a, b) = (from(q), from(r));
        let n = [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
        let size = |v: [f32; 3]| max(max(v[0].abs(), v[1].abs()), v[2].abs());
        let edge = max(size(a), size(b));
        let (mut low, mut high, mut far) = (f32::INFINITY, f32::NEG_INFINITY, 0.0);
        for corner in self.shaft.corners {
            let c = from(*corner);
            let side = n[0] * c[0] + n[1] * c[1] + n[2] * c[2];
            (low, high, far) = (min(low, side), max(high, side), max(far, size(c)));
        }
        let [ox, oy, oz] = self.shaft.origins;
        let mut lanes = [0; LANES];
        for i in 0..LANES {
            let o = [ox[i] - p[0], oy[i] - p[1], oz[i] - p[2]];
            let side = n[0] * o[0] + n[1] * o[1] + n[2] * o[2];
            let near = size(o);
            // 1e-30 is added for underflow.
            let unit = SIDE_MARGIN * edge * max(edge, near);
            let (margin, light_margin) = (unit * near + 1e-30, unit * far + 1e-30);
            let before = (side > margin) & (low > light_margin);
            let behind = (side < -margin) & (high < -light_margin);
            let own = self.shaft.leaving[i] == primitive;
            lanes[i] = self.shaft.active.0[i] & -i32::from(!(before | behind | own));
        }
        lanes
    }

    /// Returns false only if no shadow ray of any lane hits the triangle in `slot`, whose
    /// scene-wide index is `primitive`.
    ///
    /// A ray misses if two of its edge functions have different signs. The functions are linear in
    /// the direction, so their values at the corners of the light bound them. A ray also misses if
    /// its parameter at the triangle's plane is negative.
    #[inline(always)]
    fn may_hit(&self, block: &Block, slot: usize, primitive: u32) -> bool {
        let [p, q, r] = block.triangle(slot);
        let lanes = self.maybe_crossing([p, q, r], primitive);
        if lanes == [0; LANES] {
            return false;
        }
        let o = self.shaft.origins;
        let (a, b, c) = (minus(&p, o), minus(&q, o), minus(&r, o));
        let normals = [cross(&a, &b), cross(&b, &c), cross(&c, &a)];
        let (mut low, mut high) = ([[f32::INFINITY; LANES]; 4], [[f32::NEG_INFINITY; LANES]; 4]);
        for corner in self.shaft.corners {
            let d = minus(corner, o);
            let edges = [dot(&d, &normals[0]), dot(&d, &normals[1]), dot(&d, &normals[2])];
            for i in 0..LANES {
                let all = edges[0][i] + edges[1][i] + edges[2][i];
                (low[3][i], high[3][i]) = (min(low[3][i], all), max(high[3][i], all));
            }
            for k in 0..3 {
                for i in 0..LANES {
                    low[k][i] = min(low[k][i], edges[k][i]);
                    high[k][i] = max(high[k][i], edges[k][i]);
                }
            }
        }
        if self.shaft.between {
            return self.may_hit_between(&low, &high, [&a, &b, &c]);
        }
        let heights = dot(&a, &normals[1]);
        let mut may_hit = 0;
        for i in 0..LANES {
            let m = max(max(largest(&a, i), largest(&b, i)), largest(&c, i));
            // 1e-30 is added for underflow.
            let margin = m * m * self.margin[i] + 1e-30;
            let positive = (low[0][i] > margin) | (low[1][i] > margin) | (low[2][i] > margin);
            let negative = (high[0][i] < -margin) | (high[1][i] < -margin) | (high[2][i] < -margin);
            let slack = MARGIN * m * m * m + 1e-30;
            // The sum of the edge functions has three times their error.
            let behind = ((heights[i] > slack) & (high[3][i] < -3.0 * margin))
                | ((heights[i] < -slack) & (low[3][i] > 3.0 * margin));
            let misses = (positive & negative) | behind;
            may_hit |= lanes[i] & -i32::from(!misses);
        }
        may_hit != 0
    }

    /// [`Segments::may_hit`] for rays that also begin between the points. `low` and `high` bound
    /// the edge functions of each point; `corners` are the triangle's, relative to each point.
    ///
    /// An edge function is the volume of a tetrahedron, so it is linear in the point as well. Its
    /// values at the points bound the values between them.
    #[inline(always)]
    fn may_hit_between(
        &self,
        low: &[[f32; LANES]; 4],
        high: &[[f32; LANES]; 4],
        corners: [&Lanes3; 3],
    ) -> bool {
        let (mut m, mut margin) = (0.0, 0.0);
        let (mut lowest, mut highest) = ([f32::INFINITY; 3], [f32::NEG_INFINITY; 3]);
        for i in (0..LANES).filter(|&i| self.shaft.active.0[i] != 0) {
            for corner in corners {
                m = max(m, largest(corner, i));
            }
            margin = max(margin, self.margin[i]);
            for k in 0..3 {
                lowest[k] = min(lowest[k], low[k][i]);
                highest[k] = max(highest[k], high[k][i]);
            }
        }
        let margin = m * m * margin + 1e-30;
        let positive = max(max(lowest[0], lowest[1]), lowest[2]) > margin;
        let negative = min(min(highest[0], highest[1]), highest[2]) < -margin;
        !(positive & negative)
    }
}

/// Returns a point relative to the origin of each lane.
#[inline(always)]
fn minus(point: &[f32; 3], origins: &Lanes3) -> Lanes3 {
    let mut d = [[0.0; LANES]; 3];
    for axis in 0..3 {
        for i in 0..LANES {
            d[axis][i] = point[axis] - origins[axis][i];
        }
    }
    d
}

#[inline(always)]
fn dot(a: &Lanes3, b: &Lanes3) -> [f32; LANES] {
    let mut dot = [0.0; LANES];
    for i in 0..LANES {
        dot[i] = a[0][i] * b[0][i] + a[1][i] * b[1][i] + a[2][i] * b[2][i];
    }
    dot
}

#[inline(always)]
fn cross(a: &Lanes3, b: &Lanes3) -> Lanes3 {
    let mut cross = [[0.0; LANES]; 3];
    for axis in 0..3 {
        let (j, k) = ((axis + 1) % 3, (axis + 2) % 3);
        for i in 0..LANES {
            cross[axis][i] = a[j][i] * b[k][i] - a[k][i] * b[j][i];
        }
    }
    cross
}

/// Returns the largest magnitude of the coordinates of lane `i`.
#[inline(always)]
fn largest(a: &Lanes3, i: usize) -> f32 {
    max(max(a[0][i].abs(), a[1][i].abs()), a[2][i].abs())
}

impl Frustum {
    /// Bounds all segments of a shaft. Also returns where they end: see [`Frustum::end_depth`].
    /// Returns `None` if there is no axis along which all segments run in the same direction.
    ///
    /// The axis of the frustum is the one with the widest gap between points and light. A line from
    /// a point through the light crosses a plane normal to that axis between the lines through the
    /// corners. So the lines through the corners bound all lines.
    #[inline(always)]
    fn around(tier: impl HorizontalMin, shaft: &Shaft, scene: &Bounds3) -> Option<(Self, f32)> {
        let (origins, active) = (shaft.origins, &shaft.active);
        let (low, high) = ends(tier, shaft);
        let (near, far) = corners(shaft);
        // The gap between the points and the light along each axis. Negative if they overlap.
        let mut gaps = [0.0; 3];
        for axis in 0..3 {
            gaps[axis] = max(near[axis] - high[axis], low[axis] - far[axis]);
        }
        let z = gaps[2] >= max(gaps[0], gaps[1]);
        let k = if z { 2 } else { usize::from(gaps[1] >= gaps[0]) };
        if !(gaps[k] > 0.0) {
            return None;
        }
        let axes = [(k + 1) % 3, (k + 2) % 3, k];
        let backward = far[k] < low[k];
        let (lower, upper) = (scene.lower(), scene.upper());
        let (mut reach, mut size, mut octant) = (0.0, 0.0, 0);
        for axis in 0..3 {
            reach = max(reach, max(high[axis] - lower[axis], upper[axis] - low[axis]));
            size = max(size, max(low[axis].abs(), high[axis].abs()));
            size = max(size, max(near[axis].abs(), far[axis].abs()));
            octant |= usize::from(near[axis] < low[axis]) << axis;
        }
        if !(max(reach, size) < MAX_EXTENT) {
            return None;
        }
        // At least what `Frustum` needs, 45u of the reach and 10u of the coordinates (u = 2^-24),
        // another 2u of the reach for the inverse, and 6u for the light's rounded points. Lines
        // that leave the scene round by u of `size` at each of three steps.
        let slack = (64.0 * reach + 16.0 * size) * f32::EPSILON + 8.0 * f32::MIN_POSITIVE;
        let (forward, scene_end, start, light) = match backward {
            true => (-1.0, -lower[k], -high[k], -near[k]),
            false => (1.0, upper[k], low[k], far[k]),
        };
        let (scene_end, start) = (scene_end + slack, start - slack);
        let end = min(light + slack, scene_end);
        let (z0, z1) = (forward * start, forward * max(end, start));
        let mut rows = [[f32::INFINITY; LANES]; 8];
        for corner in shaft.corners {
            let mut inverse = [0.0; LANES];
            for i in 0..LANES {
                inverse[i] = 1.0 / (corner[k] - origins[k][i]);
            }
            for axis in 0..2 {
                let j = axes[axis];
                for i in 0..LANES {
                    let (x, z) = (origins[j][i], origins[k][i]);
                    let slope = (corner[j] - x) * inverse[i];
                    let (x0, x1) = (x + slope * (z0 - z), x + slope * (z1 - z));
                    rows[axis][i] = min(x0, rows[axis][i]);
                    rows[2 + axis][i] = min(-x0, rows[2 + axis][i]);
                    rows[4 + axis][i] = min(x1, rows[4 + axis][i]);
                    rows[6 + axis][i] = min(-x1, rows[6 + axis][i]);
                }
            }
        }
        for row in &mut rows {
            *row = select(active, row);
        }
        let mut frustum = Self::without_sides(axes, octant, forward, [start, scene_end, slack]);
        frustum.set_sides([z0, z1], &tier.horizontal_min_rows(&rows));
        Some((frustum, end))
    }
}

/// Returns the smallest and the largest coordinates of the points of a shaft.
#[inline(always)]
fn ends(tier: impl HorizontalMin, shaft: &Shaft) -> ([f32; 3], [f32; 3]) {
    let mut rows = [[f32::INFINITY; LANES]; 8];
    for axis in 0..3 {
        let mut minus = [0.0; LANES];
        for i in 0..LANES {
            minus[i] = -shaft.origins[axis][i];
        }
        rows[axis] = select(&shaft.active, &shaft.origins[axis]);
        rows[3 + axis] = select(&shaft.active, &minus);
    }
    let [x, y, z, minus_x, minus_y, minus_z, ..] = tier.horizontal_min_rows(&rows);
    ([x, y, z], [-minus_x, -minus_y, -minus_z])
}

/// Returns the smallest and the largest coordinates of the corners of a shaft's light.
#[inline(always)]
fn corners(shaft: &Shaft) -> ([f32; 3], [f32; 3]) {
    let (mut near, mut far) = ([f32::INFINITY; 3], [f32::NEG_INFINITY; 3]);
    for corner in shaft.corners {
        for axis in 0..3 {
            near[axis] = min(corner[axis], near[axis]);
            far[axis] = max(corner[axis], far[axis]);
        }
    }
    (near, far)
}
