//! Traversal of the tree by up to 16 rays together: coherent rays for closest hits, aligned rays
//! for occlusion ([`Query::coherent`], [`Query::aligned`]).
//!
//! A frustum around the rays culls the children of a node and the triangles of a leaf. Then the 16
//! lanes are tested together against each remaining child or triangle ([`triangle`]).

mod any;
mod closest;
mod instance;
mod reach;
mod spheres;
mod triangle;

use std::cell::Cell;
use std::thread::LocalKey;

use super::build::Tree;
use super::frustum::Frustum;
use super::query::Query;
use super::simd::Tier;
use super::single::Single;
use crate::geometry::Geometry;
use crate::ray::{LANES, Mask, Rays};

/// A stack entry of a packet traversal.
pub trait StackEntry: Sized + 'static {
    /// The stack for tracing one ray alone.
    type SingleStack;
    /// Returns an empty stack for one ray.
    fn single_stack() -> Self::SingleStack;
    /// Returns the packet stack of this thread. The thread keeps it to reuse its memory.
    fn thread_stack() -> &'static LocalKey<Cell<Vec<Self>>>;
}

/// The stacks of a packet traversal.
pub struct Stacks<E: StackEntry> {
    /// Stack of the packet. Its memory belongs to the thread.
    packet: Vec<E>,
    /// Stack for tracing one ray alone.
    pub single: E::SingleStack,
}

impl<E: StackEntry> Stacks<E> {
    /// Takes the empty packet stack of this thread, and makes an empty stack for single rays.
    // Traversal inside the closure of `LocalKey::with` would be compiled for the portable
    // instruction set. So the stack is taken out and given back.
    #[inline(always)]
    pub fn take() -> Self {
        Self { packet: E::thread_stack().take(), single: E::single_stack() }
    }

    /// Gives the packet stack back to the thread, for its next packet.
    #[inline(always)]
    pub fn keep(self) {
        let mut stack = self.packet;
        stack.clear();
        E::thread_stack().set(stack);
    }
}

/// Iterator over the indices of the bits that are set, among the lowest 16. Lowest first.
pub struct Bits(pub u32);

impl Iterator for Bits {
    type Item = usize;
    #[inline(always)]
    fn next(&mut self) -> Option<usize> {
        let lowest = self.0.trailing_zeros() as usize;
        self.0 &= self.0.wrapping_sub(1);
        (lowest < LANES).then_some(lowest)
    }
}

/// The rays of a packet and the tree that they traverse.
pub struct Packet<'a, T> {
    tier: T,
    tree: &'a Tree,
    geometry: &'a Geometry,
    query: &'a Query,
    rays: &'a Rays,
    /// Ends of the segments, scaled like [`Query::tfar`]. A closest hit so far shortens them; -inf
    /// for an inactive or occluded ray.
    tfar: [f32; LANES],
    /// Frustum around the active rays.
    frustum: Frustum,
    /// Where the frustum ends: see [`Frustum::end_depth`].
    end_depth: f32,
}

impl<'a, T: Tier> Packet<'a, T> {
    /// Prepares the rays whose bits are set in `active`. At least one bit must be set. The rays
    /// must be aligned ([`Query::aligned`]), and for closest hits coherent ([`Query::coherent`]).
    #[inline(always)]
    pub fn new(
        tier: T,
        (tree, geometry): (&'a Tree, &'a Geometry),
        (query, rays): (&'a Query, &'a Rays),
        active: u32,
    ) -> Self {
        let lane = query.lane(active.trailing_zeros() as usize);
        let active = Mask(lanes_from_bits(active));
        let mut tfar = query.tfar;
        for i in 0..LANES {
            tfar[i] = if active.0[i] != 0 { tfar[i] } else { f32::NEG_INFINITY };
        }
        let (frustum, end_depth) = Frustum::new(tier, lane, &active, &tfar, &tree.bounds);
        Self { tier, tree, geometry, query, rays, tfar, frustum, end_depth }
    }

    /// Moves the end of the frustum to the farthest end of a ray.
    #[inline(always)]
    pub fn shorten(&mut self) {
        self.end_depth = self.frustum.end_depth(self.tier, self.query, &self.tfar);
    }

    /// Prepares ray `i` for a traversal without the other rays.
    #[inline(always)]
    fn single(&self, i: usize) -> Single<'a, T> {
        Single::new(self.tier, (self.tree, self.geometry), self.query.lane(i), self.rays)
    }
}

/// Converts bits to lanes: all bits of lane i are set if bit i is.
#[inline(always)]
fn lanes_from_bits(bits: u32) -> [i32; LANES] {
    let mut lanes = [0; LANES];
    for i in 0..LANES {
        lanes[i] = -(((bits >> i) & 1) as i32);
    }
    lanes
}
