//! The portable kernels, which every target supports. The tests compare the other instruction sets
//! with them.

use super::super::frustum::HorizontalMin;
use super::super::node::{Block, Node, WIDTH};
use super::super::query::{max, min};
use super::loops::{Loops, QUARTER};

/// The [`Tier`](super::Tier) that needs no particular instruction set.
#[derive(Debug, Clone, Copy)]
pub struct Portable;

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

impl Loops for Portable {
    #[inline(always)]
    fn min(a: f32, b: f32) -> f32 {
        min(a, b)
    }

    #[inline(always)]
    fn max(a: f32, b: f32) -> f32 {
        max(a, b)
    }

    #[inline(always)]
    fn mask_bits(self, mask: &[i32; WIDTH]) -> u32 {
        let mut bits = 0;
        for i in 0..WIDTH {
            bits |= u32::from(mask[i] != 0) << i;
        }
        bits
    }

    #[inline(always)]
    fn bits_in_order(self, mask: &[i32; WIDTH], node: &Node, octant: usize) -> u32 {
        let slots = self.mask_bits(mask);
        if slots == 0 {
            return 0;
        }
        (0..WIDTH).fold(0, |bits, j| bits | ((slots >> node.ordered(octant, j)) & 1) << j)
    }

    #[inline(always)]
    fn astride(self, block: &Block, flags: &[i32; WIDTH]) -> u32 {
        let mut bits = 0;
        for i in 0..WIDTH {
            let [a, b, c] = [0, 1, 2].map(|k| flags[block.corner(k, i)]);
            bits |= u32::from(a & b & c == 0) << i;
        }
        bits & u32::from(block.present)
    }

    #[inline(always)]
    fn corners(
        self,
        block: &Block,
        quarter: usize,
        x: &[f32; WIDTH],
        y: &[f32; WIDTH],
    ) -> [[[f32; QUARTER]; 2]; 3] {
        let mut corners = [[[0.0; QUARTER]; 2]; 3];
        for k in 0..3 {
            for i in 0..QUARTER {
                let v = block.corner(k, QUARTER * quarter + i);
                (corners[k][0][i], corners[k][1][i]) = (x[v], y[v]);
            }
        }
        corners
    }
}
