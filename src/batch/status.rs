//! Progress of a batch, for a display.

use std::path::PathBuf;
use std::sync::atomic::AtomicU64;
use std::sync::atomic::Ordering::Relaxed;
use std::sync::{Arc, Mutex};

use serde_json::Value;

use crate::error::{Error, Problem};
use crate::monitor::{Monitor, Phase};
use crate::threads::lock;

/// Counters that a batch updates and a display polls.
#[derive(Debug, Default)]
pub struct Status {
    /// Number of frames of this run.
    pub total: AtomicU64,
    /// Number of frames rendered.
    pub rendered: AtomicU64,
    /// Number of existing frames that were kept.
    pub kept: AtomicU64,
    /// Number of frames that failed.
    pub failed: AtomicU64,
    /// Number of rays of finished frames.
    pub rays: AtomicU64,
    running: Mutex<Vec<Arc<Monitor>>>,
}

impl Status {
    /// Adds a frame whose progress counts until [`Status::ended`].
    pub fn began(&self, monitor: &Arc<Monitor>) {
        let mut running = lock(&self.running);
        running.push(Arc::clone(monitor));
    }

    /// Removes a frame that has ended, whether it succeeded or failed.
    pub fn ended(&self, monitor: &Arc<Monitor>) {
        let mut running = lock(&self.running);
        running.retain(|other| !Arc::ptr_eq(other, monitor));
    }

    /// Returns the sum of the finished fractions of the frames in work, and their rays so far.
    pub fn under_way(&self) -> (f64, u64) {
        let running = lock(&self.running);
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

    /// Returns the number of frames that are rendered, kept or failed.
    pub fn settled(&self) -> u64 {
        [&self.rendered, &self.kept, &self.failed].iter().map(|count| count.load(Relaxed)).sum()
    }
}

/// An event that a run reports to its caller.
#[derive(Debug)]
pub enum Event<'a> {
    /// A mesh was framed.
    Framed {
        /// Path of the input.
        input: &'a str,
        /// Camera of frame 0, in the form of scenes and job files.
        camera: &'a Value,
    },
    /// A warning about an input.
    Warning {
        /// Path of the input.
        input: &'a str,
        /// Text and place of the warning.
        problem: &'a Problem,
    },
    /// An existing frame is rendered again.
    Again {
        /// Reason why the existing files may not stay.
        reason: &'a str,
    },
    /// A frame was written, and its files have their final names.
    Frame {
        /// Paths of its files.
        outputs: &'a [PathBuf],
    },
    /// An input, or a frame of it, failed; the batch goes on.
    Failed {
        /// Path of the input.
        input: &'a str,
        /// Error of the input or frame.
        error: &'a Error,
    },
}
