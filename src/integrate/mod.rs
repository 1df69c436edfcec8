//! One tile of the picture, packet by packet: camera rays, hits, light, mirrors, pixels.
//!
//! Packets sit on the frame's absolute pixel and sample grid and are traced whole, so that a crop
//! of the render is the render of the crop, whatever a backend does inside a packet.

mod block;
mod cast;
mod crevices;
mod joint;
mod lamp;
mod noise;
mod passes;
mod pipeline;
mod plan;
mod quarters;
mod record;
mod roulette;
mod shadows;
mod sky;
mod slot;
mod split;

use std::ops::Range;

use crate::accel::Accelerator;
use crate::film::{Dropped, Window};
use crate::monitor::Monitor;
use crate::ray::{LANES, Mask};
use crate::simd::Kernel;
use crate::world::World;

use self::block::{BlockSums, Values};
use self::cast::Cast;
pub use self::crevices::Crevices;
pub use self::noise::{Goal, Relative, Tally, rate};
pub use self::passes::{LEAST, PassKernel, Passes};
use self::pipeline::{Finish, pipeline};
pub use self::record::{Beauty, Layers, Record};
pub use self::shadows::{OWN, ShadowRays};
pub use self::slot::Pattern;

use self::sky::Sky;
use self::slot::Slot;

/// Pixels along a tile's side; a multiple of every packet's block.
pub const TILE: u32 = 32;

/// Rays traced, by class.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct RayCounts {
    /// From the camera, with those that whole squares of the picture were told of: see [`Accelerator::nothing_between`].
    pub primary: u64,
    /// Towards lights.
    pub shadow: u64,
    /// Mirror bounces.
    pub reflection: u64,
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

/// What does not change from tile to tile.
#[derive(Clone, Copy)]
pub struct Integrator<'a> {
    /// What is rendered.
    pub world: &'a World,
    /// What finds the hits.
    pub accelerator: &'a dyn Accelerator,
    /// Asks to stop.
    pub monitor: &'a Monitor,
}

/// Rendering one tile.
pub struct TileKernel<'a, 'r, 'f, R> {
    /// What does not change.
    pub integrator: Integrator<'a>,
    /// The kept pixels of this tile: all within one square of the frame's tile grid.
    pub window: Window,
    /// Their R, G, B, A, row by row.
    pub rows: &'r mut [&'f mut [[f32; 4]]],
    /// What is kept beside them: [`Beauty`] keeps nothing.
    pub record: R,
    /// The words of the kept pixels' layers, row by row.
    pub words: &'r mut [&'f mut [u32]],
    /// Which of the world's samples are taken.
    pub samples: Range<u32>,
}

impl<'a, 'r, 'f> TileKernel<'a, 'r, 'f, Beauty<'static>> {
    /// Without layers.
    pub fn beauty(
        integrator: Integrator<'a>,
        window: Window,
        rows: &'r mut [&'f mut [[f32; 4]]],
    ) -> Self {
        let samples = 0..integrator.world.spp;
        Self { integrator, window, rows, record: Beauty(None), words: &mut [], samples }
    }
}

impl<R: Record> Kernel for TileKernel<'_, '_, '_, R> {
    type Output = (RayCounts, Dropped);

    #[inline(always)]
    fn run(mut self) -> (RayCounts, Dropped) {
        let integrator = self.integrator;
        let world = integrator.world;
        let pattern = Pattern::for_spp(world.spp);
        let samples = self.samples.clone();
        let limit = limit(world, self.window);
        let (blocks, told) = self.blocks(&pattern, limit);
        let begin = samples.start / pattern.samples * pattern.samples;
        let units = blocks.iter().flat_map(|&corner| {
            (begin..samples.end).step_by(pattern.samples as usize).map(move |first| (corner, first))
        });
        let mut tile = Tile { kernel: self, sums: BlockSums::new(&pattern, 4, 0) };
        let mut counts = pipeline(integrator, &pattern, &samples, limit, units, &mut tile);
        counts.primary += told;
        (counts, tile.kernel.record.dropped())
    }
}

