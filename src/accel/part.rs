//! Builds the accelerator of a backend over one set of primitives.

use super::accelerator::{Accelerator, BuildOptions};
#[cfg(feature = "embree")]
use super::embree;
use super::footprint::MemoryFootprint;
use super::geometry_ref::GeometryRef;
use super::{brute, bvh, coursework};
use crate::error::{Error, ErrorKind, Problem, Result};
use crate::geometry::{PrimitiveCounts, Unseen};
use crate::monitor::{Monitor, Phase};
use crate::reserve;
use crate::scene::{Backend, EmbreeMode};

/// Builds the accelerator of `backend` over the primitives that are not in `unseen`.
pub fn build_part<'g>(
    (geometry, unseen): (GeometryRef<'g>, &Unseen),
    backend: Backend,
    options: &BuildOptions,
    monitor: &Monitor,
) -> Result<Box<dyn Accelerator + 'g>> {
    monitor.begin(Phase::Build, 1000);
    if !geometry.instances.is_empty() && !backend.traces_instances() {
        let message = format!("`{}` traces no instances", backend.name());
        let help = "load the scene with copies in place of instances, or use bvh";
        return Err(Error::new(
            ErrorKind::Unsupported,
            Problem::new("--backend", message).help(help),
        ));
    }
    // Backends that allocate in many pieces: the predicted sum is checked once.
    let probe = |footprint: MemoryFootprint| {
        let counts = PrimitiveCounts::new(geometry.count());
        reserve::probe(footprint.peak_bytes(counts), backend.name())
    };
    match backend {
        Backend::Embree(mode) => build_embree((geometry, unseen), mode, options, monitor),
        Backend::Bvh(isa) => {
            Ok(Box::new(bvh::Bvh::build_part((geometry, unseen), isa, options, monitor)?))
        }
        Backend::Coursework => {
            probe(MemoryFootprint::COURSEWORK)?;
            let part = (geometry, unseen);
            Ok(Box::new(coursework::Coursework::build_part(part, options, monitor)?))
        }
        Backend::Brute => {
            probe(MemoryFootprint::BRUTE)?;
            Ok(Box::new(brute::Brute::build_part((geometry, unseen), options, monitor)?))
        }
    }
}

/// Builds Embree's tree over the primitives that are not in the given set.
#[cfg(feature = "embree")]
pub fn build_embree<'g>(
    part: (GeometryRef<'g>, &Unseen),
    mode: EmbreeMode,
    options: &BuildOptions,
    monitor: &Monitor,
) -> Result<Box<dyn Accelerator + 'g>> {
    Ok(Box::new(embree::Embree::build_part(part, mode, options, monitor)?))
}

#[cfg(not(feature = "embree"))]
pub fn build_embree<'g>(
    _: (GeometryRef<'g>, &Unseen),
    mode: EmbreeMode,
    _: &BuildOptions,
    _: &Monitor,
) -> Result<Box<dyn Accelerator + 'g>> {
    let name = Backend::Embree(mode).name();
    let message = format!("found `{name}`, which this build does not have");
    let help = "available: bvh, coursework, brute";
    Err(Error::new(ErrorKind::Unsupported, Problem::new("--backend", message).help(help)))
}
