//! Closest hits of the rays of a packet.

use std::cell::Cell;
use std::thread::LocalKey;

use super::{Bits, Packet, StackEntry, Stacks, lanes_from_bits};
use crate::accel::bvh::hits::ClosestHits;
use crate::accel::bvh::node::{Block, Child, ChildKind, Indices, Node};
use crate::accel::bvh::simd::{Stack, Tier};
use crate::accel::bvh::single::ClosestHit;
use crate::ray::{LANES, NONE};

/// A subtree that at most this many rays enter is traversed ray by ray.
const MAX_SINGLE_RAYS: u32 = 3;

/// A child that is still to be visited, and the scaled ray parameters at which the rays enter its
/// box: NaN for a ray that misses the box, so that it enters for no `tfar`, even an infinite one.
#[derive(Clone, Copy)]
#[repr(C, align(64))]
pub struct ClosestEntry {
    pub(super) near: [f32; LANES],
    pub(super) child: Child,
}

impl ClosestEntry {
    /// The root of a tree, which all rays enter.
    #[inline(always)]
    pub(super) fn root() -> Self {
        Self { near: [f32::NEG_INFINITY; LANES], child: Child::node(0) }
    }
}

thread_local! {
    static STACK: Cell<Vec<ClosestEntry>> = const { Cell::new(Vec::new()) };
}

impl StackEntry for ClosestEntry {
    type SingleStack = Stack;
    #[inline(always)]
    fn single_stack() -> Stack {
        Stack::new()
    }
    fn thread_stack() -> &'static LocalKey<Cell<Vec<Self>>> {
        &STACK
    }
}

