//! The closest hits of 16 rays, and their way into the caller's packet.

use super::build::Tree;
use super::query::Query;
use super::single::{Best, SPHERE};
use crate::geometry::Geometry;
use crate::ray::{LANES, NONE, RayPacket, Rays};

/// The closest hits so far.
pub struct Found {
    /// Ray parameters; the ends of the segments until there is a hit.
    pub t: [f64; LANES],
    /// Numbers of the primitives in the whole scene, or [`NONE`].
    pub primitive: [u32; LANES],
    /// Leaves of the triangles.
    pub block: [u32; LANES],
    /// Places of the triangles in them, or [`SPHERE`].
    pub slot: [u32; LANES],
}

impl Found {
    /// No hits.
    #[inline(always)]
    pub fn nothing(rays: &Rays) -> Self {
        let mut t = [0.0; LANES];
        for i in 0..LANES {
            t[i] = f64::from(rays.tfar[i]);
        }
        Self { t, primitive: [NONE; LANES], block: [0; LANES], slot: [SPHERE; LANES] }
    }

    /// Sets lane `i`.
    #[inline(always)]
    pub fn set(&mut self, i: usize, best: &Best) {
        self.t[i] = best.t;
        self.primitive[i] = best.primitive;
        self.block[i] = best.block;
        self.slot[i] = best.slot;
    }

    /// Writes the hits. Weights are those of the sheared triangle, of a quad as Embree has them.
    #[inline(always)]
    pub fn store(
        &self,
        tree: &Tree,
        geometry: &Geometry,
        query: &Query,
        packet: &mut RayPacket,
    ) {
        let mut corners = [[[0.0f32; LANES]; 3]; 3];
        let mut second_half = [false; LANES];
        for i in 0..LANES {
            if self.primitive[i] == NONE {
                continue;
            }
            (packet.hits.geom[i], packet.hits.prim[i]) = geometry.place(self.primitive[i]);
            packet.rays.tfar[i] = self.t[i] as f32;
            if self.slot[i] == SPHERE {
                continue;
            }
            let block = &tree.blocks[self.block[i] as usize];
            let slot = self.slot[i] as usize;
            second_half[i] = block.is_second_half(slot);
            let axes = query.lane(i).axes;
            for (k, corner) in corners.iter_mut().enumerate() {
                let v = block.corner(k, slot);
                for (lanes, &axis) in corner.iter_mut().zip(&axes) {
                    lanes[i] = block.vertices[axis][v];
                }
            }
        }
        for i in 0..LANES {
            let shear = |[x, y, z]: &[[f32; LANES]; 3]| {
                let depth = z[i] - query.origin[2][i];
                (
                    f64::from((x[i] - query.origin[0][i]) - query.shear[0][i] * depth),
                    f64::from((y[i] - query.origin[1][i]) - query.shear[1][i] * depth),
                )
            };
            let ((ax, ay), (bx, by), (cx, cy)) =
                (shear(&corners[0]), shear(&corners[1]), shear(&corners[2]));
            let (u, v, w) = (cx * by - cy * bx, ax * cy - ay * cx, bx * ay - by * ax);
            let inverse = 1.0 / (u + v + w);
            let (v, w) = (v * inverse, w * inverse);
            let (v, w) = if second_half[i] { (1.0 - v, 1.0 - w) } else { (v, w) };
            let hit = self.primitive[i] != NONE;
            packet.hits.u[i] = if hit { v as f32 } else { packet.hits.u[i] };
            packet.hits.v[i] = if hit { w as f32 } else { packet.hits.v[i] };
        }
    }
}
