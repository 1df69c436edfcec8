//! What every instruction-set tier does in its own way: boxes and triangles 16 at a time.
//!
//! The tiers differ in speed and in the rounding of box distances, never in an answer: their
//! triangle tests only rule out what [`super::exact`] would, and that decides.

#[cfg(target_arch = "x86_64")]
pub mod avx2;
#[cfg(all(target_arch = "x86_64", lightpath_avx512))]
pub mod avx512;
pub mod portable;
mod stack;
#[cfg(test)]
mod tests;

pub use self::stack::{MAX_DEPTH, Path, Stack};

use super::frustum::{Frustum, Least};
use super::node::{Block, Child, Node, WIDTH};
use super::query::Lane;
use crate::simd::Kernel;

/// Relative and absolute slack of the edge functions' signs in f32: with products p and q their
/// difference is off by at most 3u max(|p|, |q|) where p and q cancel, and by 2^-149 where they
/// underflow. In units of max |q|.
pub const EDGE_SLACK: f32 = 4.0 * f32::EPSILON;
/// See [`EDGE_SLACK`]. No denormal number: with one of those Intel's processors take some 150
/// cycles for a sum.
pub const EDGE_FLOOR: f32 = f32::MIN_POSITIVE;

/// The triangles of a leaf that a ray's line may meet, by bit.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Candidates {
    /// Those that may be met between `tnear` and `tfar`.
    pub maybe: u32,
    /// Those of `maybe` that the line certainly meets: the signs of their edge functions are beyond
    /// the rounding of f32.
    pub sure: u32,
}

/// The kernels of one tier.
pub trait Tier: Least {
    /// Whether the tier has fused multiply-add.
    const FUSED: bool;

    /// a b - c, rounded once where the tier can do that. For bounds only.
    #[inline(always)]
    fn mul_sub(a: f32, b: f32, c: f32) -> f32 {
        if Self::FUSED { a.mul_add(b, -c) } else { a * b - c }
    }

    /// Runs a kernel compiled for this tier. Elsewhere the tier's own kernels work, but slowly:
    /// every instruction of them is a call.
    fn run<K: Kernel>(self, kernel: K) -> K::Output;

    /// The nearest of the children whose boxes the ray meets before `tfar`, or [`Child::EMPTY`];
    /// pushes the others, the nearest of these last.
    fn nearest(self, node: &Node, lane: &Lane, tfar: f32, stack: &mut Stack) -> Child;

    /// The children whose boxes the ray meets before `tfar`, by bit.
    fn met(self, node: &Node, lane: &Lane, tfar: f32) -> u32;

    /// The places, in the order of the octant, of the children whose boxes a frustum meets before
    /// `end`, by bit.
    fn overlaps(self, node: &Node, frustum: &Frustum, end: f32) -> u32;

    /// The triangles of a leaf that are not all on one side of a frustum, or beyond `end`, by bit.
    fn overlapping(self, block: &Block, frustum: &Frustum, end: f32) -> u32;

    /// The lanes where `a` is at most `b`, by bit.
    fn at_most(self, a: &[f32; WIDTH], b: &[f32; WIDTH]) -> u32;

    /// The triangles of a leaf that [`super::exact`] has to look at.
    fn candidates(self, block: &Block, lane: &Lane, tfar: f32) -> Candidates;

    /// Told of each sphere that is tested; for counting.
    #[inline(always)]
    fn meets_sphere(self) {}
}

/// The lesser of each pair; the second where one is NaN.
///
/// Written as a loop it becomes a masked store where `a` comes from memory, and those cannot be
/// forwarded to the next load.
#[inline(always)]
pub fn min8(a: [f32; 8], b: [f32; 8]) -> [f32; 8] {
    #[cfg(target_arch = "x86_64")]
    // SAFETY: SSE is part of x86-64; all addresses are within the arrays.
    unsafe {
        use std::arch::x86_64::{_mm_loadu_ps, _mm_min_ps, _mm_storeu_ps};
        let mut least = a;
        for half in [0, 4] {
            let (a, b) = (_mm_loadu_ps(a.as_ptr().add(half)), _mm_loadu_ps(b.as_ptr().add(half)));
            _mm_storeu_ps(least.as_mut_ptr().add(half), _mm_min_ps(a, b));
        }
        least
    }
    #[cfg(not(target_arch = "x86_64"))]
    std::array::from_fn(|i| if a[i] < b[i] { a[i] } else { b[i] })
}
