//! Accelerators: the trait [`Accelerator`], and [`build`], which makes the backend of a scene.

mod accelerator;
pub mod brute;
pub mod bvh;
pub mod coursework;
#[cfg(feature = "embree")]
pub mod embree;
mod footprint;
pub mod lane;
mod shaft;

pub use accelerator::{Accelerator, BuildInfo, BuildOptions, Visits};
pub use footprint::Footprint;
pub use shaft::Shaft;

use crate::error::Result;
use crate::geometry::Geometry;
use crate::monitor::{Monitor, Phase};
use crate::reserve;
use crate::scene::{Backend, EmbreeMode};

/// Builds the accelerator of `backend` over `geometry`.
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
    monitor.begin(Phase::Build, 1000);
    if let Backend::Coursework | Backend::Brute = backend {
        // These allocate in many pieces, so the sum is checked once.
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
    use crate::error::{Error, Kind, Problem};
    let name = Backend::Embree(mode).name();
    let message = format!("found `{name}`, which this build does not have");
    let help = "available: bvh, coursework, brute";
    Err(Error::new(Kind::Unsupported, Problem::new("--backend", message).help(help)))
}
