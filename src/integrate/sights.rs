//! Finds blocks of pixels whose camera rays all miss, or all hit one triangle, without tracing
//! them.

use crate::accel::{Accelerator, Cone};
use crate::ray::{Mask, Rays};
use crate::shading::{lane, set_lane};
use crate::world::World;

use super::sole_triangle::SoleTriangle;
use super::tile_grid::{LEVELS, TILE};

/// Fewest camera rays in a square for which a query pays off.
const MIN_RAYS: u64 = 1024;

/// What the camera rays of a block can hit.
#[derive(Debug, Clone, Copy)]
pub enum Sight {
    /// Nothing.
    Background,
    /// Nothing but this triangle, and all of them hit it.
    Sole(SoleTriangle),
    /// Anything.
    Any,
}

/// Squares of the picture that show nothing or one triangle. Keeps the result of the last query for
/// each square size.
pub struct Sights<'a> {
    world: &'a World,
    accelerator: &'a dyn Accelerator,
    /// Number of square sizes, from the largest, that are worth a query.
    levels: usize,
    squares: [Square; LEVELS],
}

/// A square of the frame's grid.
#[derive(Clone, Copy)]
struct Square {
    corner: [u32; 2],
    sight: Sight,
}

impl<'a> Sights<'a> {
    /// Creates an empty cache for blocks of `block` pixels (width, height), with `samples` samples
    /// per pixel.
    pub fn new(
        world: &'a World,
        accelerator: &'a dyn Accelerator,
        samples: u32,
        block: [u32; 2],
    ) -> Self {
        let worth = |level: &usize| {
            let side = TILE >> level;
            let rays = u64::from(side * side) * u64::from(samples);
            side >= block[0].max(block[1]) && rays >= MIN_RAYS
        };
        // The rays of a lens have no common origin. Rays of a general projection may leave the
        // corners' frustum.
        let cone = !world.camera.has_lens() && world.camera.general_projection().is_none();
        // A visible environment map differs from pixel to pixel.
        let even = world.visible_environments.is_empty() || world.transparent;
        let levels = if cone && even { (0..LEVELS).filter(worth).count() } else { 0 };
        // No query was made yet.
        let squares = [Square { corner: [u32::MAX; 2], sight: Sight::Any }; LEVELS];
        Self { world, accelerator, levels, squares }
    }

    /// What the camera rays of the block at `corner` can hit. Conservative: may return more.
    pub fn sight(&mut self, corner: [u32; 2]) -> Sight {
        for level in 0..self.levels {
            let side = TILE >> level;
            let corner = corner.map(|x| x / side * side);
            if self.squares[level].corner != corner {
                let Some(sight) = self.query(corner, side) else {
                    self.levels = 0;
                    return Sight::Any;
                };
                self.squares[level] = Square { corner, sight };
            }
            let sight = self.squares[level].sight;
            if !matches!(sight, Sight::Any) {
                return sight;
            }
        }
        Sight::Any
    }

    /// [`Sights::sight`] for one square. `None` if the backend has no such query.
    fn query(&self, [x, y]: [u32; 2], side: u32) -> Option<Sight> {
        let at = |pixel: u32| pixel.wrapping_sub(self.world.overscan) as i32 as f32;
        let mut rays = Rays::EMPTY;
        let mut active = Mask::NONE;
        for (i, [dx, dy]) in [[0, 0], [side, 0], [0, side], [side, side]].into_iter().enumerate() {
            let (origin, direction) = self.world.camera.pinhole_ray(at(x + dx), at(y + dy));
            set_lane(&mut rays.org, i, origin);
            set_lane(&mut rays.dir, i, direction);
            active.0[i] = -1;
        }
        Some(match self.accelerator.cone(&active, &rays)? {
            Cone::Empty => Sight::Background,
            Cone::Primitive(primitive) => {
                let origin = lane(&rays.org, 0).as_dvec3();
                let directions = [0, 1, 2, 3].map(|i| lane(&rays.dir, i).as_dvec3());
                SoleTriangle::new(&self.world.geometry, primitive, origin, directions)
                    .map_or(Sight::Any, Sight::Sole)
            }
            Cone::Any => Sight::Any,
        })
    }
}
