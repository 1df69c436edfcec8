//! One lane of a packet in f64: what backends that trace ray by ray work with.

use glam::DVec3;

use crate::ray::{LANES, Mask, RayPacket, Rays};

/// The ray `origin + t direction`, t in (`tnear`, `tfar`), exactly as a packet holds it in f32.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Ray {
    /// Relative to the scene's origin.
    pub origin: DVec3,
    /// Any length but zero.
    pub direction: DVec3,
    /// Start of the segment, >= 0.
    pub tnear: f64,
    /// End of the segment; may be infinite.
    pub tfar: f64,
    /// The primitive number that the ray leaves, or [`crate::ray::NONE`].
    pub leaving: u32,
}

impl Ray {
    /// Lane `i` of `rays`.
    pub fn of(rays: &Rays, i: usize) -> Self {
        let vector =
            |v: &[[f32; LANES]; 3]| DVec3::from([v[0][i], v[1][i], v[2][i]].map(f64::from));
        Self {
            origin: vector(&rays.org),
            direction: vector(&rays.dir),
            tnear: rays.tnear[i].into(),
            tfar: rays.tfar[i].into(),
            leaving: rays.leaving[i],
        }
    }
}

/// What a ray hits.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Hit {
    /// Geometry id.
    pub geom: u32,
    /// Primitive within its geometry.
    pub prim: u32,
    /// Where on the ray.
    pub t: f64,
    /// Barycentric weight of the second corner; 0 on a sphere.
    pub u: f64,
    /// Barycentric weight of the third corner; 0 on a sphere.
    pub v: f64,
    /// Geometric normal of any length.
    pub ng: DVec3,
}

impl Hit {
    /// Writes it into lane `i`, rounded to f32.
    pub fn store(&self, packet: &mut RayPacket, i: usize) {
        packet.rays.tfar[i] = self.t as f32;
        let hits = &mut packet.hits;
        (hits.geom[i], hits.prim[i]) = (self.geom, self.prim);
        (hits.u[i], hits.v[i]) = (self.u as f32, self.v as f32);
        // A normal of unit length is within the range of f32 whatever the triangle's size.
        let ng = self.ng.normalize_or_zero().as_vec3();
        (hits.ng[0][i], hits.ng[1][i], hits.ng[2][i]) = (ng.x, ng.y, ng.z);
    }
}

/// The lanes that `active` names.
pub fn lanes(active: &Mask) -> impl Iterator<Item = usize> + use<'_> {
    (0..LANES).filter(|&i| active.0[i] != 0)
}
