//! 16 rays made ready for the tree: slabs that err to the safe side, and the shear.

use crate::ray::{LANES, Mask, Rays};

use super::Bounds3;

/// Half an ulp of 1: the largest relative error of one f32 operation.
const U: f32 = f32::EPSILON / 2.0;

/// Smallest magnitude of a direction component, relative to the largest: keeps 1/d and o/d
/// finite, so that no 0 * inf arises.
pub const MIN_DIRECTION: f32 = 1.0 / (1u64 << 60) as f32;

/// By the dominant axis: the two after it in cyclic order, then itself. A static: a table in the
/// code is written to the stack for every ray.
static AXES: [[usize; 3]; 4] = [[1, 2, 0], [2, 0, 1], [0, 1, 2], [0, 1, 2]];

/// 16 rays against boxes and against triangles.
///
/// Directions are scaled by a power of two (exact) so that the largest component is in [1, 2);
/// `scale` takes ray parameters there.
///
/// Boxes. A slab is `t = plane * inverse - offset` in one fused operation or two. Every box is
/// widened by `margin`, folded into the offsets, and every distance by 4u, folded into the
/// inverses, so that no rounding prunes what [`super::exact`] would hit:
/// - The triangle test moves a vertex in the plane normal to the dominant axis by at most 6u max|v
///   - o| (see there), so where it reports a hit the ray passes within that distance of the
///   triangle, hence of its box, and it keeps the hit within 64u max|v - o| of that box: `margin`
///   >= 64u max|v - o| over the scene's box.
/// - Rounding of `o + margin`, of the product with the inverse, and of the fused operation's
///   second operand move a plane by at most 4u|o|: part of `margin`.
/// - The inverse and the last rounding are relative errors of at most 3.5u: 4u taken off the near
///   distance and added to the far one (Ize 2013, JCGT 2(2)). Near distances below zero do not
///   matter, as t starts at `tnear` >= 0.
/// - A component below `MIN_DIRECTION` is lifted to it: the ray strays by at most MIN_DIRECTION
///   times the scene, 2^-60 against 2^-22 in `margin`.
#[derive(Debug)]
#[repr(C, align(64))]
pub struct Query {
    /// Inverse direction, made smaller by 4u.
    pub near_inverse: [[f32; LANES]; 3],
    /// (origin + margin) * inverse.
    pub near_offset: [[f32; LANES]; 3],
    /// Inverse direction, made larger by 4u.
    pub far_inverse: [[f32; LANES]; 3],
    /// (origin - margin) * inverse.
    pub far_offset: [[f32; LANES]; 3],
    /// How far boxes are widened.
    pub margin: [f32; LANES],
    /// Start of the segment, scaled.
    pub tnear: [f32; LANES],
    /// End of the segment, scaled.
    pub tfar: [f32; LANES],
    /// What ray parameters were multiplied with.
    pub scale: [f32; LANES],
    /// Bit a: direction negative along axis a.
    pub octant: [u32; LANES],
    /// Axis along which the direction is largest.
    pub dominant: [u32; LANES],
    /// Origin along the two axes after the dominant one in cyclic order, then along that.
    pub origin: [[f32; LANES]; 3],
    /// Direction over its dominant component, for the two axes after the dominant one.
    pub shear: [[f32; LANES]; 2],
    /// Scaled direction along the dominant axis, of magnitude 1 to 2.
    pub along: [f32; LANES],
}

