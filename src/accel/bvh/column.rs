//! Finds the triangles that a half-line along an axis may hit: candidates for an exact test.
//!
//! A column is the box around the half-line. It is unbounded on one side.

use super::node::{Block, Child, ChildKind, Node, WIDTH};
use super::tree::Bvh;
use crate::simd::{self, Kernel};

/// A half-line along an axis, with bounds on its start. Coordinates are relative to the scene's
/// origin.
#[derive(Debug, Clone, Copy)]
pub struct HalfLine {
    /// The two axes normal to the half-line, then the axis that it runs along.
    pub axes: [usize; 3],
    /// Lower and upper bounds of the start point: element k is along `axes[k]`. The caller adds
    /// the rounding errors of the start and of the tree's vertices.
    pub start: [[f32; 3]; 2],
    /// Whether the half-line runs towards larger coordinates.
    pub upward: bool,
}

impl HalfLine {
    /// Returns the column: lower and upper corner, in the order of `axes`.
    #[inline(always)]
    fn bounds(&self) -> [[f32; 3]; 2] {
        let [mut lower, mut upper] = self.start;
        if self.upward {
            upper[2] = f32::INFINITY;
        } else {
            lower[2] = f32::NEG_INFINITY;
        }
        [lower, upper]
    }
}

impl Bvh<'_> {
    /// Appends to `found` the scene-wide index of every triangle whose box overlaps the column of
    /// `line`. Ignores spheres. `stack` is scratch memory.
    pub fn column(&self, line: &HalfLine, stack: &mut Vec<u32>, found: &mut Vec<u32>) {
        simd::dispatch(self.isa, Column { bvh: self, line, stack, found });
    }
}

struct Column<'a> {
    bvh: &'a Bvh<'a>,
    line: &'a HalfLine,
    stack: &'a mut Vec<u32>,
    found: &'a mut Vec<u32>,
}

impl Kernel for Column<'_> {
    type Output = ();
    #[inline(always)]
    fn run(self) {
        let Self { bvh, line, stack, found } = self;
        let (axes, bounds) = (line.axes, line.bounds());
        stack.clear();
        stack.push(Child::node(0).0);
        while let Some(child) = stack.pop() {
            match Child(child).kind() {
                ChildKind::Node(index) => {
                    let node = &bvh.tree.nodes[index];
                    let mut reached = children_in_box(node, axes, &bounds);
                    while reached != 0 {
                        stack.push(node.first(reached).0);
                        reached &= reached - 1;
                    }
                }
                ChildKind::Triangles(index) => {
                    let block = &bvh.tree.blocks[index];
                    let mut left = triangles_in_box(block, axes, &bounds);
                    while left != 0 {
                        found.push(bvh.tree.indices().of(block, left.trailing_zeros() as usize));
                        left &= left - 1;
                    }
                }
                ChildKind::Spheres(_) | ChildKind::Empty => {}
            }
        }
    }
}

/// Returns the children whose boxes overlap a box, as bits.
#[inline(always)]
fn children_in_box(node: &Node, axes: [usize; 3], [lower, upper]: &[[f32; 3]; 2]) -> u32 {
    let mut inside = [1u32; WIDTH];
    for k in 0..3 {
        let (low, high) = (&node.planes[axes[k] % 3], &node.planes[axes[k] % 3 + 3]);
        for i in 0..WIDTH {
            inside[i] &= u32::from(low[i] <= upper[k]) & u32::from(high[i] >= lower[k]);
        }
    }
    let mut bits = 0;
    for i in 0..WIDTH {
        bits |= inside[i] << i;
    }
    bits
}

/// Returns the triangles of a leaf whose boxes overlap a box, as bits.
#[inline(always)]
fn triangles_in_box(block: &Block, axes: [usize; 3], [lower, upper]: &[[f32; 3]; 2]) -> u32 {
    let mut outside = [0u8; WIDTH];
    for k in 0..3 {
        let x = &block.vertices[axes[k] % 3];
        for i in 0..WIDTH {
            outside[i] |= u8::from(x[i] < lower[k]) << (2 * k);
            outside[i] |= u8::from(x[i] > upper[k]) << (2 * k + 1);
        }
    }
    let mut bits = 0;
    for i in 0..WIDTH {
        let [a, b, c] = [0, 1, 2].map(|k| outside[block.corner(k, i)]);
        bits |= u32::from(a & b & c == 0) << i;
    }
    bits & u32::from(block.present)
}
