//! What all tiles of a render share, and the counts that each returns.

use serde::Serialize;

use crate::accel::Accelerator;
use crate::monitor::Monitor;
use crate::simd::Isa;
use crate::world::World;

/// Number of rays traced, by class.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize)]
pub struct RayCounts {
    /// Camera rays, including the rays of blocks that show nothing or one triangle, which are not
    /// traced: see [`Accelerator::cone`].
    pub primary: u64,
    /// Shadow rays, from surfaces to lights, including the rays of empty shafts, which are not
    /// traced: see [`Accelerator::is_shaft_empty`].
    pub shadow: u64,
    /// Rays of mirror bounces.
    pub reflection: u64,
}

impl RayCounts {
    /// Number of rays of all classes.
    pub fn all(&self) -> u64 {
        self.primary + self.shadow + self.reflection
    }
}

impl std::ops::Add for RayCounts {
    type Output = Self;
    fn add(self, other: Self) -> Self {
        Self {
            primary: self.primary + other.primary,
            shadow: self.shadow + other.shadow,
            reflection: self.reflection + other.reflection,
        }
    }
}

/// The parts of a render that are the same for all tiles.
#[derive(Clone, Copy)]
pub struct RenderContext<'a> {
    /// The scene that is rendered.
    pub world: &'a World,
    /// Backend that finds the hits.
    pub accelerator: &'a dyn Accelerator,
    /// Instruction set of the shading.
    pub isa: Isa,
    /// Progress and the request to stop.
    pub monitor: &'a Monitor,
}