/// A tile, and the sums of the block that is being finished.
struct Tile<'a, 'r, 'f, R> {
    kernel: TileKernel<'a, 'r, 'f, R>,
    sums: BlockSums,
}

impl<R: Record> Finish for Tile<'_, '_, '_, R> {
    // What records keep of equals is the first.
    const ANY_ORDER: bool = !R::ON;

    #[inline(always)]
    fn finish(
        &mut self,
        slot: &mut Slot,
        pattern: &Pattern,
        cast: &mut Cast,
        counts: &mut RayCounts,
    ) {
        self.kernel.finish(slot, pattern, cast, &mut self.sums, counts);
    }
}

impl<R: Record> TileKernel<'_, '_, '_, R> {
    /// Corners of the blocks whose samples are to be taken, and how many camera rays the others have, which are
    /// written. (Once a tile: apart from the loop over packets.)
    #[inline(never)]
    fn blocks(&mut self, pattern: &Pattern, limit: [u32; 2]) -> (Vec<[u32; 2]>, u64) {
        let (world, count) = (self.integrator.world, self.samples.end - self.samples.start);
        // What is recorded, and sums to be merged, take their samples one by one.
        let mut sky = (!self.record.has_words())
            .then(|| Sky::new(world, self.integrator.accelerator, count, pattern.block));
        let mut told = 0;
        let mut blocks = Vec::with_capacity((TILE * TILE) as usize / pattern.pixels());
        for corner in corners(pattern, self.window) {
            if sky.as_mut().is_some_and(|sky| sky.has(corner)) {
                self.write_sky(corner, pattern.block);
                told += u64::from(pattern.within(limit, corner)) * u64::from(count);
            } else {
                blocks.push(corner);
            }
        }
        (blocks, told)
    }

    /// Shades a traced packet, adds it to its pixels' sums and, after the last sample, writes the
    /// pixels.
    #[inline(always)]
    fn finish(
        &mut self,
        slot: &mut Slot,
        pattern: &Pattern,
        cast: &mut Cast,
        sums: &mut BlockSums,
        counts: &mut RayCounts,
    ) {
        let (world, samples) = (self.integrator.world, self.samples.clone());
        if slot.first <= samples.start {
            sums.clear();
            self.record.begin();
        }
        let hit = cast.run(slot, counts, &mut self.record);
        let alpha = alpha(&hit, world.transparent);
        let (block, [r, g, b]) = (pattern.block, &cast.radiance);
        if world.spp == 1 && !self.record.has_words() {
            // A lane is a pixel.
            return self.write(slot.corner, block, |i| [r[i], g[i], b[i], alpha[i]]);
        }
        if R::ON {
            self.record.packet(slot, &samples, &cast.radiance);
        }
        let values = [*r, *g, *b, alpha].map(Values);
        if slot.quarter {
            sums.add_quarter(slot.first, &values);
        } else {
            sums.add(pattern, slot.first, &samples, &values, &[true; 4]);
        }
        if slot.first.saturating_add(pattern.samples) >= samples.end {
            if self.record.has_words() {
                self.write_words(slot.corner, pattern, sums);
            }
            let n = f64::from(samples.end - samples.start);
            self.write(slot.corner, block, |i| [0, 1, 2, 3].map(|c| (sums.total(i, c) / n) as f32));
        }
    }

    /// Writes the layers of a block's pixels, those that are kept.
    #[inline(always)]
    fn write_words(&mut self, [x, y]: [u32; 2], pattern: &Pattern, beauty: &BlockSums) {
        let (w, [width, height]) = (self.window, pattern.block);
        let n = self.samples.end - self.samples.start;
        for row in y.max(w.y0)..(y + height).min(w.y1) {
            for column in x.max(w.x0)..(x + width).min(w.x1) {
                let pixel = ((row - y) * width + column - x) as usize;
                let words = &mut self.words[(row - w.y0) as usize];
                self.record.write(pixel, n, beauty, (column - w.x0) as usize, words);
            }
        }
    }

    /// Writes the pixels of a block in which there is nothing: the mean of equals is one of them, exactly.
    fn write_sky(&mut self, corner: [u32; 2], block: [u32; 2]) {
        let world = self.integrator.world;
        let [r, g, b] = world.background.to_array();
        let pixel = if world.transparent { [0.0; 4] } else { [r, g, b, 1.0] };
        self.write(corner, block, |_| pixel);
    }

    /// Writes a block's pixels by their index in it, those that are kept.
    #[inline(always)]
    fn write(
        &mut self,
        [x, y]: [u32; 2],
        [width, height]: [u32; 2],
        pixel: impl Fn(usize) -> [f32; 4],
    ) {
        let w = self.window;
        if [width, height] == [4, 4] && x >= w.x0 && y >= w.y0 && x + 4 <= w.x1 && y + 4 <= w.y1 {
            // What the loop below does, for what nearly every block of single samples is.
            let left = (x - w.x0) as usize;
            for dy in 0..4 {
                let row = &mut self.rows[(y - w.y0) as usize + dy][left..];
                if let Some(kept) = row.first_chunk_mut::<4>() {
                    for dx in 0..4 {
                        kept[dx] = pixel(4 * dy + dx);
                    }
                }
            }
            return;
        }
        let (left, right) = (x.max(w.x0), (x + width).min(w.x1));
        for row in y.max(w.y0)..(y + height).min(w.y1) {
            let kept = (left - w.x0) as usize..(right - w.x0) as usize;
            let first = ((row - y) * width + left - x) as usize;
            let pixels = &mut self.rows[(row - w.y0) as usize][kept];
            for (i, kept) in pixels.iter_mut().enumerate() {
                *kept = pixel((first + i) % LANES);
            }
        }
    }
}

