//! 16 rays prepared for traversal: conservative slabs for boxes, and the shear for triangles.

use crate::ray::{LANES, Mask, Rays};

use super::bounds::Bounds3;

/// u: the largest relative error of one f32 operation, half an ulp of 1, 2^-24.
const U: f32 = f32::EPSILON / 2.0;

/// Smallest magnitude of a component d of a scaled direction whose inverse is taken: see [`Query`].
/// It keeps 1/d and o/d finite, so that 0 * inf never occurs. The shear uses the components as they
/// are.
pub const MIN_DIRECTION: f32 = 1.0 / (1u64 << 60) as f32;

/// For each dominant axis, the two axes after it in cyclic order, then the axis itself. The fourth
/// row is never used: with it, `k % 4` needs no check of bounds. A static, because a table in the
/// code is written to the stack for every ray.
static AXES: [[usize; 3]; 4] = [[1, 2, 0], [2, 0, 1], [0, 1, 2], [0, 1, 2]];

/// 16 rays in the form that tests of boxes and triangles need.
///
/// Directions are scaled by a power of two, so that the largest component lies in [1, 2). (At the
/// ends of the range of f32 it lies in [1/3, 4).) Only underflow rounds. `scale` converts the ray
/// parameters of the caller to those of the scaled directions. Rays that are traced must pass
/// [`Rays::possible`]; the values of other lanes are meaningless.
///
/// # Boxes
///
/// The ray parameter at a plane of a box is `t = plane * inverse - offset`, in one fused operation
/// or two. Every box is widened by `box_slack`, which the offsets include. Every t is widened by
/// 4u, which the inverses include (u = 2^-24). So no rounding prunes a hit of [`super::exact`].
/// |v - o| is the largest coordinate of a corner v relative to the ray's origin o:
///
/// - The triangle test of [`super::exact`] moves a vertex by at most 6u max|v - o| in the plane
///   normal to the dominant axis. So a ray that hits passes within that distance of the triangle,
///   and hence of its box. The test clamps the hit to that box, widened by 64u max|v - o| over the
///   corners. Therefore `box_slack` >= 64u R, where R is the largest |v - o| of the scene's box.
/// - Three roundings move a plane by at most 4u|o|: of `o + box_slack`, of its product with the
///   inverse, and of the second operand of the fused operation. `box_slack` includes this.
/// - The inverse and the last rounding have relative errors of at most 3.5u together. So t of the
///   near plane is reduced by 4u and t of the far plane is enlarged by 4u (Ize 2013, JCGT 2(2)). A
///   negative t does not matter, because t starts at `tnear` >= 0.
/// - A component below `min_component` is raised to `min_component`, which is [`MIN_DIRECTION`] or
///   more (see [`Query::new`]). A hit has t <= R over the largest component, so the ray strays by
///   some `min_component` R. `box_slack` includes 2 `min_component` R.
/// - [`Query::tfar_for_hit`] may round the end of the segment down by u. `box_slack` includes 2u R
///   more than the 64u R. That reduces t of the near plane of a hit by 2u, because t |d| <= R on
///   every axis.
#[derive(Debug)]
#[repr(C, align(64))]
pub struct Query {
    /// Reciprocal of the scaled direction, reduced by 4u.
    pub near_inverse: [[f32; LANES]; 3],
    /// `(origin + box_slack) * near_inverse`; `box_slack` has the sign of the direction.
    pub near_offset: [[f32; LANES]; 3],
    /// Reciprocal of the scaled direction, enlarged by 4u.
    pub far_inverse: [[f32; LANES]; 3],
    /// `(origin - box_slack) * far_inverse`; `box_slack` has the sign of the direction.
    pub far_offset: [[f32; LANES]; 3],
    /// How far boxes are widened in each direction.
    pub box_slack: [f32; LANES],
    /// Start of the segment, scaled and reduced by 4u.
    pub tnear: [f32; LANES],
    /// End of the segment, scaled and enlarged by 4u.
    pub tfar: [f32; LANES],
    /// Factor from the ray parameters of the caller to scaled ones.
    pub scale: [f32; LANES],
    /// Octant of the direction. Bit a is set if it is negative along axis a.
    pub octant: [u32; LANES],
    /// Dominant axis: the axis along which the direction is largest, the last of equal ones.
    pub dominant: [u32; LANES],
    /// Origin along the two axes after the dominant one in cyclic order, then along the dominant
    /// one.
    pub origin: [[f32; LANES]; 3],
    /// Slopes: direction along the two axes after the dominant one, divided by its dominant
    /// component.
    pub shear: [[f32; LANES]; 2],
    /// Scaled direction along the dominant axis: the largest component, with its sign.
    pub dominant_component: [f32; LANES],
}

impl Query {
    /// Prepares rays for a tree over `scene`.
    #[inline(always)]
    pub fn new(rays: &Rays, scene: &Bounds3) -> Self {
        Self::with_slack(rays, scene, &[0.0; LANES])
    }

