//! Accelerators: the trait [`Accelerator`], and the backends that implement it.

pub mod brute;
pub mod bvh;
mod by_kind;
pub mod coursework;
#[cfg(feature = "embree")]
pub mod embree;
mod footprint;
pub mod lane;
mod shaft;

pub use footprint::Footprint;
pub use shaft::Shaft;

use crate::error::{Error, Kind, Problem, Result};
use crate::geometry::{Geometry, Nearby, Unseen, is_near};
use crate::monitor::{Monitor, Phase};
use crate::ray::{Coherence, Mask, RayKind, RayPacket, Rays};
use crate::reserve;
use crate::scene::{Backend, EmbreeMode};

/// Limits of a build: threads and memory.
#[derive(Debug, Clone, Copy)]
pub struct BuildOptions {
    /// Worker threads, >= 1.
    pub threads: usize,
    /// Most bytes that the accelerator may hold. A build that needs more stops with an error.
    pub max_bytes: Option<u64>,
}

/// Version, instruction set and memory of an accelerator.
#[derive(Debug, Clone, Default)]
pub struct BuildInfo {
    /// Name and version of the code that finds the hits, e.g. `Embree 4.4.0`.
    pub version: String,
    /// Instruction set in use, e.g. `AVX2`.
    pub isa: String,
    /// Bytes held after the build.
    pub bytes: u64,
    /// Largest number of bytes held during the build.
    pub peak_bytes: u64,
}

/// Number of nodes and primitives that queries visited. The same on every machine.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Visits {
    /// Nodes of the tree that were visited.
    pub nodes: u64,
    /// Triangles, quads and spheres that were tested.
    pub primitives: u64,
}

/// Finds closest hits and occlusion for packets of 16 rays.
///
/// Active rays must pass [`Rays::possible`]: finite values and a direction that is not zero.
pub trait Accelerator: Send + Sync {
    /// Version, instruction set and memory.
    fn info(&self) -> BuildInfo;

    /// Returns the accelerator over the primitives that rays of `kind` can hit. `None` if this
    /// accelerator is the one of all kinds.
    fn only(&self, _kind: RayKind) -> Option<&dyn Accelerator> {
        None
    }

    /// Finds the closest hit of every active lane.
    ///
    /// A lane that hits gets `tfar` and the hit. A lane that misses keeps its `geom`, so the caller
    /// clears `geom` first. Hits of the primitive in `leaving` do not count, except on the far side
    /// of a sphere.
    fn closest(&self, active: &Mask, packet: &mut RayPacket, coherence: Coherence);

    /// Like [`Accelerator::closest`], but may return false hits of the backend's own test.
    ///
    /// A false hit lies on a primitive that the ray passes by more than the error of the test. This
    /// query is for callers that refine their hits anyhow. They trace the rays that
    /// [`crate::geometry::refine`] marks as doubtful again, by [`Accelerator::closest`] with the
    /// original `tfar`.
    fn closest_unfiltered(&self, active: &Mask, packet: &mut RayPacket, coherence: Coherence) {
        self.closest(active, packet, coherence);
    }

    /// Number of false hits discarded since the build: the ray passes the primitive by more than
    /// the error of the backend's test.
    fn false_hits(&self) -> u64 {
        0
    }

    /// Sets `tfar` to -inf in every active lane that hits anything in (`tnear`, `tfar`).
    fn occluded(&self, active: &Mask, rays: &mut Rays, coherence: Coherence);

    /// Like [`Accelerator::occluded`], but false hits of the backend's own test may occlude a ray.
    /// It measures the cost of the bare backend.
    fn occluded_unfiltered(&self, active: &Mask, rays: &mut Rays, coherence: Coherence) {
        self.occluded(active, rays, coherence);
    }

    /// Returns `Some(true)` only if no ray inside the cone spanned by the active rays can hit
    /// anything.
    ///
    /// All active rays share one origin; their `tnear` is 0 and their `tfar` infinite. A direction
    /// of the cone is a sum of theirs with factors >= 0, rounded once. Conservative: may return
    /// `Some(false)` for an empty cone. Returns `None` if the backend has no such query.
    fn is_cone_empty(&self, _: &Mask, _: &Rays) -> Option<bool> {
        None
    }

    /// Returns `Some(true)` only if no shadow ray of the shaft is occluded.
    ///
    /// Conservative: may return `Some(false)` although nothing occludes them. Returns `None` if the
    /// backend has no such query.
    fn is_shaft_empty(&self, _: &Shaft) -> Option<bool> {
        None
    }

