//! Finds the frames that a batch has not rendered, that are not those of its job as it is now, or
//! that it could not render again, and why.

use std::collections::BTreeMap;

use crate::batch::fingerprint::Settings;
use crate::batch::job::Job;
use crate::batch::journal;
use crate::batch::resume::Resume;
use crate::batch::scene;
use crate::batch::tasks::Task;
use crate::error::{Problem, Result};
use crate::monitor::Monitor;
use crate::output::Outputs;
use crate::reserve::MemoryLimit;
use crate::units;
use crate::world::ContentHashes;

use super::entry::SheetEntry;

/// Returns the problems of each input, in the order of the job: frames that are missing, frames
/// that are older than its settings or files, a failure after its frames were made. An input has
/// none if `--resume` would keep all its frames, and no failure came later.
///
/// Reads the inputs that have frames, one after the other, on the threads of the current rayon
/// pool. `memory_limit` limits the arrays of a mesh.
///
/// The reason is the first line of the failure in the journals of the frame with the lowest index,
/// or that of its files. A task that was killed leaves no reason.
pub fn missing(job: &Job, memory_limit: Option<MemoryLimit>) -> Vec<Vec<Problem>> {
    let entries = SheetEntry::all(job, &journal::read(&job.folder));
    entries.iter().map(|entry| problems(job, entry, memory_limit)).collect()
}

fn problems(job: &Job, entry: &SheetEntry, memory_limit: Option<MemoryLimit>) -> Vec<Problem> {
    let made = |frame: &u32| entry.frames.contains_key(frame);
    let missing: Vec<u32> = (0..job.frames()).filter(|frame| !made(frame)).collect();
    let message = entry.message();
    let failure = message.as_ref().and_then(|message| message.lines().next());
    let problem = |frames: &[u32], state: &str, why: &str| {
        let what = match (frames.len() == job.frames() as usize, frames.len()) {
            (true, _) => format!("all frames are {state}"),
            (false, 1) => format!("frame {} is {state}", units::ranges(frames)),
            (false, _) => format!("frames {} are {state}", units::ranges(frames)),
        };
        Problem::new(&entry.input, format!("{what}: {why}"))
    };
    let stale = stale(job, entry.number, memory_limit);
    let reasons = stale.as_ref().ok();
    let mut problems = Vec::new();
    if let Some(first) = missing.first() {
        let file = reasons.and_then(|reasons| reasons.get(first)).map(String::as_str);
        let why = failure.or(file).unwrap_or("no task made them or said why not");
        problems.push(problem(&missing, "missing", why));
    }
    let older = reasons.into_iter().flatten().filter(|(frame, _)| made(frame));
    let (older, whys): (Vec<u32>, Vec<&str>) = older.map(|(f, why)| (*f, why.as_str())).unzip();
    if let Some(why) = whys.first() {
        problems.push(problem(&older, "older than the job", why));
    }
    let failed: Vec<u32> = entry.failures.keys().copied().collect();
    match (problems.is_empty(), failure, stale.err()) {
        (true, Some(why), _) => problems.push(problem(&failed, "older than a failure", why)),
        (true, None, Some(error)) => {
            let first = error.problems.first().map(Problem::to_string).unwrap_or_default();
            let message = format!("its frames cannot be compared with it: {first}");
            problems.push(Problem::new(&entry.input, message));
        }
        _ => {}
    }
    problems
}

/// Returns the frames of an input that `--resume` would render again although they have files, and
/// why. Compares fingerprints, and does not read all bytes of the files.
///
/// # Errors
/// All problems of the input.
fn stale(
    job: &Job,
    number: usize,
    memory_limit: Option<MemoryLimit>,
) -> Result<BTreeMap<u32, String>> {
    let files = |frame| Outputs::names(&job.prefix(number, frame));
    if !(0..job.frames()).any(|frame| files(frame).iter().any(|path| path.exists())) {
        return Ok(BTreeMap::new());
    }
    let ready = scene::read(job, &job.inputs[number], memory_limit, &Monitor::default())?;
    let task = Task { input: number, frames: 0..job.frames() };
    let mut contents = ContentHashes::default();
    let resume = Resume::Keep(None);
    let (settings, monitor) = (Settings::of(job), Monitor::default());
    let (frames, _) = ready.frames((job, &task), resume, &settings, &mut contents, &monitor)?;
    Ok(frames.into_iter().filter_map(|frame| Some((frame.number, frame.again?))).collect())
}
