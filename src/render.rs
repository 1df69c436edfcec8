//! Renders a [`World`] with an accelerator into a [`Film`]: tiles on threads, progress,
//! cancellation.

mod adaptive;
mod tiles;

use std::ops::Range;
use std::sync::atomic::Ordering::Relaxed;

use rayon::prelude::*;

pub use self::adaptive::{Adaptive, SampleCounts, render_adaptive};
use self::tiles::{pixels, tiles};
use crate::accel::Accelerator;
use crate::error::Result;
use crate::film::{Dropped, Film, Planes};
pub use crate::integrate::RayCounts;
use crate::integrate::{Beauty, Layers, Record, RenderContext, TileKernel};
use crate::layers::{LayerPlan, PartialSumsLayout};
use crate::monitor::{Monitor, Phase};
use crate::simd::{self, Isa};
use crate::world::World;

/// Renders the film's window, without layers, on the threads of the current rayon pool. The bits of
/// a pixel are the same for any number of threads and any window. A film can be used again for the
/// next frame.
///
/// # Errors
/// `Interrupted` after a signal, and errors of the disk; the film is then unfinished.
pub fn render(
    world: &World,
    accelerator: &dyn Accelerator,
    isa: Isa,
    film: &mut Film,
    monitor: &Monitor,
) -> Result<RayCounts> {
    film.planes = Planes::default();
    render_with(world, accelerator, isa, film, 0..world.spp, || Beauty(None), monitor)
}

/// [`render`] with the layers of a plan. R, G, B, A are the same bit for bit. The film's planes
/// must be the planes of the plan.
///
/// # Errors
/// `Interrupted` after a signal, and errors of the disk; the film is then unfinished.
pub fn render_layers(
    world: &World,
    accelerator: &dyn Accelerator,
    isa: Isa,
    film: &mut Film,
    plan: &LayerPlan,
    monitor: &Monitor,
) -> Result<RayCounts> {
    if plan.is_empty() {
        return render(world, accelerator, isa, film, monitor);
    }
    let record = || Layers::new(plan, None, world.spp);
    render_with(world, accelerator, isa, film, 0..world.spp, record, monitor)
}

/// [`render_layers`] for a part of the samples. The film's planes must be the planes of `raw`,
/// which is made for the plan's layout. They receive partial sums, from which a merge computes the
/// bits of the whole render. The film's pixels become the mean of these samples.
///
/// # Errors
/// `Interrupted` after a signal, and errors of the disk; the film is then unfinished.
pub fn render_samples(
    world: &World,
    accelerator: &dyn Accelerator,
    isa: Isa,
    film: &mut Film,
    plan: &LayerPlan,
    raw: &PartialSumsLayout,
    monitor: &Monitor,
) -> Result<RayCounts> {
    let samples = raw.samples();
    if plan.is_empty() {
        let record = || Beauty(Some(raw));
        return render_with(world, accelerator, isa, film, samples, record, monitor);
    }
    let record = || Layers::new(plan, Some(raw), world.spp);
    render_with(world, accelerator, isa, film, samples, record, monitor)
}

fn render_with<R: Record>(
    world: &World,
    accelerator: &dyn Accelerator,
    isa: Isa,
    film: &mut Film,
    samples: Range<u32>,
    record: impl Fn() -> R + Sync,
    monitor: &Monitor,
) -> Result<RayCounts> {
    monitor.begin(Phase::Render, pixels(film.window));
    let context = RenderContext { world, accelerator, monitor };
    // Without a maximum, the last tiles are handed out some 60 at a time, and threads wait for the
    // one that got them.
    let (counts, dropped) = tiles(film, world.frame_end())
        .into_par_iter()
        .with_max_len(1)
        .map(|mut tile| {
            if monitor.stopped() {
                return Default::default();
            }
            let kernel = TileKernel {
                context,
                window: tile.window,
                rows: &mut tile.rows,
                record: record(),
                words: &mut tile.words,
                samples: samples.clone(),
            };
            let (counts, dropped) = simd::dispatch(isa, kernel);
            monitor.done.fetch_add(pixels(tile.window), Relaxed);
            monitor.rays.fetch_add(counts.primary + counts.shadow + counts.reflection, Relaxed);
            (counts, dropped)
        })
        .reduce(Default::default, |(a, lost): (RayCounts, Dropped), (b, more)| {
            (a + b, lost.and(more))
        });
    film.dropped = dropped;
    monitor.check()?;
    world.shapes.check_textures()?;
    Ok(counts)
}
