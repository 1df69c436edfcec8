//! What is measured: backends in one mode and instruction set each, the columns of the table.

use super::tally::Kind;
use crate::accel::brute::Brute;
use crate::accel::{self, Accelerator, BuildOptions};
use crate::error::Result;
use crate::geometry::Geometry;
use crate::measure::bench::Contestant;
use crate::measure::cross_check;
use crate::monitor::Monitor;
use crate::ray::Coherence;
use crate::scene::{Backend, EmbreeMode};
use crate::simd::Isa;

/// A backend in one mode.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Column {
    /// Its name, mode and instruction set.
    pub contestant: Contestant,
}

impl Column {
    /// What is measured where nothing is named: Embree fast and robust, `bvh` in each tier of this machine, `coursework`, `brute`.
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

    /// `bvh` in each tier that this machine runs.
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

    /// As the table has it.
    pub fn name(&self) -> &str {
        &self.contestant.name
    }

    /// What finds the hits.
    pub fn backend(&self) -> Backend {
        self.contestant.backend
    }

    /// Whether it fails the run where it misses a row's mark; others are published.
    pub fn must_hold(&self) -> bool {
        matches!(self.backend(), Backend::Bvh(_) | Backend::Brute)
    }

    /// What must not happen to what renders, although its leaks are published only.
    pub fn forbidden(&self) -> &'static [Kind] {
        match self.backend() {
            Backend::Embree(EmbreeMode::Robust | EmbreeMode::Compact) => {
                &[Kind::FalseHit, Kind::SelfShadow]
            }
            _ => &[],
        }
    }

    /// Whether it traces fewer rays because each takes long.
    pub fn slow(&self) -> bool {
        matches!(self.backend(), Backend::Coursework | Backend::Brute)
    }

    /// The bound of its own test, in units of the shear's: what [`cross_check`] grants it.
    pub fn factor(&self) -> f64 {
        cross_check::factor(self.backend())
    }

    /// The ways to ask whose answers may differ; `packets` is how packets are announced.
    pub fn ways(&self, packets: Coherence) -> Vec<Coherence> {
        match self.slow() {
            true => vec![packets],
            false => vec![packets, Coherence::Single],
        }
    }

    /// Builds it.
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

/// What is measured, and how much.
#[derive(Debug, Clone)]
pub struct Settings {
    /// The columns, in order.
    pub columns: Vec<Column>,
    /// Of all random rays.
    pub seed: u64,
    /// How many times the rays of the quick run.
    pub times: u64,
    /// Whether pictures are made of failures.
    pub pictures: bool,
}

/// All columns over one geometry, and the oracle.
pub struct Built<'g> {
    /// What they are built over.
    pub geometry: &'g Geometry,
    /// In the order of the settings.
    pub columns: Vec<(&'g Column, Box<dyn Accelerator + 'g>)>,
    /// Knows the exact answers.
    pub oracle: Brute<'g>,
}
