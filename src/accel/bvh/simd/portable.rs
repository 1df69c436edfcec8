//! The portable kernels: plain loops, which every target supports. The tests compare the other
//! instruction sets with them.

use super::super::frustum::{Frustum, HorizontalMin, Side};
use super::super::node::{Block, Child, Node, WIDTH};
use super::super::query::{Lane, Slabs};
use super::{Candidates, EDGE_FLOOR, EDGE_SLACK, Stack, Tier};
use crate::ray::Mask;
use crate::simd::Kernel;

/// The [`Tier`] that needs no particular instruction set.
#[derive(Debug, Clone, Copy)]
pub struct Portable;

/// Returns the scaled ray parameters at which the ray enters and leaves the children's boxes,
/// clipped to `tnear` and `tfar`.
#[inline(always)]
fn slabs(node: &Node, ray: &Slabs, tfar: f32) -> ([f32; WIDTH], [f32; WIDTH]) {
    let (mut near, mut far) = ([ray.tnear; WIDTH], [tfar; WIDTH]);
    for axis in 0..3 {
        let (enter, leave) = (&node.planes[ray.enter[axis]], &node.planes[ray.leave[axis]]);
        for i in 0..WIDTH {
            let t0 = enter[i] * ray.near_inverse[axis] - ray.near_offset[axis];
            let t1 = leave[i] * ray.far_inverse[axis] - ray.far_offset[axis];
            // A comparison with NaN is false, so NaN prunes nothing.
            near[i] = if t0 > near[i] { t0 } else { near[i] };
            far[i] = if t1 < far[i] { t1 } else { far[i] };
        }
    }
    (near, far)
}

impl HorizontalMin for Portable {
    #[inline(always)]
    fn horizontal_min(self, v: &[f32; WIDTH]) -> f32 {
        let mut v = *v;
        for half in [8, 4, 2, 1] {
            for i in 0..half {
                v[i] = if v[i + half] < v[i] { v[i + half] } else { v[i] };
            }
        }
        v[0]
    }
}

impl Tier for Portable {
    const FUSED: bool = false;

    fn run<K: Kernel>(self, kernel: K) -> K::Output {
        kernel.run()
    }

    #[inline(always)]
    fn first_in_order(self, node: &Node, lane: &Lane, tfar: f32, stack: &mut Stack) -> Child {
        let (near, far) = slabs(node, &lane.slabs(), tfar);
        let mut nearest = None;
        for j in 0..WIDTH {
            let i = node.ordered(lane.octant, j);
            if near[i] <= far[i] {
                if let Some((child, distance)) = nearest.replace((node.children[i], near[i])) {
                    stack.push(child, distance);
                }
            }
        }
        nearest.map_or(Child::EMPTY, |(child, _)| child)
    }

    #[inline(always)]
    fn hit_children(self, node: &Node, lane: &Lane, tfar: f32) -> u32 {
        let (near, far) = slabs(node, &lane.slabs(), tfar);
        self.at_most(&near, &far)
    }

    #[inline(always)]
    fn children_in_frustum(self, node: &Node, frustum: &Frustum, end: f32) -> u32 {
        let (planes, low, high) = (&node.planes, frustum.low(), frustum.high());
        let at = |side: &Side, i: usize| side.a + side.b * planes[side.row][i];
        // A comparison with NaN is false, so NaN prunes nothing.
        let outside = |i: usize| {
            let beside = (0..2).any(|axis| {
                let k = frustum.axes[axis];
                planes[k + 3][i] < at(&low[axis], i) || planes[k][i] > at(&high[axis], i)
            });
            let forward = frustum.forward;
            beside
                || planes[frustum.leave][i] * forward < frustum.start
                || planes[frustum.enter][i] * forward > end
        };
        (0..WIDTH).fold(0, |mask, j| {
            let i = node.ordered(frustum.octant, j);
            mask | u32::from(!outside(i)) << j
        })
    }

    #[inline(always)]
    fn triangles_in_frustum(self, block: &Block, frustum: &Frustum, end: f32) -> u32 {
        let ([kx, ky, kz], lows, highs) = (frustum.axes, frustum.low(), frustum.high());
        let mut flags = [0u8; WIDTH];
        for i in 0..WIDTH {
            let z = block.vertices[kz][i];
            for (axis, k) in [kx, ky].into_iter().enumerate() {
                let x = block.vertices[k][i];
                let (low, high) = (&lows[axis], &highs[axis]);
                flags[i] |= u8::from(x < low.a + low.b * z) << (2 * axis);
                flags[i] |= u8::from(x > high.a + high.b * z) << (2 * axis + 1);
            }
            flags[i] |= u8::from(z * frustum.forward < frustum.start) << 4;
            flags[i] |= u8::from(z * frustum.forward > end) << 5;
        }
        let mut mask = 0;
        for i in 0..WIDTH {
            let [a, b, c] = [0, 1, 2].map(|k| flags[block.corner(k, i)]);
            mask |= u32::from(a & b & c == 0) << i;
        }
        mask & u32::from(block.present)
    }

    #[inline(always)]
    fn bits(self, mask: &Mask) -> u32 {
        let mut lanes = 0;
        for i in 0..WIDTH {
            lanes |= u32::from(mask.0[i] != 0) << i;
        }
        lanes
    }

    #[inline(always)]
    fn at_most(self, a: &[f32; WIDTH], b: &[f32; WIDTH]) -> u32 {
        let mut lanes = 0;
        for i in 0..WIDTH {
            lanes |= u32::from(a[i] <= b[i]) << i;
        }
        lanes
    }

    #[inline(always)]
    fn candidates(self, block: &Block, lane: &Lane, tfar: f32) -> Candidates {
        let [kx, ky, kz] = lane.axes;
        let (mut x, mut y, mut z) = ([0.0f32; WIDTH], [0.0f32; WIDTH], [0.0f32; WIDTH]);
        let forward = 1.0f32.copysign(lane.value(&lane.query.dominant_component));
        for i in 0..WIDTH {
            let vertex = [block.vertices[kx][i], block.vertices[ky][i], block.vertices[kz][i]];
            let depth;
            [x[i], y[i], depth] = lane.sheared(vertex);
            z[i] = depth * forward;
        }
        let end = lane.depth(tfar);
        let (mut maybe, mut sure) = (0, 0);
        for i in 0..WIDTH {
            let (a, b, c) = (block.corner(0, i), block.corner(1, i), block.corner(2, i));
            let (q0, q1, q2) = (y[c] * x[b], y[a] * x[c], y[b] * x[a]);
            let (u, v, w) = (x[c] * y[b] - q0, x[a] * y[c] - q1, x[b] * y[a] - q2);
            let slack = q0.abs().max(q1.abs()).max(q2.abs()) * EDGE_SLACK + EDGE_FLOOR;
            let (lowest, highest) = (u.min(v).min(w), u.max(v).max(w));
            let misses = lowest < -slack && highest > slack;
            let behind = z[a].max(z[b]).max(z[c]) < 0.0;
            let beyond = z[a].min(z[b]).min(z[c]) > end;
            maybe |= u32::from(!(misses | behind | beyond)) << i;
            sure |= u32::from(lowest > slack || highest < -slack) << i;
        }
        maybe &= u32::from(block.present);
        Candidates { maybe, sure: maybe & sure }
    }
}