impl Query {
    /// Makes rays ready for a tree over `scene`.
    #[inline(always)]
    pub fn new(rays: &Rays, scene: &Bounds3) -> Self {
        let [ox, oy, oz] = &rays.org;
        let mut direction = [[0.0f32; LANES]; 3];
        let (mut scale, mut tnear, mut tfar) = ([0.0f32; LANES], [0.0f32; LANES], [0.0f32; LANES]);
        for i in 0..LANES {
            let (x, y, z) = (rays.dir[0][i], rays.dir[1][i], rays.dir[2][i]);
            let largest = max(max(x.abs(), y.abs()), z.abs());
            // Of the ends of the range the neighbours: what `down` undoes, `up` must restore.
            let exponent = (largest.to_bits() >> 23).clamp(1, 253);
            let down = f32::from_bits((254 - exponent) << 23);
            let up = f32::from_bits(exponent << 23);
            scale[i] = up;
            tnear[i] = rays.tnear[i] * up * (1.0 - 4.0 * U);
            tfar[i] = rays.tfar[i] * up * (1.0 + 4.0 * U) + f32::MIN_POSITIVE;
            (direction[0][i], direction[1][i], direction[2][i]) = (x * down, y * down, z * down);
        }
        let (lower, upper) = (scene.lower(), scene.upper());
        let (mut margin, mut least) = ([0.0f32; LANES], [0.0f32; LANES]);
        for i in 0..LANES {
            let (mut reach, mut origin) = (0.0f32, 0.0f32);
            for axis in 0..3 {
                let o = rays.org[axis][i];
                reach = max(reach, max((lower[axis] - o).abs(), (upper[axis] - o).abs()));
                origin = max(origin, o.abs());
            }
            // Coordinates beyond 2^62 would overflow with 1/LEAST: a larger least, and its strays
            // in the margin.
            let lift = max(MIN_DIRECTION, (reach + origin) * (16.0 / f32::MAX));
            least[i] = lift;
            margin[i] =
                (66.0 * U + 2.0 * lift) * reach + 4.0 * U * origin + 4.0 * f32::MIN_POSITIVE;
        }
        let mut octant = [0u32; LANES];
        let (mut near_inverse, mut near_offset) = ([[0.0; LANES]; 3], [[0.0; LANES]; 3]);
        let (mut far_inverse, mut far_offset) = ([[0.0; LANES]; 3], [[0.0; LANES]; 3]);
        for axis in 0..3 {
            for i in 0..LANES {
                let d = direction[axis][i];
                let d = max(d.abs(), least[i]).copysign(d);
                let inverse = 1.0 / d;
                let out = margin[i].copysign(d);
                let (near, far) = (inverse * (1.0 - 4.0 * U), inverse * (1.0 + 4.0 * U));
                let o = rays.org[axis][i];
                near_inverse[axis][i] = near;
                far_inverse[axis][i] = far;
                near_offset[axis][i] = (o + out) * near;
                far_offset[axis][i] = (o - out) * far;
                octant[i] |= (d.to_bits() >> 31) << axis;
            }
        }
        let [dx, dy, dz] = &direction;
        let mut dominant = [0u32; LANES];
        let (mut origin, mut shear, mut along) =
            ([[0.0; LANES]; 3], [[0.0; LANES]; 2], [0.0; LANES]);
        for i in 0..LANES {
            let (ax, ay, az) = (dx[i].abs(), dy[i].abs(), dz[i].abs());
            let z = az >= max(ax, ay);
            let y = !z & (ay >= ax);
            let pick = |x_first: f32, y_first: f32, z_first: f32| {
                if z {
                    z_first
                } else if y {
                    y_first
                } else {
                    x_first
                }
            };
            dominant[i] = if z { 2 } else { u32::from(y) };
            origin[0][i] = pick(oy[i], oz[i], ox[i]);
            origin[1][i] = pick(oz[i], ox[i], oy[i]);
            origin[2][i] = pick(ox[i], oy[i], oz[i]);
            let d = pick(dx[i], dy[i], dz[i]);
            along[i] = d;
            shear[0][i] = pick(dy[i], dz[i], dx[i]) / d;
            shear[1][i] = pick(dz[i], dx[i], dy[i]) / d;
        }
        Self {
            near_inverse,
            near_offset,
            far_inverse,
            far_offset,
            margin,
            tnear,
            tfar,
            scale,
            octant,
            dominant,
            origin,
            shear,
            along,
        }
    }

    /// Those of the rays that are coherent with the first of them: of its octant and its dominant
    /// axis.
    #[inline(always)]
    pub fn coherent(&self, rays: &Mask) -> Mask {
        let first = rays.first();
        let (octant, dominant) = (self.octant[first], self.dominant[first]);
        let mut part = Mask::NONE;
        for i in 0..LANES {
            let same = (self.octant[i] == octant) & (self.dominant[i] == dominant);
            part.0[i] = rays.0[i] & -i32::from(same);
        }
        part
    }

    /// Those of the rays that are aligned with the first of them: of its dominant axis, and of its
    /// direction along that.
    #[inline(always)]
    pub fn aligned(&self, rays: &Mask) -> Mask {
        let first = rays.first();
        let dominant = self.dominant[first];
        let sign = self.along[first].to_bits() >> 31;
        let mut part = Mask::NONE;
        for i in 0..LANES {
            let same = (self.dominant[i] == dominant) & (self.along[i].to_bits() >> 31 == sign);
            part.0[i] = rays.0[i] & -i32::from(same);
        }
        part
    }

    /// What a hit of ray `i` at `t` makes of its end as the boxes see it: scaled, and never less
    /// for what underflows.
    #[inline(always)]
    pub fn end(&self, i: usize, t: f64) -> f32 {
        (t as f32 + f32::MIN_POSITIVE) * self.scale[i] + f32::MIN_POSITIVE
    }

    /// How far along the dominant axis ray `i` is at a scaled parameter, or a bit farther: what
    /// lies beyond is farther than the parameter.
    #[inline(always)]
    pub fn depth(&self, i: usize, t: f32) -> f32 {
        t * self.along[i].abs() * (1.0 + 8.0 * U)
    }

