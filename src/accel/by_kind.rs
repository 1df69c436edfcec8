//! Accelerators for scenes in which some kinds of rays cannot hit all shapes: one for each distinct
//! set of primitives.
//!
//! A mask per ray would add a test to every primitive of every traversal. Separate accelerators
//! leave the traversal unchanged. They share the arrays of the geometry.

use super::accelerator::{Accelerator, BuildInfo, BuildOptions, Cone, Visits, over_limit};
use super::geometry_ref::GeometryRef;
use super::part::build_part;
use super::shaft::Shaft;
use crate::error::Result;
use crate::geometry::{Geometry, Nearby};
use crate::monitor::Monitor;
use crate::ray::{Coherence, Mask, RayKind, RayPacket, Rays};
use crate::scene::Backend;

/// An accelerator for each distinct set of primitives that a kind of ray can hit.
///
/// [`Accelerator::closest`] uses the set of camera rays, [`Accelerator::occluded`] that of shadow
/// rays. [`Accelerator::near`] finds the primitives of all sets.
pub struct ByKind<'g> {
    built: Vec<Box<dyn Accelerator + 'g>>,
    /// For each [`RayKind`], the index of its accelerator in `built`.
    of: [usize; RayKind::ALL.len()],
    peak_bytes: u64,
}

impl<'g> ByKind<'g> {
    /// Builds the accelerators one after another.
    ///
    /// # Errors
    /// See [`super::build`].
    pub fn build(
        geometry: GeometryRef<'g>,
        backend: Backend,
        options: &BuildOptions,
        monitor: &Monitor,
    ) -> Result<Self> {
        let mut built: Vec<Box<dyn Accelerator + 'g>> = Vec::new();
        let (mut of, mut bytes, mut peak_bytes) = ([0; RayKind::ALL.len()], 0, 0);
        for kind in RayKind::ALL {
            let unseen = geometry.unseen(kind);
            let before = RayKind::ALL.into_iter().take(kind as usize);
            let same = before.into_iter().find(|&other| geometry.unseen(other) == unseen);
            if let Some(other) = same {
                of[kind as usize] = of[other as usize];
                continue;
            }
            let max_bytes = match options.max_bytes {
                Some(limit) => Some(limit.checked_sub(bytes).ok_or_else(|| over_limit(limit))?),
                None => None,
            };
            let options = BuildOptions { max_bytes, ..*options };
            let accelerator = build_part((geometry.clone(), unseen), backend, &options, monitor)?;
            let info = accelerator.info();
            peak_bytes = peak_bytes.max(bytes + info.peak_bytes);
            bytes += info.bytes;
            of[kind as usize] = built.len();
            built.push(accelerator);
        }
        Ok(Self { built, of, peak_bytes })
    }

    fn of(&self, kind: RayKind) -> &dyn Accelerator {
        self.built[self.of[kind as usize]].as_ref()
    }
}

impl Accelerator for ByKind<'_> {
    fn info(&self) -> BuildInfo {
        let bytes = self.built.iter().map(|accelerator| accelerator.info().bytes).sum();
        BuildInfo { bytes, peak_bytes: self.peak_bytes, ..self.of(RayKind::Camera).info() }
    }

    fn only(&self, kind: RayKind) -> Option<&dyn Accelerator> {
        Some(self.of(kind))
    }

    fn closest(&self, active: &Mask, packet: &mut RayPacket, coherence: Coherence) {
        self.of(RayKind::Camera).closest(active, packet, coherence);
    }

    fn closest_unfiltered(&self, active: &Mask, packet: &mut RayPacket, coherence: Coherence) {
        self.of(RayKind::Camera).closest_unfiltered(active, packet, coherence);
    }

    fn false_hits(&self) -> u64 {
        self.built.iter().map(|accelerator| accelerator.false_hits()).sum()
    }

    fn occluded(&self, active: &Mask, rays: &mut Rays, coherence: Coherence) {
        self.of(RayKind::Shadow).occluded(active, rays, coherence);
    }

    fn occluded_unfiltered(&self, active: &Mask, rays: &mut Rays, coherence: Coherence) {
        self.of(RayKind::Shadow).occluded_unfiltered(active, rays, coherence);
    }

    fn cone(&self, active: &Mask, rays: &Rays) -> Option<Cone> {
        self.of(RayKind::Camera).cone(active, rays)
    }

    fn is_shaft_empty(&self, shaft: &Shaft) -> Option<bool> {
        self.of(RayKind::Shadow).is_shaft_empty(shaft)
    }

    fn near(&self, geometry: &Geometry, nearby: &Nearby, found: &mut dyn FnMut(u32)) {
        let mut all = Vec::new();
        for accelerator in &self.built {
            accelerator.near(geometry, nearby, &mut |primitive| all.push(primitive));
        }
        all.sort_unstable();
        all.dedup();
        all.into_iter().for_each(found);
    }

    fn visits(
        &self,
        active: &Mask,
        rays: &Rays,
        shadow: bool,
        coherence: Coherence,
    ) -> Option<Visits> {
        let kind = if shadow { RayKind::Shadow } else { RayKind::Camera };
        self.of(kind).visits(active, rays, shadow, coherence)
    }
}
