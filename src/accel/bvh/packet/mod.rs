//! 16 rays that go about the same way through the tree together.
//!
//! One ray that bounds them all finds the children of a node that any of them can meet; then the 16
//! rays are tested against each of these, and against each triangle of a leaf, lane by lane
//! ([`triangle`]).

mod any;
mod closest;
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

/// What stands on the stack of a traversal.
pub trait Waiting: Sized + 'static {
    /// What one ray alone has yet to visit.
    type Alone;
    /// Nothing.
    fn alone() -> Self::Alone;
    /// Room for the packets of this thread.
    fn kept() -> &'static LocalKey<Cell<Vec<Self>>>;
}

/// What is yet to visit.
pub struct Stacks<E: Waiting> {
    /// By the rays together: the thread's own, whose room it keeps.
    packet: Vec<E>,
    /// By one ray alone.
    single: E::Alone,
}

impl<E: Waiting> Stacks<E> {
    /// Empty stacks. (No closure gets them: that would be compiled for the portable tier.)
    #[inline(always)]
    pub fn take() -> Self {
        Self { packet: E::kept().take(), single: E::alone() }
    }

    /// Keeps the room for the thread's next packet.
    #[inline(always)]
    pub fn keep(self) {
        let mut stack = self.packet;
        stack.clear();
        E::kept().set(stack);
    }
}

/// The numbers of the bits that are set, from the lowest on.
struct Bits(u32);

impl Iterator for Bits {
    type Item = usize;
    #[inline(always)]
    fn next(&mut self) -> Option<usize> {
        let lowest = self.0.trailing_zeros() as usize;
        self.0 &= self.0.wrapping_sub(1);
        (lowest < LANES).then_some(lowest)
    }
}

/// 16 rays on their way through the tree.
pub struct Packet<'a, T> {
    tier: T,
    tree: &'a Tree,
    geometry: &'a Geometry,
    query: &'a Query,
    rays: &'a Rays,
    /// Ends of the segments as the boxes see them; -inf where a ray is done.
    tfar: [f32; LANES],
    /// Around the rays.
    frustum: Frustum,
    /// Where it ends: see [`Frustum::end`].
    end: f32,
}

impl<'a, T: Tier> Packet<'a, T> {
    /// The active rays of a query, which are coherent ([`Query::coherent`]), or aligned
    /// ([`Query::aligned`]) if it is asked for any hit.
    #[inline(always)]
    pub fn new(
        tier: T,
        (tree, geometry): (&'a Tree, &'a Geometry),
        (query, rays): (&'a Query, &'a Rays),
        active: &Mask,
    ) -> Self {
        let mut tfar = query.tfar;
        for i in 0..LANES {
            tfar[i] = if active.0[i] != 0 { tfar[i] } else { f32::NEG_INFINITY };
        }
        let (frustum, end) = Frustum::new(tier, query, active, &tfar, &tree.bounds);
        Self { tier, tree, geometry, query, rays, tfar, frustum, end }
    }

    /// The frustum ends with the last ray.
    #[inline(always)]
    pub fn shorten(&mut self) {
        self.end = self.frustum.end(self.tier, self.query, &self.tfar);
    }

    /// One of the rays.
    #[inline(always)]
    fn single(&self, i: usize) -> Single<'a, T> {
        Single::new(self.tier, (self.tree, self.geometry), self.query.lane(i), self.rays)
    }
}

/// Bits as lanes: all bits set.
#[inline(always)]
fn spread(bits: u32) -> [i32; LANES] {
    let mut lanes = [0; LANES];
    for i in 0..LANES {
        lanes[i] = -(((bits >> i) & 1) as i32);
    }
    lanes
}
