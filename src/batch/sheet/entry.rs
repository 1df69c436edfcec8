//! Collects the state of each input of a batch from its files and journals.

use std::collections::{BTreeMap, HashMap};
use std::path::PathBuf;

use rayon::prelude::*;

use crate::batch::job::{Job, JobInput};
use crate::batch::journal::{FrameRecord, JournalRecord, MeshRecord};
use crate::output::Outputs;
use crate::output::finished::{self, FileState};

/// State of one input of a job.
#[derive(Debug, Clone, Default)]
pub struct SheetEntry {
    /// Index of the input in the job.
    pub number: usize,
    /// Path of the input.
    pub input: String,
    /// Frames whose files are complete, with their records if a journal has these.
    pub frames: BTreeMap<u32, Option<FrameRecord>>,
    /// Number of frames that the job expects.
    pub of: u32,
    /// Record of reading and building, if a journal has one.
    pub mesh: Option<MeshRecord>,
    /// Failures that no later record has resolved, by frame. The key `None` is a failure of the
    /// whole input; a rendered or kept frame resolves it.
    pub failures: BTreeMap<Option<u32>, String>,
}

/// Returns true if all files of a frame exist and are complete.
fn is_whole(job: &Job, input: usize, frame: u32, record: Option<&FrameRecord>) -> bool {
    let [exr, png] = Outputs::names(&job.prefix(input, frame));
    let is_there = |path: &PathBuf| job.folder.join(path).is_file();
    matches!(finished::exr(&exr), FileState::Whole(_))
        && matches!(finished::png(&png), FileState::Whole(_))
        && record.is_none_or(|record| record.outputs.iter().all(is_there))
}

impl SheetEntry {
    /// Returns the entries of all inputs of a job, in its order. `frames` holds only frames whose
    /// files are complete.
    ///
    /// Checks files on the threads of the current rayon pool.
    pub fn all(job: &Job, records: &[JournalRecord]) -> Vec<Self> {
        let mut by_name: HashMap<String, Self> = HashMap::new();
        for record in records {
            let input = match record {
                JournalRecord::Mesh(mesh) => &mesh.input,
                JournalRecord::Frame(frame) => &frame.input,
                JournalRecord::Kept { input, .. } | JournalRecord::Failed { input, .. } => input,
                JournalRecord::Start { .. } | JournalRecord::End { .. } => continue,
            };
            by_name.entry(input.clone()).or_default().add(record);
        }
        let inputs = job.inputs.par_iter().enumerate();
        let entry = |(number, input): (usize, &JobInput)| {
            let (input, of) = (input.path.display().to_string(), job.frames());
            let mut known = by_name.get(&input).cloned().unwrap_or_default();
            known.failures.retain(|frame, _| frame.is_none_or(|frame| frame < of));
            let frames = (0..of).into_par_iter().filter_map(|frame| {
                let record = known.frames.get(&frame).cloned().flatten();
                is_whole(job, number, frame, record.as_ref()).then_some((frame, record))
            });
            let frames = frames.collect::<Vec<_>>().into_iter().collect();
            Self { number, input, of, frames, ..known }
        };
        inputs.map(entry).collect()
    }

    fn add(&mut self, record: &JournalRecord) {
        match record {
            JournalRecord::Mesh(mesh) => {
                self.failures.remove(&None);
                self.mesh = Some(mesh.clone());
            }
            JournalRecord::Frame(frame) => {
                self.clear_failures(frame.frame);
                self.frames.insert(frame.frame, Some(frame.clone()));
            }
            JournalRecord::Kept { frames, .. } => {
                for frame in frames {
                    self.clear_failures(*frame);
                    self.frames.entry(*frame).or_default();
                }
            }
            JournalRecord::Failed { frame, message, .. } => {
                self.failures.insert(*frame, message.clone());
            }
            JournalRecord::Start { .. } | JournalRecord::End { .. } => {}
        }
    }

    fn clear_failures(&mut self, frame: u32) {
        self.failures.remove(&None);
        self.failures.remove(&Some(frame));
    }

    /// Returns the file name of the input.
    pub fn name(&self) -> &str {
        self.input.rsplit('/').next().unwrap_or(&self.input)
    }

    /// Returns the seconds of tracing and writing, summed over all frames on record.
    pub fn seconds(&self) -> f64 {
        self.records().map(|frame| frame.render_s + frame.write_s).sum()
    }

    /// Returns the number of rays, summed over all frames on record.
    pub fn rays(&self) -> u64 {
        self.records().flat_map(|frame| frame.rays.values()).sum()
    }

    /// Returns the warnings of the mesh and of all frames.
    pub fn warnings(&self) -> Vec<&str> {
        let mesh = self.mesh.iter().flat_map(|mesh| &mesh.warnings);
        let all = mesh.chain(self.records().flat_map(|frame| &frame.warnings));
        let mut all: Vec<&str> = all.map(String::as_str).collect();
        all.dedup();
        all
    }

    /// Returns the failures as text. Equal lines in a row appear once.
    pub fn message(&self) -> Option<String> {
        let mut lines: Vec<&str> = self.failures.values().map(String::as_str).collect();
        lines.dedup();
        (!lines.is_empty()).then(|| lines.join("\n"))
    }

    fn records(&self) -> impl Iterator<Item = &FrameRecord> {
        self.frames.values().flatten()
    }
}
