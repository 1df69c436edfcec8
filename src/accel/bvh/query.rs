//! 16 rays made ready for the tree: slabs that err to the safe side, and the shear.

use crate::ray::{LANES, Rays};

use super::Bounds3;

/// Half an ulp of 1: the largest relative error of one f32 operation.
const U: f32 = f32::EPSILON / 2.0;

/// Smallest magnitude of a direction component, relative to the largest: keeps 1/d and o/d
/// finite, so that no 0 * inf arises.
const LEAST: f32 = 1.0 / (1u64 << 60) as f32;

/// 16 rays against boxes and against triangles.
///
/// Directions are scaled by a power of two (exact) so that the largest component is in [1, 2);
/// `scale` takes ray parameters there.
///
/// Boxes. A slab is `t = plane * inverse - offset` in one fused operation or two. Every box is
/// widened by `margin`, folded into the offsets, and every distance by 4u, folded into the
/// inverses, so that no rounding prunes what [`super::exact`] would hit:
/// - The triangle test moves a vertex in the plane normal to the dominant axis by at most
///   6u max|v - o| (see there), so where it reports a hit the ray passes within that distance of
///   the triangle, hence of its box: `margin` >= 6u max|v - o| over the scene's box.
/// - Rounding of `o + margin`, of the product with the inverse, and of the fused operation's
///   second operand move a plane by at most 4u|o|: part of `margin`.
/// - The inverse and the last rounding are relative errors of at most 3.5u: 4u taken off the near
///   distance and added to the far one (Ize 2013, JCGT 2(2)). Near distances below zero do not
///   matter, as t starts at `tnear` >= 0.
/// - A component below `LEAST` is lifted to it: the ray strays by at most LEAST times the scene,
///   2^-60 against 2^-22 in `margin`.
pub struct Query {
    /// Inverse direction, made smaller by 4u.
    pub near_inverse: [[f32; LANES]; 3],
    /// (origin + margin) * inverse.
    pub near_offset: [[f32; LANES]; 3],
    /// Inverse direction, made larger by 4u.
    pub far_inverse: [[f32; LANES]; 3],
    /// (origin - margin) * inverse.
    pub far_offset: [[f32; LANES]; 3],
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
    /// Direction over its dominant component, for the two axes after the dominant one in cyclic
    /// order.
    pub shear: [[f32; LANES]; 2],
}

impl Query {
    /// Makes rays ready for a tree over `scene`.
    #[inline(always)]
    pub fn new(rays: &Rays, scene: &Bounds3) -> Self {
        let mut q = Self {
            near_inverse: [[0.0; LANES]; 3],
            near_offset: [[0.0; LANES]; 3],
            far_inverse: [[0.0; LANES]; 3],
            far_offset: [[0.0; LANES]; 3],
            tnear: [0.0; LANES],
            tfar: [0.0; LANES],
            scale: [0.0; LANES],
            octant: [0; LANES],
            dominant: [0; LANES],
            shear: [[0.0; LANES]; 2],
        };
        let mut direction = [[0.0f32; LANES]; 3];
        for i in 0..LANES {
            let (x, y, z) = (rays.dir[0][i], rays.dir[1][i], rays.dir[2][i]);
            let largest = x.abs().max(y.abs()).max(z.abs());
            let exponent = (largest.to_bits() >> 23) as i32;
            let down = f32::from_bits(((254 - exponent).max(1) as u32) << 23);
            let up = f32::from_bits((exponent.max(1) as u32) << 23);
            q.scale[i] = up;
            q.tnear[i] = rays.tnear[i] * up * (1.0 - 4.0 * U);
            q.tfar[i] = rays.tfar[i] * up * (1.0 + 4.0 * U);
            (direction[0][i], direction[1][i], direction[2][i]) = (x * down, y * down, z * down);
        }
        let (lower, upper) = (scene.lower(), scene.upper());
        let mut margin = [0.0f32; LANES];
        let mut least = [0.0f32; LANES];
        for i in 0..LANES {
            let (mut reach, mut origin) = (0.0f32, 0.0f32);
            for axis in 0..3 {
                let o = rays.org[axis][i];
                reach = reach.max((lower[axis] - o).abs()).max((upper[axis] - o).abs());
                origin = origin.max(o.abs());
            }
            // Coordinates beyond 2^62 would overflow with 1/LEAST: a larger least, and its strays
            // in the margin.
            let lift = LEAST.max((reach + origin) * (1.0 / f32::MAX) * 16.0);
            least[i] = lift;
            margin[i] = (8.0 * U + 2.0 * lift) * reach + 4.0 * U * origin;
        }
        for axis in 0..3 {
            for i in 0..LANES {
                let d = direction[axis][i];
                let d = d.abs().max(least[i]).copysign(d);
                let inverse = 1.0 / d;
                let out = margin[i].copysign(d);
                let (near, far) = (inverse * (1.0 - 4.0 * U), inverse * (1.0 + 4.0 * U));
                let o = rays.org[axis][i];
                q.near_inverse[axis][i] = near;
                q.far_inverse[axis][i] = far;
                q.near_offset[axis][i] = (o + out) * near;
                q.far_offset[axis][i] = (o - out) * far;
                q.octant[i] |= (d.to_bits() >> 31) << axis;
            }
        }
        for i in 0..LANES {
            let (x, y, z) = (direction[0][i], direction[1][i], direction[2][i]);
            let (ax, ay, az) = (x.abs(), y.abs(), z.abs());
            let k = if az >= ax.max(ay) { 2 } else { u32::from(ay >= ax) };
            let (dx, dy, dz) = match k {
                0 => (y, z, x),
                1 => (z, x, y),
                _ => (x, y, z),
            };
            q.dominant[i] = k;
            q.shear[0][i] = dx / dz;
            q.shear[1][i] = dy / dz;
        }
        q
    }

