//! The closest hits of 16 rays, and how they are written to the caller's packet.

use crate::geometry::{Geometry, on_quad_half};
use crate::ray::{LANES, NONE, RayPacket, Rays};

/// Up to this many geometries after the first, a loop over all of them finds the geometries of the
/// hits.
const MAX_SCANNED_GEOMETRIES: usize = 16;

/// The closest hits so far of 16 rays, by lane.
#[repr(C, align(64))]
pub struct ClosestHits {
    /// Ray parameters. Without a hit, the end of the segment.
    pub t: [f64; LANES],
    /// Scene-wide primitive indices, or [`NONE`].
    pub primitive: [u32; LANES],
    /// Barycentric weights of the second and third corner, and the sum of all three weights. Not
    /// normalised. 0, 0, 1 for a sphere and without a hit.
    pub weights: [[f32; LANES]; 3],
    /// All bits set if the weights belong to the second half of a quad, else 0.
    pub second_half: [i32; LANES],
}

impl ClosestHits {
    /// Returns 16 lanes without a hit.
    #[inline(always)]
    pub fn new(rays: &Rays) -> Self {
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

    /// Writes geometry id, primitive index, weights and t of the hits to `packet`, but no normals.
    /// Lanes without a hit keep their values. The weights of a quad are Embree's: see
    /// [`Geometry::quad_half`].
    #[inline(always)]
    pub fn store(&self, geometry: &Geometry, packet: &mut RayPacket) {
        let first = geometry.bases()[1];
        let mut others = false;
        for i in 0..LANES {
            let hit = self.primitive[i] != NONE;
            others |= hit & (self.primitive[i] >= first);
            let inverse = 1.0 / self.weights[2][i];
            let (u, v) = (self.weights[0][i] * inverse, self.weights[1][i] * inverse);
            let (u, v) = (clamp_unit(u), clamp_unit(v));
            let second = self.second_half[i] != 0;
            let (u, v) = if second { (1.0 - u, 1.0 - v) } else { (u, v) };
            let hits = &mut packet.hits;
            hits.u[i] = if hit { u } else { hits.u[i] };
            hits.v[i] = if hit { v } else { hits.v[i] };
            hits.geom[i] = if hit { 0 } else { hits.geom[i] };
            hits.prim[i] = if hit { self.primitive[i] } else { hits.prim[i] };
            packet.rays.tfar[i] = if hit { self.t[i] as f32 } else { packet.rays.tfar[i] };
        }
        if !geometry.quads.is_empty() {
            let id = geometry.quads_id() as usize;
            let (first, end) = (geometry.bases()[id], geometry.bases()[id + 1]);
            for i in 0..LANES {
                let on_quad = (self.primitive[i] >= first) & (self.primitive[i] < end);
                let (u, v) = (packet.hits.u[i], packet.hits.v[i]);
                let (on_u, on_v) = on_quad_half(u, v, self.second_half[i] != 0);
                packet.hits.u[i] = if on_quad { on_u } else { u };
                packet.hits.v[i] = if on_quad { on_v } else { v };
            }
        }
        let later = &geometry.bases()[1..geometry.bases().len() - 1];
        if others && later.len() <= MAX_SCANNED_GEOMETRIES {
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
            self.store_geometries(geometry, packet);
        }
    }

    /// Writes geometry id and primitive index of each hit by a search. For scenes of more than
    /// [`MAX_SCANNED_GEOMETRIES`] geometries after the first.
    #[inline(never)]
    fn store_geometries(&self, geometry: &Geometry, packet: &mut RayPacket) {
        for i in (0..LANES).filter(|&i| self.primitive[i] != NONE) {
            (packet.hits.geom[i], packet.hits.prim[i]) = geometry.place(self.primitive[i]);
        }
    }
}

/// Clamps to [0, 1]; 0 for NaN.
#[inline(always)]
fn clamp_unit(x: f32) -> f32 {
    let x = if x > 0.0 { x } else { 0.0 };
    if x < 1.0 { x } else { 1.0 }
}
