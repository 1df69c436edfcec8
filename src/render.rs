//! Renders a [`World`] with an accelerator into a [`Film`]: tiles on threads, progress,
//! cancellation.

mod adaptive;
mod overscan;
pub mod sampling;
mod tiles;

use std::ops::Range;
use std::sync::atomic::Ordering::Relaxed;

pub use self::adaptive::{Adaptive, SampleCounts, render_adaptive};
pub use self::overscan::{checked_overscan, overscan_window};
use self::tiles::tiles;
use crate::accel::Accelerator;
use crate::error::Result;
use crate::film::{Dropped, Film, Planes};
use crate::integrate::{Beauty, Layers, Record, TileKernel};
pub use crate::integrate::{RayCounts, RenderContext};
use crate::layers::{LayerPlan, PartialSumsLayout};
use crate::monitor::{Monitor, Phase};
use crate::parallel;
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
    let context = RenderContext { world, accelerator, isa, monitor };
    render_layers(context, film, &LayerPlan::default(), None)
}

/// [`render`] with the layers of a plan. R, G, B, A are the same bit for bit. The film's planes
/// must be the planes of the plan.
///
/// `raw`, which is made for the plan's layout, renders a part of the samples. The film's planes
/// must then be the planes of `raw`. They receive partial sums, from which a merge computes the
/// bits of the whole render. The film's pixels become the mean of these samples.
///
/// # Errors
/// `Interrupted` after a signal, and errors of the disk; the film is then unfinished.
pub fn render_layers(
    context: RenderContext,
    film: &mut Film,
    plan: &LayerPlan,
    raw: Option<&PartialSumsLayout>,
) -> Result<RayCounts> {
    let spp = context.world.spp;
    let samples = raw.map_or(0..spp, PartialSumsLayout::samples);
    if !plan.is_empty() {
        return render_with(context, film, samples, || Layers::new(plan, raw, spp));
    }
    if raw.is_none() {
        film.planes = Planes::default();
    }
    render_with(context, film, samples, || Beauty(raw))
}

fn render_with<R: Record>(
    context: RenderContext,
    film: &mut Film,
    samples: Range<u32>,
    record: impl Fn() -> R + Sync,
) -> Result<RayCounts> {
    let RenderContext { world, monitor, .. } = context;
    monitor.begin(Phase::Render, film.window.pixels());
    let rendered = parallel::map(tiles(film, world.frame_end()).into_iter(), |mut tile| {
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
        let (counts, dropped) = simd::dispatch(context.isa, kernel);
        monitor.done.fetch_add(tile.window.pixels(), Relaxed);
        monitor.rays.fetch_add(counts.all(), Relaxed);
        (counts, dropped)
    });
    let add = |(a, lost): (RayCounts, Dropped), (b, more)| (a + b, lost.and(more));
    let (counts, dropped) = rendered.into_iter().fold(Default::default(), add);
    film.dropped = dropped;
    monitor.check()?;
    world.shapes.check_textures()?;
    Ok(counts)
}
