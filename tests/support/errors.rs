//! Sizes of errors.

/// Returns the worse of two errors. NaN is worse than all.
pub fn worse(a: f64, b: f64) -> f64 {
    if a.is_nan() || b.is_nan() { f64::INFINITY } else { a.max(b) }
}
