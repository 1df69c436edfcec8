//! How far a batch is, for whoever shows it.

use std::{
    path::PathBuf,
    sync::{
        Arc, Mutex, PoisonError,
        atomic::{AtomicU64, Ordering::Relaxed},
    },
};

use serde_json::Value;

use crate::{
    error::{Error, Problem},
    monitor::{Monitor, Phase},
};

/// Counters that a batch writes and a display polls.
#[derive(Debug, Default)]
pub struct Status {
    /// Frames of this run.
    pub total: AtomicU64,
    /// Frames rendered.
    pub rendered: AtomicU64,
    /// Frames that were there.
    pub kept: AtomicU64,
    /// Frames that failed.
    pub failed: AtomicU64,
    /// Rays of finished frames.
    pub rays: AtomicU64,
    running: Mutex<Vec<Arc<Monitor>>>,
}

impl Status {
    /// Counts what this monitor says until [`Status::ended`].
    pub fn began(&self, monitor: &Arc<Monitor>) {
        let mut running = self.running.lock().unwrap_or_else(PoisonError::into_inner);
        running.push(Arc::clone(monitor));
    }

    /// A frame is over, however it ended.
    pub fn ended(&self, monitor: &Arc<Monitor>) {
        let mut running = self.running.lock().unwrap_or_else(PoisonError::into_inner);
        running.retain(|other| !Arc::ptr_eq(other, monitor));
    }

    /// Frames that are under way, in parts of whole ones, and the rays they took.
    pub fn under_way(&self) -> (f64, u64) {
        let running = self.running.lock().unwrap_or_else(PoisonError::into_inner);
        running.iter().fold((0.0, 0), |(frames, rays), monitor| {
            let part = match monitor.phase() {
                Phase::Render => {
                    let total = monitor.total.load(Relaxed).max(1);
                    monitor.done.load(Relaxed).min(total) as f64 / total as f64
                }
                Phase::Write => 1.0,
                Phase::Load | Phase::Build | Phase::Check => 0.0,
            };
            (frames + part, rays + monitor.rays.load(Relaxed))
        })
    }

    /// Frames that need nothing more.
    pub fn settled(&self) -> u64 {
        [&self.rendered, &self.kept, &self.failed].iter().map(|count| count.load(Relaxed)).sum()
    }
}

/// What happens, for whoever tells the user.
#[derive(Debug)]
pub enum Event<'a> {
    /// A mesh is framed: its camera as scenes and job files write it.
    Framed {
        /// Its file.
        input: &'a str,
        /// The scene's `camera`.
        camera: &'a Value,
    },
    /// Something is suspicious.
    Warning {
        /// The input's file.
        input: &'a str,
        /// What.
        problem: &'a Problem,
    },
    /// A frame that is there is rendered again.
    Again {
        /// Why.
        reason: &'a str,
    },
    /// A frame has its names.
    Frame {
        /// Its files.
        outputs: &'a [PathBuf],
    },
    /// An input, or a frame of it, failed; the batch goes on.
    Failed {
        /// The input's file.
        input: &'a str,
        /// What is wrong.
        error: &'a Error,
    },
}
