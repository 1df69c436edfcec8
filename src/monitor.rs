//! What a long job shares with whoever watches it: how far it is, and whether to stop.

use std::sync::{
    Arc,
    atomic::{AtomicI32, AtomicU8, AtomicU64, Ordering::Relaxed},
};

use crate::error::{Error, Kind, Problem, Result};

/// What the job is doing.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[repr(u8)]
pub enum Phase {
    /// Reading and preparing the scene.
    Load = 0,
    /// Building the accelerator; `done` of `total` are thousandths.
    Build = 1,
    /// Tracing; `done` of `total` are pixels.
    Render = 2,
    /// Writing files.
    Write = 3,
    /// Judging answers; `done` of `total` are packets of rays.
    Check = 4,
}

/// Counters that the job writes and a progress display polls; a signal that stops the job.
#[derive(Debug, Default)]
pub struct Monitor {
    /// 0, or the number of the signal that asks the job to stop.
    pub signal: Arc<AtomicI32>,
    /// Steps done in this phase.
    pub done: AtomicU64,
    /// Steps of this phase.
    pub total: AtomicU64,
    /// Rays traced so far.
    pub rays: AtomicU64,
    phase: AtomicU8,
}

impl Monitor {
    /// Counters of their own for a part of the job; a signal stops both.
    pub fn part(&self) -> Self {
        Self { signal: Arc::clone(&self.signal), ..Self::default() }
    }

    /// Starts a phase of `total` steps.
    pub fn begin(&self, phase: Phase, total: u64) {
        self.done.store(0, Relaxed);
        self.total.store(total, Relaxed);
        self.phase.store(phase as u8, Relaxed);
    }

    /// The current phase.
    pub fn phase(&self) -> Phase {
        match self.phase.load(Relaxed) {
            0 => Phase::Load,
            1 => Phase::Build,
            2 => Phase::Render,
            3 => Phase::Write,
            _ => Phase::Check,
        }
    }

    /// Sets how many steps of this phase are done.
    pub fn set_done(&self, done: u64) {
        self.done.store(done, Relaxed);
    }

    /// Whether a signal asked the job to stop.
    pub fn stopped(&self) -> bool {
        self.signal.load(Relaxed) != 0
    }

    /// An error once a signal asked the job to stop.
    pub fn check(&self) -> Result<()> {
        match self.signal.load(Relaxed) {
            0 => Ok(()),
            signal => Err(Error::new(
                Kind::Interrupted(signal),
                Problem::new("", "stopped by a signal; no output was written"),
            )),
        }
    }
}
