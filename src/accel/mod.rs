//! What finds the hits: one trait, and the backends behind it.

pub mod brute;
pub mod bvh;
pub mod coursework;
#[cfg(feature = "embree")]
pub mod embree;
mod footprint;
pub mod lane;

pub use footprint::Footprint;

use crate::error::Result;
#[cfg(not(feature = "embree"))]
use crate::error::{Error, Kind, Problem};
use crate::geometry::{Geometry, Nearby, is_near};
use crate::monitor::{Monitor, Phase};
use crate::ray::{Coherence, Mask, RayPacket, Rays};
use crate::reserve;
use crate::scene::{Backend, EmbreeMode};

/// How an accelerator is built.
#[derive(Debug, Clone, Copy)]
pub struct BuildOptions {
    /// Worker threads, >= 1.
    pub threads: usize,
    /// Stop the build cleanly once the accelerator would hold more bytes.
    pub max_bytes: Option<u64>,
}

/// What an accelerator is and what it cost.
#[derive(Debug, Clone, Default)]
pub struct BuildInfo {
    /// Name and version of what does the work, e.g. `Embree 4.4.0`.
    pub version: String,
    /// Instruction set in use, e.g. `AVX2`.
    pub isa: String,
    /// Bytes held after the build.
    pub bytes: u64,
    /// Largest number of bytes held during the build.
    pub peak_bytes: u64,
}

/// What queries looked at; does not depend on the machine.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Visits {
    /// Nodes of the tree.
    pub nodes: u64,
    /// Triangles, quads and spheres that were tested.
    pub primitives: u64,
}

/// Finds closest hits and occlusion for packets of 16 rays.
///
/// Active rays must be possible ([`Rays::possible`]): finite, of a direction that is not zero.
pub trait Accelerator: Send + Sync {
    /// What it is and what it cost.
    fn info(&self) -> BuildInfo;

    /// The closest hit of every active lane: sets `tfar` and the hit, or leaves `geom` as it was
    /// (the caller clears it). Hits of the primitive in `leaving` do not count, but for the far
    /// side of a sphere.
    fn closest(&self, active: &Mask, packet: &mut RayPacket, coherence: Coherence);

    /// As [`Accelerator::closest`], but a hit may be one that the ray does not come near, where the
    /// backend's own test reports such: for callers that refine their hits anyhow. What
    /// [`crate::geometry::refine`] then finds doubtful they ask [`Accelerator::closest`] for, with
    /// `tfar` as it was.
    fn closest_candidates(&self, active: &Mask, packet: &mut RayPacket, coherence: Coherence) {
        self.closest(active, packet, coherence);
    }

    /// Candidate hits discarded since the build, as the ray passes the primitive by more than the
    /// backend's test may be off.
    fn false_hits(&self) -> u64 {
        0
    }

    /// Sets `tfar` to -inf in every active lane that meets anything in (`tnear`, `tfar`).
    fn occluded(&self, active: &Mask, rays: &mut Rays, coherence: Coherence);

    /// As [`Accelerator::occluded`], but what a ray does not come near may occlude it, where the
    /// backend's own test reports such: what the bare backend costs, for measurements.
    fn occluded_candidates(&self, active: &Mask, rays: &mut Rays, coherence: Coherence) {
        self.occluded(active, rays, coherence);
    }

    /// Whether for sure no ray between the active ones, which leave one point, meets anything: none from that point
    /// whose direction is a sum of theirs with factors >= 0, rounded once. `tnear` is 0, `tfar` infinite. `None`
    /// where the backend can never tell.
    fn nothing_between(&self, _: &Mask, _: &Rays) -> Option<bool> {
        None
    }

    /// Calls `found` for every triangle and quad of `geometry`, which this was built over, whose box reaches
    /// into another, by its primitive number, and perhaps for some more. Any order.
    fn near(&self, geometry: &Geometry, nearby: &Nearby, found: &mut dyn FnMut(u32)) {
        near_by_all(geometry, nearby, found);
    }

    /// What [`Accelerator::closest`], or [`Accelerator::occluded`] if `shadow`, looks at for these
    /// rays, summed over them; `None` where the backend cannot tell. May be slow.
    fn visits(&self, _: &Mask, _: &Rays, _shadow: bool, _: Coherence) -> Option<Visits> {
        None
    }
}

/// [`Accelerator::near`] by a look at every primitive.
fn near_by_all(geometry: &Geometry, nearby: &Nearby, found: &mut dyn FnMut(u32)) {
    let count = geometry.bases().last().copied().unwrap_or(0);
    (0..count).filter(|&primitive| is_near(geometry, primitive, nearby)).for_each(found);
}

/// Builds `backend` over `geometry`.
///
/// # Errors
/// `Unsupported` where the backend cannot run here or has no such mode, `Limit` above
/// `max_bytes`, `Interrupted` after a signal, `Retry` when memory ran out.
pub fn build<'g>(
    geometry: &'g Geometry,
    backend: Backend,
    options: &BuildOptions,
    monitor: &Monitor,
) -> Result<Box<dyn Accelerator + 'g>> {
    monitor.begin(Phase::Build, 1000);
    if let Backend::Coursework | Backend::Brute = backend {
        // These take memory in many pieces.
        let peak = Footprint::of(backend, options.threads)?;
        reserve::probe(peak.peak_bytes(geometry.count()), backend.name())?;
    }
    match backend {
        Backend::Embree(mode) => build_embree(geometry, mode, options, monitor),
        Backend::Bvh(isa) => Ok(Box::new(bvh::Bvh::build(geometry, isa, options, monitor)?)),
        Backend::Coursework => {
            Ok(Box::new(coursework::Coursework::build(geometry, options, monitor)?))
        }
        Backend::Brute => Ok(Box::new(brute::Brute::build(geometry, options, monitor)?)),
    }
}

#[cfg(feature = "embree")]
fn build_embree<'g>(
    geometry: &'g Geometry,
    mode: EmbreeMode,
    options: &BuildOptions,
    monitor: &Monitor,
) -> Result<Box<dyn Accelerator + 'g>> {
    Ok(Box::new(embree::Embree::build(geometry, mode, options, monitor)?))
}

#[cfg(not(feature = "embree"))]
fn build_embree<'g>(
    _: &'g Geometry,
    mode: EmbreeMode,
    _: &BuildOptions,
    _: &Monitor,
) -> Result<Box<dyn Accelerator + 'g>> {
    let name = Backend::Embree(mode).name();
    let message = format!("found `{name}`, which this build does not have");
    let help = "available: bvh, coursework, brute";
    Err(Error::new(Kind::Unsupported, Problem::new("--backend", message).help(help)))
}
