//! Backends under test: their names, their error bounds, and whether a wrong answer fails a check.

use glam::DVec3;

use crate::accel::{self, Accelerator, BuildOptions};
use crate::error::{Error, ErrorKind, Result};
use crate::geometry::Geometry;
use crate::monitor::Monitor;
use crate::ray::Coherence;
use crate::scene::{Backend, EmbreeMode};
use crate::simd::Isa;

/// A backend under test, with its name in reports.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct TestedBackend {
    /// Name in reports, as on the command line.
    pub name: String,
    /// The backend, with its mode or instruction set.
    pub backend: Backend,
}

impl TestedBackend {
    /// Creates a backend under test that reports show as `name`.
    pub fn new(name: &str, backend: Backend) -> Self {
        Self { name: name.into(), backend }
    }

    /// Parses a name such as `embree-fast` or `bvh:avx2`. Plain `bvh` gets the instruction set
    /// `isa`. Messages name the command-line flag `flag`.
    ///
    /// # Errors
    /// - `Invalid` for an unknown name, or for an instruction set after another backend than `bvh`.
    /// - `Unsupported` if this machine or this build lacks the named instruction set.
    pub fn parse(flag: &str, name: &str, isa: Isa) -> Result<Self> {
        let (kind, forced) = match name.split_once(':') {
            Some((kind, forced)) => (kind, Some(forced)),
            None => (name, None),
        };
        let backend = match kind {
            "bvh" => Backend::Bvh(isa),
            "embree" => Backend::Embree(EmbreeMode::Robust),
            "embree-fast" => Backend::Embree(EmbreeMode::Fast),
            "embree-compact" => Backend::Embree(EmbreeMode::Compact),
            "coursework" => Backend::Coursework,
            "brute" => Backend::Brute,
            _ => {
                let message = format!(
                    "found {name:?}, expected some of bvh, embree, embree-fast, embree-compact, \
                     coursework, brute"
                );
                return Err(Error::invalid(flag, message));
            }
        };
        let backend = match (backend, forced) {
            (backend, None) => backend,
            (Backend::Bvh(_), Some(forced)) => {
                let isa = ISA_NAMES.into_iter().find(|(name, _)| *name == forced);
                let (_, isa) = isa.ok_or_else(|| {
                    let message =
                        format!("found {forced:?}, expected portable, neon, avx2 or avx512");
                    Error::invalid(flag, message)
                })?;
                Backend::Bvh(isa.supported(flag)?)
            }
            (_, Some(_)) => {
                let message = format!("found {name:?}, expected an instruction set only after bvh");
                return Err(Error::invalid(flag, message));
            }
        };
        Ok(Self::new(name, backend))
    }

    /// Collects backends and rejects duplicates: entries of the same name and the same backend. So
    /// `bvh` and `bvh:avx2` may both be listed. Messages name the command-line flag `flag`.
    ///
    /// # Errors
    /// - The first error in `backends`.
    /// - `Invalid` if a backend is listed twice.
    pub fn distinct(
        flag: &str,
        backends: impl IntoIterator<Item = Result<Self>>,
    ) -> Result<Vec<Self>> {
        let mut all = Vec::new();
        for backend in backends {
            let backend = backend?;
            if all.contains(&backend) {
                let message = format!("found {} twice, expected each backend once", backend.name);
                return Err(Error::invalid(flag, message));
            }
            all.push(backend);
        }
        Ok(all)
    }

    /// The default backends of `accuracy`: Embree fast and robust, `bvh` in each instruction set of
    /// this machine, `coursework` and `brute`. `embree-compact` runs only where a flag names it.
    pub fn all() -> Vec<Self> {
        let mut all = vec![
            Self::new("embree-fast", Backend::Embree(EmbreeMode::Fast)),
            Self::new("embree", Backend::Embree(EmbreeMode::Robust)),
        ];
        all.extend(Self::tiers());
        all.push(Self::new("coursework", Backend::Coursework));
        all.push(Self::new("brute", Backend::Brute));
        all
    }

    /// `bvh` in each instruction set that this machine supports.
    pub fn tiers() -> Vec<Self> {
        let supported = |&(_, isa): &(&str, Isa)| Isa::available().any(|other| other == isa);
        ISA_NAMES
            .into_iter()
            .filter(supported)
            .map(|(name, isa)| Self::new(&format!("bvh:{name}"), Backend::Bvh(isa)))
            .collect()
    }

