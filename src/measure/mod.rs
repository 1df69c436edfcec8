//! Clocks and comparisons: what the measuring commands stand on.

pub mod rays;
