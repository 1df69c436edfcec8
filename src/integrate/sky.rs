//! Parts of the picture in which there is nothing, told without tracing their samples.

use crate::accel::Accelerator;
use crate::ray::{Mask, Rays};
use crate::shading::set_lane;
use crate::world::World;

use super::TILE;

/// What asking for a square costs pays off where it holds so many camera rays.
const WORTH: u64 = 1024;

/// Squares within one another: a tile, quarters of tiles, and so on down to pixels.
const LEVELS: usize = TILE.ilog2() as usize + 1;

/// What is known of the squares that were asked for last.
pub struct Sky<'a> {
    world: &'a World,
    accelerator: &'a dyn Accelerator,
    /// How many levels are worth asking for.
    levels: usize,
    squares: [Square; LEVELS],
}

/// A square of the frame's grid.
#[derive(Clone, Copy)]
struct Square {
    corner: [u32; 2],
    empty: bool,
}

impl<'a> Sky<'a> {
    /// For blocks of pixels of so many samples each, whose sides are `block` at least.
    pub fn new(
        world: &'a World,
        accelerator: &'a dyn Accelerator,
        samples: u32,
        block: [u32; 2],
    ) -> Self {
        let worth = |level: &usize| {
            let side = TILE >> level;
            let rays = u64::from(side * side) * u64::from(samples);
            side >= block[0].max(block[1]) && rays >= WORTH
        };
        // Only a pinhole's rays leave one point.
        let levels = if world.camera.has_lens() { 0 } else { (0..LEVELS).filter(worth).count() };
        // None yet.
        let squares = [Square { corner: [u32::MAX; 2], empty: false }; LEVELS];
        Self { world, accelerator, levels, squares }
    }

    /// Whether for sure no camera ray of the block at `corner` meets anything.
    pub fn has(&mut self, corner: [u32; 2]) -> bool {
        for level in 0..self.levels {
            let side = TILE >> level;
            let corner = corner.map(|x| x / side * side);
            if self.squares[level].corner != corner {
                let Some(empty) = self.ask(corner, side) else {
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

    /// Whether for sure no camera ray of the square at `corner` meets anything; `None` if nobody can tell.
    fn ask(&self, [x, y]: [u32; 2], side: u32) -> Option<bool> {
        let at = |pixel: u32| pixel.wrapping_sub(self.world.margin) as i32 as f32;
        let mut rays = Rays::EMPTY;
        let mut active = Mask::NONE;
        for (i, [dx, dy]) in [[0, 0], [side, 0], [0, side], [side, side]].into_iter().enumerate() {
            let (origin, direction) = self.world.camera.pinhole_ray(at(x + dx), at(y + dy));
            set_lane(&mut rays.org, i, origin);
            set_lane(&mut rays.dir, i, direction);
            active.0[i] = -1;
        }
        self.accelerator.nothing_between(&active, &rays)
    }
}
