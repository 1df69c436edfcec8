//! A candidate hit that Embree passes to a filter.

use glam::DVec3;

/// One lane of Embree's filter arguments.
#[derive(Debug, Clone, Copy)]
pub struct Candidate {
    pub origin: DVec3,
    pub direction: DVec3,
    /// Geometric normal in f32 as Embree computes it: (v2 - v0) x (v0 - v1) or its negative.
    pub normal: DVec3,
    pub tnear: f64,
    /// The ray's end before the query.
    pub tfar: f64,
    /// Ray parameter of the candidate by Embree's test.
    pub t: f64,
    pub u: f32,
    pub v: f32,
    pub prim: u32,
    pub geom: u32,
    /// Scene-wide index of the primitive that the ray leaves, or `NONE`.
    pub leaving: u32,
}