    /// Calls `found` with the primitive number of every triangle and quad whose bounding box
    /// overlaps the box `nearby`.
    ///
    /// May also call it for other primitives, in any order. `geometry` is the geometry that the
    /// accelerator was built over.
    fn near(&self, geometry: &Geometry, nearby: &Nearby, found: &mut dyn FnMut(u32)) {
        near_by_all(geometry, nearby, found);
    }

    /// Counts the nodes and primitives that a query visits, summed over the active rays.
    ///
    /// The query is [`Accelerator::occluded`] if `shadow`, else [`Accelerator::closest`]. Returns
    /// `None` if the backend cannot count them. May be slow.
    fn visits(&self, _: &Mask, _: &Rays, _shadow: bool, _: Coherence) -> Option<Visits> {
        None
    }
}

/// Answers [`Accelerator::near`] by a loop over all primitives.
fn near_by_all(geometry: &Geometry, nearby: &Nearby, found: &mut dyn FnMut(u32)) {
    (0..geometry.count() as u32)
        .filter(|&primitive| is_near(geometry, primitive, nearby))
        .for_each(found);
}

/// Builds the accelerator of `backend` over `geometry`, or several if kinds of rays hit different
/// primitives: see [`Accelerator::only`].
///
/// # Errors
/// - `Unsupported`: the backend cannot run on this machine, or is not in this build.
/// - `Limit`: it would need more than `max_bytes`.
/// - `Interrupted`: a signal arrived.
/// - `Retry`: memory ran out.
pub fn build<'g>(
    geometry: &'g Geometry,
    backend: Backend,
    options: &BuildOptions,
    monitor: &Monitor,
) -> Result<Box<dyn Accelerator + 'g>> {
    let [camera, others @ ..] = RayKind::ALL.map(|kind| geometry.unseen(kind));
    if others.into_iter().any(|unseen| unseen != camera) {
        return Ok(Box::new(by_kind::ByKind::build(geometry, backend, options, monitor)?));
    }
    build_part(geometry, camera, backend, options, monitor)
}

/// Builds the accelerator of `backend` over the primitives that are not in `unseen`.
fn build_part<'g>(
    geometry: &'g Geometry,
    unseen: &'g Unseen,
    backend: Backend,
    options: &BuildOptions,
    monitor: &Monitor,
) -> Result<Box<dyn Accelerator + 'g>> {
    monitor.begin(Phase::Build, 1000);
    if let Backend::Coursework | Backend::Brute = backend {
        // These allocate in many pieces, so the sum is checked once.
        let peak = Footprint::of(backend, options.threads)?;
        reserve::probe(peak.peak_bytes(geometry.count()), backend.name())?;
    }
    match backend {
        Backend::Embree(mode) => build_embree((geometry, unseen), mode, options, monitor),
        Backend::Bvh(isa) => {
            Ok(Box::new(bvh::Bvh::build_part((geometry, unseen), isa, options, monitor)?))
        }
        Backend::Coursework => {
            let part = (geometry, unseen);
            Ok(Box::new(coursework::Coursework::build_part(part, options, monitor)?))
        }
        Backend::Brute => {
            Ok(Box::new(brute::Brute::build_part((geometry, unseen), options, monitor)?))
        }
    }
}

/// Error of a build that would need more than `limit` bytes.
fn over_limit(limit: u64) -> Error {
    let message = format!("the accelerator would hold more than the {limit} bytes left to it");
    Error::new(Kind::Limit, Problem::new("--max-memory", message))
}

#[cfg(feature = "embree")]
fn build_embree<'g>(
    part: (&'g Geometry, &'g Unseen),
    mode: EmbreeMode,
    options: &BuildOptions,
    monitor: &Monitor,
) -> Result<Box<dyn Accelerator + 'g>> {
    Ok(Box::new(embree::Embree::build_part(part, mode, options, monitor)?))
}

#[cfg(not(feature = "embree"))]
fn build_embree<'g>(
    _: (&'g Geometry, &'g Unseen),
    mode: EmbreeMode,
    _: &BuildOptions,
    _: &Monitor,
) -> Result<Box<dyn Accelerator + 'g>> {
    let name = Backend::Embree(mode).name();
    let message = format!("found `{name}`, which this build does not have");
    let help = "available: bvh, coursework, brute";
    Err(Error::new(Kind::Unsupported, Problem::new("--backend", message).help(help)))
}
