//! The leaves alone, for a tree of somebody else's; [`super::search`] has their tests.

use super::bounds::Bounds3;
use super::build::{self, Tree};
use super::node::{Block, Child, SphereLeaf};
use crate::accel::BuildOptions;
use crate::error::Result;
use crate::geometry::Geometry;
use crate::monitor::Monitor;
use crate::ray::{LANES, Mask, Rays};
use crate::simd::Isa;

/// How far from the middle of the scene rays may start, in longest sides of its box, for
/// [`Leaves::margin`] to hold.
pub const REACH: f32 = 4.0;

/// Leaves over all primitives of a scene.
pub struct Leaves<'g> {
    /// What they are made of.
    pub(super) geometry: &'g Geometry,
    /// No nodes.
    pub(super) tree: Tree,
    /// Whose kernels test them.
    pub(super) isa: Isa,
    peak_bytes: u64,
}

impl<'g> Leaves<'g> {
    /// Makes the leaves.
    ///
    /// # Errors
    /// As [`super::Bvh::build`].
    pub fn build(
        geometry: &'g Geometry,
        options: &BuildOptions,
        monitor: &Monitor,
    ) -> Result<Self> {
        let isa = options.isa.min(Isa::detect());
        let (tree, peak_bytes) = build::leaves(geometry, isa, options.max_bytes, monitor)?;
        Ok(Self { geometry, tree, isa, peak_bytes })
    }

    /// How many.
    pub fn count(&self) -> usize {
        self.tree.blocks.len() + self.tree.spheres.len()
    }

    /// Least and greatest corner of a leaf's box.
    pub fn bounds(&self, leaf: usize) -> ([f32; 3], [f32; 3]) {
        let bounds = match self.tree.blocks.get(leaf) {
            Some(block) => bounds_of(block),
            None => self.bounds_of_spheres(&self.tree.spheres[leaf - self.tree.blocks.len()]),
        };
        (bounds.lower(), bounds.upper())
    }

    /// How much boxes have to grow, so that no ray that starts within [`REACH`] misses the box of a
    /// triangle that the exact test would hit, nor the place of the hit: 64u max|v - o| (see
    /// [`super::exact::BOX_SLACK`]), and the box's own rounding.
    pub fn margin(&self) -> f32 {
        33.0 * f32::EPSILON * (REACH + 1.0) * self.size() + 4.0 * f32::MIN_POSITIVE
    }

    /// The triangles and quads of a leaf, by their primitive numbers.
    pub fn primitives(&self, leaf: u32) -> impl Iterator<Item = u32> + '_ {
        let block = self.tree.blocks.get(leaf as usize);
        let all = block.into_iter().flat_map(|block| block.primitives);
        all.filter(|&primitive| primitive != crate::ray::NONE)
    }

    /// Whether all active rays start within [`REACH`].
    pub fn reaches(&self, active: &Mask, rays: &Rays) -> bool {
        let (lower, upper) = (self.tree.bounds.lower(), self.tree.bounds.upper());
        let far = REACH * self.size();
        let mut within = true;
        for axis in 0..3 {
            let middle = 0.5 * lower[axis] + 0.5 * upper[axis];
            for i in 0..LANES {
                within &= (active.0[i] == 0) | ((rays.org[axis][i] - middle).abs() <= far);
            }
        }
        within
    }

    /// Longest side of the scene's box.
    fn size(&self) -> f32 {
        let [x, y, z] = self.tree.bounds.extent();
        x.max(y).max(z).max(0.0)
    }

    /// Bytes held.
    pub fn bytes(&self) -> u64 {
        self.tree.bytes()
    }

    /// Most bytes held while they were made.
    pub fn peak_bytes(&self) -> u64 {
        self.peak_bytes
    }

    fn bounds_of_spheres(&self, leaf: &SphereLeaf) -> Bounds3 {
        let spheres = leaf.0.iter().filter_map(|&id| self.geometry.spheres.get(id as usize));
        spheres.fold(Bounds3::EMPTY, |all, sphere| {
            let (lower, upper) = sphere.bounds();
            all.union(Bounds3::new(lower, upper))
        })
    }

    /// A leaf as the tests know it.
    pub(super) fn child(&self, leaf: usize) -> Child {
        let triangles = self.tree.blocks.len();
        if leaf < triangles { Child::triangles(leaf) } else { Child::spheres(leaf - triangles) }
    }
}

/// The box around a leaf's vertices; unused ones repeat the last.
fn bounds_of(block: &Block) -> Bounds3 {
    let [x, y, z] = &block.vertices;
    let corners: [[f32; 3]; LANES] = std::array::from_fn(|i| [x[i], y[i], z[i]]);
    Bounds3::of(&corners)
}