    /// [`Query::new`] for boxes that are widened by `more` in addition.
    #[inline(always)]
    pub fn with_slack(rays: &Rays, scene: &Bounds3, more: &[f32; LANES]) -> Self {
        let [ox, oy, oz] = &rays.org;
        let mut direction = [[0.0f32; LANES]; 3];
        let (mut scale, mut tnear, mut tfar) = ([0.0f32; LANES], [0.0f32; LANES], [0.0f32; LANES]);
        for i in 0..LANES {
            let (x, y, z) = (rays.dir[0][i], rays.dir[1][i], rays.dir[2][i]);
            let largest = max(max(x.abs(), y.abs()), z.abs());
            // The exponents at the ends of the range are replaced by their neighbours, so that `up`
            // undoes `down` exactly.
            let exponent = (largest.to_bits() >> 23).clamp(1, 253);
            let down = f32::from_bits((254 - exponent) << 23);
            let up = f32::from_bits(exponent << 23);
            scale[i] = up;
            tnear[i] = rays.tnear[i] * up * (1.0 - 4.0 * U);
            tfar[i] = rays.tfar[i] * up * (1.0 + 4.0 * U) + f32::MIN_POSITIVE;
            (direction[0][i], direction[1][i], direction[2][i]) = (x * down, y * down, z * down);
        }
        let (lower, upper) = (scene.lower(), scene.upper());
        let (mut box_slack, mut min_component) = ([0.0f32; LANES], [0.0f32; LANES]);
        for i in 0..LANES {
            let (mut reach, mut origin) = (0.0f32, 0.0f32);
            for axis in 0..3 {
                let o = rays.org[axis][i];
                reach = max(reach, max((lower[axis] - o).abs(), (upper[axis] - o).abs()));
                origin = max(origin, o.abs());
            }
            // Coordinates from 2^68 on would overflow when multiplied by 1 / MIN_DIRECTION. So if
            // reach + origin is above 2^64, the smallest component is larger. `box_slack` includes
            // how far the ray strays.
            let smallest = max(MIN_DIRECTION, (reach + origin) * (16.0 / f32::MAX));
            min_component[i] = smallest;
            box_slack[i] = (66.0 * U + 2.0 * smallest) * reach
                + 4.0 * U * origin
                + 4.0 * f32::MIN_POSITIVE
                + more[i];
        }
        let mut octant = [0u32; LANES];
        let (mut near_inverse, mut near_offset) = ([[0.0; LANES]; 3], [[0.0; LANES]; 3]);
        let (mut far_inverse, mut far_offset) = ([[0.0; LANES]; 3], [[0.0; LANES]; 3]);
        for axis in 0..3 {
            for i in 0..LANES {
                let d = direction[axis][i];
                let d = max(d.abs(), min_component[i]).copysign(d);
                let inverse = 1.0 / d;
                let out = box_slack[i].copysign(d);
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
        let (mut origin, mut shear, mut dominant_component) =
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
            dominant_component[i] = d;
            shear[0][i] = pick(dy[i], dz[i], dx[i]) / d;
            shear[1][i] = pick(dz[i], dx[i], dy[i]) / d;
        }
        Self {
            near_inverse,
            near_offset,
            far_inverse,
            far_offset,
            box_slack,
            tnear,
            tfar,
            scale,
            octant,
            dominant,
            origin,
            shear,
            dominant_component,
        }
    }

    /// Returns the rays that have the octant and the dominant axis of ray `first`.
    #[inline(always)]
    pub fn coherent(&self, first: usize) -> Mask {
        let first = first % LANES;
        let (octant, dominant) = (self.octant[first], self.dominant[first]);
        let mut part = Mask::NONE;
        for i in 0..LANES {
            let same = (self.octant[i] == octant) & (self.dominant[i] == dominant);
            part.0[i] = -i32::from(same);
        }
        part
    }

    /// Returns the rays that have the dominant axis of ray `first` and its sign along that axis.
    #[inline(always)]
    pub fn aligned(&self, first: usize) -> Mask {
        let first = first % LANES;
        let dominant = self.dominant[first];
        let sign = self.dominant_component[first].to_bits() >> 31;
        let mut part = Mask::NONE;
        for i in 0..LANES {
            let same = (self.dominant[i] == dominant)
                & (self.dominant_component[i].to_bits() >> 31 == sign);
            part.0[i] = -i32::from(same);
        }
        part
    }

    /// Converts the parameter `t` of a hit of ray `i` to a new `tfar` for tests of boxes: scaled,
    /// and enlarged to compensate underflow. The factor 1 + 4u of [`Query::tfar`] is not needed, as
    /// `box_slack` covers the rounding: see [`Query`].
    #[inline(always)]
    pub fn tfar_for_hit(&self, i: usize, t: f64) -> f32 {
        (t as f32 + f32::MIN_POSITIVE) * self.scale[i] + f32::MIN_POSITIVE
    }

    /// Returns the depth of ray `i` at the scaled parameter `t` >= 0, rounded up. The depth is the
    /// distance from the origin along the dominant axis. A point at a larger depth has a larger
    /// parameter.
    #[inline(always)]
    pub fn depth(&self, i: usize, t: f32) -> f32 {
        t * self.dominant_component[i].abs() * (1.0 + 8.0 * U)
    }

    /// Returns true only if ray `i` lies within its open segment at every depth from `first` to
    /// `last` along the dominant axis. Conservative: may return false near the ends.
    #[inline(always)]
    pub fn within(&self, i: usize, first: f32, last: f32) -> bool {
        let dominant_component = self.dominant_component[i].abs();
        // 16u exceed the 4u by which the ends were moved, plus all roundings here. The smallest
        // normal numbers compensate underflow.
        (first > self.tnear[i] * dominant_component * (1.0 + 16.0 * U) + 4.0 * f32::MIN_POSITIVE)
            & (last
                < self.tfar[i] * dominant_component * (1.0 - 16.0 * U) - 4.0 * f32::MIN_POSITIVE)
    }

    /// Returns ray `i` without the other rays.
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

/// The values of one ray that a test of boxes needs. Fields without description are as in
/// [`Query`].
#[derive(Debug, Clone, Copy)]
pub struct Slabs {
    pub near_inverse: [f32; 3],
    pub near_offset: [f32; 3],
    pub far_inverse: [f32; 3],
    pub far_offset: [f32; 3],
    pub tnear: f32,
    /// For each axis, the row of [`super::node::Node::planes`] through which the ray enters a box.
    pub enter: [usize; 3],
    /// For each axis, the row through which the ray leaves a box.
    pub leave: [usize; 3],
}

/// Returns the smaller number; `b` if either is NaN.
#[inline(always)]
pub fn min(a: f32, b: f32) -> f32 {
    if a < b { a } else { b }
}

/// Returns the larger number; `b` if either is NaN.
#[inline(always)]
pub fn max(a: f32, b: f32) -> f32 {
    if a > b { a } else { b }
}

/// One ray of a [`Query`].
#[derive(Debug, Clone, Copy)]
pub struct Lane<'a> {
    pub query: &'a Query,
    /// Lane of the ray in `query`.
    pub i: usize,
    pub octant: usize,
    /// The two axes after the dominant one, then the dominant one.
    pub axes: [usize; 3],
    /// As in [`Slabs`].
    pub enter: [usize; 3],
    /// As in [`Slabs`].
    pub leave: [usize; 3],
}

impl Lane<'_> {
    /// Returns the values for tests of boxes.
    #[inline(always)]
    pub fn slabs(&self) -> Slabs {
        let (q, axes) = (self.query, |m: &[[f32; LANES]; 3]| {
            [self.value(&m[0]), self.value(&m[1]), self.value(&m[2])]
        });
        Slabs {
            near_inverse: axes(&q.near_inverse),
            near_offset: axes(&q.near_offset),
            far_inverse: axes(&q.far_inverse),
            far_offset: axes(&q.far_offset),
            tnear: self.value(&q.tnear),
            enter: self.enter,
            leave: self.leave,
        }
    }

