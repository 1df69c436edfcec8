//! From f32 to f64.

use glam::DVec3;

/// Converts a point to f64.
#[inline(always)]
pub fn doubles(v: [f32; 3]) -> DVec3 {
    DVec3::from(v.map(f64::from))
}
