//! The workers of a batch run.
//!
//! Each worker takes the next input (a mesh or scene), reads it, builds its accelerator, renders
//! its frames and drops it. There is one worker more than frames rendered at a time. So the next
//! mesh is ready when the previous mesh is done. [`gate`](super::gate) keeps the order.

use std::io;
use std::ops::Range;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::Path;
use std::sync::atomic::Ordering::Relaxed;
use std::sync::atomic::{AtomicBool, AtomicUsize};
use std::sync::{Mutex, PoisonError};

use crate::accel::{MemoryFootprint, memory_footprint};
use crate::error::{Error, ErrorKind, Problem, Result};
use crate::files::FileSet;
use crate::memory::{self, Prediction};
use crate::monitor::Monitor;
use crate::output::atomic::{PartFile, Sweep};
use crate::render::RayCounts;
use crate::reserve::MemoryLimit;
use crate::scene::Backend;
use crate::threads::{self, Pool, lock};
use crate::units::plural;
use crate::world::ReadFiles;

use super::file_hashes::FileHashes;
use super::fingerprint::Settings;
use super::gate::{MemoryGate, RenderPermits};
use super::job::{Job, JobInput};
use super::journal::{Journal, JournalRecord};
use super::status::{Event, Status};
use super::tasks::Task;
use super::{outputs, scene};

/// Tiles of 32 x 32 pixels per thread: enough to keep a thread busy while others finish theirs.
const TILES_PER_THREAD: usize = 8;

/// Share of the available memory that meshes may take if the user sets no limit.
const SHARE_OF_AVAILABLE: f64 = 0.6;

/// Settings of one batch run.
#[derive(Debug, Clone)]
pub struct BatchOptions {
    /// Number of worker threads, at least 1.
    pub threads: usize,
    /// Number of frames rendered at a time. `None`: derived from the picture size of the first
    /// task.
    pub jobs: Option<usize>,
    /// Limit in bytes for the whole run: meshes, textures, accelerators and films together.
    pub max_memory: Option<u64>,
    /// Keeps existing frames that are complete and have the expected fingerprint.
    pub resume: bool,
    /// With `resume`: also requires the bytes of a kept file to match the hash in the journal.
    pub verify: bool,
    /// Starts nothing new after the first failure.
    pub fail_fast: bool,
    /// Range of frame indices to render ([`super::index`]). `None`: all frames.
    pub range: Option<Range<u64>>,
}

/// Result of a batch run.
#[derive(Debug)]
pub struct Outcome {
    /// Number of frames rendered.
    pub rendered: u64,
    /// Number of existing frames that were kept.
    pub kept: u64,
    /// Index of an input, and the error of this input or of one of its frames.
    pub failures: Vec<(usize, Error)>,
    /// Error that ended the run, because all later frames would have it: a full disk.
    pub fatal: Option<Error>,
    /// Number of the signal that stopped the run.
    pub signal: Option<i32>,
}

/// Memory of a task that may begin.
#[derive(Debug)]
pub struct Share {
    /// Memory of its input with one film.
    pub prediction: Prediction,
    /// Maximum number of films at a time.
    pub films: u64,
    /// If the run has a limit of memory, the part of it in bytes that this task may use.
    pub bytes: u64,
}

/// State shared by all workers of a run.
pub struct Run<'a> {
    pub job: &'a Job,
    pub tasks: &'a [Task],
    pub options: &'a BatchOptions,
    pub monitor: &'a Monitor,
    pub status: &'a Status,
    pub journal: &'a Journal,
    pub tell: &'a (dyn Fn(Event) + Sync),
    pub sweep: Sweep,
    pub settings: Settings,
    /// Threads that trace rays and write files.
    pub pool: Pool,
    /// Threads that read meshes and build accelerators, so that these do not wait for rays.
    pub loading: Pool,
    /// Files that the job reads and that are known before a mesh is read.
    inputs: FileSet,
    /// Hashes of the files that earlier runs wrote, if `--resume` checks them.
    pub hashes: Option<FileHashes>,
    pub permits: RenderPermits,
    pub jobs: usize,
    memory: MemoryGate,
    /// Memory that the process could still get when the run began.
    memory_limit: Option<MemoryLimit>,
    next: AtomicUsize,
    footprints: Mutex<Vec<(Backend, MemoryFootprint)>>,
    stop: AtomicBool,
    fatal: Mutex<Option<Error>>,
    failures: Mutex<Vec<(usize, Error)>>,
    /// True if a run has warned of frames that differ in brightness.
    told_of_flicker: AtomicBool,
}

