//! The settings of a run.

use crate::lab::backend::TestedBackend;

/// Backends, seed and number of rays of a run.
#[derive(Debug, Clone)]
pub struct AccuracySettings {
    /// The backends under test, in the order of the table's columns.
    pub tested_backends: Vec<TestedBackend>,
    /// Seed of all random rays.
    pub seed: u64,
    /// Number of rays, in multiples of the quick run.
    pub times: u64,
    /// Whether to draw pictures of failures.
    pub pictures: bool,
}
