//! What every backend offers: the queries of [`Accelerator`], and the options and figures of a
//! build.

use super::shaft::Shaft;
use crate::error::{Error, ErrorKind, Problem};
use crate::geometry::{Geometry, Nearby, is_near};
use crate::ray::{Coherence, Mask, RayKind, RayPacket, Rays};

/// Limits of a build: threads and memory.
#[derive(Debug, Clone, Copy)]
pub struct BuildOptions {
    /// Worker threads, >= 1.
    pub threads: usize,
    /// Most bytes that the accelerator may hold, during the build and after it. A build that needs
    /// more stops with an error.
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

/// Numbers of nodes and primitives that queries visited. They are the same on every machine.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Visits {
    /// Nodes of the tree that were visited.
    pub nodes: u64,
    /// Triangles, quads and spheres that were tested.
    pub primitives: u64,
}

/// Finds closest hits and occlusion for packets of 16 rays.
///
/// Active rays must pass [`Rays::possible`]: origin and direction are finite, the direction is
/// neither zero nor denormal, and `tnear` <= `tfar`.
pub trait Accelerator: Send + Sync {
    /// Version, instruction set and memory.
    fn info(&self) -> BuildInfo;

    /// Returns the accelerator over the primitives that rays of `kind` can hit. Returns `None` if
    /// this accelerator serves all kinds.
    fn only(&self, _kind: RayKind) -> Option<&dyn Accelerator> {
        None
    }

    /// Finds the closest hit of every active lane in (`tnear`, `tfar`).
    ///
    /// In a lane that hits, `tfar` becomes t, and the hit is written to `hits`. `bvh` writes no
    /// normal. A lane that misses may keep its `geom`, so the caller clears `geom` first. Hits of
    /// the primitive in `leaving` do not count, except on the far side of a sphere.
    fn closest(&self, active: &Mask, packet: &mut RayPacket, coherence: Coherence);

    /// Like [`Accelerator::closest`], but may return false hits of the backend's own test.
    ///
    /// A false hit lies on a primitive that the ray misses by more than the error of the test. This
    /// query is for callers that refine their hits anyhow. [`crate::geometry::refine`] marks false
    /// hits as doubtful. The caller traces these rays again by [`Accelerator::closest`], with the
    /// original `tfar`.
    fn closest_unfiltered(&self, active: &Mask, packet: &mut RayPacket, coherence: Coherence) {
        self.closest(active, packet, coherence);
    }

    /// Returns the number of false hits discarded since the build: the ray misses the primitive by
    /// more than the error of the backend's test.
    fn false_hits(&self) -> u64 {
        0
    }

    /// Sets `tfar` to -inf in every active lane that hits anything in (`tnear`, `tfar`).
    fn occluded(&self, active: &Mask, rays: &mut Rays, coherence: Coherence);

    /// Like [`Accelerator::occluded`], but false hits of the backend's own test may occlude a ray.
    /// This query serves to measure the cost of the bare backend.
    fn occluded_unfiltered(&self, active: &Mask, rays: &mut Rays, coherence: Coherence) {
        self.occluded(active, rays, coherence);
    }

    /// Returns what the rays inside the cone spanned by the active rays can hit.
    ///
    /// All active rays must share one origin; their `tnear` is 0 and their `tfar` infinite. A
    /// direction of the cone is a sum of the rays' directions with factors >= 0, rounded once.
    /// Conservative: may return more than the rays hit. Returns `None` if the backend has no such
    /// query.
    fn cone(&self, _: &Mask, _: &Rays) -> Option<Cone> {
        None
    }

    /// Returns `Some(true)` only if no shadow ray of the shaft is occluded.
    ///
    /// Conservative: may return `Some(false)` although nothing occludes the rays. Returns `None` if
    /// the backend has no such query.
    fn is_shaft_empty(&self, _: &Shaft) -> Option<bool> {
        None
    }

    /// Calls `found` with the scene-wide primitive index of every triangle and quad near the point
    /// of `nearby`.
    ///
    /// May also call `found` for other primitives, in any order, and more than once for a quad.
    /// `geometry` is the geometry that the accelerator was built over.
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

/// What the rays inside a cone can hit.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Cone {
    /// Nothing.
    Empty,
    /// At most this triangle or quad, by its scene-wide index.
    Primitive(u32),
    /// Anything.
    Any,
}

/// Implements [`Accelerator::near`] by a loop over all primitives.
fn near_by_all(geometry: &Geometry, nearby: &Nearby, found: &mut dyn FnMut(u32)) {
    (0..geometry.count() as u32)
        .filter(|&primitive| is_near(geometry, primitive, nearby))
        .for_each(found);
}

/// Returns the error of a build that would need more than `limit` bytes.
pub fn over_limit(limit: u64) -> Error {
    let message = format!("the accelerator would hold more than the {limit} bytes left to it");
    Error::new(ErrorKind::Limit, Problem::new("--max-memory", message))
}
