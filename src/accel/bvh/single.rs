//! Traversal of the tree by one ray.

use super::build::Tree;
use super::exact::{Ray64, ShearedTriangle, depth_range, weights_of};
use super::hits::ClosestHits;
use super::local_rays::LocalRays;
use super::node::{Block, Child, ChildKind, Indices, WIDTH};
use super::query::Lane;
use super::simd::{Path, Stack, Tier};
use crate::geometry::Geometry;
use crate::ray::{LANES, NONE, Rays};

/// The closest hit of a ray so far.
#[derive(Debug, Clone, Copy)]
pub struct ClosestHit {
    /// Ray parameter. Without a hit, the end of the segment.
    pub t: f64,
    /// `t` scaled for tests of boxes: see [`super::query::Query::tfar_for_hit`].
    pub tfar: f32,
    /// Scene-wide primitive index, or [`NONE`].
    pub primitive: u32,
    /// Edge functions of the triangle; 1, 0, 0 for a sphere and without a hit.
    edges: [f64; 3],
    /// Whether the triangle is the second half of a quad.
    second_half: bool,
}

impl ClosestHit {
    /// No hit, for lanes without a ray.
    pub const NONE: Self =
        Self { t: 0.0, tfar: 0.0, primitive: NONE, edges: [1.0, 0.0, 0.0], second_half: false };

    /// Returns the hit of a sphere.
    fn sphere(t: f64, tfar: f32, primitive: u32) -> Self {
        Self { t, tfar, primitive, edges: [1.0, 0.0, 0.0], second_half: false }
    }

    /// Returns lane `i` of a packet's closest hits, without its weights: `edges` are 1, 0, 0.
    #[inline(always)]
    pub fn from_lane(found: &ClosestHits, i: usize, tfar: f32) -> Self {
        Self::sphere(found.t[i], tfar, found.primitive[i])
    }

    /// Writes the hit to a lane of a packet's closest hits.
    #[inline(always)]
    pub fn store(&self, found: &mut ClosestHits, i: usize) {
        (found.t[i], found.primitive[i]) = (self.t, self.primitive);
        [found.weights[0][i], found.weights[1][i]] = weights_of(self.edges);
        found.weights[2][i] = 1.0;
        found.second_half[i] = -i32::from(self.second_half);
    }

    /// Whether a hit at `t` replaces this one: it is nearer, or equally near with a lower primitive
    /// index. Without a hit, `self.t` is the open end of the segment, where no hit counts.
    #[inline(always)]
    fn is_replaced_by(&self, t: f64, primitive: u32) -> bool {
        t < self.t || (t == self.t && primitive < self.primitive && self.primitive != NONE)
    }
}

/// One ray and the tree that it traverses.
pub struct Single<'a, T> {
    pub(super) tier: T,
    pub(super) tree: &'a Tree,
    geometry: &'a Geometry,
    pub(super) lane: Lane<'a>,
    /// The caller's rays. This ray is in lane `lane.i`.
    rays: &'a Rays,
    /// Scene-wide index of the primitive that the ray leaves, or [`NONE`].
    leaving: u32,
}

impl<'a, T: Tier> Single<'a, T> {
    #[inline(always)]
    pub fn new(
        tier: T,
        (tree, geometry): (&'a Tree, &'a Geometry),
        lane: Lane<'a>,
        rays: &'a Rays,
    ) -> Self {
        Self { tier, tree, geometry, lane, rays, leaving: rays.leaving[lane.i % LANES] }
    }

