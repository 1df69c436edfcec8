//! Finds blocks of pixels whose camera rays all miss, without tracing them.

use crate::accel::Accelerator;
use crate::ray::{Mask, Rays};
use crate::shading::set_lane;
use crate::world::World;

use super::tile_grid::{LEVELS, TILE};

/// Fewest camera rays in a square for which a query pays off.
const MIN_RAYS: u64 = 1024;

/// Empty squares of the picture. Keeps the result of the last query for each square size.
pub struct EmptyBlocks<'a> {
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
    empty: bool,
}

impl<'a> EmptyBlocks<'a> {
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
        let squares = [Square { corner: [u32::MAX; 2], empty: false }; LEVELS];
        Self { world, accelerator, levels, squares }
    }

    /// Returns true only if no camera ray of the block at `corner` hits anything. Conservative: may
    /// return false for an empty block.
    pub fn has(&mut self, corner: [u32; 2]) -> bool {
        for level in 0..self.levels {
            let side = TILE >> level;
            let corner = corner.map(|x| x / side * side);
            if self.squares[level].corner != corner {
                let Some(empty) = self.query(corner, side) else {
                    self.levels = 0;
                    return false;
                };
                self.squares[level] = Square { corner, empty };
            }
            if self.squares[level].empty {
                return true;
            }
        }
        false
    }

    /// [`EmptyBlocks::has`] for one square. `None` if the backend has no such query.
    fn query(&self, [x, y]: [u32; 2], side: u32) -> Option<bool> {
        let at = |pixel: u32| pixel.wrapping_sub(self.world.overscan) as i32 as f32;
        let mut rays = Rays::EMPTY;
        let mut active = Mask::NONE;
        for (i, [dx, dy]) in [[0, 0], [side, 0], [0, side], [side, side]].into_iter().enumerate() {
            let (origin, direction) = self.world.camera.pinhole_ray(at(x + dx), at(y + dy));
            set_lane(&mut rays.org, i, origin);
            set_lane(&mut rays.dir, i, direction);
            active.0[i] = -1;
        }
        self.accelerator.is_cone_empty(&active, &rays)
    }
}
