//! The closest hits of 16 rays, and their way into the caller's packet.

use crate::geometry::Geometry;
use crate::ray::{LANES, NONE, RayPacket, Rays};

/// Up to so many geometries are counted through.
const FEW: usize = 16;

/// The closest hits so far.
#[repr(C, align(64))]
pub struct Found {
    /// Ray parameters; the ends of the segments until there is a hit.
    pub t: [f64; LANES],
    /// Numbers of the primitives in the whole scene, or [`NONE`].
    pub primitive: [u32; LANES],
    /// Weights of the second and third corner and their sum with the first's; not normalised, 0 0 1
    /// for a sphere.
    pub weights: [[f32; LANES]; 3],
    /// Bits set: these are weights of the second half of a quad.
    pub second_half: [i32; LANES],
}

impl Found {
    /// No hits.
    #[inline(always)]
    pub fn nothing(rays: &Rays) -> Self {
        let mut t = [0.0; LANES];
        for i in 0..LANES {
            t[i] = f64::from(rays.tfar[i]);
        }
        Self {
            t,
            primitive: [NONE; LANES],
            weights: [[0.0; LANES], [0.0; LANES], [1.0; LANES]],
            second_half: [0; LANES],
        }
    }

    /// Writes the hits; weights of a quad as Embree has them.
    #[inline(always)]
    pub fn store(&self, geometry: &Geometry, packet: &mut RayPacket) {
        let first = geometry.bases()[1];
        let mut others = false;
        for i in 0..LANES {
            let hit = self.primitive[i] != NONE;
            others |= hit & (self.primitive[i] >= first);
            let inverse = 1.0 / self.weights[2][i];
            let (u, v) = (self.weights[0][i] * inverse, self.weights[1][i] * inverse);
            let (u, v) = (unit(u), unit(v));
            let second = self.second_half[i] != 0;
            let (u, v) = if second { (1.0 - u, 1.0 - v) } else { (u, v) };
            let hits = &mut packet.hits;
            hits.u[i] = if hit { u } else { hits.u[i] };
            hits.v[i] = if hit { v } else { hits.v[i] };
            hits.geom[i] = if hit { 0 } else { hits.geom[i] };
            hits.prim[i] = if hit { self.primitive[i] } else { hits.prim[i] };
            packet.rays.tfar[i] = if hit { self.t[i] as f32 } else { packet.rays.tfar[i] };
        }
        let later = &geometry.bases()[1..geometry.bases().len() - 1];
        if others && later.len() <= FEW {
            for &base in later {
                for i in 0..LANES {
                    let hit = self.primitive[i] != NONE;
                    let inside = hit & (self.primitive[i] >= base);
                    packet.hits.geom[i] += u32::from(inside);
                    let prim = &mut packet.hits.prim[i];
                    *prim = if inside { self.primitive[i] - base } else { *prim };
                }
            }
        } else if others {
            self.place(geometry, packet);
        }
    }

    /// Finds each primitive's geometry where there are many.
    #[inline(never)]
    fn place(&self, geometry: &Geometry, packet: &mut RayPacket) {
        for i in (0..LANES).filter(|&i| self.primitive[i] != NONE) {
            (packet.hits.geom[i], packet.hits.prim[i]) = geometry.place(self.primitive[i]);
        }
    }
}

#[inline(always)]
fn unit(x: f32) -> f32 {
    let x = if x > 0.0 { x } else { 0.0 };
    if x < 1.0 { x } else { 1.0 }
}
