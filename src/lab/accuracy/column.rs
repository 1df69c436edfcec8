//! Columns of the table: backends, each in one mode and instruction set.

use super::tally::Kind;
use crate::accel::brute::Brute;
use crate::accel::{self, Accelerator, BuildOptions};
use crate::error::Result;
use crate::geometry::Geometry;
use crate::lab::bench::Contestant;
use crate::lab::crosscheck;
use crate::monitor::Monitor;
use crate::ray::Coherence;
use crate::scene::{Backend, EmbreeMode};
use crate::simd::Isa;

/// A backend in one mode and instruction set.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Column {
    /// The backend with its name.
    pub contestant: Contestant,
}

impl Column {
    /// The default columns: Embree fast and robust, `bvh` in each instruction set of this machine,
    /// `coursework` and `brute`.
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
        let tier = |isa: Isa| {
            let name = match isa {
                Isa::Portable => "bvh:portable",
                Isa::Avx2 => "bvh:avx2",
                Isa::Avx512 => "bvh:avx512",
            };
            Self::new(name, Backend::Bvh(isa))
        };
        Isa::available().map(tier).collect()
    }

    fn new(name: &str, backend: Backend) -> Self {
        Self { contestant: Contestant { name: name.into(), backend } }
    }

    /// Name of the column in the table.
    pub fn name(&self) -> &str {
        &self.contestant.name
    }

    /// The backend of the column.
    pub fn backend(&self) -> Backend {
        self.contestant.backend
    }

    /// Returns whether the run fails if the backend does not meet the criterion of a case. Failures
    /// of other backends are only published.
    pub fn must_hold(&self) -> bool {
        matches!(self.backend(), Backend::Bvh(_) | Backend::Brute)
    }

    /// Kinds of errors that fail the run even if [`Column::must_hold`] is false.
    ///
    /// They apply to robust Embree, because `--backend embree` renders with it. Its leaks are only
    /// published.
    pub fn forbidden(&self) -> &'static [Kind] {
        match self.backend() {
            Backend::Embree(EmbreeMode::Robust | EmbreeMode::Compact) => {
                &[Kind::FalseHit, Kind::SelfShadow]
            }
            _ => &[],
        }
    }

    /// Returns whether the backend traces fewer rays, because each takes long.
    pub fn slow(&self) -> bool {
        matches!(self.backend(), Backend::Coursework | Backend::Brute)
    }

    /// Error bound of the backend's own test, in units of the bound of the shear: the factor of
    /// [`crosscheck`].
    pub fn factor(&self) -> f64 {
        crosscheck::factor(self.backend())
    }

    /// The coherences whose answers may differ: `packets` for packets, and single rays if the
    /// backend has a separate query for them.
    pub fn ways(&self, packets: Coherence) -> Vec<Coherence> {
        match self.slow() {
            true => vec![packets],
            false => vec![packets, Coherence::Single],
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
        accel::build(geometry, self.backend(), &options, monitor)
    }
}

/// Backends, seed and number of rays of a run.
#[derive(Debug, Clone)]
pub struct Settings {
    /// The columns of the table, in order.
    pub columns: Vec<Column>,
    /// Seed of all random rays.
    pub seed: u64,
    /// Number of rays, in multiples of the quick run.
    pub times: u64,
    /// Whether to draw pictures of failures.
    pub pictures: bool,
}

/// All columns and the oracle, built over one geometry.
pub struct Built<'g> {
    /// The geometry that all of them are built over.
    pub geometry: &'g Geometry,
    /// The columns with their accelerators, in the order of the settings.
    pub columns: Vec<(&'g Column, Box<dyn Accelerator + 'g>)>,
    /// The oracle, which computes the exact answers.
    pub oracle: Brute<'g>,
}