    /// Returns the rays in the coordinates of the mesh of an instance.
    #[inline(always)]
    pub(super) fn local_rays(&self, instance: usize) -> LocalRays<'a> {
        LocalRays::new((self.tree, self.geometry), instance, self.lane.query, self.rays)
    }

    /// Returns the ray in f64. Computed on demand, because most rays never need it.
    #[inline(always)]
    pub(super) fn ray(&self) -> Ray64 {
        Ray64::new(self.rays, self.lane.i % LANES, self.lane.axes[2])
    }

    /// Returns a [`ClosestHit`] without a hit, at the end of the segment.
    #[inline(always)]
    pub fn no_hit(&self) -> ClosestHit {
        ClosestHit::sphere(self.ray().tfar, self.lane.value(&self.lane.query.tfar), NONE)
    }

    /// Returns the closest hit.
    #[inline(always)]
    pub fn closest(&self, stack: &mut Stack) -> ClosestHit {
        let mut best = self.no_hit();
        self.closest_below(Child::node(0), stack, &mut best);
        best
    }

    /// Updates the closest hit with the subtree below `child`. `stack` must be empty, and is left
    /// empty.
    #[inline(always)]
    pub fn closest_below(&self, child: Child, stack: &mut Stack, best: &mut ClosestHit) {
        let mut child = child;
        loop {
            if let ChildKind::Node(index) = child.kind() {
                // The nearest child is visited next, without passing through the stack.
                child =
                    self.tier.first_in_order(&self.tree.nodes[index], &self.lane, best.tfar, stack);
                if let Some(later) = stack.last() {
                    self.tree.prefetch_if_large(later);
                }
                if child != Child::EMPTY {
                    continue;
                }
            } else {
                self.closest_in_leaf(child, best);
            }
            child = loop {
                let Some((next, distance)) = stack.pop() else { return };
                if distance > best.tfar {
                    continue;
                }
                break next;
            };
        }
    }

    /// Returns whether the ray hits anything.
    #[inline(always)]
    pub fn occluded(&self, path: &mut Path) -> bool {
        self.occluded_below(Child::node(0), path)
    }

    /// Returns whether the ray hits anything below `child`. `path` must be empty, and is left
    /// empty.
    #[inline(always)]
    pub fn occluded_below(&self, child: Child, path: &mut Path) -> bool {
        let ChildKind::Node(mut index) = child.kind() else { return self.any_in_leaf(child) };
        let tfar = self.lane.value(&self.lane.query.tfar);
        let mut left = self.tier.hit_children(&self.tree.nodes[index], &self.lane, tfar);
        loop {
            while left == 0 {
                let Some(step) = path.pop() else { return false };
                (index, left) = step;
            }
            let node = &self.tree.nodes[index];
            let child = node.first(left);
            left &= left - 1;
            if let ChildKind::Node(below) = child.kind() {
                if left != 0 {
                    path.push(index, left);
                    self.tree.prefetch_if_large(node.first(left));
                }
                index = below;
                left = self.tier.hit_children(&self.tree.nodes[index], &self.lane, tfar);
            } else if self.any_in_leaf(child) {
                path.clear();
                return true;
            }
        }
    }

    /// Updates the closest hit with a leaf.
    #[inline(always)]
    pub fn closest_in_leaf(&self, leaf: Child, best: &mut ClosestHit) {
        match leaf.kind() {
            ChildKind::Triangles(index) => {
                self.closest_in_block(&self.tree.blocks[index], self.tree.indices(), best);
            }
            ChildKind::Spheres(index) => self.closest_in_spheres(index, best),
            ChildKind::Node(_) | ChildKind::Empty => {}
        }
    }

    /// Returns whether the ray hits anything in a leaf.
    #[inline(always)]
    pub fn any_in_leaf(&self, leaf: Child) -> bool {
        match leaf.kind() {
            ChildKind::Triangles(index) => {
                self.any_in_block(&self.tree.blocks[index], self.tree.indices())
            }
            ChildKind::Spheres(index) => self.any_in_spheres(index),
            ChildKind::Node(_) | ChildKind::Empty => false,
        }
    }

    /// Updates the closest hit with a leaf of triangles.
    #[inline(always)]
    pub fn closest_in_block(&self, block: &Block, indices: Indices, best: &mut ClosestHit) {
        let found = self.tier.candidates(block, &self.lane, best.tfar);
        let mut left = found.maybe;
        while left != 0 {
            let i = left.trailing_zeros();
            left &= left - 1;
            let slot = i as usize % WIDTH;
            let primitive = indices.of(block, slot);
            if primitive == self.leaving {
                continue;
            }
            let seen = ShearedTriangle::new(&self.lane, block, slot);
            if (found.sure >> i) & 1 == 0 && !seen.inside() {
                continue;
            }
            let ray = self.ray();
            let t = seen.t(&ray, block.triangle(slot));
            let closer = t > ray.tnear && best.is_replaced_by(t, primitive);
            if closer && self.starts_before(&seen, &ray, t, (block, slot)) {
                let tfar = self.lane.tfar_for_hit(t);
                let second_half = block.is_second_half(slot);
                *best = ClosestHit { t, tfar, primitive, edges: seen.edges, second_half };
            }
        }
    }

    /// Whether the ray starts before its hit at `t` with a triangle of a leaf. Few hits need the
    /// corners, so they are read only here.
    #[inline(always)]
    fn starts_before(
        &self,
        seen: &ShearedTriangle,
        ray: &Ray64,
        t: f64,
        (block, slot): (&Block, usize),
    ) -> bool {
        ray.is_far(t, &self.lane)
            || seen.is_ahead(ray)
            || ray.hit_is_after_start(t, block.triangle(slot))
    }

    /// Whether a hit at `t` lies within the open segment of the ray.
    #[inline(always)]
    pub(super) fn is_within(
        &self,
        seen: &ShearedTriangle,
        ray: &Ray64,
        t: f64,
        triangle: (&Block, usize),
    ) -> bool {
        t > ray.tnear && t < ray.tfar && self.starts_before(seen, ray, t, triangle)
    }

    /// Returns whether the ray hits any triangle of a leaf.
    #[inline(always)]
    pub fn any_in_block(&self, block: &Block, indices: Indices) -> bool {
        let found = self.tier.candidates(block, &self.lane, self.lane.value(&self.lane.query.tfar));
        let mut left = found.maybe;
        while left != 0 {
            let i = left.trailing_zeros();
            left &= left - 1;
            let slot = i as usize % WIDTH;
            if indices.of(block, slot) == self.leaving {
                continue;
            }
            let sure = (found.sure >> i) & 1 != 0;
            let (first, last) = depth_range(&self.lane, block, slot);
            // The depth of the hit lies between those of the corners. If all of these lie inside
            // the segment, t need not be computed.
            let within = self.lane.within(first, last);
            if sure && within {
                return true;
            }
            let seen = ShearedTriangle::new(&self.lane, block, slot);
            if !sure && !seen.inside() {
                continue;
            }
            if within {
                return true;
            }
            let ray = self.ray();
            let t = seen.t(&ray, block.triangle(slot));
            if self.is_within(&seen, &ray, t, (block, slot)) {
                return true;
            }
        }
        false
    }

    /// Updates the closest hit with a leaf of spheres, or of an instance.
    #[inline(never)]
    pub fn closest_in_spheres(&self, index: usize, best: &mut ClosestHit) {
        for id in self.tree.spheres[index].0 {
            if let Some(instance) = self.geometry.instance_in_leaf(id) {
                self.closest_in_instance(instance, best);
                continue;
            }
            let Some((t, primitive)) = self.sphere_hit(id, best.t) else { continue };
            if best.is_replaced_by(t, primitive) {
                let tfar = self.lane.tfar_for_hit(t);
                *best = ClosestHit::sphere(t, tfar, primitive);
            }
        }
    }

    /// Returns whether the ray hits any sphere of a leaf, or its instance.
    #[inline(never)]
    pub fn any_in_spheres(&self, index: usize) -> bool {
        let tfar = self.ray().tfar;
        self.tree.spheres[index].0.into_iter().any(|id| match self.geometry.instance_in_leaf(id) {
            Some(instance) => self.any_in_instance(instance),
            None => self.sphere_hit(id, tfar).is_some(),
        })
    }

    /// Returns t of the ray's first hit with sphere `id`, and the scene-wide primitive index. A hit
    /// at `tfar` counts too, for the tie rule. Returns `None` for an unused slot.
    #[inline(always)]
    fn sphere_hit(&self, id: u32, tfar: f64) -> Option<(f64, u32)> {
        let sphere = self.geometry.spheres.get(id as usize)?;
        self.tier.count_sphere_test();
        let ray = self.ray();
        let (origin, direction) = (ray.origin.into(), ray.direction.into());
        if sphere.surely_missed(origin, direction) {
            return None;
        }
        let primitive = self.geometry.primitive(self.geometry.spheres_id(), id);
        let (beyond, leaving) = (just_beyond(tfar), primitive == self.leaving);
        let t = sphere.intersect(origin, direction, ray.tnear, beyond, leaving);
        (!t.is_nan() && t < ray.tfar).then_some((t, primitive))
    }
}

/// Returns `t` enlarged by one or two ulp. A search that ends there still finds an equally near
/// hit, which may have a lower primitive index.
#[inline(always)]
pub fn just_beyond(t: f64) -> f64 {
    t * (1.0 + f64::EPSILON)
}
