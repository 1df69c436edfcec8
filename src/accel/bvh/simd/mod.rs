//! Kernels of each instruction set: tests of 16 boxes or 16 triangles at a time.
//!
//! Instruction sets differ in speed and in the rounding of box distances, but never in a hit. Their
//! triangle tests are conservative. They reject or accept only triangles for which f32 is certain.
//! [`super::exact`] decides the others.

#[cfg(target_arch = "x86_64")]
pub mod avx2;
#[cfg(all(target_arch = "x86_64", lightpath_avx512))]
pub mod avx512;
mod loops;
pub mod min8;
#[cfg(target_arch = "aarch64")]
pub mod neon;
pub mod portable;
mod stack;
#[cfg(test)]
mod tests;

pub use self::stack::{MAX_DEPTH, Path, Paths, Stack};

use super::frustum::{Frustum, HorizontalMin};
use super::node::{Block, Child, Node, WIDTH};
use super::query::{Lane, max, min};
use crate::ray::Mask;
use crate::simd::Kernel;

/// Relative slack of the signs of edge functions in f32, in units of max |q| over the three edges.
///
/// An edge function is a difference of two products p and q. Its error is at most 3u max(|p|, |q|)
/// (u = 2^-24) if p and q cancel, and 2^-149 if they underflow. [`EDGE_FLOOR`] is the absolute
/// slack.
pub const EDGE_SLACK: f32 = 4.0 * f32::EPSILON;
/// Absolute slack of the signs of edge functions: see [`EDGE_SLACK`]. Not a denormal number,
/// because adding a denormal takes some 150 cycles on Intel processors.
pub const EDGE_FLOOR: f32 = f32::MIN_POSITIVE;

/// Triangles of a leaf that a ray's line may hit, as bits.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Candidates {
    /// Triangles that may be hit between the origin of the ray and `tfar`.
    pub maybe: u32,
    /// Subset of `maybe`: triangles that the line certainly hits. The magnitudes of their edge
    /// functions exceed the rounding error of f32.
    pub sure: u32,
}

/// The kernels of one instruction set, which we call a tier.
pub trait Tier: HorizontalMin {
    /// Whether the instruction set has fused multiply-add.
    const FUSED: bool;

    /// Returns a b - c, rounded once if [`Self::FUSED`]. Only for bounds, because its bits depend
    /// on the instruction set.
    #[inline(always)]
    fn mul_sub(a: f32, b: f32, c: f32) -> f32 {
        if Self::FUSED { a.mul_add(b, -c) } else { a * b - c }
    }

    /// Returns the smaller number; `b` if `a` is NaN, and either if `b` is. Only for bounds,
    /// because the sign of a zero depends on the instruction set.
    #[inline(always)]
    fn lesser(a: f32, b: f32) -> f32 {
        min(a, b)
    }

    /// Returns the larger number; `b` if `a` is NaN, and either if `b` is. Only for bounds,
    /// because the sign of a zero depends on the instruction set.
    #[inline(always)]
    fn larger(a: f32, b: f32) -> f32 {
        max(a, b)
    }

    /// Runs a kernel that is compiled for this instruction set. In other code the functions of this
    /// trait work, but slowly: every instruction is a call.
    fn run<K: Kernel>(self, kernel: K) -> K::Output;

    /// Returns the first child whose box the ray enters before `tfar`, or [`Child::EMPTY`]. Pushes
    /// the other such children, so that the nearer ones are popped first. The order is that of the
    /// ray's octant ([`Node::order`]), not that of the distances.
    fn first_in_order(self, node: &Node, lane: &Lane, tfar: f32, stack: &mut Stack) -> Child;

    /// Returns the slots of the children whose boxes the ray enters before `tfar`, as bits.
    fn hit_children(self, node: &Node, lane: &Lane, tfar: f32) -> u32;

    /// Returns the children whose boxes may overlap a frustum before `end`. Bit j is the child at
    /// place j of the order of the frustum's octant.
    fn children_in_frustum(self, node: &Node, frustum: &Frustum, end: f32) -> u32;

    /// Returns the triangles of a leaf that may overlap a frustum before `end`, as bits. A triangle
    /// is left out only if all its corners lie outside one plane.
    fn triangles_in_frustum(self, block: &Block, frustum: &Frustum, end: f32) -> u32;

    /// Returns the active lanes, as bits.
    fn bits(self, mask: &Mask) -> u32;

    /// Returns the lanes in which `a` is at most `b`, as bits. A NaN is not.
    fn at_most(self, a: &[f32; WIDTH], b: &[f32; WIDTH]) -> u32;

    /// Returns the triangles of a leaf that the ray may hit before `tfar`. It certainly hits no
    /// other triangle there.
    fn candidates(self, block: &Block, lane: &Lane, tfar: f32) -> Candidates;

    /// Called for each test of a sphere. [`super::visits`] counts the calls.
    #[inline(always)]
    fn count_sphere_test(self) {}
}