/// Runs the tasks of a job and returns the outcome, which includes the errors of single inputs.
///
/// # Errors
/// Threads that cannot be started.
pub fn run(
    job: &Job,
    tasks: &[Task],
    options: &BatchOptions,
    (monitor, status, journal): (&Monitor, &Status, &Journal),
    tell: &(dyn Fn(Event) + Sync),
    (loading, inputs): (Pool, FileSet),
) -> Result<Outcome> {
    let jobs = options.jobs.unwrap_or_else(|| jobs(job, tasks, options));
    let limit = options.max_memory.unwrap_or_else(|| {
        let available = memory::available_bytes().unwrap_or(u64::MAX);
        (available as f64 * SHARE_OF_AVAILABLE) as u64
    });
    let run = Run {
        job,
        tasks,
        options,
        monitor,
        status,
        journal,
        tell,
        sweep: Sweep::default(),
        settings: Settings::of(job),
        pool: threads::pool(options.threads)?,
        loading,
        inputs,
        hashes: (options.resume && options.verify)
            .then(|| FileHashes::read(&job.folder, outputs::run_files(job, tasks))),
        permits: RenderPermits::new(jobs),
        jobs,
        memory: MemoryGate::new(limit),
        memory_limit: memory::limit_before_kill(),
        next: AtomicUsize::new(0),
        footprints: Mutex::default(),
        stop: AtomicBool::new(false),
        fatal: Mutex::default(),
        failures: Mutex::default(),
        told_of_flicker: AtomicBool::new(false),
    };
    together((jobs + 1).min(tasks.len()), || run.work());
    let failures = run.failures.into_inner().unwrap_or_else(PoisonError::into_inner);
    Ok(Outcome {
        rendered: status.rendered.load(Relaxed),
        kept: status.kept.load(Relaxed),
        failures,
        fatal: run.fatal.into_inner().unwrap_or_else(PoisonError::into_inner),
        signal: Some(monitor.signal.load(Relaxed)).filter(|signal| *signal != 0),
    })
}

/// Runs `work` on this thread and on up to `count - 1` further threads, as many as the system can
/// start. Returns when all have returned.
pub fn together(count: usize, work: impl Fn() + Sync) {
    std::thread::scope(|scope| {
        for _ in 1..count {
            // Fewer threads are no error: the threads share the work.
            if std::thread::Builder::new().spawn_scoped(scope, &work).is_err() {
                break;
            }
        }
        work();
    });
}

/// Returns the number of frames to render at a time: one if a frame keeps all threads busy, more if
/// frames are small.
fn jobs(job: &Job, tasks: &[Task], options: &BatchOptions) -> usize {
    let threads = options.threads;
    let first = tasks.first().map(|task| scene::predict(job, task));
    let Some(Ok((scene, _))) = first else {
        return 1;
    };
    let tiles = |side: u32| (side + 2 * job.overscan).div_ceil(32) as usize;
    let tiles = tiles(scene.camera.width) * tiles(scene.camera.height);
    (TILES_PER_THREAD * threads / tiles).clamp(1, 2 * threads)
}

