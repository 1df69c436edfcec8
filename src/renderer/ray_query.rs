//! Traces the rays of a library's user: packs 16 rays at a time, and returns hits in world space.

use glam::{DVec3, Vec3};

use crate::accel::Accelerator;
use crate::geometry::{Geometry, NONE, Surfaces, refine};
use crate::ray::{Coherence, LANES, Mask, RayPacket, lane};
use crate::scene::{CheckedShape, ShapeKind};
use crate::world::World;

/// A ray `origin + t direction`, with t in (`t_min`, `t_max`), in world space.
///
/// Before the ray is traced, its limits, its direction, and its origin relative to the scene's
/// origin are rounded to f32. A ray hits nothing if any of its numbers is NaN, if its origin or
/// direction is infinite, or if its direction has no length in f32.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Ray {
    /// Where the ray starts.
    pub origin: [f64; 3],
    /// Direction, of any length > 0.
    pub direction: [f64; 3],
    /// Start of the segment, >= 0. A negative value counts as 0.
    pub t_min: f64,
    /// End of the segment; may be infinite.
    pub t_max: f64,
    /// Scene-wide index of the primitive that the ray leaves, or [`NONE`].
    leaving: u32,
    /// `origin` relative to the scene's origin, if the ray is from [`Hit::ray`]. Converting it to
    /// world space and back could round it to the other side of the surface.
    outside: Option<[f32; 3]>,
}

impl Ray {
    /// Makes a ray from `origin` without end.
    pub fn new(origin: [f64; 3], direction: [f64; 3]) -> Self {
        let (t_min, t_max) = (0.0, f64::INFINITY);
        Self { origin, direction, t_min, t_max, leaving: NONE, outside: None }
    }

    /// Makes the segment between two points, with t from 0 to 1.
    ///
    /// The points are rounded. So a surface that contains one of them may occlude the segment. A
    /// ray from [`Hit::ray`] has no such error at its start.
    pub fn between(from: [f64; 3], to: [f64; 3]) -> Self {
        let direction = DVec3::from(to) - DVec3::from(from);
        Self { t_max: 1.0, ..Self::new(from, direction.to_array()) }
    }
}

/// The closest hit of a ray.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Hit {
    /// Ray parameter of the hit, in lengths of the ray's direction; rounded to f32.
    pub t: f64,
    /// Hit point in world space; rounded to f32 relative to the scene's origin.
    pub point: [f64; 3],
    /// Geometric unit normal, on the side that the ray comes from. It is not interpolated.
    pub normal: [f64; 3],
    /// Index of the shape: the shapes of the scene in their order, then the meshes from memory. All
    /// copies of a mesh with `instances` have the index of its shape. The layer `objectid` numbers
    /// them apart.
    pub shape: usize,
    /// Index of the copy in the shape's `instances`; 0 for a shape without.
    pub instance: usize,
    /// Index of the triangle in the shape's mesh, or of the point if the mesh is drawn as points.
    /// For other shapes 0.
    pub primitive: usize,
    /// Barycentric weights of the second and third corner of the triangle; 0 on a sphere.
    pub barycentric: [f64; 2],
    /// Hit point relative to the scene's origin, rounded to the side that the ray comes from.
    outside: [f32; 3],
    /// The scene's origin in world space.
    scene_origin: [f64; 3],
    /// Scene-wide index of the primitive.
    leaving: u32,
}

impl Hit {
    /// Makes a ray that leaves the surface at this hit. Its origin lies on the side that the first
    /// ray came from. The ray does not hit the surface at its own origin, and needs no epsilon.
    pub fn ray(&self, direction: [f64; 3]) -> Ray {
        let origin = in_world(self.outside, self.scene_origin.into());
        let outside = Some(self.outside);
        Ray { leaving: self.leaving, outside, ..Ray::new(origin, direction) }
    }
}

/// How hits name a shape of a [`crate::scene::Scene`], where copies follow all shapes of the file.
#[derive(Debug, Clone, Copy)]
pub(super) struct ShapeNumber {
    /// As [`Hit::shape`].
    shape: usize,
    /// As [`Hit::instance`].
    instance: usize,
}

