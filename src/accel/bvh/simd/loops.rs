//! Kernels as plain loops over 16 lanes, for instruction sets whose vectors the compiler uses by
//! itself. Only the operations of [`Loops`] differ between these instruction sets.

use super::super::frustum::{Frustum, HorizontalMin, Side};
use super::super::node::{Block, Child, Node, WIDTH};
use super::super::packet::Bits;
use super::super::query::{Lane, Slabs};
use super::{Candidates, EDGE_FLOOR, EDGE_SLACK, Stack, Tier};
use crate::ray::Mask;
use crate::simd::Kernel;

/// Number of triangles of a leaf whose edge functions are computed together.
pub const QUARTER: usize = WIDTH / 4;

/// An instruction set that runs the kernels of this file.
///
/// In a mask of lanes, all bits of a lane are set, or none.
pub trait Loops: HorizontalMin {
    /// As [`Tier::lesser`].
    fn min(a: f32, b: f32) -> f32;

    /// As [`Tier::larger`].
    fn max(a: f32, b: f32) -> f32;

    /// Converts a mask to bits.
    fn mask_bits(self, mask: &[i32; WIDTH]) -> u32;

    /// Converts a mask of the children of a node to bits. Bit j is the child at place j of the
    /// order of an octant.
    fn bits_in_order(self, mask: &[i32; WIDTH], node: &Node, octant: usize) -> u32;

    /// Returns the triangles whose three corners have no common flag, as bits. `flags` holds the
    /// flags of the vertices, in 8 bits. Each flag marks the vertices outside one plane.
    fn astride(self, block: &Block, flags: &[i32; WIDTH]) -> u32;

    /// Returns the values of `x` and `y` at corners 0, 1 and 2 of the triangles in a quarter of the
    /// slots.
    fn corners(
        self,
        block: &Block,
        quarter: usize,
        x: &[f32; WIDTH],
        y: &[f32; WIDTH],
    ) -> [[[f32; QUARTER]; 2]; 3];
}

/// Returns the scaled ray parameters at which the ray enters the children's boxes, clipped to
/// `tnear`, and the mask of the boxes that it enters before `tfar`.
#[inline(always)]
fn slabs<L: Loops>(node: &Node, ray: &Slabs, tfar: f32) -> ([f32; WIDTH], [i32; WIDTH]) {
    let (mut near, mut far) = ([ray.tnear; WIDTH], [tfar; WIDTH]);
    for axis in 0..3 {
        let (enter, leave) = (&node.planes[ray.enter[axis]], &node.planes[ray.leave[axis]]);
        for i in 0..WIDTH {
            let t0 = enter[i] * ray.near_inverse[axis] - ray.near_offset[axis];
            let t1 = leave[i] * ray.far_inverse[axis] - ray.far_offset[axis];
            // NaN prunes nothing.
            near[i] = L::max(t0, near[i]);
            far[i] = L::min(t1, far[i]);
        }
    }
    (near, mask_of_at_most(&near, &far))
}

/// Returns the mask of the lanes in which `a` is at most `b`.
#[inline(always)]
fn mask_of_at_most(a: &[f32; WIDTH], b: &[f32; WIDTH]) -> [i32; WIDTH] {
    let mut mask = [0; WIDTH];
    for i in 0..WIDTH {
        mask[i] = -i32::from(a[i] <= b[i]);
    }
    mask
}

/// Tests the signs of the edge functions of a quarter of the triangles. Returns those that the
/// ray's line may hit, and those that it certainly hits, as bits.
#[inline(always)]
fn edges<L: Loops>([a, b, c]: [[[f32; QUARTER]; 2]; 3]) -> (u32, u32) {
    let ([ax, ay], [bx, by], [cx, cy]) = (a, b, c);
    let (mut maybe, mut sure) = (0, 0);
    for i in 0..QUARTER {
        let (q0, q1, q2) = (cy[i] * bx[i], ay[i] * cx[i], by[i] * ax[i]);
        let (u, v, w) = (cx[i] * by[i] - q0, ax[i] * cy[i] - q1, bx[i] * ay[i] - q2);
        // Infinite if a product overflows. Then nothing is certain, and a NaN does not matter.
        let slack = L::max(L::max(q0.abs(), q1.abs()), q2.abs()) * EDGE_SLACK + EDGE_FLOOR;
        let (lowest, highest) = (L::min(L::min(u, v), w), L::max(L::max(u, v), w));
        let misses = (lowest < -slack) & (highest > slack);
        // A sum, because the compiler knows an instruction for it.
        maybe += u32::from(!misses) << i;
        sure += u32::from((lowest > slack) | (highest < -slack)) << i;
    }
    (maybe, sure)
}

impl<L: Loops> Tier for L {
    const FUSED: bool = false;

    #[inline(always)]
    fn lesser(a: f32, b: f32) -> f32 {
        L::min(a, b)
    }

