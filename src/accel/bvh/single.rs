//! One ray through the tree.

use super::build::Tree;
use super::exact::{self, Ray64};
use super::node::{Kind, SphereLeaf};
use super::query::Lane;
use super::simd::{Stack, Tier};
use crate::geometry::Geometry;
use crate::ray::NONE;

/// What a ray hit so far.
#[derive(Debug, Clone, Copy)]
pub struct Best {
    /// Ray parameter; the end of the segment until there is a hit.
    pub t: f64,
    /// Weight of the second corner.
    pub u: f64,
    /// Weight of the third corner.
    pub v: f64,
    /// Number of the primitive in the whole scene, or [`NONE`].
    pub primitive: u32,
}

impl Best {
    /// Nothing yet, up to `tfar`.
    #[inline(always)]
    pub fn none(tfar: f64) -> Self {
        Self { t: tfar, u: 0.0, v: 0.0, primitive: NONE }
    }

    /// Whether a hit is closer; of equal distances the lower primitive's counts.
    #[inline(always)]
    fn gives_way(&self, t: f64, primitive: u32) -> bool {
        t < self.t || (t == self.t && primitive < self.primitive && self.primitive != NONE)
    }
}

/// A ray on its way through the tree.
pub struct Single<'a, T> {
    /// The kernels.
    pub tier: T,
    /// The tree.
    pub tree: &'a Tree,
    /// What it is made of.
    pub geometry: &'a Geometry,
    /// The ray, made ready; `tfar` shrinks with every hit.
    pub lane: Lane,
    /// The ray in f64.
    pub ray: Ray64,
    /// What its parameters were multiplied with for the boxes.
    pub scale: f32,
    /// The primitive that it leaves.
    pub leaving: u32,
}

impl<T: Tier> Single<'_, T> {
    /// The closest hit.
    #[inline(always)]
    pub fn closest(mut self, stack: &mut Stack) -> Best {
        let mut best = Best::none(self.ray.tfar);
        stack.push(super::node::Child::node(0), f32::NEG_INFINITY);
        while let Some((child, distance)) = stack.pop() {
            if distance > self.lane.tfar {
                continue;
            }
            match child.kind() {
                Kind::Node(index) => {
                    self.tier.push_ordered(&self.tree.nodes[index], &self.lane, stack);
                }
                Kind::Triangles(index) => self.closest_in_block(index, &mut best),
                Kind::Spheres(index) => self.closest_in_spheres(index, &mut best),
                Kind::Empty => {}
            }
        }
        best
    }

    /// Whether anything is hit.
    #[inline(always)]
    pub fn occluded(self, stack: &mut Stack) -> bool {
        stack.push(super::node::Child::node(0), f32::NEG_INFINITY);
        while let Some((child, _)) = stack.pop() {
            let hit = match child.kind() {
                Kind::Node(index) => {
                    self.tier.push_any(&self.tree.nodes[index], &self.lane, stack);
                    false
                }
                Kind::Triangles(index) => self.any_in_block(index),
                Kind::Spheres(index) => self.any_in_spheres(index),
                Kind::Empty => false,
            };
            if hit {
                stack.clear();
                return true;
            }
        }
        false
    }

    #[inline(always)]
    pub(super) fn closest_in_block(&mut self, index: usize, best: &mut Best) {
        let block = &self.tree.blocks[index];
        let mut candidates = self.tier.candidates(block, &self.lane);
        while candidates != 0 {
            let i = candidates.trailing_zeros() as usize;
            candidates &= candidates - 1;
            let primitive = block.primitives[i % block.primitives.len()];
            if primitive == self.leaving {
                continue;
            }
            let Some(hit) = exact::hit(&self.lane, &self.ray, block.triangle(i)) else { continue };
            if hit.t > self.ray.tnear && best.gives_way(hit.t, primitive) {
                let second = block.is_second_half(i);
                let (u, v) = if second { (1.0 - hit.u, 1.0 - hit.v) } else { (hit.u, hit.v) };
                *best = Best { t: hit.t, u, v, primitive };
                self.lane.tfar = hit.t as f32 * self.scale;
            }
        }
    }

    #[inline(always)]
    pub(super) fn any_in_block(&self, index: usize) -> bool {
        let block = &self.tree.blocks[index];
        let mut candidates = self.tier.candidates(block, &self.lane);
        while candidates != 0 {
            let i = candidates.trailing_zeros() as usize;
            candidates &= candidates - 1;
            if block.primitives[i % block.primitives.len()] == self.leaving {
                continue;
            }
            let Some(hit) = exact::hit(&self.lane, &self.ray, block.triangle(i)) else { continue };
            if hit.t > self.ray.tnear && hit.t < self.ray.tfar {
                return true;
            }
        }
        false
    }

    #[inline(never)]
    pub(super) fn closest_in_spheres(&mut self, index: usize, best: &mut Best) {
        for (t, primitive) in self.sphere_hits(&self.tree.spheres[index], best.t) {
            if best.gives_way(t, primitive) {
                *best = Best { t, u: 0.0, v: 0.0, primitive };
            }
        }
        if best.primitive != NONE {
            self.lane.tfar = best.t as f32 * self.scale;
        }
    }

    #[inline(never)]
    pub(super) fn any_in_spheres(&self, index: usize) -> bool {
        self.sphere_hits(&self.tree.spheres[index], self.ray.tfar).next().is_some()
    }

    fn sphere_hits(&self, leaf: &SphereLeaf, tfar: f64) -> impl Iterator<Item = (f64, u32)> {
        let (ray, leaving) = (self.ray, self.leaving);
        let base = self.geometry.bases()[self.geometry.spheres_id() as usize];
        let spheres = &self.geometry.spheres;
        let SphereLeaf(ids) = *leaf;
        ids.into_iter().filter_map(move |id| {
            let sphere = spheres.get(id as usize)?;
            let primitive = base + id;
            // Up to and with tfar: an equal distance may belong to a lower primitive.
            let t = sphere.intersect(
                ray.origin.into(),
                ray.direction.into(),
                ray.tnear,
                tfar * (1.0 + f64::EPSILON),
                primitive == leaving,
            );
            (!t.is_nan() && t < ray.tfar).then_some((t, primitive))
        })
    }
}
