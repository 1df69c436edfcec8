//! Batch rendering: a [`Job`] of many meshes and frames becomes a folder of pictures and a journal.
//!
//! `description` holds the job file as written; [`Job`] is its checked form. `tasks` lists the
//! frames and `workers` renders them. `scene` turns an input into the scenes of its frames;
//! `mesh` reads, builds and renders it, once for each origin of `origins`. `gate` orders the
//! workers, `resume` decides which frames may stay, `journal` records events, and `sheet` draws the
//! contact sheet.

mod cameras;
mod description;
mod file_hashes;
mod fingerprint;
mod flags;
mod gate;
mod inputs;
mod job;
mod journal;
mod mesh;
mod names;
mod origins;
mod outputs;
mod places;
mod resume;
mod scene;
pub mod sheet;
mod status;
mod tasks;
mod workers;

pub use description::{Input as WrittenInput, JobFile, LimitKeys, TurntableKeys};
pub use flags::Flags;
pub use job::{Job, without_mesh};
pub use journal::{FrameRecord, JournalRecord};
pub use outputs::{
    check_lengths, refuse_files, refuse_foreign_sheet, refuse_photographs, refuse_sheet, task_files,
};
pub use places::Places;
pub use scene::{check_settings, predict};
pub use status::{Event, Status};
pub use tasks::{Task, index, tasks};
pub use workers::{BatchOptions, Outcome};

pub use journal::read as journal;

use std::ops::Range;
use std::path::PathBuf;
use std::sync::atomic::Ordering::Relaxed;

use crate::error::{Error, Result};
use crate::monitor::Monitor;
use crate::threads;

use journal::{Journal, now};

/// Renders a job, writes its journal, and returns the numbers of frames rendered and kept, and the
/// failures. Calls `tell` with each event.
///
/// The files of a frame get their final names as soon as the frame is finished.
///
/// # Errors
/// Errors that concern all inputs: an invalid range, an output that would overwrite an input or a
/// photograph, a pipe among the files of an input, a folder that cannot be written, a disk that is
/// full at the start or at the end.
pub fn run(
    job: &Job,
    options: &BatchOptions,
    monitor: &Monitor,
    status: &Status,
    tell: &(dyn Fn(Event) + Sync),
) -> Result<Outcome> {
    let tasks = tasks::tasks(job.inputs.len(), job.frames(), options.range.as_ref())?;
    let all = 0..tasks::index(job.frames(), job.inputs.len(), 0);
    let range = options.range.as_ref().unwrap_or(&all);
    status.total.store(range.end - range.start, Relaxed);
    let loading = threads::pool(options.threads)?;
    let path = journal_path(job, options.range.as_ref());
    let inputs = loading.install(|| -> Result<_> {
        let inputs = outputs::inputs(job, monitor)?;
        outputs::refuse(job, &tasks, &path, &inputs)?;
        outputs::refuse_photographs(job, &tasks)?;
        Ok(inputs)
    })?;
    std::fs::create_dir_all(&job.folder).map_err(|e| Error::io(&job.folder, "create", &e))?;
    let journal = Journal::open(&path)?;
    let version = env!("CARGO_PKG_VERSION").to_string();
    journal.add(&JournalRecord::Start { time: now(), version, range: [range.start, range.end] })?;
    let outcome =
        workers::run(job, &tasks, options, (monitor, status, &journal), tell, (loading, inputs))?;
    let ended = journal.add(&JournalRecord::End {
        time: now(),
        rendered: outcome.rendered,
        kept: outcome.kept,
        failed: status.failed.load(Relaxed),
        signal: outcome.signal,
    });
    // After a fatal error, such as a full disk, the failures are more telling.
    ended.or_else(|error| if outcome.fatal.is_some() { Ok(()) } else { Err(error) })?;
    Ok(outcome)
}

/// Returns the path of the journal: `batch.jsonl`. A range of frames has a journal of its own, so
/// that no two tasks of a farm write to the same file.
fn journal_path(job: &Job, range: Option<&Range<u64>>) -> PathBuf {
    job.folder.join(match range {
        None => "batch.jsonl".to_string(),
        Some(range) => format!("batch.{}-{}.jsonl", range.start, range.end),
    })
}
