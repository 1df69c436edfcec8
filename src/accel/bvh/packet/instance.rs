//! Tests an instance against a packet. The tests are separate kernels, because most scenes have no
//! instances.

use std::cell::Cell;

use super::any::AnyEntry;
use super::closest::ClosestEntry;
use super::{Bits, Packet};
use crate::accel::bvh::MIN_TOGETHER;
use crate::accel::bvh::hits::ClosestHits;
use crate::accel::bvh::local_rays::LocalRays;
use crate::accel::bvh::node::{Child, ChildKind};
use crate::accel::bvh::simd::Tier;
use crate::accel::bvh::single::ClosestHit;
use crate::ray::LANES;
use crate::simd::Kernel;

thread_local! {
    // The stacks of the scene's tree are in use.
    static CLOSEST: Cell<Vec<ClosestEntry>> = const { Cell::new(Vec::new()) };
    static ANY: Cell<Vec<AnyEntry>> = const { Cell::new(Vec::new()) };
}

/// Updates the closest hits of the rays in `entering` with an instance.
pub struct ClosestInInstance<'s, 'a, T> {
    pub packet: &'s mut Packet<'a, T>,
    pub instance: usize,
    pub entering: u32,
    pub best: &'s mut ClosestHits,
}

impl<T: Tier> Kernel for ClosestInInstance<'_, '_, T> {
    type Output = ();
    #[inline(always)]
    fn run(self) {
        let Self { packet, instance, entering, best } = self;
        let (scene, tier) = ((packet.tree, packet.geometry), packet.tier);
        let local = LocalRays::new(scene, instance, packet.query, packet.rays);
        let mut stack = CLOSEST.take();
        let mut rest = entering;
        while rest != 0 {
            let part = rest & tier.bits(&local.query.coherent(rest.trailing_zeros() as usize));
            rest &= !part;
            if part.count_ones() < MIN_TOGETHER {
                for i in Bits(part) {
                    let mut traced = ClosestHit::from_lane(best, i, packet.tfar[i]);
                    packet.single(i).closest_in_copy(&local, &mut traced);
                    packet.store_if_new(i, &traced, best);
                }
                continue;
            }
            let rays = (&local.query, &local.rays);
            let boxes = Packet::new(tier, (local.tree, local.geometry), rays, part);
            packet.closest_in_copy(boxes, &local, best, &mut stack);
        }
        CLOSEST.set(stack);
        packet.shorten();
    }
}

/// Tests the rays in `entering` against an instance. Adds the occluded ones to `occluded`.
pub struct AnyInInstance<'s, 'a, T> {
    pub packet: &'s mut Packet<'a, T>,
    pub instance: usize,
    pub entering: u32,
    pub occluded: &'s mut [i32; LANES],
}

impl<T: Tier> Kernel for AnyInInstance<'_, '_, T> {
    type Output = ();
    #[inline(always)]
    fn run(self) {
        let Self { packet, instance, entering, occluded } = self;
        let (scene, tier) = ((packet.tree, packet.geometry), packet.tier);
        let local = LocalRays::new(scene, instance, packet.query, packet.rays);
        let mut stack = ANY.take();
        let mut rest = entering;
        while rest != 0 {
            let part = rest & tier.bits(&local.query.aligned(rest.trailing_zeros() as usize));
            rest &= !part;
            if part.count_ones() < MIN_TOGETHER {
                for i in Bits(part) {
                    if packet.single(i).any_in_copy(&local) {
                        occluded[i] = -1;
                    }
                }
                continue;
            }
            let rays = (&local.query, &local.rays);
            let boxes = Packet::new(tier, (local.tree, local.geometry), rays, part);
            packet.any_in_copy(boxes, &local, occluded, &mut stack);
        }
        ANY.set(stack);
    }
}

impl<T: Tier> Packet<'_, T> {
    /// Updates the closest hits of the rays of `boxes`, which are rays of this packet in the
    /// coordinates of an instance's mesh.
    #[inline(always)]
    fn closest_in_copy(
        &mut self,
        mut boxes: Packet<'_, T>,
        local: &LocalRays,
        best: &mut ClosestHits,
        stack: &mut Vec<ClosestEntry>,
    ) {
        boxes.end_at_hits(local, best);
        let mut may_have_shortened = false;
        stack.push(ClosestEntry::root());
        while let Some(entry) = stack.pop() {
            let entering = self.tier.at_most(&entry.near, &boxes.tfar);
            if entering == 0 {
                continue;
            }
            match entry.child.kind() {
                ChildKind::Node(index) => {
                    if may_have_shortened {
                        boxes.shorten();
                        self.shorten();
                        may_have_shortened = false;
                    }
                    boxes.push(&local.tree.nodes[index], stack);
                }
                ChildKind::Triangles(index) => {
                    self.closest_in_block((&local.block(index), local.indices()), entering, best);
                    boxes.end_at_hits(local, best);
                    may_have_shortened = true;
                }
                ChildKind::Spheres(_) | ChildKind::Empty => {}
            }
        }
    }

    /// Adds the occluded rays of `boxes` to `occluded`: see [`Packet::closest_in_copy`].
    #[inline(always)]
    fn any_in_copy(
        &mut self,
        mut boxes: Packet<'_, T>,
        local: &LocalRays,
        occluded: &mut [i32; LANES],
        stack: &mut Vec<AnyEntry>,
    ) {
        boxes.finish_rays(occluded);
        let mut left = boxes.left();
        stack.push(AnyEntry { child: Child::node(0), entering: left });
        while let Some(entry) = stack.pop() {
            let entering = entry.entering & left;
            match entry.child.kind() {
                _ if entering == 0 => {}
                ChildKind::Node(index) => boxes.push_any(&local.tree.nodes[index], stack),
                ChildKind::Triangles(index) => {
                    self.any_in_block((&local.block(index), local.indices()), entering, occluded);
                    self.finish_rays(occluded);
                    boxes.finish_rays(occluded);
                    left = boxes.left();
                }
                ChildKind::Spheres(_) | ChildKind::Empty => {}
            }
        }
    }

    /// Ends the active rays at their closest hits so far.
    #[inline(always)]
    fn end_at_hits(&mut self, local: &LocalRays, best: &ClosestHits) {
        for i in 0..LANES {
            let end = local.tfar(i, best.t[i], best.primitive[i]);
            let active = self.tfar[i] > f32::NEG_INFINITY;
            self.tfar[i] = if active { end } else { self.tfar[i] };
        }
    }
}
