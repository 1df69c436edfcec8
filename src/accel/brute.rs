//! Every primitive against every ray, decided by exact predicates: the oracle.

use super::{Accelerator, BuildInfo, BuildOptions};
use crate::error::Result;
use crate::geometry::Geometry;
use crate::monitor::Monitor;
use crate::ray::{Coherence, Mask, RayPacket, Rays};

/// See the module.
pub struct Brute<'g> {
    geometry: &'g Geometry,
}

impl<'g> Brute<'g> {
    /// Builds it.
    ///
    /// # Errors
    /// See [`super::build`].
    pub fn build(geometry: &'g Geometry, _: &BuildOptions, _: &Monitor) -> Result<Self> {
        let _ = super::unavailable;
        Ok(Self { geometry })
    }
}

impl Accelerator for Brute<'_> {
    fn info(&self) -> BuildInfo {
        let _ = self.geometry;
        BuildInfo::default()
    }

    fn closest(&self, _: &Mask, _: &mut RayPacket, _: Coherence) {
        todo!()
    }

    fn occluded(&self, _: &Mask, _: &mut Rays, _: Coherence) {
        todo!()
    }
}
