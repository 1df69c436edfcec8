//! Adaptive sampling: more samples where the error is large, until the error is small enough or the
//! time limit is reached.
//!
//! With a noise target, the number of a pixel's samples depends on the other pixels of its tile and
//! on the brightness of the whole frame. Where a crop cuts a tile, the whole tile is sampled. So
//! threads and crops make no difference; only a time limit does. The number of a
//! pixel's samples does not depend on these samples, so their mean is unbiased.

use std::sync::atomic::Ordering::Relaxed;
use std::time::{Duration, Instant};

use serde::Serialize;

use super::tiles::{Tile, tiles};
use crate::error::Result;
use crate::film::{Dropped, Film, Planes, Window};
use crate::integrate::{
    Beauty, Goal, Layers, MIN_PASS_SAMPLES, PassKernel, Passes, PixelSamples, RayCounts, Record,
    Relative, RenderContext, TILE, packet_end, rate,
};
use crate::layers::LayerPlan;
use crate::monitor::{Monitor, Phase};
use crate::parallel;
use crate::sampler::independent_seed;
use crate::simd;
use crate::world::World;

/// Approximate largest number of probes, and the least distance between them in pixels. A probe is
/// a pixel that samples the frame's brightness.
const PROBES: f64 = 1024.0;
const PROBE_DISTANCE: u32 = 4;

/// Estimated heap memory of one pixel's layers, their sums excluded, in bytes.
const HELD_BYTES: usize = 256;

/// Memory of one pixel's first plan in bytes: a number of samples, and sums over its neighbours.
const PLAN_BYTES: usize = 36;

/// Settings of adaptive sampling. The world's `spp` must equal `most`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Adaptive {
    /// Samples of every pixel in the first pass: a power of two, at least [`MIN_PASS_SAMPLES`].
    pub first: u32,
    /// Largest number of samples of a pixel: a power of two.
    pub most: u32,
    /// Relative standard error at which a pixel needs no more samples.
    pub noise: Option<f64>,
    /// Radiance that `noise` is relative to.
    pub relative: Relative,
    /// Time limit: no pass begins that is expected to end later. The first pass is always taken.
    pub time: Option<Duration>,
}

impl Adaptive {
    /// Returns the bytes per pixel that are kept from the first to the last pass. `words` is the
    /// number of the film's layer words per pixel. Returns 0 without a time limit: then only the
    /// tiles in work keep such memory, not all pixels at once.
    pub fn bytes_per_pixel(&self, words: usize) -> u64 {
        let held = if words > 0 { HELD_BYTES + 2 * words * size_of::<f64>() } else { 0 };
        let levels = 1 + (self.most / self.first.max(1)).max(1).ilog2() as usize;
        let errors = if self.noise.is_some() { levels * size_of::<f32>() + PLAN_BYTES } else { 0 };
        if self.time.is_some() { (size_of::<PixelSamples>() + errors + held) as u64 } else { 0 }
    }
}

/// Statistics of the numbers of camera samples of a film's pixels.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize)]
pub struct SampleCounts {
    /// Fewest samples of a pixel.
    pub least: u32,
    /// Most samples of a pixel.
    pub most: u32,
    /// Mean number of samples per pixel.
    pub mean: f64,
}

/// Ray counts, sample counts and lost matte coverage of some tiles.
type Rendered = (RayCounts, SampleCounts, Dropped);

/// Settings that all tiles share.
#[derive(Clone, Copy)]
struct SharedSettings<'a> {
    context: RenderContext<'a>,
    adaptive: Adaptive,
    goal: Option<Goal>,
}

/// Renders the film's window, and the layers of a plan, with as many samples as each pixel needs.
///
/// # Errors
/// `Interrupted` after a signal, and errors of the disk; the film is then unfinished.
pub fn render_adaptive(
    context: RenderContext,
    film: &mut Film,
    plan: &LayerPlan,
    adaptive: Adaptive,
) -> Result<(RayCounts, SampleCounts)> {
    let RenderContext { world, monitor, .. } = context;
    debug_assert_eq!(world.spp, adaptive.most);
    monitor.begin(Phase::Render, film.window.pixels());
    let mut job = SharedSettings { context, adaptive, goal: None };
    let mut counts = RayCounts::default();
    if let Some(noise) = adaptive.noise {
        let (mean, rays) = job.brightness();
        let Adaptive { relative, most, .. } = adaptive;
        job.goal = Some(Goal::new(
            noise,
            relative,
            mean,
            most,
            rate(world.sampler, world.light_tree.is_some()),
        ));
        counts = rays;
    }
    let (rays, taken) = if plan.is_empty() {
        film.planes = Planes::default();
        job.render(film, || Beauty(None))
    } else {
        job.render(film, || Layers::new(plan, None, world.spp))
    };
    monitor.check()?;
    world.shapes.check_textures()?;
    Ok((counts + rays, taken))
}

