//! The frame's absolute grid of tiles, and the order of the blocks of pixels in a tile.

use super::camera_packet::Pattern;
use crate::film::Window;
use crate::world::World;

/// Side of a tile in pixels; a multiple of every packet's block.
pub const TILE: u32 = 32;

/// Number of nested square sizes: a tile, its quarters, and so on down to pixels.
pub const LEVELS: usize = TILE.ilog2() as usize + 1;

/// Right and bottom end (exclusive) of the pixels that may share packets with the pixels of
/// `window`. On each axis, that is the end of the camera's frame if the window begins before that
/// end, else the end of the overscan. So overscan changes no packet of the frame: on the left and
/// at the top, its width is a multiple of [`TILE`].
pub fn packet_end(world: &World, window: Window) -> [u32; 2] {
    let [right, bottom] = world.frame_end();
    let [width, height] = world.frame;
    [
        if window.x0 < right { right } else { width },
        if window.y0 < bottom { bottom } else { height },
    ]
}

/// Top left corners of the blocks that overlap the window, in Z-order. The window must lie in one
/// tile.
#[inline(always)]
pub fn corners(pattern: &Pattern, w: Window) -> impl Iterator<Item = [u32; 2]> + use<> {
    let [bw, bh] = pattern.block;
    let (x0, y0) = (w.x0 / TILE * TILE, w.y0 / TILE * TILE);
    (0..(TILE / bw) * (TILE / bh)).map(morton).filter_map(move |[bx, by]| {
        let (x, y) = (x0 + bx * bw, y0 + by * bh);
        let reaches = x + bw > w.x0 && x < w.x1 && y + bh > w.y0 && y < w.y1;
        reaches.then_some([x, y])
    })
}

/// Column and row of `index`, below 2^16, on the Z-order curve of a tile.
#[inline(always)]
pub fn morton(index: u32) -> [u32; 2] {
    let even = |mut bits: u32| {
        bits &= 0x5555_5555;
        bits = (bits | (bits >> 1)) & 0x3333_3333;
        bits = (bits | (bits >> 2)) & 0x0f0f_0f0f;
        (bits | (bits >> 4)) & 0x00ff_00ff
    };
    [even(index), even(index >> 1)]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn z_order_visits_every_block_once() {
        let mut seen = [[false; 8]; 8];
        for index in 0..64 {
            let [x, y] = morton(index);
            assert!(!std::mem::replace(&mut seen[y as usize][x as usize], true));
        }
        assert_eq!([morton(1), morton(2), morton(3)], [[1, 0], [0, 1], [1, 1]]);
    }

    #[test]
    fn a_crop_has_the_blocks_of_the_frame_that_overlap_it() {
        let pattern = Pattern::for_spp(1);
        let crop = Window { x0: 35, y0: 3, x1: 41, y1: 5 };
        let mut blocks: Vec<_> = corners(&pattern, crop).collect();
        blocks.sort_unstable();
        assert_eq!(blocks, [[32, 0], [32, 4], [36, 0], [36, 4], [40, 0], [40, 4]]);
    }
}
