//! Progress display: a thread polls the counters of a job, which only counts.
//!
//! On a terminal the display is a bar on stderr. Elsewhere it is a plain line every 3 seconds. So a
//! short job prints none, and the log of a long job stays readable. Other modes print JSON lines
//! for programs to stderr, or lines for render farms to stdout; the last one is the final state.

use std::io::{IsTerminal, Write};
use std::path::PathBuf;
use std::sync::Mutex;
use std::sync::mpsc::{RecvTimeoutError, Sender, channel};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use clap::ValueEnum;
use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};
use serde_json::Value;

use crate::error::{Error, Result};
use crate::threads::lock;

use super::print;

const PLAIN_EVERY: Duration = Duration::from_secs(3);
const JSON_EVERY: Duration = Duration::from_millis(500);
const BAR_EVERY: Duration = Duration::from_millis(100);
/// Interval between readings of the counters. It is short, because the rate of a phase is measured
/// from the first reading in it.
const POLL_EVERY: Duration = BAR_EVERY;

/// How progress is shown.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum ProgressMode {
    /// A bar on a terminal, else plain
    Auto,
    /// A line every 3 seconds
    Plain,
    /// One JSON object per line; add --quiet for no other lines than errors
    Json,
    /// Open Job Description, on stdout
    Openjd,
    /// `ALF_PROGRESS 50%` on stdout: Tractor, Deadline
    Alf,
    /// Nothing
    Off,
}

impl ProgressMode {
    /// Returns the mode that was asked for. Without one, a quiet run shows no progress.
    pub fn of(asked: Option<Self>, quiet: bool) -> Self {
        asked.unwrap_or(if quiet { Self::Off } else { Self::Auto })
    }

    /// Refuses progress on stdout beside `--json`.
    ///
    /// # Errors
    /// `Invalid` for `openjd` and `alf`.
    pub fn refuse_beside_json(asked: Option<Self>) -> Result<()> {
        match asked {
            Some(Self::Openjd | Self::Alf) => {
                let message = "found with --json, which has stdout for itself";
                Err(Error::invalid("--progress", message).help("--stats FILE.json"))
            }
            _ => Ok(()),
        }
    }
}

/// A running progress display; it ends when it is dropped.
#[derive(Debug)]
pub struct Progress {
    bar: Option<ProgressBar>,
    stop: Option<Sender<()>>,
    thread: Option<JoinHandle<()>>,
    start: Instant,
    /// The first path that could not be printed.
    unprinted: Mutex<Result<()>>,
}

impl Progress {
    /// Starts the display thread. `meter` reads the counters.
    pub fn start(mode: ProgressMode, mut meter: impl FnMut() -> Reading + Send + 'static) -> Self {
        let (start, unprinted) = (Instant::now(), Mutex::new(Ok(())));
        let terminal = std::io::stderr().is_terminal();
        let bar = (mode == ProgressMode::Auto && terminal).then(new_bar);
        let every = match (mode, &bar) {
            (ProgressMode::Off, _) => {
                return Self { bar, stop: None, thread: None, start, unprinted };
            }
            (ProgressMode::Json, _) => JSON_EVERY,
            (ProgressMode::Openjd | ProgressMode::Alf, _) => POLL_EVERY,
            (_, Some(_)) => BAR_EVERY,
            _ => PLAIN_EVERY,
        };
        let (stop, stopped) = channel();
        let shown = bar.clone();
        let work = move || {
            let (mut shown_at, mut last_percent) = (Instant::now(), None);
            loop {
                let over = stopped.recv_timeout(POLL_EVERY) != Err(RecvTimeoutError::Timeout);
                let now = meter();
                if let ProgressMode::Openjd | ProgressMode::Alf = mode {
                    last_percent = now.farm(mode, last_percent);
                } else if over && mode == ProgressMode::Json {
                    now.json();
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
            // Without a thread there is no progress display; the job is not affected.
            thread: thread.spawn(work).ok(),
            start,
            unprinted,
        }
    }

    /// Returns the seconds since the display started.
    pub fn elapsed(&self) -> f64 {
        self.start.elapsed().as_secs_f64()
    }

    /// Prints the paths of finished files to stdout without breaking the bar. An error does not
    /// stop the job.
    pub fn result(&self, paths: &[PathBuf]) {
        let lines = print::path_lines(paths);
        let show = || print::bytes(&lines);
        let shown = match &self.bar {
            Some(bar) => bar.suspend(show),
            None => show(),
        };
        if let Err(error) = shown {
            let mut unprinted = lock(&self.unprinted);
            if unprinted.is_ok() {
                *unprinted = Err(error);
            }
        }
    }

    /// Ends the display.
    ///
    /// # Errors
    /// The first error of [`Progress::result`].
    pub fn finish(self) -> Result<()> {
        lock(&self.unprinted).clone()
    }

    /// Prints a message to stderr without breaking the bar.
    pub fn message(&self, text: &str) {
        match &self.bar {
            Some(bar) => bar.suspend(|| print::note(text)),
            None => print::note(text),
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
    // The template is a constant. If it were invalid, the default style would stay.
    if let Ok(style) = ProgressStyle::with_template("{prefix:6} {wide_bar} {percent:>3}%  {msg}") {
        bar.set_style(style);
    }
    bar
}

/// Values of the counters at one moment.
#[derive(Debug, Clone)]
pub struct Reading {
    /// Name of the current phase.
    pub label: String,
    /// Finished steps of the phase.
    pub done: u64,
    /// All steps of the phase.
    pub total: u64,
    /// Progress of the whole job, from 0 to 1.
    pub overall: f64,
    /// Rate and remaining time as text.
    pub message: String,
    /// The whole reading as JSON.
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
        print::note(&format!("{} {percent:.1}%  {}", self.label, self.message));
    }

    fn json(&self) {
        // In one piece, so that no other message divides the line.
        let _ = std::io::stderr().write_all(format!("{}\n", self.json).as_bytes());
    }

    /// Prints lines for render farms to stdout, each percentage once. Returns the last printed
    /// percentage.
    fn farm(&self, mode: ProgressMode, last_percent: Option<u32>) -> Option<u32> {
        let percent = (100.0 * self.overall.clamp(0.0, 1.0)) as u32;
        if last_percent.is_some_and(|last_percent| last_percent >= percent) {
            return last_percent;
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