    /// Whether all of ray `i` between two distances along the dominant axis lies within its open
    /// segment for sure.
    #[inline(always)]
    pub fn within(&self, i: usize, first: f32, last: f32) -> bool {
        let along = self.along[i].abs();
        // 16u are more than the ends were moved by and all roundings here; the least normal numbers
        // pay for what underflows.
        (first > self.tnear[i] * along * (1.0 + 16.0 * U) + 4.0 * f32::MIN_POSITIVE)
            & (last < self.tfar[i] * along * (1.0 - 16.0 * U) - 4.0 * f32::MIN_POSITIVE)
    }

    /// Ray `i` alone.
    #[inline(always)]
    pub fn lane(&self, i: usize) -> Lane<'_> {
        let i = i % LANES;
        let k = self.dominant[i] as usize;
        let axes = AXES[k % 4];
        let octant = self.octant[i] as usize % 8;
        let (x, y, z) = (octant & 1, (octant >> 1) & 1, octant >> 2);
        let enter = [3 * x, 1 + 3 * y, 2 + 3 * z];
        let leave = [3 - 3 * x, 4 - 3 * y, 5 - 3 * z];
        Lane { query: self, i, octant, axes, enter, leave }
    }
}

/// What of a ray the boxes see.
#[derive(Debug, Clone, Copy)]
pub struct Slabs {
    /// See [`Query`].
    pub near_inverse: [f32; 3],
    /// See [`Query`].
    pub near_offset: [f32; 3],
    /// See [`Query`].
    pub far_inverse: [f32; 3],
    /// See [`Query`].
    pub far_offset: [f32; 3],
    /// See [`Query`].
    pub tnear: f32,
    /// For each axis the row of [`super::node::Node::planes`] that the ray enters a box through.
    pub enter: [usize; 3],
    /// For each axis the row that it leaves a box through.
    pub leave: [usize; 3],
}

/// The lesser; the second where one is NaN.
#[inline(always)]
pub fn min(a: f32, b: f32) -> f32 {
    if a < b { a } else { b }
}

/// The greater; the second where one is NaN.
#[inline(always)]
pub fn max(a: f32, b: f32) -> f32 {
    if a > b { a } else { b }
}

/// One ray of a [`Query`].
#[derive(Debug, Clone, Copy)]
pub struct Lane<'a> {
    /// All 16.
    pub query: &'a Query,
    /// Which one.
    pub i: usize,
    /// See [`Query`].
    pub octant: usize,
    /// The two axes after the dominant one, then the dominant one.
    pub axes: [usize; 3],
    /// For each axis the row of [`super::node::Node::planes`] that the ray enters a box through.
    pub enter: [usize; 3],
    /// For each axis the row that it leaves a box through.
    pub leave: [usize; 3],
}

impl Lane<'_> {
    /// What the boxes see.
    #[inline(always)]
    pub fn slabs(&self) -> Slabs {
        let (q, of) =
            (self.query, |m: &[[f32; LANES]; 3]| [self.of(&m[0]), self.of(&m[1]), self.of(&m[2])]);
        Slabs {
            near_inverse: of(&q.near_inverse),
            near_offset: of(&q.near_offset),
            far_inverse: of(&q.far_inverse),
            far_offset: of(&q.far_offset),
            tnear: self.of(&q.tnear),
            enter: self.enter,
            leave: self.leave,
        }
    }

    /// Of a [`Query`]'s member this ray's.
    #[inline(always)]
    pub fn of(&self, member: &[f32; LANES]) -> f32 {
        member[self.i % LANES]
    }

    /// See [`Query::depth`].
    #[inline(always)]
    pub fn depth(&self, t: f32) -> f32 {
        self.query.depth(self.i % LANES, t)
    }

    /// Of a coordinate along the dominant axis, relative to the ray's origin.
    #[inline(always)]
    pub fn depth_of(&self, z: f32) -> f32 {
        z - self.of(&self.query.origin[2])
    }

    /// See [`Query::end`].
    #[inline(always)]
    pub fn end(&self, t: f64) -> f32 {
        self.query.end(self.i % LANES, t)
    }

    /// See [`Query::within`].
    #[inline(always)]
    pub fn within(&self, first: f32, last: f32) -> bool {
        self.query.within(self.i % LANES, first, last)
    }

    /// A vertex, in the order of `axes`, relative to the ray: along the first two axes the distance
    /// from the ray at the vertex's depth, then the depth. The same bits in every tier: multiply,
    /// then subtract.
    #[inline(always)]
    pub fn sheared(&self, [x, y, z]: [f32; 3]) -> [f32; 3] {
        let (origin, shear) = (&self.query.origin, &self.query.shear);
        let depth = self.depth_of(z);
        [
            (x - self.of(&origin[0])) - self.of(&shear[0]) * depth,
            (y - self.of(&origin[1])) - self.of(&shear[1]) * depth,
            depth,
        ]
    }
}
