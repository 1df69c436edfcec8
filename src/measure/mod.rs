//! Clocks and comparisons: what the measuring commands stand on.

pub mod ab;
pub mod accuracy;
pub mod answers;
pub mod bench;
pub mod compare;
pub mod converge;
pub mod cross_check;
pub mod growth;
pub mod judge;
pub mod metrics;
pub mod random;
pub mod rays;
pub mod replay;
pub mod result;
pub mod stats;
