//! What every instruction-set tier does in its own way: boxes and triangles 16 at a time.
//!
//! The tiers differ in speed and in the rounding of box distances, never in an answer: their
//! triangle tests only rule out what [`super::exact`] would, and that decides.

#[cfg(all(target_arch = "x86_64", lightpath_avx512))]
pub mod avx512;
pub mod portable;
mod stack;

pub use self::stack::{MAX_DEPTH, Stack};

use super::node::{Block, Node};
use super::query::Lane;

/// Relative and absolute slack of the edge functions' signs in f32: with products p and q their
/// difference is off by at most 3u max(|p|, |q|) where p and q cancel, and by 2^-149 where they
/// underflow. In units of max |q|.
pub const EDGE_SLACK: f32 = 4.0 * f32::EPSILON;
/// See [`EDGE_SLACK`].
pub const EDGE_FLOOR: f32 = 1e-42;

/// The kernels of one tier.
pub trait Tier: Copy {
    /// Pushes the children whose boxes the ray meets, the nearest last.
    fn push_ordered(self, node: &Node, lane: &Lane, stack: &mut Stack);

    /// Pushes the children whose boxes the ray meets, in any order, distances included.
    fn push_any(self, node: &Node, lane: &Lane, stack: &mut Stack);

    /// The triangles of a leaf that the ray's line may meet, by bit.
    fn candidates(self, block: &Block, lane: &Lane) -> u32;
}
