//! Accelerators: the trait [`Accelerator`], and [`build`], which builds the accelerator of a
//! backend.

mod accelerator;
pub mod brute;
pub mod bvh;
mod by_kind;
pub mod coursework;
#[cfg(feature = "embree")]
pub mod embree;
mod footprint;
mod geometry_ref;
pub mod lane;
mod part;
mod predict;
mod shaft;

pub use accelerator::{Accelerator, BuildInfo, BuildOptions, Cone, Visits};
pub use footprint::MemoryFootprint;
pub use geometry_ref::GeometryRef;
pub use predict::memory_footprint;
pub use shaft::Shaft;

use std::sync::Arc;

use crate::error::Result;
use crate::geometry::Geometry;
use crate::monitor::Monitor;
use crate::ray::RayKind;
use crate::scene::Backend;

/// Builds the accelerator of `backend` over `geometry`, or several if kinds of rays hit different
/// primitives: see [`Accelerator::only`].
///
/// # Errors
/// - `Unsupported`: the backend cannot run on this machine, or is not in this build.
/// - `Limit`: the build would need more than `max_bytes`, or has too many primitives for `bvh`.
/// - `Interrupted`: a signal arrived.
/// - `Retry`: memory ran out.
pub fn build<'g>(
    geometry: &'g Geometry,
    backend: Backend,
    options: &BuildOptions,
    monitor: &Monitor,
) -> Result<Box<dyn Accelerator + 'g>> {
    build_over(geometry.into(), backend, options, monitor)
}

/// Does the same as [`build`] with a geometry that the accelerator keeps alive.
///
/// # Errors
/// The errors of [`build`].
pub fn build_shared(
    geometry: Arc<Geometry>,
    backend: Backend,
    options: &BuildOptions,
    monitor: &Monitor,
) -> Result<Box<dyn Accelerator>> {
    build_over(GeometryRef::Shared(geometry), backend, options, monitor)
}

fn build_over<'g>(
    geometry: GeometryRef<'g>,
    backend: Backend,
    options: &BuildOptions,
    monitor: &Monitor,
) -> Result<Box<dyn Accelerator + 'g>> {
    let [camera, others @ ..] = RayKind::ALL.map(|kind| geometry.unseen(kind));
    if others.into_iter().any(|unseen| unseen != camera) {
        return Ok(Box::new(by_kind::ByKind::build(geometry, backend, options, monitor)?));
    }
    part::build_part((geometry.clone(), camera), backend, options, monitor)
}
