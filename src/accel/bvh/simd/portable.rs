//! Plain loops: what every target runs, and what the other tiers are held against.

use super::super::node::{Block, Node, WIDTH};
use super::super::query::Lane;
use super::{EDGE_FLOOR, EDGE_SLACK, Stack, Tier};

/// The tier that needs nothing.
#[derive(Debug, Clone, Copy)]
pub struct Portable;

/// Distances at which the ray enters and leaves the children's boxes.
#[inline(always)]
pub fn slabs(node: &Node, lane: &Lane) -> ([f32; WIDTH], [f32; WIDTH]) {
    let (mut near, mut far) = ([lane.tnear; WIDTH], [lane.tfar; WIDTH]);
    for axis in 0..3 {
        let (enter, leave) = lane.rows(axis);
        let (enter, leave) = (&node.planes[enter], &node.planes[leave]);
        for i in 0..WIDTH {
            let t0 = enter[i] * lane.near_inverse[axis] - lane.near_offset[axis];
            let t1 = leave[i] * lane.far_inverse[axis] - lane.far_offset[axis];
            // A NaN loses every comparison: it prunes nothing.
            near[i] = if t0 > near[i] { t0 } else { near[i] };
            far[i] = if t1 < far[i] { t1 } else { far[i] };
        }
    }
    (near, far)
}

impl Tier for Portable {
    #[inline(always)]
    fn push_ordered(self, node: &Node, lane: &Lane, stack: &mut Stack) {
        let (near, far) = slabs(node, lane);
        for j in 0..WIDTH {
            let i = node.ordered(lane.octant, j);
            if near[i] <= far[i] {
                stack.push(node.children[i], near[i]);
            }
        }
    }

    #[inline(always)]
    fn push_any(self, node: &Node, lane: &Lane, stack: &mut Stack) {
        let (near, far) = slabs(node, lane);
        for i in 0..WIDTH {
            if near[i] <= far[i] {
                stack.push(node.children[i], near[i]);
            }
        }
    }

    #[inline(always)]
    fn candidates(self, block: &Block, lane: &Lane) -> u32 {
        let [kx, ky, kz] = lane.axes;
        let (mut x, mut y) = ([0.0f32; WIDTH], [0.0f32; WIDTH]);
        for i in 0..WIDTH {
            let depth = block.vertices[kz][i] - lane.origin[2];
            x[i] = (block.vertices[kx][i] - lane.origin[0]) - lane.shear[0] * depth;
            y[i] = (block.vertices[ky][i] - lane.origin[1]) - lane.shear[1] * depth;
        }
        let mut mask = 0;
        for i in 0..WIDTH {
            let [a, b, c] = [0, 1, 2].map(|k| usize::from(block.corners[k][i]) % WIDTH);
            let (q0, q1, q2) = (y[c] * x[b], y[a] * x[c], y[b] * x[a]);
            let (u, v, w) = (x[c] * y[b] - q0, x[a] * y[c] - q1, x[b] * y[a] - q2);
            let slack = q0.abs().max(q1.abs()).max(q2.abs()) * EDGE_SLACK + EDGE_FLOOR;
            let misses = u.min(v).min(w) < -slack && u.max(v).max(w) > slack;
            mask |= u32::from(!misses) << i;
        }
        mask & u32::from(block.present)
    }
}
