//! All primitives of a scene, relative to one f64 origin.

/// The primitives that an accelerator sees.
#[derive(Debug, Default)]
pub struct Geometry {}