    /// Ray `i` alone.
    #[inline(always)]
    pub fn lane(&self, rays: &Rays, i: usize) -> Lane {
        let of = |v: &[[f32; LANES]; 3]| [v[0][i], v[1][i], v[2][i]];
        let k = self.dominant[i] as usize % 3;
        let axes = [[1, 2, 0], [2, 0, 1], [0, 1, 2]][k];
        Lane {
            near_inverse: of(&self.near_inverse),
            near_offset: of(&self.near_offset),
            far_inverse: of(&self.far_inverse),
            far_offset: of(&self.far_offset),
            octant: self.octant[i] as usize % 8,
            tnear: self.tnear[i],
            tfar: self.tfar[i],
            axes,
            origin: axes.map(|a| rays.org[a][i]),
            shear: [self.shear[0][i], self.shear[1][i]],
        }
    }
}

/// One ray of a [`Query`].
#[derive(Debug, Clone, Copy)]
pub struct Lane {
    /// See [`Query`].
    pub near_inverse: [f32; 3],
    /// See [`Query`].
    pub near_offset: [f32; 3],
    /// See [`Query`].
    pub far_inverse: [f32; 3],
    /// See [`Query`].
    pub far_offset: [f32; 3],
    /// See [`Query`].
    pub octant: usize,
    /// See [`Query`].
    pub tnear: f32,
    /// See [`Query`]; shrinks with every hit.
    pub tfar: f32,
    /// The two axes after the dominant one, then the dominant one.
    pub axes: [usize; 3],
    /// Origin in the order of `axes`.
    pub origin: [f32; 3],
    /// Direction along the first two `axes` over that along the third.
    pub shear: [f32; 2],
}

impl Lane {
    /// Rows of [`super::node::Node::planes`] that the ray enters and leaves a box through.
    #[inline(always)]
    pub fn rows(&self, axis: usize) -> (usize, usize) {
        let negative = (self.octant >> axis) & 1;
        (axis + 3 * negative, axis + 3 - 3 * negative)
    }

    /// A vertex relative to the ray: along the first two axes the distance from the ray at the
    /// vertex's depth, then the depth. The same bits in every tier: multiply, then subtract.
    #[inline(always)]
    pub fn sheared(&self, vertex: [f32; 3]) -> [f32; 3] {
        let [x, y, z] = self.axes;
        let depth = vertex[z] - self.origin[2];
        [
            (vertex[x] - self.origin[0]) - self.shear[0] * depth,
            (vertex[y] - self.origin[1]) - self.shear[1] * depth,
            depth,
        ]
    }
}
