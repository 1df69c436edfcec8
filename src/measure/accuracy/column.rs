//! What is measured: backends in one mode and instruction set each, the columns of the table.

use super::tally::Kind;
use crate::accel::brute::Brute;
use crate::accel::{self, Accelerator, BuildOptions, EmbreeMode};
use crate::error::Result;
use crate::geometry::Geometry;
use crate::measure::bench::Contestant;
use crate::measure::cross_check;
use crate::monitor::Monitor;
use crate::ray::Coherence;
use crate::scene::Backend;
use crate::simd::Isa;

/// A backend in one mode.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Column {
    /// Its name, mode and instruction set.
    pub contestant: Contestant,
}

impl Column {
    /// All there are: Embree fast, robust and exact, `bvh` in each tier of this machine, `coursework`,
    /// `brute`.
    pub fn all() -> Vec<Self> {
        let best = Isa::detect();
        let one = |name: &str, backend, embree, isa| Self {
            contestant: Contestant { name: name.into(), backend, embree, isa },
        };
        let mut all = vec![
            one("embree-fast", Backend::Embree, EmbreeMode::Fast, best),
            one("embree", Backend::Embree, EmbreeMode::Robust, best),
            one("embree-exact", Backend::Embree, EmbreeMode::Exact, best),
        ];
        all.extend(Self::tiers());
        all.push(one("coursework", Backend::Coursework, EmbreeMode::Robust, best));
        all.push(one("brute", Backend::Brute, EmbreeMode::Robust, best));
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
            let (backend, embree) = (Backend::Bvh, EmbreeMode::Robust);
            Self { contestant: Contestant { name: name.into(), backend, embree, isa } }
        };
        Isa::available().map(tier).collect()
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
        matches!(self.backend(), Backend::Bvh | Backend::Brute)
            || (self.backend(), self.contestant.embree) == (Backend::Embree, EmbreeMode::Exact)
    }

    /// What must not happen to what renders by default, although its leaks are published only.
    pub fn forbidden(&self) -> &'static [Kind] {
        match (self.backend(), self.contestant.embree) {
            (Backend::Embree, EmbreeMode::Robust) => &[Kind::FalseHit, Kind::SelfShadow],
            _ => &[],
        }
    }

    /// Whether it traces fewer rays because each takes long.
    pub fn slow(&self) -> bool {
        matches!(self.backend(), Backend::Coursework | Backend::Brute)
    }

    /// The bound of its own test, in units of the shear's: what [`cross_check`] grants it.
    pub fn factor(&self) -> f64 {
        // Our leaves decide, whatever finds them.
        let exact = self.contestant.embree == EmbreeMode::Exact;
        cross_check::factor(if exact { Backend::Bvh } else { self.backend() })
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
        let Contestant { backend, embree, isa, .. } = self.contestant;
        let options = BuildOptions { threads, embree, isa, max_bytes: None };
        accel::build(geometry, backend, &options, monitor)
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
