//! The coursework's BVH, as its report describes it: the baseline.

use super::{Accelerator, BuildInfo, BuildOptions};
use crate::error::Result;
use crate::geometry::Geometry;
use crate::monitor::Monitor;
use crate::ray::{Coherence, Mask, RayPacket, Rays};

/// See the module.
pub struct Coursework<'g> {
    geometry: &'g Geometry,
}

impl<'g> Coursework<'g> {
    /// Builds it.
    ///
    /// # Errors
    /// See [`super::build`].
    pub fn build(geometry: &'g Geometry, _: &BuildOptions, _: &Monitor) -> Result<Self> {
        let _ = super::unavailable;
        Ok(Self { geometry })
    }
}

impl Accelerator for Coursework<'_> {
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