    /// Returns this ray's value of an array of [`Query`].
    #[inline(always)]
    pub fn value(&self, member: &[f32; LANES]) -> f32 {
        member[self.i % LANES]
    }

    /// Applies [`Query::depth`] to this ray.
    #[inline(always)]
    pub fn depth(&self, t: f32) -> f32 {
        self.query.depth(self.i % LANES, t)
    }

    /// Returns the depth of a coordinate `z` along the dominant axis: `z` minus the origin of the
    /// ray.
    #[inline(always)]
    pub fn depth_of(&self, z: f32) -> f32 {
        z - self.value(&self.query.origin[2])
    }

    /// Applies [`Query::tfar_for_hit`] to this ray.
    #[inline(always)]
    pub fn tfar_for_hit(&self, t: f64) -> f32 {
        self.query.tfar_for_hit(self.i % LANES, t)
    }

    /// Applies [`Query::within`] to this ray.
    #[inline(always)]
    pub fn within(&self, first: f32, last: f32) -> bool {
        self.query.within(self.i % LANES, first, last)
    }

    /// Shears a vertex, given in the order of `axes`. Returns its offsets from the ray along the
    /// first two axes at its depth, then the depth. Multiplies, then subtracts, so that every
    /// instruction set computes the same bits.
    #[inline(always)]
    pub fn sheared(&self, [x, y, z]: [f32; 3]) -> [f32; 3] {
        let (origin, shear) = (&self.query.origin, &self.query.shear);
        let depth = self.depth_of(z);
        [
            (x - self.value(&origin[0])) - self.value(&shear[0]) * depth,
            (y - self.value(&origin[1])) - self.value(&shear[1]) * depth,
            depth,
        ]
    }
}
