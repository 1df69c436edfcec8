//! Collects the state of each input of a batch for the contact sheet: from the input's files, and
//! from the batch's journals (logs of what its runs did).

use std::collections::{BTreeMap, HashMap};
use std::ops::Range;
use std::path::PathBuf;
use std::slice;
use std::sync::Arc;

use crate::batch::job::Job;
use crate::batch::journal::{FrameRecord, JournalRecord, MeshRecord, seen_from};
use crate::batch::tasks;
use crate::output::Outputs;
use crate::output::finished::{self, FileState};
use crate::parallel;

/// State of one input of a job.
#[derive(Debug, Clone, Default)]
pub struct SheetEntry {
    /// Index of the input in the job.
    pub number: usize,
    /// Path of the input.
    pub input: String,
    /// Frames of the input whose files are complete; `None` if no journal has a record.
    pub frames: BTreeMap<u32, Option<FrameRecord>>,
    /// Number of frames of each input.
    pub of: u32,
    /// Record of reading and building by the latest run that did, if a journal has one. A run
    /// reads an input once for each origin of coordinates: times are sums, bytes are the most.
    pub mesh: Option<MeshRecord>,
    /// Number of that run, counted from 1.
    mesh_run: usize,
    /// Text of the last failure, by frame. A failure of the input is one of all its frames. It is
    /// removed if a later run renders or keeps the frame.
    pub failures: BTreeMap<u32, Arc<str>>,
}

/// Returns true if all files of a frame exist and are complete.
fn is_whole(job: &Job, input: usize, frame: u32, record: Option<&FrameRecord>) -> bool {
    let [exr, png] = Outputs::names(&job.prefix(input, frame));
    let is_there = |path: &PathBuf| job.folder.join(path).is_file();
    matches!(finished::exr(&exr), FileState::Whole(_))
        && matches!(finished::png(&png), FileState::Whole(_))
        && record.is_none_or(|record| record.outputs.iter().all(is_there))
}

/// Returns true if a record is about what the job has now under its input and frame. In another
/// batch of the same folder, or before a list of cameras changed, the number was another frame's.
fn is_about(job: &Job, input: usize, record: &FrameRecord) -> bool {
    let [exr, _] = Outputs::names(&job.prefix(input, record.frame));
    record.outputs.iter().any(|output| output == seen_from(&exr, &job.folder))
}

impl SheetEntry {
    /// Returns the entries of all inputs of a job, in its order. Checks files on the threads of the
    /// current rayon pool.
    ///
    /// A record belongs to the input with its identity. A record of an old journal has none, and
    /// belongs to all inputs with its path. So does a record of a mesh or of a rendered frame whose
    /// identity no input has. A frame that was kept or failed is then one of another batch.
    pub fn all(job: &Job, records: &[JournalRecord]) -> Vec<Self> {
        let of = job.frames();
        let entry = |number: usize| {
            let input = job.inputs[number].path.display().to_string();
            Self { number, input, of, ..Self::default() }
        };
        let mut all: Vec<Self> = (0..job.inputs.len()).map(entry).collect();
        let identities = (0..all.len()).map(|number| (job.identity(number), number));
        let identities: HashMap<String, usize> = identities.collect();
        let mut paths: HashMap<String, Vec<usize>> = HashMap::new();
        for entry in &all {
            paths.entry(entry.input.clone()).or_default().push(entry.number);
        }
        let mut run = (0, 0..u64::MAX);
        for record in records {
            if let JournalRecord::Start { range: [first, end], .. } = record {
                run = (run.0 + 1, *first..*end);
            }
            let Some((path, identity)) = record.input() else { continue };
            let own = identity.and_then(|identity| identities.get(identity)).map(slice::from_ref);
            let tells_files = matches!(record, JournalRecord::Mesh(_) | JournalRecord::Frame(_));
            let by_path = paths.get(path).filter(|_| identity.is_none() || tells_files);
            for &number in own.or(by_path.map(Vec::as_slice)).unwrap_or_default() {
                match record {
                    // Its failure was of the same other frame.
                    JournalRecord::Frame(frame) if !is_about(job, number, frame) => {
                        all[number].failures.remove(&frame.frame);
                    }
                    _ => all[number].add(record, &run),
                }
            }
        }
        parallel::each(all.iter_mut(), |entry| entry.keep_whole(job));
        all
    }

