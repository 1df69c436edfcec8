//! Measures error against time, for `lightpath converge`.
//!
//! - `grid`: the settings that are compared.
//! - `study`: chooses the next render and collects results.
//! - `fit`: fits power laws to the results and finds their Pareto front.
//! - `result`: the report as it is written to files.
//!
//! Only this file renders. It builds the accelerators once and changes the settings of the world
//! from render to render.

mod clock;
mod common_bias;
mod crop;
mod fit;
mod grid;
mod reference;
mod result;
mod study;
#[cfg(test)]
mod tests;

use std::sync::atomic::Ordering::Relaxed;
use std::sync::mpsc::{RecvTimeoutError, channel};
use std::time::{Duration, Instant};

pub use crop::Crop;
pub use fit::{Slope, front, slope};
pub use grid::{Setting, StudyGrid};
pub use reference::{ReferenceError, ReferencePicture};
pub use result::{
    CheapestPoint, MeanWithError, PointResult, ReferenceResult, SamplerRatio, Series, StudyNames,
    StudyReport, VERSION, report,
};
pub use study::{Study, StudyLimits, StudyPoint};

use self::clock::Clock;
use super::backend::TestedBackend;
use super::metrics::non_finite;
use crate::accel::Accelerator;
use crate::error::{Error, ErrorKind, Problem, Result};
use crate::film::{Film, Window};
use crate::monitor::Monitor;
use crate::render::render;
use crate::shading::Emitter;
use crate::simd::Isa;
use crate::units::counted;
use crate::world::World;

/// Value in place of a signal number. It means that the budget is used up.
const BUDGET: i32 = -1;

/// Backends, settings and limits of a study.
#[derive(Debug, Clone)]
pub struct StudySettings {
    /// Backends to compare. The first renders the reference.
    pub tested_backends: Vec<TestedBackend>,
    /// Settings that are compared.
    pub grid: StudyGrid,
    /// Budget, number of renders and first seed.
    pub limits: StudyLimits,
    /// Start of the study. Its budget counts from there.
    pub started: Instant,
    /// Instruction set of the shading.
    pub isa: Isa,
}

/// Runs a study on the current rayon pool. Calls `note` with the name of each step when it begins.
///
/// Sampler, seed and numbers of samples of `world` are changed.
///
/// # Errors
/// - The errors of [`accel::build`](crate::accel::build).
/// - `Check`: a pixel is not finite.
/// - `Limit`: the budget does not suffice for a reference and one picture.
/// - `Interrupted`: a signal arrived.
pub fn run(
    world: &mut World,
    settings: &StudySettings,
    reference: Option<ReferencePicture>,
    monitor: &Monitor,
    note: &(dyn Fn(&str) + Sync),
) -> Result<Study> {
    let inner = &Monitor::default();
    let (done, waiting) = channel::<()>();
    let budget = settings.limits.budget;
    let clock = &Clock::since(settings.started);
    let study = std::thread::scope(|scope| {
        // This thread ends a render that exceeds the budget, and forwards signals.
        scope.spawn(move || {
            let tick = Duration::from_millis(20);
            while waiting.recv_timeout(tick) == Err(RecvTimeoutError::Timeout) {
                clock.tick();
                let late = if clock.elapsed_s() > budget { BUDGET } else { 0 };
                let signal = monitor.signal.load(Relaxed);
                inner.signal.store(if signal == 0 { late } else { signal }, Relaxed);
            }
        });
        let study = work(world, settings, reference, (inner, clock), note);
        drop(done);
        study
    });
    monitor.check()?;
    let study = match study {
        Err(error) if error.kind == ErrorKind::Interrupted(BUDGET) => None,
        other => Some(other?),
    };
    let any = |study: &Study| study.points.iter().any(|point| !point.errors.is_empty());
    study.filter(any).ok_or_else(|| {
        let message =
            format!("{} s do not suffice for a reference and one picture", settings.limits.budget);
        Error::new(ErrorKind::Limit, Problem::new("--budget", message))
            .help("a longer --budget, a smaller --size, fewer samples or a faster backend")
    })
}

fn work(
    world: &mut World,
    settings: &StudySettings,
    reference: Option<ReferencePicture>,
    (monitor, clock): (&Monitor, &Clock),
    note: &(dyn Fn(&str) + Sync),
) -> Result<Study> {
    let mut built: Vec<Box<dyn Accelerator + '_>> = Vec::new();
    for backend in &settings.tested_backends {
        note(&format!("building {}", backend.name));
        built.push(backend.build(&world.geometry, rayon::current_num_threads(), monitor)?);
    }
    let [width, height] = world.frame;
    let mut film = Film::new([width, height], Window::full(width, height))?;
    let mut study = Study::new(settings.grid.clone(), settings.limits, width as usize, reference);
    let mut values = Vec::with_capacity(3 * film.pixels.len());
    while let Some(job) = study.next(clock.elapsed_s()) {
        let setting = job.setting;
        note(&describe(&job, &settings.tested_backends[setting.backend].name));
        (world.spp, world.area_spp) = (setting.spp, setting.spp);
        (world.sampler, world.seed) = (setting.sampler, job.seed);
        for light in &mut world.lights {
            if let (Emitter::Area(area), Some(n)) = (&mut light.emitter, setting.light_samples) {
                area.set_samples(n);
            }
        }
        let started_s = clock.elapsed_s();
        let accelerator = &*built[setting.backend];
        let counts = match render(world, accelerator, settings.isa, &mut film, monitor) {
            // An interrupted render does not count. The results so far may suffice.
            Err(error) if error.kind == ErrorKind::Interrupted(BUDGET) => break,
            other => other?,
        };
        let seconds = clock.elapsed_s() - started_s;
        values.clear();
        values.extend(film.pixels.iter().flat_map(|[r, g, b, _]| [r, g, b]));
        let (bad, _) = non_finite(&values, 3);
        if bad > 0 {
            let pixels = counted(bad, ["pixel is", "pixels are"]);
            let message = format!("{pixels} NaN or infinite, so the error cannot be computed");
            let place = describe(&job, &settings.tested_backends[setting.backend].name);
            return Err(Error::new(ErrorKind::Check, Problem::new(place, message)));
        }
        study.take(&job, &values, counts.all(), seconds);
    }
    Ok(study)
}

/// Describes a job for progress and messages.
fn describe(job: &study::StudyRender, backend: &str) -> String {
    let Setting { sampler, spp, light_samples, .. } = job.setting;
    let lights = light_samples.map_or(String::new(), |n| format!(" x {n}"));
    let what = match job.purpose {
        study::Purpose::Probe => "timing: ",
        study::Purpose::Reference => "reference: ",
        study::Purpose::Point(_) => "",
    };
    format!("{what}{backend}, {}, {spp}{lights} samples, seed {}", sampler.name(), job.seed)
}