impl SharedSettings<'_> {
    fn render<R: Record + Send>(
        &self,
        film: &mut Film,
        record: impl Fn() -> R + Sync,
    ) -> (RayCounts, SampleCounts) {
        let all = film.window.pixels();
        let tiles = tiles(film, self.context.world.frame_end());
        let done = match self.adaptive.time {
            Some(time) => self.in_time(time, tiles, record),
            None => self.tile_by_tile(tiles, record),
        };
        let (rays, mut taken, dropped) = done.unwrap_or_default();
        taken.mean /= all as f64;
        film.dropped = dropped;
        (rays, taken)
    }

    /// Renders each tile until its pixels need no more samples.
    fn tile_by_tile<R: Record>(
        &self,
        tiles: Vec<Tile>,
        record: impl Fn() -> R + Sync,
    ) -> Option<Rendered> {
        let monitor = self.context.monitor;
        let render = |tile: Tile| {
            let mut work = Work::new(self, tile, record());
            let mut rays = work.pass(self);
            while !monitor.stopped() && self.goal.is_some_and(|goal| work.passes.choose(&goal)) {
                rays = rays + work.pass(self);
            }
            monitor.done.fetch_add(work.tile.window.pixels(), Relaxed);
            let (taken, dropped) = work.finish(monitor);
            (rays, taken, dropped)
        };
        parallel::map(tiles.into_iter(), render).into_iter().reduce(join)
    }

    /// Renders in passes over the whole film. Each pass is as large as the remaining time allows.
    /// So the last passes are small.
    fn in_time<R: Record + Send>(
        &self,
        time: Duration,
        tiles: Vec<Tile>,
        record: impl Fn() -> R + Sync,
    ) -> Option<Rendered> {
        let (start, monitor) = (Instant::now(), self.context.monitor);
        let make = |tile| Work::new(self, tile, record());
        let mut all = parallel::map(tiles.into_iter(), make);
        let mut rays = RayCounts::default();
        // A pass takes 2^-shift of a doubling of the samples. Once a whole doubling does not fit
        // into the remaining time, no further doubling is chosen.
        let mut shift = 0;
        loop {
            let (begun, wanted) = (Instant::now(), wanted(&all));
            let pass = |work: &mut Work<R>| {
                let rays = work.pass(self);
                let part = start.elapsed().as_secs_f64() / time.as_secs_f64().max(1e-9);
                let total = monitor.total.load(Relaxed);
                monitor.set_done(total.min((part * total as f64) as u64));
                rays
            };
            let passes = parallel::map(all.iter_mut(), pass);
            rays = passes.into_iter().fold(rays, |a, b| a + b);
            if monitor.stopped() {
                break;
            }
            let each = begun.elapsed().as_secs_f64() / wanted.max(1) as f64;
            let left = time.saturating_sub(start.elapsed()).as_secs_f64();
            if shift == 0 {
                parallel::each(all.iter_mut(), |work| work.choose(self));
            }
            while wanted_after(&mut all, shift) as f64 * each > left && shift < u32::BITS {
                shift += 1;
            }
            if self::wanted(&all) == 0 || shift == u32::BITS {
                break;
            }
        }
        let done = parallel::map(all.into_iter(), |work| {
            let (taken, dropped) = work.finish(monitor);
            (RayCounts::default(), taken, dropped)
        });
        let (_, taken, dropped) = done.into_iter().reduce(join)?;
        Some((rays, taken, dropped))
    }

    /// Returns the mean radiance of a grid of the frame's pixels, and the number of rays traced for
    /// it. The picture's sample counts depend on this mean. So the mean has samples of its own,
    /// which are independent of the picture's samples.
    fn brightness(&self) -> (f64, RayCounts) {
        let world = self.context.world;
        let other = World { seed: independent_seed(world.seed), ..world.clone() };
        let job =
            SharedSettings { context: RenderContext { world: &other, ..self.context }, ..*self };
        let [width, height] = world.frame.map(|side| side - 2 * world.overscan);
        let area = f64::from(width) * f64::from(height);
        let distance = ((area / PROBES).sqrt().ceil() as u32).max(PROBE_DISTANCE);
        let middle = |size: u32| {
            (0..size)
                .step_by(distance as usize)
                .map(move |at| at + (distance / 2).min(size - 1 - at))
        };
        let probes: Vec<[u32; 2]> =
            middle(height).flat_map(|y| middle(width).map(move |x| [x, y])).collect();
        let sums = parallel::map(probes.iter(), |&[x, y]| {
            let [x0, y0] = [x, y].map(|at| at + world.overscan);
            let pixel = Window { x0, y0, x1: x0 + 1, y1: y0 + 1 };
            let mut passes = Passes::new(pixel, MIN_PASS_SAMPLES, || ());
            let rays = job.pass(&mut passes, &mut Beauty(None));
            let [r, g, b, _] = passes.tallies[0].sum;
            ((r + g + b) / (3.0 * f64::from(MIN_PASS_SAMPLES)), rays)
        });
        let rays = sums.iter().fold(RayCounts::default(), |all, (_, rays)| all + *rays);
        (mean_of_finite(sums.iter().map(|(radiance, _)| *radiance)), rays)
    }

    fn pass<R: Record>(&self, passes: &mut Passes<R::Held>, record: &mut R) -> RayCounts {
        let rays =
            simd::dispatch(self.context.isa, PassKernel { context: self.context, passes, record });
        self.context.monitor.rays.fetch_add(rays.all(), Relaxed);
        rays
    }
}

