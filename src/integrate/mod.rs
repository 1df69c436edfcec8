//! Renders one tile, packet by packet: camera rays, hits, shading, mirror bounces, pixels.
//!
//! Packets lie on the frame's absolute grid of pixels and samples and are traced whole. So a crop
//! of the render equals the render of the crop, whatever a backend does inside a packet.

mod adaptive_shadows;
mod area_light;
mod background;
mod block;
mod camera_packet;
mod catchers;
mod clear_squares;
mod crevices;
mod differentials;
mod drawn_lights;
mod expectation;
mod joint;
mod layers;
mod light_batch;
mod light_shafts;
mod light_sums;
mod noise;
mod passes;
mod pipeline;
mod plan;
mod plate;
mod quarters;
mod record;
mod render_context;
mod sampled_light;
mod shadows;
mod sights;
mod skips;
mod sole_triangle;
mod split;
mod tile_grid;
mod whitted;

use std::ops::Range;

use crate::film::{Dropped, Window};
use crate::ray::LANES;
use crate::simd::Kernel;

use self::block::{BlockSums, Values};
pub use self::camera_packet::Pattern;
pub use self::crevices::Crevices;
pub use self::layers::Layers;
pub use self::noise::{Goal, PixelSamples, Relative, rate};
pub use self::passes::{MIN_PASS_SAMPLES, PassKernel, Passes};
use self::pipeline::{Block, ShadePacket, pipeline};
pub use self::record::{Beauty, Record};
pub use self::render_context::{RayCounts, RenderContext};
pub use self::shadows::{OWN_LANES, ShadowRays};
pub use self::tile_grid::{TILE, packet_end};
use self::whitted::WhittedIntegrator;

use self::camera_packet::CameraPacket;
use self::sights::{Sight, Sights};
use self::tile_grid::corners;

/// Renders one tile into its rows.
pub struct TileKernel<'a, 'r, 'f, R> {
    /// Scene, backend and monitor.
    pub context: RenderContext<'a>,
    /// The kept pixels of this tile, all within one square of the frame's tile grid.
    pub window: Window,
    /// R, G, B, A of the kept pixels, row by row.
    pub rows: &'r mut [&'f mut [[f32; 4]]],
    /// Records the layers; [`Beauty`] records none.
    pub record: R,
    /// Layers of the kept pixels as 32-bit words, row by row.
    pub words: &'r mut [&'f mut [u32]],
    /// Range of the world's samples that this render takes.
    pub samples: Range<u32>,
}

impl<'a, 'r, 'f> TileKernel<'a, 'r, 'f, Beauty<'static>> {
    /// A kernel without layers, for all samples of the world.
    pub fn beauty(
        context: RenderContext<'a>,
        window: Window,
        rows: &'r mut [&'f mut [[f32; 4]]],
    ) -> Self {
        let samples = 0..context.world.spp;
        Self { context, window, rows, record: Beauty(None), words: &mut [], samples }
    }
}

impl<R: Record> Kernel for TileKernel<'_, '_, '_, R> {
    type Output = (RayCounts, Dropped);

    #[inline(always)]
    fn run(mut self) -> (RayCounts, Dropped) {
        let context = self.context;
        let world = context.world;
        let pattern = Pattern::for_spp(world.spp);
        let samples = self.samples.clone();
        let packet_end = packet_end(world, self.window);
        let (blocks, background_rays) = self.blocks(&pattern, packet_end);
        let begin = samples.start / pattern.samples * pattern.samples;
        let units = blocks.iter().flat_map(|block| {
            (begin..samples.end).step_by(pattern.samples as usize).map(move |first| (block, first))
        });
        let mut tile = ShadedTile { kernel: self, sums: BlockSums::new(&pattern, 4, 0) };
        let mut counts = pipeline(context, &pattern, &samples, packet_end, units, &mut tile);
        counts.primary += background_rays;
        (counts, tile.kernel.record.dropped())
    }
}

/// A tile, and the sums of its current block.
struct ShadedTile<'a, 'r, 'f, R> {
    kernel: TileKernel<'a, 'r, 'f, R>,
    sums: BlockSums,
}

impl<R: Record> ShadePacket for ShadedTile<'_, '_, '_, R> {
    // A record keeps the first of equally near samples, so its samples must come in order.
    const ANY_ORDER: bool = !R::ON;

    #[inline(always)]
    fn finish(
        &mut self,
        camera_packet: &mut CameraPacket,
        pattern: &Pattern,
        integrator: &mut WhittedIntegrator,
        counts: &mut RayCounts,
    ) {
        self.kernel.finish(camera_packet, pattern, integrator, &mut self.sums, counts);
    }
}

