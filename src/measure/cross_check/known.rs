//! Known rates of wrong answers of the backends that may be wrong. docs/notebook/crosscheck.md has
//! the measurements. A higher rate means that something broke.

use crate::scene::Backend;

/// So few wrong answers of a kind are no rate yet.
const FEW: u64 = 10;

/// The share of answers to rays of a source (by name) that may be wrong; `None` for those that must
/// be right. Generous: about twice the largest share of any scene that was measured.
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

/// How many of so many answers that is.
pub fn most(rate: f64, rays: u64) -> u64 {
    (rate * rays as f64) as u64 + FEW
}
