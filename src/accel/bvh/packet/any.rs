//! Occlusion of the rays of a packet: whether each has any hit within its segment.

use std::cell::Cell;
use std::thread::LocalKey;

use super::{Bits, Packet, StackEntry, Stacks, lanes_from_bits};
use crate::accel::bvh::node::{Block, Child, ChildKind, Indices, Node};
use crate::accel::bvh::simd::{Path, Tier};
use crate::ray::LANES;

/// A subtree that at most this many rays enter is traversed ray by ray.
const MAX_SINGLE_RAYS: u32 = 4;

/// A child that is still to be visited, and the rays that enter its box, as bits.
#[derive(Clone, Copy)]
pub struct AnyEntry {
    pub(super) child: Child,
    pub(super) entering: u32,
}

thread_local! {
    static STACK: Cell<Vec<AnyEntry>> = const { Cell::new(Vec::new()) };
}

impl StackEntry for AnyEntry {
    type SingleStack = Path;
    #[inline(always)]
    fn single_stack() -> Path {
        Path::new()
    }
    fn thread_stack() -> &'static LocalKey<Cell<Vec<Self>>> {
        &STACK
    }
}

impl<T: Tier> Packet<'_, T> {
    /// Returns the occluded rays: all bits of their lanes are set. `stacks` must be empty.
    #[inline(always)]
    pub fn occluded(mut self, stacks: &mut Stacks<AnyEntry>) -> [i32; LANES] {
        let mut occluded = [0; LANES];
        let mut left = self.left();
        stacks.packet.push(AnyEntry { child: Child::node(0), entering: left });
        while let Some(entry) = stacks.packet.pop() {
            let entering = entry.entering & left;
            match entry.child.kind() {
                _ if entering == 0 => {}
                ChildKind::Node(index) if entering.count_ones() > MAX_SINGLE_RAYS => {
                    self.push_any(&self.tree.nodes[index], &mut stacks.packet);
                }
                ChildKind::Node(_) => {
                    for i in Bits(entering) {
                        if self.single(i).occluded_below(entry.child, &mut stacks.single) {
                            occluded[i] = -1;
                        }
                    }
                    self.finish_rays(&occluded);
                    left = self.left();
                }
                _ => {
                    self.any_in_leaf(entry.child, entering, &mut occluded);
                    left = self.left();
                }
            }
        }
        occluded
    }

    /// Returns the active rays that are not occluded so far, as bits. A ray whose `tfar` is below
    /// its `tnear` is not among them.
    #[inline(always)]
    pub(super) fn left(&self) -> u32 {
        self.tier.at_most(&self.query.tnear, &self.tfar)
    }

    /// Returns the scaled ray parameters at which the rays enter and leave the box of a node's
    /// child, clipped to `tnear` and `tfar`. A ray misses the box if the first exceeds the second.
    /// The rays may have several octants.
    #[inline(always)]
    fn slabs_of_any_octant(&self, node: &Node, slot: usize) -> ([f32; LANES], [f32; LANES]) {
        let q = self.query;
        let (mut near, mut far) = (q.tnear, self.tfar);
        for axis in 0..3 {
            let (lower, upper) = (node.planes[axis][slot], node.planes[axis + 3][slot]);
            for i in 0..LANES {
                let backward = q.near_inverse[axis][i] < 0.0;
                let (enter, leave) = if backward { (upper, lower) } else { (lower, upper) };
                let t0 = T::mul_sub(enter, q.near_inverse[axis][i], q.near_offset[axis][i]);
                let t1 = T::mul_sub(leave, q.far_inverse[axis][i], q.far_offset[axis][i]);
                near[i] = T::larger(t0, near[i]);
                far[i] = T::lesser(t1, far[i]);
            }
        }
        (near, far)
    }

    /// Pushes the children that at least one ray enters, from far to near in the order of the first
    /// ray's octant. So the nearest is popped first.
    #[inline(always)]
    pub(super) fn push_any(&self, node: &Node, stack: &mut Vec<AnyEntry>) {
        for place in Bits(self.tier.children_in_frustum(node, &self.frustum, self.end_depth)) {
            let slot = node.ordered(self.frustum.octant, place);
            let (near, far) = self.slabs_of_any_octant(node, slot);
            let entering = self.tier.at_most(&near, &far);
            if entering != 0 {
                stack.push(AnyEntry { child: node.children[slot], entering });
            }
        }
    }

    /// Tests the rays in `entering` against a leaf. Adds the occluded ones to `occluded`.
    #[inline(always)]
    pub fn any_in_leaf(&mut self, leaf: Child, entering: u32, occluded: &mut [i32; LANES]) {
        match leaf.kind() {
            ChildKind::Triangles(index) => {
                let tree = self.tree;
                self.any_in_block((&tree.blocks[index], tree.indices()), entering, occluded);
            }
            ChildKind::Spheres(index) => self.any_in_spheres(index, entering, occluded),
            ChildKind::Node(_) | ChildKind::Empty => {}
        }
        self.finish_rays(occluded);
    }

    /// Sets `tfar` of the occluded rays to -inf, so that no later test includes them.
    #[inline(always)]
    pub(super) fn finish_rays(&mut self, occluded: &[i32; LANES]) {
        for i in 0..LANES {
            self.tfar[i] = if occluded[i] != 0 { f32::NEG_INFINITY } else { self.tfar[i] };
        }
    }

    #[inline(always)]
    pub(super) fn any_in_block(
        &mut self,
        (block, indices): (&Block, Indices),
        entering: u32,
        occluded: &mut [i32; LANES],
    ) {
        let triangles = self.tier.triangles_in_frustum(block, &self.frustum, self.end_depth);
        // Each ray is tested against 16 triangles, or each triangle against 16 rays: the fewer
        // tests.
        if entering.count_ones() <= triangles.count_ones() {
            for i in Bits(entering) {
                if self.single(i).any_in_block(block, indices) {
                    occluded[i] = -1;
                }
            }
            return;
        }
        let entering = lanes_from_bits(entering);
        for slot in Bits(triangles) {
            let triangle = (slot, indices.of(block, slot));
            let Some(mut edges) = self.edges(block, triangle, &entering) else { continue };
            let mut rest = 0;
            for i in 0..LANES {
                // The depth of the hit lies between those of the corners. If all of these lie
                // inside the segment, t need not be computed.
                let within = self.query.within(i, edges.first[i], edges.last[i]);
                let sure = edges.maybe[i] & !edges.unsure[i] & -i32::from(within);
                occluded[i] |= sure;
                self.tfar[i] = if sure != 0 { f32::NEG_INFINITY } else { self.tfar[i] };
                edges.maybe[i] &= !sure;
                rest |= edges.maybe[i];
            }
            if rest == 0 {
                continue;
            }
            let test = self.test(block, slot, edges);
            for i in 0..LANES {
                let t = test.t[i];
                let counts = (test.hit[i] != 0)
                    & (t > f64::from(self.rays.tnear[i]))
                    & (t < f64::from(self.rays.tfar[i]));
                occluded[i] |= -i32::from(counts);
                self.tfar[i] = if counts { f32::NEG_INFINITY } else { self.tfar[i] };
            }
        }
    }
}
