//! Batch rendering: a [`Job`] of many meshes and frames becomes a folder of pictures and a journal.
//!
//! `description` holds the job file as written; [`Job`] is its checked form. `plan` lists the
//! frames and `pipeline` runs the workers. `scene` turns an input into the scenes of its frames;
//! `mesh` reads, builds and renders it. `gate` orders the workers, `resume` decides which frames
//! may stay, `journal` records events, and `sheet` draws the contact sheet.

mod description;
mod fingerprint;
mod gate;
mod inputs;
mod job;
mod journal;
mod mesh;
mod names;
mod outputs;
mod pipeline;
mod plan;
mod resume;
mod scene;
pub mod sheet;
mod status;
mod sums;

pub use description::{Input as WrittenInput, JobFile, LimitKeys, TurntableKeys};
pub use job::{Flags, Input, Job};
pub use journal::Record;
pub use outputs::{refuse_files, refuse_sheet};
pub use plan::{index, tasks};
pub use scene::predict;
pub use status::{Event, Status};

pub use journal::read as journal;

use std::{ops::Range, path::PathBuf, sync::atomic::Ordering::Relaxed};

use crate::{
    error::{Error, Result},
    monitor::Monitor,
    threads,
};

use journal::{Journal, now};

/// Settings of one batch run.
#[derive(Debug, Clone)]
pub struct Options {
    /// Number of worker threads, at least 1.
    pub threads: usize,
    /// Number of frames rendered at a time. `None`: chosen from the size of the first input's
    /// frames.
    pub jobs: Option<usize>,
    /// Limit in bytes for meshes, accelerators and films together.
    pub max_memory: Option<u64>,
    /// Keeps existing frames that are complete and have the expected fingerprint.
    pub resume: bool,
    /// With `resume`: also requires the bytes of a kept file to match the hash in the journal.
    pub verify: bool,
    /// Starts nothing new after the first failure.
    pub fail_fast: bool,
    /// Range of frame numbers to render. Frames are numbered mesh after mesh. `None`: all frames.
    pub range: Option<Range<u64>>,
}

/// Result of a batch run.
#[derive(Debug)]
pub struct Outcome {
    /// Number of frames rendered.
    pub rendered: u64,
    /// Number of existing frames that were kept.
    pub kept: u64,
    /// Errors by input file: an input that failed, or one of its frames.
    pub failures: Vec<(String, Error)>,
    /// Number of the signal that stopped the run.
    pub signal: Option<i32>,
}

/// Renders a job, writes its journal, and returns what was rendered, kept and failed.
///
/// A finished frame gets its final file names at once.
///
/// # Errors
/// Errors that concern all inputs: an invalid range, a folder that cannot be written, a full disk.
pub fn run(
    job: &Job,
    options: &Options,
    monitor: &Monitor,
    status: &Status,
    tell: &(dyn Fn(Event) + Sync),
) -> Result<Outcome> {
    let tasks = plan::tasks(job.inputs.len(), job.frames(), options.range.as_ref())?;
    let all = 0..plan::index(job.frames(), job.inputs.len(), 0);
    let range = options.range.as_ref().unwrap_or(&all);
    status.total.store(range.end - range.start, Relaxed);
    let loading = threads::pool(options.threads)?;
    let path = journal_path(job, options.range.as_ref());
    let inputs = loading.install(|| -> Result<_> {
        let inputs = outputs::inputs(job);
        outputs::refuse(job, &tasks, &path, &inputs)?;
        Ok(inputs)
    })?;
    std::fs::create_dir_all(&job.folder).map_err(|e| Error::io(&job.folder, "create", &e))?;
    let journal = Journal::open(&path)?;
    let version = env!("CARGO_PKG_VERSION").to_string();
    journal.add(&Record::Start { time: now(), version, range: [range.start, range.end] })?;
    let outcome =
        pipeline::run(job, &tasks, options, (monitor, status, &journal), tell, (loading, inputs))?;
    journal.add(&Record::End {
        time: now(),
        rendered: outcome.rendered,
        kept: outcome.kept,
        failed: outcome.failures.len() as u64,
        signal: outcome.signal,
    })?;
    Ok(outcome)
}

/// Returns the path of the journal: `batch.jsonl`, or a file of its own for a range of frames, so
/// that no two tasks write to the same file.
fn journal_path(job: &Job, range: Option<&Range<u64>>) -> PathBuf {
    job.folder.join(match range {
        None => "batch.jsonl".to_string(),
        Some(range) => format!("batch.{}-{}.jsonl", range.start, range.end),
    })
}
