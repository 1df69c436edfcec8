//! Finds the triangle that is nearest to a point.

use super::node::{Block, Child, ChildKind, Node, WIDTH};
use super::tree::Bvh;
use crate::simd::{self, Kernel};

impl Bvh<'_> {
    /// Calls `visit` with the scene-wide index of every triangle that may be nearest to `point`.
    ///
    /// `visit` returns the square of the smallest distance so far, from the exact triangles.
    /// Triangles whose boxes are farther away are left out. `point` is relative to the scene's
    /// origin. `slack` bounds how far rounding moves the point relative to a vertex, in each
    /// coordinate. Spheres are ignored.
    pub fn visit_nearest<F: FnMut(u32) -> f64>(&self, point: [f32; 3], slack: f32, visit: F) {
        simd::dispatch(self.isa, Nearest { bvh: self, point, slack, visit });
    }
}

struct Nearest<'a, F> {
    bvh: &'a Bvh<'a>,
    point: [f32; 3],
    slack: f32,
    visit: F,
}

impl<F: FnMut(u32) -> f64> Kernel for Nearest<'_, F> {
    type Output = ();
    #[inline(always)]
    fn run(self) {
        let Self { bvh, point, slack, mut visit } = self;
        let mut best = f32::INFINITY;
        let mut stack = vec![(0.0f32, Child::node(0))];
        while let Some((distance, child)) = stack.pop() {
            if distance > best {
                continue;
            }
            match child.kind() {
                ChildKind::Node(index) => {
                    let node = &bvh.tree.nodes[index];
                    let first = stack.len();
                    let distances = distances_of_boxes(node, point, slack);
                    for i in 0..WIDTH {
                        if distances[i] <= best && node.children[i] != Child::EMPTY {
                            stack.push((distances[i], node.children[i]));
                        }
                    }
                    stack[first..].sort_unstable_by(|a, b| b.0.total_cmp(&a.0));
                }
                ChildKind::Triangles(index) => {
                    let block = &bvh.tree.blocks[index];
                    let distances = distances_of_triangles(block, point, slack);
                    for i in 0..WIDTH {
                        if block.present >> i & 1 != 0 && distances[i] <= best {
                            // Rounded up, so that equally near triangles are visited too.
                            let primitive = bvh.tree.indices().of(block, i);
                            best = visit(primitive) as f32 * (1.0 + 2.0 * f32::EPSILON);
                        }
                    }
                }
                ChildKind::Spheres(_) | ChildKind::Empty => {}
            }
        }
    }
}

/// Returns lower bounds of the squared distances from a point to the boxes of a node's children.
#[inline(always)]
fn distances_of_boxes(node: &Node, point: [f32; 3], slack: f32) -> [f32; WIDTH] {
    let mut sums = [0.0f32; WIDTH];
    for k in 0..3 {
        let (low, high) = (&node.planes[k], &node.planes[k + 3]);
        for i in 0..WIDTH {
            sums[i] += squared_gap(low[i], high[i], point[k], slack);
        }
    }
    sums.map(rounded_down)
}

/// Returns lower bounds of the squared distances from a point to the boxes of a leaf's triangles.
#[inline(always)]
fn distances_of_triangles(block: &Block, point: [f32; 3], slack: f32) -> [f32; WIDTH] {
    let mut sums = [0.0f32; WIDTH];
    for k in 0..3 {
        let x = &block.vertices[k];
        for i in 0..WIDTH {
            let (a, b, c) = (x[block.corner(0, i)], x[block.corner(1, i)], x[block.corner(2, i)]);
            sums[i] += squared_gap(a.min(b).min(c), a.max(b).max(c), point[k], slack);
        }
    }
    sums.map(rounded_down)
}

/// Returns the square of the distance from `x` to an interval widened by `slack`; 0 inside it.
#[inline(always)]
fn squared_gap(low: f32, high: f32, x: f32, slack: f32) -> f32 {
    let (below, above) = (low - x, x - high);
    let gap = if below > above { below } else { above } - slack;
    if gap > 0.0 { gap * gap } else { 0.0 }
}

/// Reduces a sum of three squares by 8u of it (u = 2^-24): more than its rounding error, 6u. The
/// smallest normal number is subtracted because squares may underflow, that of the smallest
/// distance so far, too.
#[inline(always)]
fn rounded_down(sum: f32) -> f32 {
    sum * (1.0 - 4.0 * f32::EPSILON) - f32::MIN_POSITIVE
}
