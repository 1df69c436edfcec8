//! Cones around rays, which say how wide an area of a surface each sample stands for.
//!
//! Amanatides 1984, "Ray Tracing with Cones", SIGGRAPH. Mirrors are taken as flat.

use crate::geometry::Surfaces;
use crate::ray::LANES;
use crate::ray::Rays;
use crate::shading::{Lanes, lane};
use crate::world::World;

/// The cones of a packet's rays.
#[derive(Debug)]
pub struct Cones {
    /// Width at the camera.
    first: f32,
    /// Growth of the width with the distance.
    spread: f32,
    /// Width at the origins of the rays, then at their hits.
    pub widths: Lanes,
}

impl Cones {
    /// The cones of a world whose samples share the pixels.
    pub fn new(world: &World) -> Self {
        // Igehy 1999, "Tracing Ray Differentials"; n samples a pixel are 1/sqrt(n) pixels apart.
        let share = 1.0 / f64::from(world.spp).sqrt();
        let frame = world.frame.map(|side| side - 2 * world.overscan);
        let [first, spread] = world.camera.cone(frame).map(|width| (width * share) as f32);
        Self { first, spread, widths: [0.0; LANES] }
    }

    /// Starts at the camera.
    pub fn start(&mut self) {
        self.widths = [self.first; LANES];
    }

    /// Moves on to the hits of the rays.
    pub fn advance(&mut self, rays: &Rays, surfaces: &Surfaces) {
        for i in (0..LANES).filter(|&i| surfaces.hit.0[i] != 0) {
            let way = lane(&surfaces.position, i) - lane(&rays.org, i);
            self.widths[i] += self.spread * way.length();
        }
    }
}
