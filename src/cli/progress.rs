//! Progress, fed by polling counters from one thread: the job only counts.
//!
//! A bar on a terminal; else a plain line every 3 seconds, so that a short job prints none and the
//! log of a long one stays readable; JSON lines for programs; what render farms read, on stdout.

use std::{
    io::{IsTerminal, Write},
    path::PathBuf,
    sync::mpsc::{RecvTimeoutError, Sender, channel},
    thread::JoinHandle,
    time::{Duration, Instant},
};

use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};
use serde_json::Value;

use super::args::ProgressMode;

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
    start: Instant,
}

impl Progress {
    /// Starts to watch.
    pub fn start(mode: ProgressMode, mut meter: impl FnMut() -> Reading + Send + 'static) -> Self {
        let start = Instant::now();
        let terminal = std::io::stderr().is_terminal();
        let bar = (mode == ProgressMode::Auto && terminal).then(new_bar);
        let every = match (mode, &bar) {
            (ProgressMode::Off, _) => {
                return Self { bar, stop: None, thread: None, start };
            }
            (ProgressMode::Json, _) => JSON_EVERY,
            (ProgressMode::Openjd | ProgressMode::Alf, _) => POLL_EVERY,
            (_, Some(_)) => BAR_EVERY,
            _ => PLAIN_EVERY,
        };
        let (stop, stopped) = channel();
        let shown = bar.clone();
        let work = move || {
            let (mut shown_at, mut said) = (Instant::now(), None);
            loop {
                let over = stopped.recv_timeout(POLL_EVERY) != Err(RecvTimeoutError::Timeout);
                let now = meter();
                if let ProgressMode::Openjd | ProgressMode::Alf = mode {
                    said = now.farm(mode, said);
                } else if !over && shown_at.elapsed() >= every {
                    shown_at = Instant::now();
                    match (&shown, mode) {
                        (Some(bar), _) => now.show(bar),
                        (_, ProgressMode::Json) => now.json(),
                        _ => now.plain(),
                    }
                }
                if over {
                    return;
                }
            }
        };
        let thread = std::thread::Builder::new().name("progress".into());
        Self {
            bar,
            stop: Some(stop),
            // Without a thread there is no progress, and nothing else is wrong.
            thread: thread.spawn(work).ok(),
            start,
        }
    }

    /// Seconds since the start.
    pub fn elapsed(&self) -> f64 {
        self.start.elapsed().as_secs_f64()
    }

    /// Prints the names of finished files to stdout without tearing the bar.
    pub fn result(&self, paths: &[PathBuf]) {
        let lines = super::path_lines(paths);
        // A reader that has gone does not stop a batch.
        let print = || super::print_bytes(&lines).unwrap_or_default();
        match &self.bar {
            Some(bar) => bar.suspend(print),
            None => print(),
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

/// What the counters said at one moment.
#[derive(Debug, Clone)]
pub struct Reading {
    /// What is being done.
    pub label: String,
    /// Steps of it that are done.
    pub done: u64,
    /// Its steps.
    pub total: u64,
    /// Of the whole job, 0 to 1.
    pub overall: f64,
    /// Rates, for people.
    pub message: String,
    /// All of it, for programs.
    pub json: Value,
}

impl Reading {
    fn show(&self, bar: &ProgressBar) {
        bar.set_prefix(self.label.clone());
        bar.set_length(self.total);
        bar.set_position(self.done);
        bar.set_message(self.message.clone());
    }

    fn plain(&self) {
        let percent = 100.0 * self.done as f64 / self.total.max(1) as f64;
        super::note(&format!("{} {percent:.1}%  {}", self.label, self.message));
    }

    fn json(&self) {
        let _ = writeln!(std::io::stderr(), "{}", self.json);
    }

    /// What render farms read: lines on stdout, each percentage once. Returns the last one said.
    fn farm(&self, mode: ProgressMode, said: Option<u32>) -> Option<u32> {
        let percent = (100.0 * self.overall.clamp(0.0, 1.0)) as u32;
        if said.is_some_and(|said| said >= percent) {
            return said;
        }
        let line = match mode {
            ProgressMode::Alf => format!("ALF_PROGRESS {percent}%"),
            _ => {
                let status = format!("openjd_status: {} {}", self.label, self.message);
                format!("openjd_progress: {percent}\n{}", status.trim_end())
            }
        };
        let _ = writeln!(std::io::stdout(), "{line}");
        Some(percent)
    }
}
