//! Measurements: recorded rays, timings, statistics, and comparisons of answers and pictures.
//!
//! The commands `bench`, `crosscheck`, `accuracy`, `compare` and `converge` are built on it. The
//! first three share one core: a [`backend::TestedBackend`] traces packets of rays, each lane gives
//! an [`answer::Answer`], and [`verdict`] decides whether the answer is wrong.

pub mod ab;
pub mod accuracy;
pub mod agreement;
pub mod answer;
pub mod backend;
pub mod baseline;
pub mod bench;
pub mod compare;
pub mod converge;
pub mod crosscheck;
#[cfg(test)]
mod faulty;
pub mod growth;
pub mod metrics;
mod named;
mod parallel;
mod png;
pub mod query;
pub mod random;
pub mod rays;
pub mod replay;
pub mod result;
pub mod stats;
pub mod verdict;
