//! Parts of the picture in which there is nothing, told without tracing their samples.

use crate::accel::Accelerator;
use crate::ray::{Mask, Rays};
use crate::shading::set_lane;
use crate::world::World;

use super::TILE;

/// Pixels along the side of the squares that are asked for where the tile is not empty.
const SIDE: u32 = 8;

/// What is known of the squares that were asked for last.
pub struct Sky<'a> {
    world: &'a World,
    accelerator: &'a dyn Accelerator,
    /// A pinhole's rays leave one point.
    on: bool,
    tile: Square,
    part: Square,
}

/// A square of the frame's grid.
#[derive(Clone, Copy)]
struct Square {
    side: u32,
    corner: [u32; 2],
    empty: bool,
}

impl Square {
    /// None yet.
    const fn of(side: u32) -> Self {
        Self { side, corner: [u32::MAX; 2], empty: false }
    }
}

impl<'a> Sky<'a> {
    /// For the pixels of a world.
    pub fn new(world: &'a World, accelerator: &'a dyn Accelerator) -> Self {
        let on = !world.camera.has_lens();
        Self { world, accelerator, on, tile: Square::of(TILE), part: Square::of(SIDE) }
    }

    /// Whether for sure no camera ray of the block at `corner` meets anything; it lies within a square.
    pub fn has(&mut self, corner: [u32; 2]) -> bool {
        if !self.on {
            return false;
        }
        self.tile = self.ask(self.tile, corner);
        if self.tile.empty {
            return true;
        }
        self.part = self.ask(self.part, corner);
        self.part.empty
    }

    /// The square of the same side with a pixel in it.
    fn ask(&self, square: Square, pixel: [u32; 2]) -> Square {
        let side = square.side;
        let corner = pixel.map(|x| x / side * side);
        if square.corner == corner {
            return square;
        }
        let mut rays = Rays::EMPTY;
        let mut active = Mask::NONE;
        for (i, [dx, dy]) in [[0, 0], [side, 0], [0, side], [side, side]].into_iter().enumerate() {
            let at = |x: u32, d: u32| (x + d).wrapping_sub(self.world.margin) as i32 as f32;
            let (origin, direction) =
                self.world.camera.pinhole_ray(at(corner[0], dx), at(corner[1], dy));
            set_lane(&mut rays.org, i, origin);
            set_lane(&mut rays.dir, i, direction);
            active.0[i] = -1;
        }
        Square { side, corner, empty: self.accelerator.nothing_between(&active, &rays) }
    }
}