/// Returns the mean of the numbers that are finite, or 0 if there are none. Sums in the given
/// order: that of the pixels gives the same bits with any number of threads.
fn mean_of_finite(values: impl Iterator<Item = f64>) -> f64 {
    let finite = values.filter(|value| value.is_finite());
    let (sum, count) = finite.fold((0.0, 0.0), |(sum, count), value| (sum + value, count + 1.0));
    if count > 0.0 { sum / count } else { 0.0 }
}

/// A tile with its samples so far.
struct Work<'f, R: Record> {
    tile: Tile<'f>,
    record: R,
    passes: Passes<R::Held>,
}

impl<'f, R: Record> Work<'f, R> {
    fn new(job: &SharedSettings, tile: Tile<'f>, record: R) -> Self {
        let window = match job.goal {
            Some(_) => whole(tile.window, job.context.world),
            None => tile.window,
        };
        let passes = Passes::new(window, job.adaptive.first, || record.held());
        Self { tile, record, passes }
    }

    fn pass(&mut self, job: &SharedSettings) -> RayCounts {
        match job.context.monitor.stopped() {
            true => RayCounts::default(),
            false => job.pass(&mut self.passes, &mut self.record),
        }
    }

    /// Starts the next doubling: of the pixels below their plan, or of all pixels if there is no
    /// goal.
    fn choose(&mut self, job: &SharedSettings) {
        match &job.goal {
            Some(goal) => {
                self.passes.choose(goal);
            }
            None => self.passes.double(job.adaptive.most),
        }
    }

    /// Writes the pixels to the film. Writes nothing if the job was stopped: pixels may then have
    /// no samples. The mean in the returned counts is still a sum over the pixels.
    fn finish(mut self, monitor: &Monitor) -> (SampleCounts, Dropped) {
        if monitor.stopped() {
            return Default::default();
        }
        let Tile { window, rows, words } = &mut self.tile;
        self.passes.write(*window, rows, words, &mut self.record);
        let kept = self.passes.taken(*window);
        let taken = SampleCounts {
            least: kept.clone().min().unwrap_or(0),
            most: kept.clone().max().unwrap_or(0),
            mean: kept.map(f64::from).sum(),
        };
        (taken, self.record.dropped())
    }
}

/// Returns the number of samples that the next pass takes, over all tiles.
fn wanted<R: Record>(all: &[Work<R>]) -> u64 {
    all.iter().map(|work| work.passes.wanted()).sum()
}

/// Sets the next pass to 2^-shift of the doubling, and returns its number of samples.
fn wanted_after<R: Record + Send>(all: &mut [Work<R>], shift: u32) -> u64 {
    parallel::each(all.iter_mut(), |work| work.passes.want(shift));
    wanted(all)
}

/// Returns the whole tile of the absolute grid in which `part` lies. An edge of the camera's frame
/// may cut the tile. Then the result is the piece on the same side of the edge as `part`.
fn whole(part: Window, world: &World) -> Window {
    let packet_end = packet_end(world, part);
    let cut = |from: u32, axis: usize| {
        let (begin, end) = (from / TILE * TILE, world.frame_end()[axis]);
        let begin = if from >= end { begin.max(end) } else { begin };
        (begin, (from / TILE * TILE + TILE).min(packet_end[axis]))
    };
    let ((x0, x1), (y0, y1)) = (cut(part.x0, 0), cut(part.y0, 1));
    Window { x0, y0, x1, y1 }
}

fn join((rays, a, lost): Rendered, (more_rays, b, more): Rendered) -> Rendered {
    let mean = a.mean + b.mean;
    let taken = SampleCounts { least: a.least.min(b.least), most: a.most.max(b.most), mean };
    (rays + more_rays, taken, lost.and(more))
}

#[cfg(test)]
mod tests {
    use super::mean_of_finite;

    #[test]
    fn values_that_are_not_finite_do_not_lower_the_mean() {
        assert_eq!(mean_of_finite([1.0, f64::NAN, 3.0, f64::INFINITY].into_iter()), 2.0);
        assert_eq!(mean_of_finite([f64::NAN].into_iter()), 0.0);
    }
}