/// Right and bottom end, excluded, of the pixels that may share packets with those of `window`: of the camera's
/// frame if the window begins within it, else of all. So overscan changes no packet of the frame.
pub fn limit(world: &World, window: Window) -> [u32; 2] {
    let [right, bottom] = world.frame_end();
    let [width, height] = world.frame;
    [
        if window.x0 < right { right } else { width },
        if window.y0 < bottom { bottom } else { height },
    ]
}

#[inline(always)]
fn alpha(hit: &Mask, transparent: bool) -> [f32; LANES] {
    let mut alpha = [1.0; LANES];
    for i in 0..LANES {
        alpha[i] = if transparent && hit.0[i] == 0 { 0.0 } else { 1.0 };
    }
    alpha
}

/// Corners of the blocks that reach into the window, in Z-order over the window's tile.
#[inline(always)]
fn corners(pattern: &Pattern, w: Window) -> impl Iterator<Item = [u32; 2]> + use<> {
    let [bw, bh] = pattern.block;
    let (x0, y0) = (w.x0 / TILE * TILE, w.y0 / TILE * TILE);
    (0..(TILE / bw) * (TILE / bh)).map(morton).filter_map(move |[bx, by]| {
        let (x, y) = (x0 + bx * bw, y0 + by * bh);
        let reaches = x + bw > w.x0 && x < w.x1 && y + bh > w.y0 && y < w.y1;
        reaches.then_some([x, y])
    })
}

/// The position of an index along the Z-order curve of a tile.
#[inline(always)]
fn morton(index: u32) -> [u32; 2] {
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
    fn blocks_of_a_crop_are_those_of_the_frame_that_reach_into_it() {
        let pattern = Pattern::for_spp(1);
        let crop = Window { x0: 35, y0: 3, x1: 41, y1: 5 };
        let mut blocks: Vec<_> = corners(&pattern, crop).collect();
        blocks.sort_unstable();
        assert_eq!(blocks, [[32, 0], [32, 4], [36, 0], [36, 4], [40, 0], [40, 4]]);
    }
}
