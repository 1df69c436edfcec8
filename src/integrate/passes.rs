//! Adaptive sampling of a rectangle of pixels: each pixel has its own number of samples, taken in
//! passes.
//!
//! A packet is one pixel x 16 samples, as in a plain render of 16 samples or more. A pass continues
//! the sums of the pass before, in their fixed order. So a pixel with n samples has the bits of a
//! plain render with n samples.

use std::ops::Range;

use crate::film::Window;
use crate::ray::LANES;
use crate::simd::Kernel;

use super::block::{BlockSums, Values};
use super::camera_packet::{CameraPacket, Pattern};
use super::noise::{Goal, PixelSamples};
use super::pipeline::{Block, ShadePacket, pipeline};
use super::plan::{Errors, SamplePlan};
use super::record::Record;
use super::render_context::{RayCounts, RenderContext};
use super::sights::{Sight, Sights};
use super::tile_grid::{morton, packet_end};
use super::whitted::WhittedIntegrator;

/// Fewest samples that a pass takes of a pixel; a pass takes a multiple of it.
pub const MIN_PASS_SAMPLES: u32 = LANES as u32;

/// All sample indices: passes take whole packets, so no sample is excluded.
const ALL: Range<u32> = 0..u32::MAX;

/// The pixels of a rectangle, with the samples that they have so far.
#[derive(Debug)]
pub struct Passes<H> {
    window: Window,
    /// Tallies of the pixels, row by row.
    pub tallies: Vec<PixelSamples>,
    held: Vec<H>,
    errors: Errors,
    decided: Decided,
}

/// How far the numbers of samples are decided.
#[derive(Debug)]
enum Decided {
    /// Only the first pass, which has the same number for all pixels.
    Nothing,
    /// The first plan; the second is not made yet.
    First(SamplePlan),
    /// Both plans: nothing is left to decide.
    All,
}

impl<H> Passes<H> {
    /// Creates pixels without samples; the first pass takes `first` of each.
    pub fn new(window: Window, first: u32, held: impl Fn() -> H) -> Self {
        let count = (window.width() * window.height()) as usize;
        let tally =
            PixelSamples { wanted: first, aim: first, plan: first, ..PixelSamples::default() };
        let held = (0..count).map(|_| held()).collect();
        let errors = Errors::new(window.width() as usize, first);
        Self { window, tallies: vec![tally; count], held, errors, decided: Decided::Nothing }
    }

    /// Starts the next doubling; called when all pixels have reached their `aim`. Each pixel below
    /// its plan gets twice its samples. Returns true if there are such pixels.
    pub fn choose(&mut self, goal: &Goal) -> bool {
        let count = self.tallies.len();
        if !matches!(self.decided, Decided::All) {
            for (at, tally) in self.tallies.iter().enumerate() {
                self.errors.set(at, count, tally.taken, tally.error(goal));
            }
        }
        loop {
            let mut any = false;
            for tally in &mut self.tallies {
                let more = tally.taken < tally.plan;
                tally.aim = if more { 2 * tally.taken } else { tally.taken };
                tally.wanted = tally.aim;
                any |= more;
            }
            if any || !self.decide(goal) {
                return any;
            }
        }
    }

    /// Makes the next plan. Returns false if both are made.
    fn decide(&mut self, goal: &Goal) -> bool {
        let first = match std::mem::replace(&mut self.decided, Decided::All) {
            Decided::Nothing => None,
            Decided::First(plan) => Some(plan),
            Decided::All => return false,
        };
        let set = |tallies: &mut [PixelSamples], plan: &[u32]| {
            tallies.iter_mut().zip(plan).for_each(|(tally, &plan)| tally.plan = plan);
        };
        match first {
            Some(first) => set(&mut self.tallies, &self.errors.second_plan(goal, &first)),
            None => {
                let first = self.errors.first_plan(goal);
                set(&mut self.tallies, &first.samples);
                self.decided = Decided::First(first);
            }
        }
        true
    }

    /// Number of samples that the next pass takes, over all pixels.
    pub fn wanted(&self) -> u64 {
        self.tallies.iter().map(|tally| u64::from(tally.wanted - tally.taken)).sum()
    }

    /// Sets the aim of the next doubling: twice the samples for all pixels with fewer than `most`.
    pub fn double(&mut self, most: u32) {
        for tally in &mut self.tallies {
            tally.aim = if tally.taken < most { 2 * tally.taken } else { tally.taken };
        }
    }

    /// Sets the samples that the next pass takes of each pixel. With a `shift` of 0 it takes the
    /// whole doubling, with 1 half of it, with 2 a quarter, and so on. A pixel takes none if that
    /// is less than [`MIN_PASS_SAMPLES`]. A run whose length is a power of two is stratified if it
    /// begins at a multiple of that length.
    pub fn want(&mut self, shift: u32) {
        for tally in &mut self.tallies {
            let step = (tally.aim / 2).checked_shr(shift).unwrap_or(0);
            let more = tally.taken < tally.aim && step >= MIN_PASS_SAMPLES;
            tally.wanted = if more { tally.aim.min(tally.taken + step) } else { tally.taken };
        }
    }