    /// Returns whether every wrong answer of this backend fails `accuracy` and `crosscheck`. Wrong
    /// answers of other backends are published, or allowed up to a known rate. But `accuracy` also
    /// fails for false hits and self-shadows of robust Embree.
    pub fn must_be_right(&self) -> bool {
        must_be_right(&self.name)
    }

    /// Returns whether the backend traces only a part of the rays, because its queries take long.
    pub fn is_slow(&self) -> bool {
        matches!(self.backend, Backend::Coursework | Backend::Brute)
    }

    /// Error bound of the backend's own test, in units of the bound of `bvh`'s test. The unit is
    /// how far rounding can move a corner that is sheared along the ray: 6 * 2^-24 times the
    /// corner's largest coordinate from the ray's origin
    /// ([`Brute::near`](crate::accel::brute::Brute::near)).
    pub fn error_factor(&self) -> f64 {
        match self.backend {
            Backend::Embree(_) => MAX_ERROR_FACTOR,
            Backend::Bvh(_) | Backend::Coursework => 1.0,
            Backend::Brute => 0.0,
        }
    }

    /// Returns the coherences to trace a packet with: `packets`, and [`Coherence::Single`] if the
    /// backend has a separate query for single rays.
    pub fn coherences(&self, packets: Coherence) -> Vec<Coherence> {
        match self.backend {
            Backend::Embree(_) | Backend::Bvh(_) => vec![packets, Coherence::Single],
            // These trace rays one by one for every coherence.
            Backend::Coursework | Backend::Brute => vec![packets],
        }
    }

    /// Builds the backend over a geometry.
    ///
    /// # Errors
    /// See [`accel::build`].
    pub fn build<'g>(
        &self,
        geometry: &'g Geometry,
        threads: usize,
        monitor: &Monitor,
    ) -> Result<Box<dyn Accelerator + 'g>> {
        let options = BuildOptions { threads, max_bytes: None };
        accel::build(geometry, self.backend, &options, monitor)
    }
}

/// Instruction sets that may follow `bvh:`, under their names on the command line.
const ISA_NAMES: [(&str, Isa); 4] = [
    ("portable", Isa::Portable),
    ("neon", Isa::Neon),
    ("avx2", Isa::Avx2),
    ("avx512", Isa::Avx512),
];

/// Largest [`TestedBackend::error_factor`]: that of Embree. Embree's own bound is not published, so
/// the factor 4 is an assumption, not a derived bound.
pub const MAX_ERROR_FACTOR: f64 = 4.0;

/// Returns whether every wrong answer of the backend with this [`TestedBackend::name`] fails a
/// check. An instruction set, as in `bvh:avx2`, makes no difference.
pub fn must_be_right(name: &str) -> bool {
    matches!(name.split(':').next(), Some("bvh" | "brute"))
}

/// A backend under test with its accelerator.
#[derive(Clone, Copy)]
pub struct BuiltBackend<'a> {
    /// The backend with its name.
    pub tested: &'a TestedBackend,
    /// Its accelerator, built over the geometry of the test.
    pub accelerator: &'a dyn Accelerator,
}

/// Builds all backends over one geometry.
///
/// # Errors
/// See [`accel::build`].
pub fn build_all<'g>(
    backends: &[TestedBackend],
    geometry: &'g Geometry,
    threads: usize,
    monitor: &Monitor,
) -> Result<Vec<Box<dyn Accelerator + 'g>>> {
    backends.iter().map(|backend| backend.build(geometry, threads, monitor)).collect()
}

/// Returns a geometry without primitives. A backend is built over it to learn its version, or
/// whether it can be built here.
pub fn empty_geometry() -> Geometry {
    Geometry::new(DVec3::ZERO, vec![], vec![], vec![]).unwrap_or_default()
}

/// Returns the backends that can be built here, and one message for each backend that cannot, with
/// the reason.
///
/// # Errors
/// The errors of the builds, except `Unsupported`.
pub fn available(
    backends: Vec<TestedBackend>,
    monitor: &Monitor,
) -> Result<(Vec<TestedBackend>, Vec<String>)> {
    let empty = empty_geometry();
    let (mut built, mut without) = (Vec::new(), Vec::new());
    for backend in backends {
        match backend.build(&empty, 1, monitor).err() {
            None => built.push(backend),
            Some(error) if error.kind == ErrorKind::Unsupported => {
                without.push(format!("without `{}`: {error}", backend.name));
            }
            Some(error) => return Err(error),
        }
    }
    Ok((built, without))
}
