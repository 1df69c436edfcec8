//! The backends under test and the oracle over the geometry of a case.

use super::counts::CaseCounts;
use crate::accel::Accelerator;
use crate::accel::brute::Brute;
use crate::geometry::Geometry;
use crate::lab::backend::{BuiltBackend, TestedBackend};

/// All tested backends and the oracle, built over one geometry.
pub struct CaseBackends<'g> {
    /// The geometry over which backends and oracle are built.
    pub geometry: &'g Geometry,
    /// The tested backends, in the order of the settings.
    pub tested: &'g [TestedBackend],
    /// The accelerator of each tested backend.
    pub accelerators: Vec<Box<dyn Accelerator + 'g>>,
    /// The oracle, which computes the exact answers.
    pub oracle: Brute<'g>,
}

impl CaseBackends<'_> {
    /// Iterates over the tested backends with their accelerators.
    pub fn backends(&self) -> impl Iterator<Item = BuiltBackend<'_>> {
        let built = self.tested.iter().zip(&self.accelerators);
        built.map(|(tested, accelerator)| BuiltBackend { tested, accelerator: &**accelerator })
    }

    /// Calls `judge` for every tested backend and returns the counts of each. Slow backends
    /// ([`TestedBackend::is_slow`]) are left out, with counts of 0, unless `with_slow`.
    pub fn counts(
        &self,
        with_slow: bool,
        mut judge: impl FnMut(BuiltBackend, &mut CaseCounts),
    ) -> Vec<CaseCounts> {
        let count = |backend: BuiltBackend| {
            let mut counts = CaseCounts::default();
            if with_slow || !backend.tested.is_slow() {
                judge(backend, &mut counts);
            }
            counts
        };
        self.backends().map(count).collect()
    }
}
