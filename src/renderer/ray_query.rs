//! Rays of a library's user in world space: packed by 16, traced, and returned as hits.

use glam::{DVec3, Vec3};
use rayon::prelude::*;

use super::Renderer;
use crate::geometry::{Geometry, NONE, Surfaces, refine};
use crate::ray::{Coherence, LANES, Mask, RayPacket, lane};
use crate::shading::Owner;

/// A ray `origin + t direction`, with t in (`t_min`, `t_max`), in world space.
///
/// The origin is rounded to f32 relative to the scene's origin before the ray is traced, and so is
/// the direction. A ray with a NaN or without a direction hits nothing.
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
    /// `origin` relative to the scene's origin, if it is a point of [`Hit::ray`]. The way through
    /// world space could round it to the other side of the surface.
    outside: Option<[f32; 3]>,
}

impl Ray {
    /// A ray from `origin` without end.
    pub fn new(origin: [f64; 3], direction: [f64; 3]) -> Self {
        let (t_min, t_max) = (0.0, f64::INFINITY);
        Self { origin, direction, t_min, t_max, leaving: NONE, outside: None }
    }

    /// The segment between two points. It is occluded if one does not see the other.
    ///
    /// The points themselves are rounded. So a surface that contains one of them may occlude it;
    /// [`Hit::ray`] has no such error at its start.
    pub fn between(from: [f64; 3], to: [f64; 3]) -> Self {
        let direction = DVec3::from(to) - DVec3::from(from);
        Self { t_max: 1.0, ..Self::new(from, direction.to_array()) }
    }
}

/// The closest hit of a ray.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Hit {
    /// Ray parameter of the hit, in units of the ray's direction; rounded to f32.
    pub t: f64,
    /// The point that was hit, in world space; rounded to f32 relative to the scene's origin.
    pub point: [f64; 3],
    /// Unit normal of the surface, on the side that the ray comes from. It is not interpolated.
    pub normal: [f64; 3],
    /// Index of the shape: the shapes of the scene in their order, then the meshes from memory.
    pub shape: usize,
    /// Index of the triangle in the shape's mesh; 0 for other shapes.
    pub primitive: usize,
    /// Barycentric weights of the second and third corner of the triangle; 0 on a sphere.
    pub barycentric: [f64; 2],
    /// The point, rounded to the outside of the surface, relative to the scene's origin.
    outside: [f32; 3],
    /// The scene's origin in world space.
    scene_origin: [f64; 3],
    /// Scene-wide number of the primitive.
    leaving: u32,
}

impl Hit {
    /// A ray that leaves the surface here, to the side that the first ray came from. It does not
    /// hit the same surface again, and needs no epsilon.
    pub fn ray(&self, direction: [f64; 3]) -> Ray {
        let origin = in_world(self.outside, self.scene_origin.into());
        let outside = Some(self.outside);
        Ray { leaving: self.leaving, outside, ..Ray::new(origin, direction) }
    }
}

impl Renderer<'_> {
    /// Finds the closest hit of each ray; `None` for a miss. Uses the threads of the current rayon
    /// pool. Shapes that camera rays cannot hit (`visible`) do not count.
    pub fn closest(&self, rays: &[Ray]) -> Vec<Option<Hit>> {
        rays.par_chunks(LANES).flat_map_iter(|rays| self.closest_of_packet(rays)).collect()
    }

    /// Whether each ray hits anything. Faster than [`Renderer::closest`]. Shapes that cast no
    /// shadow (`visible`) do not count.
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
        let origin = self.geometry().origin;
        let (geom, prim) = (packet.hits.geom[i], packet.hits.prim[i]);
        let primitive = match self.loaded.world.shapes.owners[geom as usize] {
            Owner::One(_) => prim as usize,
            Owner::Each(_) => 0,
        };
        Hit {
            t: surfaces.t[i].into(),
            point: in_world(lane(&surfaces.position, i).to_array(), origin),
            normal: lane(&surfaces.ng, i).as_dvec3().to_array(),
            shape: self.loaded.world.shapes.shape(geom, prim) as usize,
            primitive,
            barycentric: [surfaces.u[i], surfaces.v[i]],
            outside: lane(&surfaces.outside, i).to_array(),
            scene_origin: origin.to_array(),
            leaving: surfaces.primitive[i],
        }
    }

    fn geometry(&self) -> &Geometry {
        &self.loaded.world.geometry
    }
}

/// World space coordinates of a point relative to the scene's origin.
fn in_world(point: [f32; 3], origin: DVec3) -> [f64; 3] {
    (Vec3::from(point).as_dvec3() + origin).to_array()
}

/// Makes a packet of at most 16 rays, and the set of those that can hit anything.
fn pack(rays: &[Ray], origin: DVec3) -> (Mask, RayPacket) {
    let mut packet = RayPacket::EMPTY;
    let mut active = Mask::NONE;
    for (i, ray) in rays.iter().enumerate() {
        active.0[i] = -1;
        // A caller may have moved the origin since.
        let outside = ray.outside.filter(|&outside| in_world(outside, origin) == ray.origin);
        let start = outside.map_or((DVec3::from(ray.origin) - origin).as_vec3(), Vec3::from);
        packet.rays.set(i, start, DVec3::from(ray.direction).as_vec3());
        packet.rays.tnear[i] = ray.t_min.max(0.0) as f32;
        packet.rays.tfar[i] = ray.t_max as f32;
        packet.rays.leaving[i] = ray.leaving;
    }
    (packet.rays.possible(&active), packet)
}

#[cfg(test)]
mod tests {
    use super::super::LoadedScene;
    use super::*;
    use crate::mesh::{Mesh, Positions};

    /// A tilted square in map coordinates, whose sums with the scene's origin round.
    #[test]
    fn a_ray_from_a_hit_starts_at_its_bits() {
        let at = |x: f64, y: f64| [499_999.37 + x, 4_100_000.71 + y, 31.3 + 0.3 * x - 0.7 * y];
        let corners = vec![at(0.0, 0.0), at(1.0, 0.0), at(1.0, 1.0), at(0.0, 1.0)];
        let mesh = Mesh::new(Positions::F64(corners), vec![[0, 1, 2], [0, 2, 3]]).unwrap();
        let scene = LoadedScene::of_mesh(mesh).unwrap();
        let renderer = scene.renderer().unwrap();
        let origin = renderer.geometry().origin;
        let down = |i: u32| {
            let [x, y, _] = at(f64::from(i % 20 + 1) / 23.0, f64::from(i / 20 + 1) / 23.0);
            Ray::new([x, y, 40.0], [0.0, 0.0, -1.0])
        };
        let mut moved = 0;
        for hit in renderer.closest(&(0..400).map(down).collect::<Vec<_>>()) {
            let hit = hit.expect("every ray meets the square");
            let ray = hit.ray(hit.normal);
            let start = |ray: Ray| lane(&pack(&[ray], origin).1.rays.org, 0).to_array();
            assert_eq!(start(ray), hit.outside);
            assert_eq!(renderer.occluded(&[ray]), [false]);
            moved += u32::from(start(Ray { outside: None, ..ray }) != hit.outside);
            // An origin that was moved counts.
            let beside = Ray { origin: [ray.origin[0] + 1.0, ray.origin[1], ray.origin[2]], ..ray };
            assert_eq!(start(beside)[0], (beside.origin[0] - origin.x) as f32);
        }
        assert!(moved > 0, "the way through world space rounds none of these points");
    }
}