impl Run<'_> {
    fn work(&self) {
        loop {
            let number = self.next.fetch_add(1, Relaxed);
            let Some(task) = self.tasks.get(number) else {
                return;
            };
            let input = self.job.inputs[task.input].path.display().to_string();
            let predicted = match self.stopped() {
                true => Ok((Backend::default(), Prediction::default())),
                false => guarded(|| self.predict(task)),
            };
            // Without `--max-memory`, a mesh must fit into what the machine had when the run began.
            let machine = self.memory_limit.filter(|_| self.options.max_memory.is_none());
            let limit = self.options.max_memory.or(machine.map(|limit| limit.bytes));
            // A frame is written while the next ones are traced. Fewer films are held at a time if
            // these do not fit.
            let most = (self.jobs + 1).min(task.frames.len()) as u64;
            let films_of = |p: &Prediction| p.films_within(limit.unwrap_or(u64::MAX), most);
            let films = predicted.as_ref().map_or(1, |(_, p)| films_of(p));
            let of_films = |p: &Prediction| p.clone().with_films(films).peak_bytes;
            let bytes = predicted.as_ref().map_or(0, |(_, p)| of_films(p));
            let predicted = predicted.and_then(|(backend, prediction)| {
                let build = prediction.accelerator_peak_bytes.unwrap_or(0);
                machine.map_or(Ok(()), |limit| {
                    let less = memory::less_than_predicted(backend, build, bytes, limit.bytes);
                    limit.check(bytes, &input).map_err(|error| error.maybe_help(less))
                })?;
                Ok(prediction)
            });
            // Enters even after an error or a stop: the next mesh waits until this one has entered.
            let held = self.memory.enter(number, bytes);
            if self.stopped() {
                continue;
            }
            let mut left = task.frames.len() as u64;
            let done = predicted.and_then(|prediction| {
                let share = Share { prediction, films, bytes: held.share };
                guarded(|| self.mesh((number, task), &input, share, &mut left))
            });
            if let Err(error) = done {
                self.failed(task.input, None, left, error);
            }
        }
    }

    /// Predicts the memory of a task, accelerator included. Also returns its backend.
    ///
    /// # Errors
    /// `Limit` if it exceeds `--max-memory`; headers that cannot be read.
    fn predict(&self, task: &Task) -> Result<(Backend, Prediction)> {
        let (scene, prediction) = scene::predict(self.job, task)?;
        let known = lock(&self.footprints).iter().find(|f| f.0 == scene.backend).map(|f| f.1);
        let footprint = match known {
            Some(footprint) => footprint,
            None => {
                let measure = || memory_footprint(scene.backend, self.options.threads);
                let footprint = self.loading.install(measure)?;
                lock(&self.footprints).push((scene.backend, footprint));
                footprint
            }
        };
        let prediction = prediction.with(&footprint);
        if let Some(limit) = self.options.max_memory {
            prediction.check(limit)?;
        }
        Ok((scene.backend, prediction))
    }

    /// Refuses outputs of this run that are files which an input has read.
    ///
    /// Checks only files that were unknown at the start: those of an input that could not be read
    /// then, or that has changed since.
    pub fn refuse_if_output(&self, read: &ReadFiles) -> Result<()> {
        let new: FileSet = read.paths().filter(|path| !self.inputs.has(path)).collect();
        match new.is_empty() {
            true => Ok(()),
            false => outputs::refuse(self.job, self.tasks, self.journal.path(), &new),
        }
    }

    /// Returns true if no new work may begin: after a signal, a fatal error, or a failure with
    /// `fail_fast`.
    pub fn stopped(&self) -> bool {
        self.monitor.stopped() || self.stop.load(Relaxed)
    }

    /// Records frames of an input that are kept as they are.
    pub fn kept(&self, number: usize, frames: Vec<u32>) -> Result<()> {
        self.status.kept.fetch_add(frames.len() as u64, Relaxed);
        if frames.is_empty() {
            return Ok(());
        }
        let (input, name) = self.named(number);
        self.journal.add(&JournalRecord::Kept { input, name, frames })
    }

    /// Returns the path of an input and its identity, for the journal.
    pub fn named(&self, number: usize) -> (String, Option<String>) {
        let input = self.job.inputs[number].path.display().to_string();
        (input, Some(self.job.identity(number)))
    }

    /// Records the failure of an input or of one of its frames, and counts `frames` frames that are
    /// not made. The batch continues, unless `fail_fast` is set. An interruption by a signal is no
    /// failure.
    pub fn failed(&self, number: usize, frame: Option<u32>, frames: u64, error: Error) {
        if let ErrorKind::Interrupted(_) = error.kind {
            return;
        }
        // A file with thousands of errors must not hide those of other files.
        let error = error.shortened(|more| plural(more, "more problem"));
        self.status.failed.fetch_add(frames, Relaxed);
        let (input, name) = self.named(number);
        (self.tell)(Event::Failed { input: &input, error: &error });
        let messages: Vec<String> = error.problems.iter().map(Problem::to_string).collect();
        let message = messages.join("\n");
        let record = JournalRecord::Failed { input, name, frame, message };
        if let Err(error) = self.journal.add(&record) {
            self.end(error);
        }
        lock(&self.failures).push((number, error));
        if self.options.fail_fast {
            self.stop.store(true, Relaxed);
        }
    }

    /// Ends the batch after an error that every later frame would have, too.
    pub fn end(&self, error: Error) {
        self.stop.store(true, Relaxed);
        if !matches!(error.kind, ErrorKind::Interrupted(_)) {
            lock(&self.fatal).get_or_insert(error);
        }
    }

    /// Ends the batch after an error of writing that later frames would have, too.
    pub fn end_if_shared(&self, error: &Error) {
        if is_shared(error, &self.job.folder) {
            self.end(error.clone());
        }
    }

    /// Reports warnings and returns their texts.
    pub fn warn(&self, input: &str, problems: &[Problem]) -> Vec<String> {
        for problem in problems {
            (self.tell)(Event::Warning { input, problem });
        }
        problems.iter().map(Problem::to_string).collect()
    }

    /// Warns of frames that differ in brightness, once in a run. Returns the text.
    pub fn warn_of_flicker(&self, path: &str, input: &JobInput) -> Vec<String> {
        // To find it out, the scene is read once more.
        if self.told_of_flicker.load(Relaxed) {
            return Vec::new();
        }
        let told = || self.told_of_flicker.swap(true, Relaxed);
        match scene::flicker(self.job, input).filter(|_| !told()) {
            Some(warning) => self.warn(path, &[warning]),
            None => Vec::new(),
        }
    }

    /// Removes part files that killed runs left beside the files of a frame.
    pub fn sweep_frame(&self, targets: &[impl AsRef<Path>]) {
        for target in targets {
            self.sweep.target(target.as_ref());
        }
    }

    /// Counts a frame that is written and named, and its rays.
    pub fn finished(&self, counts: &RayCounts) {
        self.status.rendered.fetch_add(1, Relaxed);
        self.status.rays.fetch_add(counts.all(), Relaxed);
    }
}

