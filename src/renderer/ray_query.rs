//! Rays of a library's user, in world space: packed by 16, traced, and told as hits.

use glam::DVec3;
use rayon::prelude::*;

use super::Renderer;
use crate::geometry::{Geometry, NONE, Surfaces, refine};
use crate::ray::{Coherence, LANES, Mask, RayPacket};
use crate::shading::Owner;

/// A ray `origin + t direction`, with t in (`t_min`, `t_max`), in world space.
///
/// The origin is rounded to f32 relative to the middle of the scene before the ray is traced, and
/// so is the direction. A ray with a NaN or without a direction hits nothing.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Ray {
    /// Where the ray starts.
    pub origin: [f64; 3],
    /// Direction, of any length > 0.
    pub direction: [f64; 3],
    /// Start of the segment, >= 0.
    pub t_min: f64,
    /// End of the segment; may be infinite.
    pub t_max: f64,
    /// Scene-wide number of the primitive that the ray leaves.
    leaving: u32,
}

impl Ray {
    /// A ray from `origin` without end.
    pub fn new(origin: [f64; 3], direction: [f64; 3]) -> Self {
        Self { origin, direction, t_min: 0.0, t_max: f64::INFINITY, leaving: NONE }
    }

    /// The segment between two points, without its ends: asks whether one sees the other.
    pub fn between(from: [f64; 3], to: [f64; 3]) -> Self {
        let direction = DVec3::from(to) - DVec3::from(from);
        Self { t_max: 1.0, ..Self::new(from, direction.to_array()) }
    }
}

/// The closest hit of a ray.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Hit {
    /// Ray parameter of the hit, in units of the ray's direction.
    pub t: f64,
    /// The point that was hit, in world space.
    pub point: [f64; 3],
    /// Unit normal of the surface, on the side that the ray comes from. It is not interpolated.
    pub normal: [f64; 3],
    /// Index of the shape: the shapes of the scene in their order, then the meshes from memory.
    pub shape: usize,
    /// Index of the triangle in the shape's mesh; 0 for other shapes.
    pub primitive: usize,
    /// Barycentric weights of the second and third corner of the triangle; 0 on a sphere.
    pub barycentric: [f64; 2],
    /// The point, rounded to the outside of the surface.
    outside: [f64; 3],
    /// Scene-wide number of the primitive.
    leaving: u32,
}

impl Hit {
    /// A ray that leaves the surface here, to the side that the first ray came from. It does not
    /// hit the same surface again, and needs no epsilon.
    pub fn ray(&self, direction: [f64; 3]) -> Ray {
        Ray { leaving: self.leaving, ..Ray::new(self.outside, direction) }
    }
}

impl Renderer<'_> {
    /// Finds the closest hit of each ray; `None` for a miss. Uses the threads of the current rayon
    /// pool.
    pub fn closest(&self, rays: &[Ray]) -> Vec<Option<Hit>> {
        rays.par_chunks(LANES).flat_map_iter(|rays| self.closest_of_packet(rays)).collect()
    }

    /// Whether each ray hits anything. Faster than [`Renderer::closest`].
    pub fn occluded(&self, rays: &[Ray]) -> Vec<bool> {
        let packets = rays.par_chunks(LANES);
        packets
            .flat_map_iter(|rays| self.occlusion_of_packet(rays).into_iter().take(rays.len()))
            .collect()
    }

    fn occlusion_of_packet(&self, rays: &[Ray]) -> [bool; LANES] {
        let (active, mut packet) = pack(rays, self.geometry().origin);
        self.accelerator.occluded(&active, &mut packet.rays, Coherence::Incoherent);
        std::array::from_fn(|i| active.0[i] != 0 && packet.rays.tfar[i] == f32::NEG_INFINITY)
    }

    fn closest_of_packet(&self, rays: &[Ray]) -> Vec<Option<Hit>> {
        let geometry = self.geometry();
        let (active, mut packet) = pack(rays, geometry.origin);
        self.accelerator.closest(&active, &mut packet, Coherence::Incoherent);
        let hit = packet.hit(&active);
        geometry.replace_stitch_hits(&hit, &mut packet);
        let mut surfaces = Surfaces::EMPTY;
        refine(geometry, &hit, &packet, &mut surfaces);
        let lanes =
            (0..rays.len()).map(|i| (hit.0[i] != 0).then(|| self.hit(&packet, &surfaces, i)));
        lanes.collect()
    }

    /// The hit of lane `i`, which must have one.
    fn hit(&self, packet: &RayPacket, surfaces: &Surfaces, i: usize) -> Hit {
        let vector = |v: &[[f32; LANES]; 3]| DVec3::from(v.map(|axis| f64::from(axis[i])));
        let origin = self.geometry().origin;
        let (geom, prim) = (packet.hits.geom[i], packet.hits.prim[i]);
        let primitive = match self.loaded.world.shapes.owners[geom as usize] {
            Owner::One(_) => prim as usize,
            Owner::Each(_) => 0,
        };
        Hit {
            t: surfaces.t[i].into(),
            point: (vector(&surfaces.position) + origin).to_array(),
            normal: vector(&surfaces.ng).to_array(),
            shape: self.loaded.world.shapes.shape(geom, prim) as usize,
            primitive,
            barycentric: [surfaces.u[i], surfaces.v[i]],
            outside: (vector(&surfaces.outside) + origin).to_array(),
            leaving: surfaces.primitive[i],
        }
    }

    fn geometry(&self) -> &Geometry {
        &self.loaded.world.geometry
    }
}

/// Makes a packet of at most 16 rays, and the set of those that can hit anything.
fn pack(rays: &[Ray], origin: DVec3) -> (Mask, RayPacket) {
    let mut packet = RayPacket::EMPTY;
    let mut active = Mask::NONE;
    for (i, ray) in rays.iter().enumerate() {
        active.0[i] = -1;
        let start = (DVec3::from(ray.origin) - origin).to_array();
        for axis in 0..3 {
            packet.rays.org[axis][i] = start[axis] as f32;
            packet.rays.dir[axis][i] = ray.direction[axis] as f32;
        }
        packet.rays.tnear[i] = ray.t_min.max(0.0) as f32;
        packet.rays.tfar[i] = ray.t_max as f32;
        packet.rays.leaving[i] = ray.leaving;
    }
    (packet.rays.possible(&active), packet)
}