impl<T: Tier> Packet<'_, T> {
    /// Updates the closest hits of the active rays with the whole tree. `stacks` must be empty.
    #[inline(always)]
    pub fn closest(mut self, stacks: &mut Stacks<ClosestEntry>, best: &mut ClosestHits) {
        stacks.packet.push(ClosestEntry::root());
        // True if rays were tested against primitives since the frustum was last shortened: a hit
        // may have shortened a ray. The frustum is shortened only before another child is visited,
        // because often none is left.
        let mut may_have_shortened = false;
        while let Some(entry) = stacks.packet.pop() {
            let entering = self.tier.at_most(&entry.near, &self.tfar);
            if entering == 0 {
                continue;
            }
            if let (ChildKind::Node(_), ..=MAX_SINGLE_RAYS) =
                (entry.child.kind(), entering.count_ones())
            {
                for i in Bits(entering) {
                    let mut traced = ClosestHit::from_lane(best, i, self.tfar[i]);
                    self.single(i).closest_below(entry.child, &mut stacks.single, &mut traced);
                    self.store_if_new(i, &traced, best);
                }
                may_have_shortened = true;
                continue;
            }
            if may_have_shortened {
                self.shorten();
                may_have_shortened = false;
            }
            if let ChildKind::Node(index) = entry.child.kind() {
                self.push(&self.tree.nodes[index], &mut stacks.packet);
            } else {
                self.closest_in_leaf(entry.child, entering, best);
                may_have_shortened = true;
            }
        }
    }

    /// Updates the closest hits of the rays in `entering` with a leaf.
    #[inline(always)]
    pub fn closest_in_leaf(&mut self, leaf: Child, entering: u32, best: &mut ClosestHits) {
        match leaf.kind() {
            ChildKind::Triangles(index) => {
                let tree = self.tree;
                self.closest_in_block((&tree.blocks[index], tree.indices()), entering, best);
            }
            ChildKind::Spheres(index) => self.closest_in_spheres(index, entering, best),
            ChildKind::Node(_) | ChildKind::Empty => {}
        }
    }

    /// Stores `traced`, the closest hit of ray `i` after it was traced alone, in `best` if it is a
    /// new hit. An old hit stays as it is in `best`, because [`ClosestHit::from_lane`] left out its
    /// weights.
    #[inline(always)]
    pub(super) fn store_if_new(&mut self, i: usize, traced: &ClosestHit, best: &mut ClosestHits) {
        if traced.t != best.t[i] || traced.primitive != best.primitive[i] {
            self.tfar[i] = traced.tfar;
            traced.store(best, i);
        }
    }

    /// Returns the scaled ray parameters at which the rays enter and leave the box of a node's
    /// child, clipped to `tnear` and `tfar`. A ray misses the box if the first exceeds the second.
    /// All rays have the same octant.
    #[inline(always)]
    fn slabs(&self, node: &Node, slot: usize) -> ([f32; LANES], [f32; LANES]) {
        let (q, octant) = (self.query, self.frustum.octant);
        let mut near = q.tnear;
        let mut far = self.tfar;
        for axis in 0..3 {
            let row = (axis + 3 * ((octant >> axis) & 1)) % 6;
            let enter = node.planes[row][slot];
            let leave = node.planes[2 * axis + 3 - row][slot];
            for i in 0..LANES {
                let t0 = T::mul_sub(enter, q.near_inverse[axis][i], q.near_offset[axis][i]);
                let t1 = T::mul_sub(leave, q.far_inverse[axis][i], q.far_offset[axis][i]);
                near[i] = T::larger(t0, near[i]);
                far[i] = T::lesser(t1, far[i]);
            }
        }
        (near, far)
    }

    /// Pushes the children that at least one ray enters, from far to near in the order of the
    /// octant. So the nearest is popped first.
    #[inline(always)]
    pub(super) fn push(&self, node: &Node, stack: &mut Vec<ClosestEntry>) {
        for place in Bits(self.tier.children_in_frustum(node, &self.frustum, self.end_depth)) {
            let slot = node.ordered(self.frustum.octant, place);
            let (mut near, far) = self.slabs(node, slot);
            let mut any = 0;
            for i in 0..LANES {
                let meets = near[i] <= far[i];
                any |= i32::from(meets);
                near[i] = if meets { near[i] } else { f32::NAN };
            }
            if any != 0 {
                stack.push(ClosestEntry { near, child: node.children[slot] });
            }
        }
    }

    #[inline(always)]
    pub(super) fn closest_in_block(
        &mut self,
        (block, indices): (&Block, Indices),
        entering: u32,
        best: &mut ClosestHits,
    ) {
        let triangles = self.tier.triangles_in_frustum(block, &self.frustum, self.end_depth);
        // Each ray is tested against 16 triangles, or each triangle against 16 rays: the fewer
        // tests.
        if entering.count_ones() <= triangles.count_ones() {
            for i in Bits(entering) {
                let mut traced = ClosestHit::from_lane(best, i, self.tfar[i]);
                self.single(i).closest_in_block(block, indices, &mut traced);
                self.store_if_new(i, &traced, best);
            }
            return;
        }
        let entering = lanes_from_bits(entering);
        for slot in Bits(triangles) {
            let primitive = indices.of(block, slot);
            let Some(mut edges) = self.edges(block, (slot, primitive), &entering) else { continue };
            for i in 0..LANES {
                edges.unsure[i] |= edges.maybe[i] & edges.blurred[i];
            }
            let test = self.test(block, slot, edges);
            let second_half = -i32::from(block.is_second_half(slot));
            for i in 0..LANES {
                let t = test.t[i];
                // Of equally near hits, the lowest primitive index wins. Without a hit, `best.t` is
                // the open end of the segment, where no hit counts.
                let closer = (t < best.t[i])
                    | ((t == best.t[i])
                        & (primitive < best.primitive[i])
                        & (best.primitive[i] != NONE));
                let counts = (test.hit[i] != 0) & closer & (t > f64::from(self.rays.tnear[i]));
                best.t[i] = if counts { t } else { best.t[i] };
                best.primitive[i] = if counts { primitive } else { best.primitive[i] };
                for (weights, found) in best.weights.iter_mut().zip(&test.weights) {
                    weights[i] = if counts { found[i] } else { weights[i] };
                }
                best.second_half[i] = if counts { second_half } else { best.second_half[i] };
                let tfar = self.query.tfar_for_hit(i, t);
                self.tfar[i] = if counts { tfar } else { self.tfar[i] };
            }
        }
    }
}