/// Returns true if an error of writing is not about one name: a disk is full, another resource is
/// exhausted (`Retry`), or the disk of the job's `folder` is read-only. A folder in it may be on
/// another disk. A part file that another process has removed (`Retry`, too) is one name.
fn is_shared(error: &Error, folder: &Path) -> bool {
    let has = |cause| error.problems.iter().any(|problem| problem.cause == Some(cause));
    error.kind == ErrorKind::Retry && !has(io::ErrorKind::NotFound)
        || has(io::ErrorKind::ReadOnlyFilesystem)
            && PartFile::create(&folder.join("probe")).is_err()
}

/// Runs `work`, and turns a panic into an error: a bug must not end the batch.
pub fn guarded<T>(work: impl FnOnce() -> Result<T>) -> Result<T> {
    catch_unwind(AssertUnwindSafe(work)).unwrap_or_else(|_| {
        let message = "the program failed here because of a bug; the batch goes on";
        let problem = Problem::new("", message).help("please report it with the file");
        Err(Error::new(ErrorKind::Unsupported, problem))
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_disk_that_is_full_or_read_only_ends_the_batch_and_one_bad_name_does_not() {
        use io::ErrorKind as E;
        let kinds = [E::StorageFull, E::ReadOnlyFilesystem, E::PermissionDenied, E::IsADirectory];
        let errors = kinds.map(|kind| Error::io("a.exr".as_ref(), "create", &kind.into()));
        let shared =
            |folder: &Path| errors.iter().map(|e| is_shared(e, folder)).collect::<Vec<_>>();
        let nowhere = Path::new("/no such folder");
        assert_eq!(shared(nowhere), [true, true, false, false]);
        // Only a folder of some frames is read-only.
        let folder = tempfile::tempdir().unwrap();
        assert_eq!(shared(folder.path()), [true, false, false, false]);
        let removed = Problem::new("a.exr", "its part file was removed").cause(E::NotFound);
        assert!(!is_shared(&Error::new(ErrorKind::Retry, removed), folder.path()));
        assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 0);
    }
}
