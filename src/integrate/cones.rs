//! Cones around rays: their width at a hit is the width of the surface area that a sample stands
//! for.
//!
//! Amanatides 1984, "Ray Tracing with Cones", SIGGRAPH. Mirrors are taken as flat, so the growth of
//! the width does not change.

use crate::geometry::Surfaces;
use crate::ray::{LANES, Rays};
use crate::shading::Lanes;
use crate::world::World;

/// The cones of a packet's rays.
#[derive(Debug)]
pub struct Cones {
    /// Width at the camera, in world units.
    first: f32,
    /// Growth of the width per unit of distance.
    spread: f32,
    /// Width at the origins of the rays, then at their hits.
    pub widths: Lanes,
}

impl Cones {
    /// The cones of a world's camera rays. Each is narrower than its pixel, because the samples
    /// share the pixel.
    pub fn new(world: &World) -> Self {
        // Igehy 1999, "Tracing Ray Differentials"; n samples a pixel are 1/sqrt(n) pixels apart.
        let share = 1.0 / f64::from(world.cone_spp).sqrt();
        let frame = world.frame.map(|side| side - 2 * world.overscan);
        let [first, spread] = world.camera.cone(frame).map(|width| (width * share) as f32);
        Self { first, spread, widths: [0.0; LANES] }
    }

    /// Sets all widths to the width at the camera.
    pub fn start(&mut self) {
        self.widths = [self.first; LANES];
    }

    /// Grows the widths from the origins of the rays to their hits.
    #[inline(always)]
    pub fn advance(&mut self, rays: &Rays, surfaces: &Surfaces) {
        for i in 0..LANES {
            let x = surfaces.position[0][i] - rays.org[0][i];
            let y = surfaces.position[1][i] - rays.org[1][i];
            let z = surfaces.position[2][i] - rays.org[2][i];
            let grown = self.widths[i] + self.spread * (x * x + y * y + z * z).sqrt();
            self.widths[i] = if surfaces.hit.0[i] != 0 { grown } else { self.widths[i] };
        }
    }
}