    /// Number of samples of each pixel of `kept`.
    pub fn taken(&self, kept: Window) -> impl Iterator<Item = u32> + Clone {
        let rows = (kept.y0..kept.y1).flat_map(move |y| (kept.x0..kept.x1).map(move |x| [x, y]));
        rows.map(|pixel| self.tallies[self.index(pixel)].taken)
    }

    fn index(&self, [x, y]: [u32; 2]) -> usize {
        ((y - self.window.y0) * self.window.width() + x - self.window.x0) as usize
    }

    /// Writes the pixels of `kept`, a part of the rectangle, into `rows`, and their layers into
    /// `words`.
    pub fn write<R: Record<Held = H>>(
        &mut self,
        kept: Window,
        rows: &mut [&mut [[f32; 4]]],
        words: &mut [&mut [u32]],
        record: &mut R,
    ) {
        let none = BlockSums::new(&Pattern::for_spp(MIN_PASS_SAMPLES), 0, 0);
        for (row, y) in (kept.y0..kept.y1).enumerate() {
            for (column, x) in (kept.x0..kept.x1).enumerate() {
                let index = self.index([x, y]);
                let PixelSamples { sum, taken, .. } = self.tallies[index];
                rows[row][column] = sum.map(|sum| (sum / f64::from(taken)) as f32);
                if record.has_words() {
                    record.exchange(&mut self.held[index]);
                    // Without channels there are no rows.
                    let words = words.get_mut(row).map_or(&mut [][..], |words| words);
                    record.write(0, taken, &none, column, words);
                    record.exchange(&mut self.held[index]);
                }
            }
        }
    }
}

/// Runs one pass: takes the wanted samples of every pixel.
pub struct PassKernel<'a, 'p, R: Record> {
    /// Scene, backend and monitor.
    pub context: RenderContext<'a>,
    /// The pixels to sample.
    pub passes: &'p mut Passes<R::Held>,
    /// Records the layers of the pixels.
    pub record: &'p mut R,
}

impl<R: Record> Kernel for PassKernel<'_, '_, R> {
    type Output = RayCounts;

    #[inline(always)]
    fn run(self) -> RayCounts {
        let pattern = Pattern::for_spp(MIN_PASS_SAMPLES);
        let passes = &self.passes;
        let w = passes.window;
        let packet_end = packet_end(self.context.world, w);
        let side = w.width().max(w.height()).next_power_of_two();
        let pixels =
            (0..side * side).map(morton).filter(|[x, y]| *x < w.width() && *y < w.height());
        // Later passes sample few pixels of a square. Layers need traced hits.
        let first = !R::ON && passes.tallies.iter().all(|tally| tally.taken == 0);
        let mut sights = first.then(|| {
            let RenderContext { world, accelerator, .. } = self.context;
            Sights::new(world, accelerator, MIN_PASS_SAMPLES, pattern.block)
        });
        let todo: Vec<(Block, Range<u32>)> = pixels
            .map(|[x, y]| {
                let corner = [w.x0 + x, w.y0 + y];
                let tally = &passes.tallies[passes.index(corner)];
                let sight = sights.as_mut().map_or(Sight::Any, |sights| sights.sight(corner));
                (Block { corner, sight }, tally.taken..tally.wanted)
            })
            .collect();
        let units = todo.iter().flat_map(|(block, samples)| {
            samples.clone().step_by(MIN_PASS_SAMPLES as usize).map(move |first| (block, first))
        });
        let mut pass =
            Pass { passes: self.passes, record: self.record, sums: BlockSums::new(&pattern, 4, 0) };
        pipeline(self.context, &pattern, &ALL, packet_end, units, &mut pass)
    }
}

struct Pass<'p, R: Record> {
    passes: &'p mut Passes<R::Held>,
    record: &'p mut R,
    /// Sums of the current pixel over this pass.
    sums: BlockSums,
}

impl<R: Record> ShadePacket for Pass<'_, R> {
    const ANY_ORDER: bool = false;

    #[inline(always)]
    fn finish(
        &mut self,
        camera_packet: &mut CameraPacket,
        pattern: &Pattern,
        integrator: &mut WhittedIntegrator,
        counts: &mut RayCounts,
    ) {
        let index = self.passes.index(camera_packet.corner);
        let tally = &mut self.passes.tallies[index];
        let held = &mut self.passes.held[index];
        if camera_packet.first == tally.taken {
            self.record.exchange(held);
            self.sums.clear();
            tally.half = [0.0; 4];
        }
        let alpha = integrator.shade(camera_packet, counts, self.record);
        if R::ON {
            self.record.packet(camera_packet, &ALL, &integrator.radiance);
        }
        let [r, g, b] = &integrator.radiance;
        let lanes = [*r, *g, *b, alpha].map(Values);
        self.sums.add(pattern, camera_packet.first, &ALL, &lanes, &[true; 4]);
        for (half, Values(lanes)) in tally.half.iter_mut().zip(&lanes) {
            for i in 0..LANES {
                let second = u64::from(camera_packet.sample[i]) * 2 >= u64::from(tally.wanted);
                *half += if second { f64::from(lanes[i]) } else { 0.0 };
            }
        }
        if camera_packet.first + MIN_PASS_SAMPLES >= tally.wanted {
            for (channel, sum) in tally.sum.iter_mut().enumerate() {
                *sum += self.sums.total(0, channel);
            }
            tally.taken = tally.wanted;
            self.record.exchange(held);
        }
    }
}