impl<R: Record> TileKernel<'_, '_, '_, R> {
    /// Writes the blocks whose camera rays all miss, as background. Returns all other blocks, and
    /// the number of camera rays of the written blocks. Called once per tile, outside the loop over
    /// packets.
    #[inline(never)]
    fn blocks(&mut self, pattern: &Pattern, packet_end: [u32; 2]) -> (Vec<Block>, u64) {
        let (world, count) = (self.context.world, self.samples.end - self.samples.start);
        // Layers, and sums that will be merged, need every sample of a pixel.
        let mut sky = (!self.record.has_words())
            .then(|| Sights::new(world, self.context.accelerator, count, pattern.block));
        let mut background_rays = 0;
        let mut blocks = Vec::with_capacity((TILE * TILE) as usize / pattern.pixels());
        for corner in corners(pattern, self.window) {
            let sight = sky.as_mut().map_or(Sight::Any, |sky| sky.sight(corner));
            match sight {
                Sight::Background => {
                    self.write_sky(corner, pattern.block);
                    let rays = u64::from(pattern.within(packet_end, corner)) * u64::from(count);
                    background_rays += rays;
                }
                Sight::Sole(_) | Sight::Any => blocks.push(Block { corner, sight }),
            }
        }
        (blocks, background_rays)
    }

    /// Shades a traced packet and adds it to its pixels' sums. Writes the pixels after the last
    /// sample.
    #[inline(always)]
    fn finish(
        &mut self,
        camera_packet: &mut CameraPacket,
        pattern: &Pattern,
        integrator: &mut WhittedIntegrator,
        sums: &mut BlockSums,
        counts: &mut RayCounts,
    ) {
        let (world, samples) = (self.context.world, self.samples.clone());
        if camera_packet.first <= samples.start {
            sums.clear();
            self.record.begin();
        }
        let alpha = integrator.shade(camera_packet, counts, &mut self.record);
        let (block, [r, g, b]) = (pattern.block, &integrator.radiance);
        if world.spp == 1 && !self.record.has_words() {
            // Each lane is one pixel.
            return self.write(camera_packet.corner, block, |i| [r[i], g[i], b[i], alpha[i]]);
        }
        if R::ON {
            self.record.packet(camera_packet, &samples, &integrator.radiance);
        }
        let values = [*r, *g, *b, alpha].map(Values);
        if camera_packet.quarter {
            sums.add_quarter(camera_packet.first, &values);
        } else {
            sums.add(pattern, camera_packet.first, &samples, &values, &[true; 4]);
        }
        if camera_packet.first.saturating_add(pattern.samples) >= samples.end {
            if self.record.has_words() {
                self.write_words(camera_packet.corner, pattern, sums);
            }
            let n = f64::from(samples.end - samples.start);
            self.write(camera_packet.corner, block, |i| {
                [0, 1, 2, 3].map(|c| (sums.total(i, c) / n) as f32)
            });
        }
    }

    /// Writes the layers of a block's kept pixels.
    #[inline(always)]
    fn write_words(&mut self, [x, y]: [u32; 2], pattern: &Pattern, beauty: &BlockSums) {
        let (w, [width, height]) = (self.window, pattern.block);
        let n = self.samples.end - self.samples.start;
        for row in y.max(w.y0)..(y + height).min(w.y1) {
            for column in x.max(w.x0)..(x + width).min(w.x1) {
                let pixel = ((row - y) * width + column - x) as usize;
                // Without channels there are no rows.
                let words = self.words.get_mut((row - w.y0) as usize);
                let words: &mut [u32] = words.map_or(&mut [], |words| words);
                self.record.write(pixel, n, beauty, (column - w.x0) as usize, words);
            }
        }
    }

    /// Writes the pixels of a block as background. One value is enough: the mean of equal samples
    /// is exactly that value.
    fn write_sky(&mut self, corner: [u32; 2], block: [u32; 2]) {
        let world = self.context.world;
        let [r, g, b] = world.background.to_array();
        let pixel = if world.transparent { [0.0; 4] } else { [r, g, b, 1.0] };
        self.write(corner, block, |_| pixel);
    }

    /// Writes the kept pixels of a block. `pixel` gives the value by index in the block.
    #[inline(always)]
    fn write(
        &mut self,
        [x, y]: [u32; 2],
        [width, height]: [u32; 2],
        pixel: impl Fn(usize) -> [f32; 4],
    ) {
        let w = self.window;
        if [width, height] == [4, 4] && x >= w.x0 && y >= w.y0 && x + 4 <= w.x1 && y + 4 <= w.y1 {
            // The same as the loop below, for a whole 4 x 4 block: nearly every block of a render
            // with one sample per pixel.
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