impl ShapeNumber {
    /// Numbers all shapes of a scene, those of meshes from memory included.
    pub(super) fn of_all(shapes: &[CheckedShape]) -> Vec<Self> {
        // For each shape that is no copy, the number of its copies so far.
        let mut copies = Vec::new();
        let numbers = shapes.iter().map(|shape| match shape.kind {
            ShapeKind::Instance { of, .. } => {
                copies[of] += 1;
                Self { shape: of, instance: copies[of] }
            }
            _ => {
                copies.push(0);
                Self { shape: copies.len() - 1, instance: 0 }
            }
        });
        numbers.collect()
    }
}

/// Traces at most 16 rays and returns for each whether it hits anything; false after the last.
pub(super) fn occlusion_of_packet(
    accelerator: &dyn Accelerator,
    geometry: &Geometry,
    rays: &[Ray],
) -> [bool; LANES] {
    let (active, mut packet) = pack(rays, geometry.origin);
    accelerator.occluded(&active, &mut packet.rays, Coherence::Unordered);
    std::array::from_fn(|i| active.0[i] != 0 && packet.rays.tfar[i] == f32::NEG_INFINITY)
}

/// Traces at most 16 rays and returns the closest hit of each. `numbers` are those of the shapes.
pub(super) fn closest_of_packet(
    accelerator: &dyn Accelerator,
    world: &World,
    numbers: &[ShapeNumber],
    rays: &[Ray],
) -> Vec<Option<Hit>> {
    let geometry = &world.geometry;
    let (active, mut packet) = pack(rays, geometry.origin);
    accelerator.closest(&active, &mut packet, Coherence::Unordered);
    let hit = packet.hit(&active);
    geometry.replace_stitch_hits(&hit, &mut packet);
    let mut surfaces = Surfaces::EMPTY;
    refine(geometry, &hit, &packet, &mut surfaces);
    let hits = (0..rays.len()).map(|i| {
        let hits = hit.0[i] != 0;
        hits.then(|| hit_of_lane(world, numbers, &packet, &surfaces, i))
    });
    hits.collect()
}

/// Returns the hit of lane `i`, which must have a hit.
fn hit_of_lane(
    world: &World,
    numbers: &[ShapeNumber],
    packet: &RayPacket,
    surfaces: &Surfaces,
    i: usize,
) -> Hit {
    let origin = world.geometry.origin;
    let (geom, prim) = (packet.hits.geom[i], packet.hits.prim[i]);
    let primitive = world.shapes.index_in_shape(geom, prim) as usize;
    let ShapeNumber { shape, instance } = numbers[world.shapes.shape(geom, prim) as usize];
    Hit {
        t: surfaces.t[i].into(),
        point: in_world(lane(&surfaces.position, i).to_array(), origin),
        normal: lane(&surfaces.ng, i).as_dvec3().to_array(),
        shape,
        instance,
        primitive,
        barycentric: [surfaces.u[i], surfaces.v[i]],
        outside: lane(&surfaces.outside, i).to_array(),
        scene_origin: origin.to_array(),
        leaving: surfaces.primitive[i],
    }
}

/// Converts a point from coordinates relative to the scene's origin to world space.
fn in_world(point: [f32; 3], origin: DVec3) -> [f64; 3] {
    (Vec3::from(point).as_dvec3() + origin).to_array()
}

