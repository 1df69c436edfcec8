//! State that a long job shares with other threads: its progress, and a request to stop.

use std::sync::Arc;
use std::sync::atomic::Ordering::{Acquire, Relaxed, Release};
use std::sync::atomic::{AtomicI32, AtomicU8, AtomicU64};

use crate::error::{Error, ErrorKind, Problem, Result};

/// Phase of a job.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[repr(u8)]
pub enum Phase {
    /// Reads and prepares the scene.
    Load = 0,
    /// Builds the accelerator. `done` and `total` count thousandths.
    Build = 1,
    /// Traces rays. `done` and `total` count pixels.
    Render = 2,
    /// Writes the output files.
    Write = 3,
    /// Answers queries, or compares answers with the oracle. `done` and `total` count rays or
    /// points, for the oracle packets of rays.
    Check = 4,
}

/// Counters that a job updates and a progress display polls, and a signal that stops the job.
#[derive(Debug, Default)]
pub struct Monitor {
    /// Number of the signal that stops the job, or 0.
    pub signal: Arc<AtomicI32>,
    /// Finished steps of the current phase.
    pub done: AtomicU64,
    /// All steps of the current phase.
    pub total: AtomicU64,
    /// Number of rays that a render has traced so far.
    pub rays: AtomicU64,
    phase: AtomicU8,
}

impl Monitor {
    /// Returns a monitor with its own counters for a part of the job. A signal stops the part and
    /// the job.
    pub fn part(&self) -> Self {
        Self { signal: Arc::clone(&self.signal), ..Self::default() }
    }

    /// Starts a phase of `total` steps.
    pub fn begin(&self, phase: Phase, total: u64) {
        self.done.store(0, Relaxed);
        self.total.store(total, Relaxed);
        // Who sees the phase also sees its counters.
        self.phase.store(phase as u8, Release);
    }

    /// Returns the current phase.
    pub fn phase(&self) -> Phase {
        match self.phase.load(Acquire) {
            0 => Phase::Load,
            1 => Phase::Build,
            2 => Phase::Render,
            3 => Phase::Write,
            _ => Phase::Check,
        }
    }

    /// Sets the number of finished steps of the current phase.
    pub fn set_done(&self, done: u64) {
        self.done.store(done, Relaxed);
    }

    /// Returns true once a signal has asked the job to stop.
    pub fn stopped(&self) -> bool {
        self.signal.load(Relaxed) != 0
    }

    /// Returns `Ok` until a signal has asked the job to stop.
    ///
    /// # Errors
    /// `Interrupted` after such a signal.
    pub fn check(&self) -> Result<()> {
        match self.signal.load(Relaxed) {
            0 => Ok(()),
            signal => Err(Error::new(
                ErrorKind::Interrupted(signal),
                Problem::new("", "stopped by a signal; no output was written"),
            )),
        }
    }
}
