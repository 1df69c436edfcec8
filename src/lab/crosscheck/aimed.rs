//! Seeded random rays that are hard to answer, aimed at the primitives of a scene.

use glam::DVec3;

use super::source::RaySource;
use crate::geometry::{Box3, Geometry, GeometryKind, doubles};
use crate::lab::random::Random;
use crate::lab::rays::PacketToTrace;
use crate::ray::{LANES, Mask, Rays};

/// Generates rays that are aimed at a geometry.
pub struct Aim<'g> {
    geometry: &'g Geometry,
    center: DVec3,
    /// Half the sides of the scene's bounding box.
    half: DVec3,
    /// Largest half side of the bounding box of each geometry id.
    sizes: Vec<f64>,
}

impl<'g> Aim<'g> {
    /// Measures the geometry. Returns `None` if it has no primitive.
    pub fn new(geometry: &'g Geometry) -> Option<Self> {
        let of = |range: &[u32]| {
            Box3::around(
                (range[0]..range[1]).map(|primitive| Box3::of(&corners(geometry, primitive))),
            )
        };
        let boxes: Vec<Box3> = geometry.bases().windows(2).map(of).collect();
        let sizes = boxes.iter().map(|b| (b.max - b.min).max_element() / 2.0).collect();
        let all = Box3::around(boxes);
        let (center, half) = (all.center(), (all.max - all.min) / 2.0);
        center.is_finite().then_some(Self { geometry, center, half, sizes })
    }

    /// Returns a packet of rays of one source. If `shadow`, the rays end before their target,
    /// behind it or never.
    pub fn packet(&self, source: RaySource, shadow: bool, random: &mut Random) -> PacketToTrace {
        let mut rays = Rays::EMPTY;
        for i in 0..LANES {
            let (origin, direction, target) = self.ray(source, random);
            let ends = [0.5, 0.999, 1.5, f64::INFINITY];
            let end = ends[random.below(4) as usize];
            rays.set(i, origin.as_vec3(), direction.as_vec3());
            if shadow {
                rays.tfar[i] = (target * end) as f32;
            }
        }
        let active = rays.possible(&Mask::ALL);
        PacketToTrace { active, rays }
    }

    /// A random point in the scene's bounding box, enlarged by the factor `times`.
    fn somewhere(&self, times: f64, random: &mut Random) -> DVec3 {
        self.center + self.half * times * random.cube()
    }

    /// Returns origin, direction, and t of the target: 1 if the ray has no target.
    fn ray(&self, source: RaySource, random: &mut Random) -> (DVec3, DVec3, f64) {
        let count = self.geometry.bases().last().copied().unwrap_or(1);
        let primitive = random.below(count);
        let geom = self.geometry.bases().partition_point(|&base| base <= primitive) - 1;
        let corners = corners(self.geometry, primitive);
        let corner = corners[random.below(corners.len() as u32) as usize];
        let next = corners[random.below(corners.len() as u32) as usize];
        let middle = corners.iter().sum::<DVec3>() / corners.len() as f64;
        let inside = middle.lerp(corner, random.unit()).lerp(next, random.unit() * 0.5);
        let rounded = |v: DVec3| v.as_vec3().as_dvec3();
        let from = rounded(self.somewhere(2.0, random));
        let mut target = 1.0;
        let (origin, direction) = match source {
            RaySource::Random => (self.somewhere(1.5, random), random.direction()),
            RaySource::Vertex => {
                if random.bits() % 2 == 0 {
                    (from, corner - from)
                } else {
                    // A direction of few bits, so that the ray passes exactly through the corner
                    // where the corner's coordinates allow.
                    let step = rounded((random.cube() * 4.0).round())
                        * 2f64.powi(random.below(6) as i32 - 3);
                    (corner - step, step)
                }
            }
            RaySource::Edge => {
                let target = rounded(corner.lerp(next, random.unit()));
                (from, target - from)
            }
            RaySource::Axis => {
                let axis = random.below(3) as usize;
                let mut direction = DVec3::ZERO;
                direction[axis] = random.sign();
                let mut origin = if random.bits() % 4 == 0 { inside } else { corner };
                origin[axis] = self.somewhere(2.0, random)[axis];
                (origin, direction)
            }
            RaySource::BoxFace => {
                let axis = random.below(3) as usize;
                let (mut origin, mut direction) =
                    (from.lerp(inside, random.unit()), random.direction());
                origin[axis] = corner[axis];
                if random.bits() % 2 == 0 {
                    direction[axis] = 0.0 * random.sign();
                }
                if random.bits() % 4 == 0 {
                    direction[(axis + 1) % 3] = 0.0;
                }
                (origin, direction)
            }
            RaySource::Far => {
                let away = random.direction() * self.sizes[geom].max(f64::MIN_POSITIVE);
                let origin = rounded(inside + away * 10f64.powf(1.0 + 3.0 * random.unit()));
                (origin, inside - origin)
            }
            RaySource::Tiny => {
                let least = 10f64.powf(-30.0 - 7.0 * random.unit());
                let distance = inside.distance(from);
                // A shorter direction would give a t beyond the range of f32.
                let least = least.max(distance * 1e-37);
                target = distance / least;
                (from, (inside - from).normalize_or(DVec3::X) * least)
            }
        };
        (origin, direction, target)
    }
}

/// Points of a primitive to aim at: its corners, or six points of a sphere.
fn corners(geometry: &Geometry, primitive: u32) -> Vec<DVec3> {
    let geom = geometry.bases().partition_point(|&base| base <= primitive) - 1;
    let prim = primitive - geometry.bases()[geom];
    match geometry.kind(geom as u32) {
        GeometryKind::Mesh(mesh) => geometry.meshes[mesh].corners(prim).map(doubles).to_vec(),
        GeometryKind::Quads => geometry.quads[prim as usize].map(doubles).to_vec(),
        GeometryKind::Instance(index) => {
            geometry.instance_corners(index, prim).map(doubles).to_vec()
        }
        GeometryKind::Spheres => {
            let sphere = &geometry.spheres[prim as usize];
            let axes = [DVec3::X, DVec3::Y, DVec3::Z, DVec3::NEG_X, DVec3::NEG_Y, DVec3::NEG_Z];
            axes.map(|axis| sphere.center + axis * sphere.radius).to_vec()
        }
    }
}