/// Packs at most 16 rays. Returns the lanes whose rays can hit anything, and the packet.
fn pack(rays: &[Ray], origin: DVec3) -> (Mask, RayPacket) {
    let mut packet = RayPacket::EMPTY;
    let mut active = Mask::NONE;
    for (i, ray) in rays.iter().enumerate() {
        active.0[i] = -1;
        // `origin` is public: the caller may have changed it since `Hit::ray`.
        let outside = ray.outside.filter(|&outside| in_world(outside, origin) == ray.origin);
        let start = outside.map_or((DVec3::from(ray.origin) - origin).as_vec3(), Vec3::from);
        packet.rays.set(i, start, DVec3::from(ray.direction).as_vec3());
        // Unlike `max`, this keeps NaN.
        packet.rays.tnear[i] = if ray.t_min < 0.0 { 0.0 } else { ray.t_min as f32 };
        packet.rays.tfar[i] = ray.t_max as f32;
        packet.rays.leaving[i] = if outside.is_some() { ray.leaving } else { NONE };
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
        let origin = scene.world.geometry.origin;
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

    /// A ray leaves a triangle only where its hit was.
    #[test]
    fn a_ray_whose_origin_was_moved_may_hit_any_triangle() {
        let corners = vec![[0.0, 0.0, 0.0], [3.0, 0.0, 0.0], [0.0, 3.0, 0.0]];
        let mesh = Mesh::new(Positions::F64(corners), vec![[0, 1, 2]]).unwrap();
        let scene = LoadedScene::of_mesh(mesh).unwrap();
        let renderer = scene.renderer().unwrap();
        let hit = renderer.closest(&[Ray::new([1.0, 1.0, 5.0], [0.0, 0.0, -1.0])])[0].unwrap();
        let ray = hit.ray([0.0, 0.0, -1.0]);
        assert_eq!(renderer.occluded(&[ray]), [false]);
        assert_eq!(renderer.occluded(&[Ray { origin: [1.0, 1.0, 5.0], ..ray }]), [true]);
    }

    #[test]
    fn a_ray_with_nan_hits_nothing() {
        let corners = vec![[0.0, 0.0, 0.0], [3.0, 0.0, 0.0], [0.0, 3.0, 0.0]];
        let mesh = Mesh::new(Positions::F64(corners), vec![[0, 1, 2]]).unwrap();
        let scene = LoadedScene::of_mesh(mesh).unwrap();
        let renderer = scene.renderer().unwrap();
        let ray = Ray::new([1.0, 1.0, 5.0], [0.0, 0.0, -1.0]);
        let nan = f64::NAN;
        let wrong = [
            Ray { origin: [nan, 1.0, 5.0], ..ray },
            Ray { direction: [0.0, nan, -1.0], ..ray },
            Ray { t_min: nan, ..ray },
            Ray { t_max: nan, ..ray },
        ];
        assert_eq!(renderer.occluded(&wrong), [false; 4]);
        assert!(renderer.closest(&wrong).iter().all(Option::is_none));
        assert_eq!(renderer.occluded(&[ray, Ray { t_min: -1.0, ..ray }]), [true; 2]);
    }

    /// Copies of a mesh stand behind all shapes of the file in the scene, but not in hits.
    #[test]
    fn copies_have_the_index_of_their_shape() {
        let folder = tempfile::tempdir().unwrap();
        let ply = folder.path().join("t.ply");
        std::fs::write(
            &ply,
            "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\n\
             property float z\nelement face 1\nproperty list uchar int vertex_indices\n\
             end_header\n0 0 0\n1 0 0\n0 1 0\n3 0 1 2\n",
        )
        .unwrap();
        let at = |x: i32| format!("[[1,0,0,{x}],[0,1,0,0],[0,0,1,0],[0,0,0,1]]");
        for backend in ["bvh", "brute", "coursework"] {
            let text = format!(
                r#"{{ "camera": {{ "type": "pinhole", "width": 1, "height": 1, "fov": 40,
                  "position": [0, 0, 9], "target": [0, 0, 0], "up": [0, 1, 0] }},
                "scene": {{ "accelerator": "{backend}", "materials": {{ "clay": {{}} }}, "shapes": [
                  {{ "type": "trimesh", "path": {ply:?}, "material": "clay",
                     "instances": [{}, {}, {}] }},
                  {{ "type": "sphere", "center": [30, 0, 0], "radius": 1, "material": "clay" }},
                  {{ "type": "trimesh", "path": {ply:?}, "material": "clay",
                     "instances": [{}, {}] }}] }} }}"#,
                at(0),
                at(4),
                at(8),
                at(40),
                at(44)
            );
            let moved = |x: f64| vec![[x, 0.0, 0.0], [x + 1.0, 0.0, 0.0], [x, 1.0, 0.0]];
            let mesh = |x| Mesh::new(Positions::F64(moved(x)), vec![[0, 1, 2]]).unwrap();
            let meshes = vec![("a", "clay", mesh(50.0)), ("b", "clay", mesh(60.0))];
            let scene = LoadedScene::with_meshes(&text, &[], meshes).unwrap();
            let renderer = scene.renderer().unwrap();
            let expected = [
                (0.0, [0, 0]),
                (4.0, [0, 1]),
                (8.0, [0, 2]),
                (30.0, [1, 0]),
                (40.0, [2, 0]),
                (44.0, [2, 1]),
                (50.0, [3, 0]),
                (60.0, [4, 0]),
            ];
            for (x, numbers) in expected {
                let ray = Ray::new([x + 0.25, 0.25, 5.0], [0.0, 0.0, -1.0]);
                let hit = renderer.closest(&[ray])[0].expect("a shape at each of these places");
                assert_eq!([hit.shape, hit.instance], numbers, "{backend}, x = {x}");
            }
        }
    }
}