    /// Drops frames that the job does not have or whose files are not complete, and adds frames
    /// whose files are complete without a record.
    fn keep_whole(&mut self, job: &Job) {
        self.failures.retain(|frame, _| *frame < job.frames());
        let frames = parallel::map(0..job.frames(), |frame| {
            let record = self.frames.get(&frame).cloned().flatten();
            is_whole(job, self.number, frame, record.as_ref()).then_some((frame, record))
        });
        self.frames = frames.into_iter().flatten().collect();
    }

    /// Adds a record of a run, given with its number and its range of tasks: the frames of all
    /// inputs, counted through.
    fn add(&mut self, record: &JournalRecord, (number, range): &(usize, Range<u64>)) {
        match record {
            JournalRecord::Mesh(mesh) => {
                let mut mesh = mesh.clone();
                if let Some(before) = self.mesh.take().filter(|_| self.mesh_run == *number) {
                    mesh.load_s += before.load_s;
                    mesh.build_s += before.build_s;
                    mesh.bytes = mesh.bytes.max(before.bytes);
                }
                (self.mesh, self.mesh_run) = (Some(mesh), *number);
            }
            JournalRecord::Frame(frame) => {
                self.failures.remove(&frame.frame);
                self.frames.insert(frame.frame, Some(frame.clone()));
            }
            JournalRecord::Kept { frames, .. } => {
                for frame in frames {
                    self.failures.remove(frame);
                    self.frames.entry(*frame).or_default();
                }
            }
            JournalRecord::Failed { frame, message, .. } => {
                let message: Arc<str> = message.as_str().into();
                let failed = frame
                    .map_or_else(|| self.frames_in(range), |frame| frame..frame.saturating_add(1));
                self.failures.extend(failed.map(|frame| (frame, Arc::clone(&message))));
            }
            JournalRecord::Start { .. } | JournalRecord::End { .. } => {}
        }
    }

    /// Returns the frames of this input in a range of tasks. If it has none, the record was of
    /// another list of inputs: then all frames, because the range tells nothing.
    fn frames_in(&self, run: &Range<u64>) -> Range<u32> {
        let start = tasks::index(self.of, self.number, 0);
        // At most `of`, so it fits into 32 bits.
        let within = |end: u64| end.saturating_sub(start).min(self.of.into()) as u32;
        let frames = within(run.start)..within(run.end);
        if frames.is_empty() { 0..self.of } else { frames }
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

    /// Returns the warnings of the mesh and of all frames. Equal warnings in a row appear once.
    pub fn warnings(&self) -> Vec<&str> {
        let mesh = self.mesh.iter().flat_map(|mesh| &mesh.warnings);
        let all = mesh.chain(self.records().flat_map(|frame| &frame.warnings));
        let mut all: Vec<&str> = all.map(String::as_str).collect();
        all.dedup();
        all
    }

    /// Returns the failures as text. Equal lines in a row appear once.
    pub fn message(&self) -> Option<String> {
        let mut lines: Vec<&str> = self.failures.values().map(|message| &**message).collect();
        lines.dedup();
        (!lines.is_empty()).then(|| lines.join("\n"))
    }

    fn records(&self) -> impl Iterator<Item = &FrameRecord> {
        self.frames.values().flatten()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A run reads an input again for each origin of coordinates.
    #[test]
    fn times_of_reading_and_building_are_sums_over_one_run() {
        let mut entry = SheetEntry::default();
        let mut add = |run: usize, load_s: f64, bytes: u64| {
            let mesh = serde_json::json!({
                "event": "mesh", "input": "a.ply", "name": "a", "triangles": 6, "load_s": load_s,
                "build_s": 1.0, "bytes": bytes, "camera": {}, "warnings": [],
            });
            entry.add(&serde_json::from_value(mesh).unwrap(), &(run, 0..1));
            let mesh = entry.mesh.clone().unwrap();
            (mesh.load_s, mesh.build_s, mesh.bytes)
        };
        assert_eq!(add(1, 5.0, 100), (5.0, 1.0, 100));
        assert_eq!(add(1, 3.0, 40), (8.0, 2.0, 100));
        assert_eq!(add(2, 2.0, 40), (2.0, 1.0, 40));
    }
}
