//! The tree and the primitives that it holds.

use std::sync::Arc;

use super::build::{self, Tree};
use super::query::Query;
use super::simd::Tier;
use super::single::Single;
use crate::accel::accelerator::BuildOptions;
use crate::accel::geometry_ref::GeometryRef;
use crate::error::Result;
use crate::geometry::{Geometry, Unseen};
use crate::monitor::Monitor;
use crate::ray::Rays;
use crate::simd::Isa;

/// A tree over the primitives of a scene.
pub struct Bvh<'g> {
    pub(super) geometry: GeometryRef<'g>,
    pub(super) tree: Arc<Tree>,
    /// Instruction set of the kernels.
    pub(super) isa: Isa,
    /// Largest number of bytes held during the build.
    pub(super) peak_bytes: u64,
}

impl<'g> Bvh<'g> {
    /// Builds the tree over all primitives, on the current rayon pool. Queries use the kernels of
    /// `isa`, or of the best instruction set below it that this machine supports.
    ///
    /// # Errors
    /// See [`crate::accel::build`].
    pub fn build(
        geometry: &'g Geometry,
        isa: Isa,
        options: &BuildOptions,
        monitor: &Monitor,
    ) -> Result<Self> {
        Self::build_part((geometry.into(), &Unseen::NONE), isa, options, monitor)
    }

    /// [`Bvh::build`] without the primitives in `unseen`.
    ///
    /// # Errors
    /// See [`crate::accel::build`].
    pub fn build_part(
        (geometry, unseen): (GeometryRef<'g>, &Unseen),
        isa: Isa,
        options: &BuildOptions,
        monitor: &Monitor,
    ) -> Result<Self> {
        let isa = isa.min(Isa::detect());
        let part = (&*geometry, unseen);
        let (tree, peak_bytes) = build::build(part, isa, options.max_bytes, monitor)?;
        Ok(Self { geometry, tree: Arc::new(tree), isa, peak_bytes })
    }

    /// Prepares ray `i` for a traversal without the other rays.
    #[inline(always)]
    pub(super) fn single<'a, T: Tier>(
        &'a self,
        tier: T,
        query: &'a Query,
        rays: &'a Rays,
        i: usize,
    ) -> Single<'a, T> {
        Single::new(tier, (&self.tree, &self.geometry), query.lane(i), rays)
    }
}
