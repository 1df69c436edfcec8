//! Known rates of wrong answers of backends that need not be right.
//!
//! The rates were measured; docs/notebook/crosscheck.md has the figures. A higher rate means that
//! something broke.

use crate::scene::Backend;

/// Number of wrong answers that are always allowed: too few to measure a rate.
const FEW: u64 = 10;

/// Share of answers to the rays of a source that may be wrong; `None` if all must be right.
///
/// It is generous: at least 1.7 times the largest share that was measured in any scene.
pub fn rate(backend: Backend, source: &str) -> Option<f64> {
    match (backend, source) {
        (Backend::Bvh(_) | Backend::Brute, _) => None,
        // Directions of length 1e-37 to 1e-30: products of them underflow.
        (Backend::Embree(_), "tiny") => Some(1.0),
        (Backend::Embree(_), "vertex" | "edge" | "axis" | "far") => Some(0.01),
        (Backend::Coursework, "vertex" | "edge" | "axis" | "box-face" | "far" | "tiny") => {
            Some(0.02)
        }
        (Backend::Embree(_) | Backend::Coursework, _) => Some(0.001),
    }
}

/// Largest number of wrong answers to `rays` rays at this rate.
pub fn most(rate: f64, rays: u64) -> u64 {
    (rate * rays as f64) as u64 + FEW
}
