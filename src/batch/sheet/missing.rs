//! Finds the frames that a batch has not rendered or could not render again, and why.

use crate::batch::job::Job;
use crate::batch::journal;
use crate::error::Problem;
use crate::units;

use super::entry::SheetEntry;

/// Returns one problem per input that lacks frames, or that failed after its frames were made. The
/// result is empty if the files of every frame exist and are complete, and no failure came later.
///
/// The reason is the first line of the failure in the journals of the frame with the lowest index.
/// A task that was killed leaves no reason.
pub fn missing(job: &Job) -> Vec<Problem> {
    let entries = SheetEntry::all(job, &journal::read(&job.folder));
    let problem = |entry: &SheetEntry| {
        let made = |frame: &u32| entry.frames.contains_key(frame);
        let missing: Vec<u32> = (0..job.frames()).filter(|frame| !made(frame)).collect();
        let (frames, state) = match missing.is_empty() {
            true => (entry.failures.keys().copied().collect(), "older than a failure"),
            false => (missing, "missing"),
        };
        let what = match (frames.len() == job.frames() as usize, frames.len()) {
            (_, 0) => return None,
            (true, _) => format!("all frames are {state}"),
            (false, 1) => format!("frame {} is {state}", units::ranges(&frames)),
            (false, _) => format!("frames {} are {state}", units::ranges(&frames)),
        };
        let message = entry.message();
        let why = message.as_ref().and_then(|message| message.lines().next());
        let why = why.unwrap_or("no task made them or said why not");
        Some(Problem::new(&entry.input, format!("{what}: {why}")))
    };
    entries.iter().filter_map(problem).collect()
}
