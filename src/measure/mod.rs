//! Clocks and comparisons: what the measuring commands stand on.

pub mod cross_check;
pub mod rays;
