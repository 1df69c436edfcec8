//! One lane of a packet as a ray and a hit in f64, for backends that trace rays one by one.

use glam::DVec3;

use crate::ray::{LANES, Mask, RayPacket, Rays, lane};

/// The ray `origin + t direction`, t in (`tnear`, `tfar`). All values come from a packet, so each
/// is an f32 value.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LaneRay {
    /// Relative to the scene's origin.
    pub origin: DVec3,
    /// Need not have unit length; not zero.
    pub direction: DVec3,
    /// Start of the segment, >= 0.
    pub tnear: f64,
    /// End of the segment; may be infinite.
    pub tfar: f64,
    /// Scene-wide index of the primitive that the ray leaves, or [`crate::ray::NONE`].
    pub leaving: u32,
}

impl LaneRay {
    /// Returns the ray in lane `i` of `rays`.
    pub fn of(rays: &Rays, i: usize) -> Self {
        Self {
            origin: lane(&rays.org, i).as_dvec3(),
            direction: lane(&rays.dir, i).as_dvec3(),
            tnear: rays.tnear[i].into(),
            tfar: rays.tfar[i].into(),
            leaving: rays.leaving[i],
        }
    }
}

/// A hit of one ray, in f64.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LaneHit {
    /// Geometry id, as in [`crate::ray::Hits::geom`].
    pub geom: u32,
    /// Index of the primitive within its geometry.
    pub prim: u32,
    /// Ray parameter of the hit, in units of the direction's length.
    pub t: f64,
    /// Barycentric weight of the second corner; 0 on a sphere.
    pub u: f64,
    /// Barycentric weight of the third corner; 0 on a sphere.
    pub v: f64,
    /// Geometric normal of any length.
    pub ng: DVec3,
}

impl LaneHit {
    /// Writes the hit into lane `i` of `packet`, rounded to f32. The normal gets unit length.
    pub fn store(&self, packet: &mut RayPacket, i: usize) {
        packet.rays.tfar[i] = self.t as f32;
        let hits = &mut packet.hits;
        (hits.geom[i], hits.prim[i]) = (self.geom, self.prim);
        (hits.u[i], hits.v[i]) = (self.u as f32, self.v as f32);
        // A unit normal fits f32; the normal of a tiny or huge triangle might not.
        let ng = self.ng.normalize_or_zero().as_vec3();
        (hits.ng[0][i], hits.ng[1][i], hits.ng[2][i]) = (ng.x, ng.y, ng.z);
    }
}

/// Returns the indices of the active lanes, lowest first.
pub fn lanes(active: &Mask) -> impl Iterator<Item = usize> + use<'_> {
    (0..LANES).filter(|&i| active.0[i] != 0)
}
