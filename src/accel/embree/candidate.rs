//! A hit that Embree offers to a filter.

use glam::DVec3;

/// A lane of Embree's arguments.
#[derive(Debug, Clone, Copy)]
pub struct Candidate {
    pub origin: DVec3,
    pub direction: DVec3,
    /// (v2 - v0) x (v0 - v1) or its negative, as Embree computes it.
    pub normal: DVec3,
    pub tnear: f64,
    /// The ray's end before the query.
    pub tfar: f64,
    /// Where Embree says that it is.
    pub t: f64,
    pub u: f32,
    pub v: f32,
    pub prim: u32,
    pub geom: u32,
    /// The primitive that the ray leaves, or `NONE`.
    pub leaving: u32,
}
