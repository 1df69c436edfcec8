//! Progress on stderr, fed by polling the [`Monitor`] from one thread: the job only counts.
//!
//! A bar on a terminal; else a plain line every 3 seconds, so that a short job prints none and the
//! log of a long one stays readable; JSON lines for programs.

use std::{
    io::{IsTerminal, Write},
    sync::{
        Arc,
        atomic::Ordering::Relaxed,
        mpsc::{RecvTimeoutError, Sender, channel},
    },
    thread::JoinHandle,
    time::{Duration, Instant},
};

use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};
use serde_json::json;

use crate::monitor::{Monitor, Phase};

use super::{args::ProgressMode, units};

const PLAIN_EVERY: Duration = Duration::from_secs(3);
const JSON_EVERY: Duration = Duration::from_millis(500);
const BAR_EVERY: Duration = Duration::from_millis(100);
/// How often counters are read, so that a phase's rate starts when the phase does.
const POLL_EVERY: Duration = BAR_EVERY;

/// A display that runs until it is dropped.
#[derive(Debug)]
pub struct Progress {
    bar: Option<ProgressBar>,
    stop: Option<Sender<()>>,
    thread: Option<JoinHandle<()>>,
}

impl Progress {
    /// Starts to watch.
    pub fn start(mode: ProgressMode, monitor: &Arc<Monitor>) -> Self {
        let terminal = std::io::stderr().is_terminal();
        let bar = (mode == ProgressMode::Auto && terminal).then(new_bar);
        let every = match (mode, &bar) {
            (ProgressMode::Off, _) => {
                return Self { bar, stop: None, thread: None };
            }
            (ProgressMode::Json, _) => JSON_EVERY,
            (_, Some(_)) => BAR_EVERY,
            _ => PLAIN_EVERY,
        };
        let (stop, stopped) = channel();
        let (shown, monitor) = (bar.clone(), Arc::clone(monitor));
        let work = move || {
            let mut meter = Meter::new(monitor);
            let mut shown_at = Instant::now();
            while stopped.recv_timeout(POLL_EVERY) == Err(RecvTimeoutError::Timeout) {
                let now = meter.read();
                if shown_at.elapsed() < every {
                    continue;
                }
                shown_at = Instant::now();
                match (&shown, mode) {
                    (Some(bar), _) => now.show(bar),
                    (_, ProgressMode::Json) => now.json(),
                    _ => now.plain(),
                }
            }
        };
        let thread = std::thread::Builder::new().name("progress".into());
        Self {
            bar,
            stop: Some(stop),
            // Without a thread there is no progress, and nothing else is wrong.
            thread: thread.spawn(work).ok(),
        }
    }

    /// Prints a message without tearing the bar.
    pub fn message(&self, text: &str) {
        match &self.bar {
            Some(bar) => bar.suspend(|| super::note(text)),
            None => super::note(text),
        }
    }
}

impl Drop for Progress {
    fn drop(&mut self) {
        self.stop = None;
        if let Some(thread) = self.thread.take() {
            let _ = thread.join();
        }
        if let Some(bar) = &self.bar {
            bar.finish_and_clear();
        }
    }
}

fn new_bar() -> ProgressBar {
    let bar = ProgressBar::with_draw_target(Some(0), ProgressDrawTarget::stderr());
    // The template is a constant; if it were wrong the default style would do.
    if let Ok(style) = ProgressStyle::with_template("{prefix:6} {wide_bar} {percent:>3}%  {msg}") {
        bar.set_style(style);
    }
    bar
}

/// Turns counters into rates.
struct Meter {
    monitor: Arc<Monitor>,
    start: Instant,
    phase: Phase,
    phase_start: Instant,
    phase_rays: u64,
}

/// What the counters said at one moment.
struct Reading {
    phase: Phase,
    done: u64,
    total: u64,
    rays: u64,
    rays_per_s: f64,
    elapsed_s: f64,
    eta_s: Option<f64>,
}

impl Meter {
    fn new(monitor: Arc<Monitor>) -> Self {
        let now = Instant::now();
        Self {
            phase: monitor.phase(),
            phase_rays: monitor.rays.load(Relaxed),
            monitor,
            start: now,
            phase_start: now,
        }
    }

    fn read(&mut self) -> Reading {
        let phase = self.monitor.phase();
        let rays = self.monitor.rays.load(Relaxed);
        if phase != self.phase {
            self.phase = phase;
            self.phase_start = Instant::now();
            self.phase_rays = rays;
        }
        let total = self.monitor.total.load(Relaxed);
        let done = self.monitor.done.load(Relaxed).min(total);
        let in_phase = self.phase_start.elapsed().as_secs_f64();
        let left = |done: u64| in_phase * (total - done) as f64 / done as f64;
        Reading {
            phase,
            done,
            total,
            rays,
            rays_per_s: (rays - self.phase_rays) as f64 / in_phase.max(1e-3),
            elapsed_s: self.start.elapsed().as_secs_f64(),
            eta_s: (done > 0).then(|| left(done)),
        }
    }
}

impl Reading {
    fn name(&self) -> &'static str {
        match self.phase {
            Phase::Load => "load",
            Phase::Build => "build",
            Phase::Render => "render",
            Phase::Write => "write",
        }
    }

    fn rate(&self) -> String {
        let mut text = match self.phase {
            Phase::Render => format!("{:.1} Mray/s", self.rays_per_s / 1e6),
            _ => String::new(),
        };
        if let Some(eta) = self.eta_s {
            let gap = if text.is_empty() { "" } else { "  " };
            text.push_str(&format!("{gap}ETA {}", units::duration(eta)));
        }
        text
    }

    fn show(&self, bar: &ProgressBar) {
        bar.set_prefix(self.name());
        bar.set_length(self.total);
        bar.set_position(self.done);
        bar.set_message(self.rate());
    }

    fn plain(&self) {
        let percent = 100.0 * self.done as f64 / self.total.max(1) as f64;
        super::note(&format!("{} {percent:.1}%  {}", self.name(), self.rate()));
    }

    fn json(&self) {
        let line = json!({
            "phase": self.name(),
            "done": self.done,
            "total": self.total,
            "rays": self.rays,
            "rays_per_s": self.rays_per_s.round(),
            "elapsed_s": self.elapsed_s,
            "eta_s": self.eta_s,
        });
        let _ = writeln!(std::io::stderr(), "{line}");
    }
}
