//! Progress of one render, phase by phase.

use std::sync::Arc;
use std::sync::atomic::Ordering::Relaxed;
use std::time::Instant;

use serde_json::json;

use crate::monitor::{Monitor, Phase};
use crate::units;

use crate::cli::progress::Reading;

/// Returns a meter that turns the monitor's counters into rates.
pub fn meter(monitor: &Arc<Monitor>) -> impl FnMut() -> Reading + Send + use<> {
    let monitor = Arc::clone(monitor);
    let start = Instant::now();
    let (mut phase, mut phase_start) = (monitor.phase(), start);
    let mut phase_rays = monitor.rays.load(Relaxed);
    move || {
        let now = monitor.phase();
        let rays = monitor.rays.load(Relaxed);
        if now != phase {
            (phase, phase_start, phase_rays) = (now, Instant::now(), rays);
        }
        let total = monitor.total.load(Relaxed);
        let done = monitor.done.load(Relaxed).min(total);
        let in_phase = phase_start.elapsed().as_secs_f64();
        let rays_per_s = (rays - phase_rays) as f64 / in_phase.max(1e-3);
        let eta_s = (done > 0).then(|| in_phase * (total - done) as f64 / done as f64);
        Reading {
            label: name(phase).to_string(),
            done,
            total,
            overall: match phase {
                Phase::Load | Phase::Build => 0.0,
                // Stays below 100% until the pictures have their final names.
                Phase::Write if done >= total => 1.0,
                Phase::Write => 0.99,
                Phase::Render | Phase::Check => (done as f64 / total.max(1) as f64).min(0.99),
            },
            message: message(phase, rays_per_s, eta_s),
            json: json!({
                "phase": name(phase),
                "done": done,
                "total": total,
                "rays": rays,
                "rays_per_s": rays_per_s.round(),
                "elapsed_s": start.elapsed().as_secs_f64(),
                "eta_s": eta_s,
            }),
        }
    }
}

fn name(phase: Phase) -> &'static str {
    match phase {
        Phase::Load => "load",
        Phase::Build => "build",
        Phase::Render => "render",
        Phase::Write => "write",
        Phase::Check => "check",
    }
}

fn message(phase: Phase, rays_per_s: f64, eta_s: Option<f64>) -> String {
    let mut text = match phase {
        Phase::Render => format!("{:.1} Mray/s", rays_per_s / 1e6),
        _ => String::new(),
    };
    if let Some(eta) = eta_s {
        let gap = if text.is_empty() { "" } else { "  " };
        text.push_str(&format!("{gap}ETA {}", units::duration(eta)));
    }
    text
}
