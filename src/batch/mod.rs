//! Many meshes, many frames: a [`Job`] in, a folder of pictures out, and a journal of what happened.
//!
//! `description` (as written) -> [`Job`] (checked) -> `plan` (which frames) -> `pipeline` (workers) ->
//! `scene` (an input becomes the scenes of its frames) -> `mesh` (read, built, rendered). `gate` says who
//! may go on, `resume` which frames may stay, `journal` what has happened, `sheet` shows it.

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

pub use description::{
    Entry, Input as WrittenInput, JobFile, LimitKeys, OutputKeys, TurntableKeys,
};
pub use job::{Flags, Input, Job};
pub use journal::{FrameRecord, MeshRecord, Record};
pub use names::Pattern;
pub use outputs::refuse_sheet;
pub use plan::{Task, index, tasks};
pub use scene::predict;
pub use status::{Event, Status};

pub use journal::read as journal;

use std::{ops::Range, path::PathBuf, sync::atomic::Ordering::Relaxed};

use crate::{
    error::{Error, Result},
    monitor::Monitor,
};

use journal::{Journal, now};

/// How a batch runs.
#[derive(Debug, Clone)]
pub struct Options {
    /// Worker threads, >= 1.
    pub threads: usize,
    /// Frames rendered at a time; by their size unless given.
    pub jobs: Option<usize>,
    /// The most that meshes, accelerators and films may take together.
    pub max_memory: Option<u64>,
    /// Keep frames that are whole and of the same fingerprint.
    pub resume: bool,
    /// Keep only frames whose bytes are those that were written.
    pub verify: bool,
    /// Begin nothing new after the first failure.
    pub fail_fast: bool,
    /// Numbers of the frames to render, of all frames mesh after mesh; all unless given.
    pub range: Option<Range<u64>>,
}

/// What came of a run.
#[derive(Debug)]
pub struct Outcome {
    /// Frames rendered.
    pub rendered: u64,
    /// Frames that were there.
    pub kept: u64,
    /// Inputs that failed, or frames of theirs.
    pub failures: Vec<(String, Error)>,
    /// The signal that stopped it.
    pub signal: Option<i32>,
}

/// Renders a job. Finished frames are final at once; the journal says what happened.
///
/// # Errors
/// What concerns all inputs: a range that is none, a folder that cannot be written, a full disk.
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
    let loading = pipeline::pool(options.threads)?;
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

/// `batch.jsonl`; of a range a file of its own, so that no two tasks write one.
fn journal_path(job: &Job, range: Option<&Range<u64>>) -> PathBuf {
    job.folder.join(match range {
        None => "batch.jsonl".to_string(),
        Some(range) => format!("batch.{}-{}.jsonl", range.start, range.end),
    })
}
