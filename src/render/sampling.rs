//! Checks the settings of adaptive sampling together, and describes them in the EXR.

use std::time::Duration;

use crate::error::{Error, Problem, Result};
use crate::film::Window;
use crate::integrate::{MIN_PASS_SAMPLES, Relative};
use crate::layers::LayerPlan;
use crate::scene::Scene;

use super::adaptive::Adaptive;

/// Maximum number of samples per pixel: the length of one Sobol sequence.
const MAX_SAMPLES: u32 = 1 << 16;

/// Default maximum number of samples per pixel with `--noise`.
const DEFAULT_MAX_SPP: u32 = 4096;

/// Maximum of `--time` in seconds: one year.
const MAX_SECONDS: f64 = 31_536_000.0;

/// Adaptive sampling as flags or a job file ask for it. Messages name the flags.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Sampling {
    /// `--noise`: the relative standard error at which a pixel needs no more samples.
    pub noise: Option<f64>,
    /// `--noise-of`: what `noise` is relative to.
    pub noise_of: Option<Relative>,
    /// `--max-spp`: the largest number of samples of a pixel.
    pub max_spp: Option<u32>,
    /// `--time`: the time limit in seconds.
    pub time: Option<f64>,
}

/// Returns the settings of adaptive sampling, or `None` if every pixel gets the same number of
/// samples.
///
/// # Errors
/// Values out of range; flags that contradict each other or the scene.
pub fn adaptive(args: &Sampling, scene: &Scene) -> Result<Option<Adaptive>> {
    let (noise, time) = (args.noise, args.time);
    if noise.is_none() && args.noise_of.is_some() {
        return Err(Error::invalid("--noise-of", "found without --noise"));
    }
    if let Some(noise) = noise.filter(|noise| !(*noise > 0.0 && *noise <= 1.0)) {
        let message = format!("found {noise}, expected a number above 0 and up to 1");
        return Err(Error::invalid("--noise", message).help("0.02 is 2% of a pixel's value"));
    }
    if let Some(time) = time.filter(|time| !(*time > 0.0 && *time <= MAX_SECONDS)) {
        let message = format!("found {time}, expected seconds above 0 and up to {MAX_SECONDS}");
        return Err(Error::invalid("--time", message));
    }
    if noise.is_none() && time.is_none() {
        return match args.max_spp {
            None => Ok(None),
            Some(_) => Err(Error::invalid("--max-spp", "found without --noise")
                .help("--spp N takes N samples of every pixel")),
        };
    }
    // Adaptive shadows draw once for all samples of a packet. So the two halves of the first pass,
    // whose difference tells the error, must be packets of their own.
    let skips = noise.is_some() && scene.can_skip_shadow_rays();
    let least = if skips { 2 * MIN_PASS_SAMPLES } else { MIN_PASS_SAMPLES };
    let first = scene.spp.checked_next_power_of_two().unwrap_or(u32::MAX).max(least);
    let most = args.max_spp.unwrap_or(match noise {
        Some(_) => DEFAULT_MAX_SPP.max(first.saturating_mul(16)).min(MAX_SAMPLES),
        None => MAX_SAMPLES,
    });
    if most > MAX_SAMPLES || !most.is_power_of_two() {
        let below = (1 << most.max(1).ilog2()).min(MAX_SAMPLES);
        let message = format!("found {most}, expected a power of two up to {MAX_SAMPLES}");
        let help = match most < MAX_SAMPLES {
            true => format!("{below} or {}", 2 * below),
            false => MAX_SAMPLES.to_string(),
        };
        return Err(Error::invalid("--max-spp", message).help(help));
    }
    if most <= first {
        let place = if args.max_spp.is_some() { "--max-spp" } else { "--spp" };
        let message = format!(
            "there is no room for more samples: every pixel gets {first} (spp {}, rounded up to a \
             power of two, at least {least}), and none more than {most}",
            scene.spp
        );
        let help = match first < MAX_SAMPLES {
            true => format!("--max-spp {} or more, or fewer --spp", 2 * first),
            false => format!("--spp {} or fewer", MAX_SAMPLES / 2),
        };
        return Err(Error::invalid(place, message).help(help));
    }
    let relative = args.noise_of.unwrap_or_default();
    Ok(Some(Adaptive { first, most, noise, relative, time: time.map(Duration::from_secs_f64) }))
}

/// Returns the bytes that adaptive sampling keeps in addition to the film.
pub fn bytes(adaptive: &Adaptive, scene: &Scene, window: Window) -> u64 {
    window.pixels() * adaptive.bytes_per_pixel(LayerPlan::new(scene).layout.channels.len())
}

/// Returns the EXR attributes that describe adaptive sampling.
pub fn attributes(adaptive: &Adaptive) -> Vec<(String, String)> {
    let mut attributes = Vec::new();
    let mut add = |name: &str, text: String| attributes.push((format!("lightpath:{name}"), text));
    if let Some(noise) = adaptive.noise {
        add("noise", noise.to_string());
        if adaptive.relative == Relative::Picture {
            add("noiseof", "picture".into());
        }
    }
    if let Some(time) = adaptive.time {
        add("time", time.as_secs_f64().to_string());
        add("reproducible", "no".to_string());
    }
    attributes
}

/// Returns the value of the attribute `lightpath:spp`: the number of samples per pixel, or the
/// range that is permitted.
pub fn spp(adaptive: Option<&Adaptive>, scene: &Scene) -> String {
    match adaptive {
        Some(Adaptive { first, most, .. }) => format!("{first}-{most}"),
        None => scene.spp.to_string(),
    }
}

/// Returns a warning if `--time` makes the picture irreproducible.
pub fn warning(adaptive: &Adaptive) -> Option<Problem> {
    adaptive.time?;
    let message =
        "the picture depends on the speed of this machine: it is marked as not reproducible";
    Some(Problem::new("--time", message).help("--noise alone always gives the same picture"))
}
