//! Ray differentials: how far apart the rays of neighbouring samples are. At a hit they are the
//! sides of the surface area that a sample stands for.
//!
//! Igehy 1999, "Tracing Ray Differentials", SIGGRAPH. Mirrors are taken as flat.

use glam::Vec3;

use super::camera_packet::CameraPacket;
use crate::camera::GeneralProjection;
use crate::geometry::Surfaces;
use crate::ray::{LANES, Rays};
use crate::shading::Lanes3;
use crate::world::World;

/// Smallest cosine between normal and ray; it limits the length of an area.
const MIN_COSINE: f32 = 1e-3;

/// How the ray of a pixel of a general projection changes, by side: its origin, its direction.
type Changes = [[Vec3; 2]; 2];

/// The differentials of a packet's rays, by side: to the sample on the right and to the one below.
#[derive(Debug)]
pub struct Differentials {
    /// Distance of neighbouring samples in pixels.
    share: f64,
    /// Changes of the rays' directions.
    directions: [Lanes3; 2],
    /// Changes of the rays' origins, then of their hits, along the surface.
    pub positions: [Lanes3; 2],
    /// Pixels of a general projection and their changes, by the parity of column and row: a pixel
    /// has many samples, and an inverse distortion takes long. A packet with several samples of a
    /// pixel covers at most 2 x 2 pixels.
    known: [Option<([u32; 2], Changes)>; 4],
}

impl Differentials {
    /// The differentials of a world's rays, without any rays yet.
    pub fn new(world: &World) -> Self {
        // n samples a pixel are 1/sqrt(n) pixels apart.
        let share = 1.0 / f64::from(world.area_spp).sqrt();
        Self {
            share,
            directions: [[[0.0; LANES]; 3]; 2],
            positions: [[[0.0; LANES]; 3]; 2],
            known: [None; 4],
        }
    }

    /// Starts with camera rays.
    #[inline(always)]
    pub fn start(&mut self, world: &World, camera_packet: &CameraPacket) {
        if let Some(projection) = world.camera.general_projection() {
            for i in 0..LANES {
                let changes = self.of_pixel(projection, camera_packet.pixel(i));
                for side in 0..2 {
                    let [origin, direction] = changes[side];
                    for axis in 0..3 {
                        self.positions[side][axis][i] = origin[axis];
                        self.directions[side][axis][i] = direction[axis];
                    }
                }
            }
            return;
        }
        let (steps, forward) = world.camera.steps();
        let [right, down] = steps.map(|step| (step * self.share).as_vec3().to_array());
        let forward = forward.as_vec3().to_array();
        self.positions = [[[0.0; LANES]; 3]; 2];
        start_side(&mut self.directions[0], right, forward, &camera_packet.packet.rays);
        start_side(&mut self.directions[1], down, forward, &camera_packet.packet.rays);
    }

    /// The changes of a pixel, computed or known.
    #[inline(always)]
    fn of_pixel(&mut self, projection: &GeneralProjection, pixel: [u32; 2]) -> Changes {
        let known = &mut self.known[(pixel[0] % 2 + 2 * (pixel[1] % 2)) as usize];
        if let Some((_, changes)) = known.filter(|(of, _)| *of == pixel) {
            return changes;
        }
        let at = pixel.map(|side| f64::from(side as i32) + 0.5);
        let share = self.share;
        let changes = projection.changes(at).map(|side| side.map(|d| (d * share).as_vec3()));
        *known = Some((pixel, changes));
        changes
    }

    /// Moves the changes of position from the origins of the rays to their hits.
    #[inline(always)]
    pub fn advance(&mut self, rays: &Rays, surfaces: &Surfaces) {
        advance_side(&mut self.positions[0], &self.directions[0], rays, surfaces);
        advance_side(&mut self.positions[1], &self.directions[1], rays, surfaces);
    }

    /// Mirrors the changes of direction at surfaces with these unit normals.
    #[inline(always)]
    pub fn reflect(&mut self, normals: &Lanes3) {
        reflect_side(&mut self.directions[0], normals);
        reflect_side(&mut self.directions[1], normals);
    }
}

/// Changes of the unit directions of camera rays. `step` is the change of the ray's point in the
/// plane at distance 1 along the unit vector `forward`.
#[inline(always)]
fn start_side(directions: &mut Lanes3, step: [f32; 3], forward: [f32; 3], rays: &Rays) {
    for i in 0..LANES {
        let [x, y, z] = [rays.dir[0][i], rays.dir[1][i], rays.dir[2][i]];
        let ahead = x * forward[0] + y * forward[1] + z * forward[2];
        let along = x * step[0] + y * step[1] + z * step[2];
        directions[0][i] = (step[0] - x * along) * ahead;
        directions[1][i] = (step[1] - y * along) * ahead;
        directions[2][i] = (step[2] - z * along) * ahead;
    }
}

/// Moves one side to the plane of the surface: Igehy's "transfer".
#[inline(always)]
fn advance_side(positions: &mut Lanes3, directions: &Lanes3, rays: &Rays, surfaces: &Surfaces) {
    for i in 0..LANES {
        let x = surfaces.position[0][i] - rays.org[0][i];
        let y = surfaces.position[1][i] - rays.org[1][i];
        let z = surfaces.position[2][i] - rays.org[2][i];
        let t = (x * x + y * y + z * z).sqrt();
        let [nx, ny, nz] = [surfaces.ng[0][i], surfaces.ng[1][i], surfaces.ng[2][i]];
        let [dx, dy, dz] = [rays.dir[0][i], rays.dir[1][i], rays.dir[2][i]];
        let cosine = nx * dx + ny * dy + nz * dz;
        let limit = MIN_COSINE.copysign(cosine);
        let cosine = if cosine.abs() > MIN_COSINE { cosine } else { limit };
        let px = positions[0][i] + directions[0][i] * t;
        let py = positions[1][i] + directions[1][i] * t;
        let pz = positions[2][i] + directions[2][i] * t;
        let along = (nx * px + ny * py + nz * pz) / cosine;
        let hit = surfaces.hit.0[i] != 0;
        positions[0][i] = if hit { px - dx * along } else { positions[0][i] };
        positions[1][i] = if hit { py - dy * along } else { positions[1][i] };
        positions[2][i] = if hit { pz - dz * along } else { positions[2][i] };
    }
}

/// Igehy's "reflection" of one side, without the curvature of the surface.
#[inline(always)]
fn reflect_side(directions: &mut Lanes3, normals: &Lanes3) {
    for i in 0..LANES {
        let [nx, ny, nz] = [normals[0][i], normals[1][i], normals[2][i]];
        let along = 2.0 * (nx * directions[0][i] + ny * directions[1][i] + nz * directions[2][i]);
        directions[0][i] -= nx * along;
        directions[1][i] -= ny * along;
        directions[2][i] -= nz * along;
    }
}