    #[inline(always)]
    fn larger(a: f32, b: f32) -> f32 {
        L::max(a, b)
    }

    fn run<K: Kernel>(self, kernel: K) -> K::Output {
        kernel.run()
    }

    #[inline(always)]
    fn first_in_order(self, node: &Node, lane: &Lane, tfar: f32, stack: &mut Stack) -> Child {
        let (near, entered) = slabs::<L>(node, &lane.slabs(), tfar);
        let places = self.bits_in_order(&entered, node, lane.octant);
        let Some(nearest) = places.checked_ilog2() else { return Child::EMPTY };
        for place in Bits(places ^ (1 << nearest)) {
            let slot = node.ordered(lane.octant, place);
            stack.push(node.children[slot], near[slot]);
        }
        node.children[node.ordered(lane.octant, nearest as usize)]
    }

    #[inline(always)]
    fn hit_children(self, node: &Node, lane: &Lane, tfar: f32) -> u32 {
        self.mask_bits(&slabs::<L>(node, &lane.slabs(), tfar).1)
    }

    #[inline(always)]
    fn children_in_frustum(self, node: &Node, frustum: &Frustum, end: f32) -> u32 {
        let (planes, [kx, ky, _]) = (&node.planes, frustum.axes);
        let ([low_x, low_y], [high_x, high_y]) = (frustum.low(), frustum.high());
        let at = |side: &Side, i: usize| side.a + side.b * planes[side.row][i];
        let forward = frustum.forward;
        let mut overlaps = [0; WIDTH];
        for i in 0..WIDTH {
            // A comparison with NaN is false, so NaN prunes nothing.
            let outside = (planes[kx + 3][i] < at(&low_x, i))
                | (planes[kx][i] > at(&high_x, i))
                | (planes[ky + 3][i] < at(&low_y, i))
                | (planes[ky][i] > at(&high_y, i))
                | (planes[frustum.leave][i] * forward < frustum.start)
                | (planes[frustum.enter][i] * forward > end);
            overlaps[i] = -i32::from(!outside);
        }
        self.bits_in_order(&overlaps, node, frustum.octant)
    }

    #[inline(always)]
    fn triangles_in_frustum(self, block: &Block, frustum: &Frustum, end: f32) -> u32 {
        let ([low_x, low_y], [high_x, high_y]) = (frustum.low(), frustum.high());
        let [x, y, z] = frustum.axes.map(|axis| &block.vertices[axis]);
        let mut flags = [0; WIDTH];
        for i in 0..WIDTH {
            let depth = z[i] * frustum.forward;
            flags[i] = i32::from(x[i] < low_x.a + low_x.b * z[i])
                | i32::from(x[i] > high_x.a + high_x.b * z[i]) << 1
                | i32::from(y[i] < low_y.a + low_y.b * z[i]) << 2
                | i32::from(y[i] > high_y.a + high_y.b * z[i]) << 3
                | i32::from(depth < frustum.start) << 4
                | i32::from(depth > end) << 5;
        }
        self.astride(block, &flags)
    }

    #[inline(always)]
    fn bits(self, mask: &Mask) -> u32 {
        self.mask_bits(&mask.0)
    }

    #[inline(always)]
    fn at_most(self, a: &[f32; WIDTH], b: &[f32; WIDTH]) -> u32 {
        self.mask_bits(&mask_of_at_most(a, b))
    }

    #[inline(always)]
    fn candidates(self, block: &Block, lane: &Lane, tfar: f32) -> Candidates {
        let vertices = lane.axes.map(|axis| &block.vertices[axis]);
        let forward = 1.0f32.copysign(lane.value(&lane.query.dominant_component));
        let end = lane.depth(tfar);
        let (mut x, mut y, mut flags) = ([0.0; WIDTH], [0.0; WIDTH], [0; WIDTH]);
        for i in 0..WIDTH {
            let depth;
            [x[i], y[i], depth] = lane.sheared(vertices.map(|row| row[i]));
            let z = depth * forward;
            flags[i] = i32::from(x[i] > 0.0)
                | i32::from(x[i] < 0.0) << 1
                | i32::from(y[i] > 0.0) << 2
                | i32::from(y[i] < 0.0) << 3
                | i32::from(z < 0.0) << 4
                | i32::from(z > end) << 5;
        }
        // The line misses a triangle that lies on one side of the line. This test does not round.
        let around = self.astride(block, &flags);
        let (mut maybe, mut sure) = (0, 0);
        for quarter in 0..WIDTH / QUARTER {
            let first = QUARTER * quarter;
            if (around >> first) & 0xf != 0 {
                let (m, s) = edges::<L>(self.corners(block, quarter, &x, &y));
                (maybe, sure) = (maybe | m << first, sure | s << first);
            }
        }
        maybe &= around;
        Candidates { maybe, sure: maybe & sure }
    }
}
