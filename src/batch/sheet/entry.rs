//! What the files and the journals say about each input of a job.

use std::{
    collections::{BTreeMap, HashMap},
    path::PathBuf,
};

use rayon::prelude::*;

use crate::{
    batch::{
        job::Job,
        journal::{FrameRecord, MeshRecord, Record},
    },
    output::{
        Outputs,
        finished::{self, Finished},
    },
};

/// One input.
#[derive(Debug, Clone, Default)]
pub struct Entry {
    /// Its place in the job.
    pub number: usize,
    /// Its file.
    pub input: String,
    /// Frames whose files are whole, and what those cost whose rendering is on record.
    pub frames: BTreeMap<u32, Option<FrameRecord>>,
    /// Frames that it should have.
    pub of: u32,
    /// What it cost to read and build, if that is on record.
    pub mesh: Option<MeshRecord>,
    /// What went wrong, and nobody mended since: of all frames, or of some.
    pub failures: BTreeMap<Option<u32>, String>,
}

/// Whether all files of a frame are there and whole.
fn is_whole(job: &Job, input: usize, frame: u32, record: Option<&FrameRecord>) -> bool {
    let [exr, png] = Outputs::names(&job.prefix(input, frame));
    let is_there = |path: &PathBuf| job.folder.join(path).is_file();
    matches!(finished::exr(&exr), Finished::Whole(_))
        && matches!(finished::png(&png), Finished::Whole(_))
        && record.is_none_or(|record| record.outputs.iter().all(is_there))
}

impl Entry {
    /// All inputs of a job, in its order. Frames are those whose files are whole. Looks at them on the threads of
    /// the current rayon pool.
    pub fn all(job: &Job, records: &[Record]) -> Vec<Self> {
        let mut by_name: HashMap<String, Self> = HashMap::new();
        for record in records {
            let input = match record {
                Record::Mesh(mesh) => &mesh.input,
                Record::Frame(frame) => &frame.input,
                Record::Kept { input, .. } | Record::Failed { input, .. } => input,
                Record::Start { .. } | Record::End { .. } => continue,
            };
            by_name.entry(input.clone()).or_default().add(record);
        }
        let inputs = job.inputs.par_iter().enumerate();
        let entry = |(number, input): (usize, &crate::batch::Input)| {
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

    fn add(&mut self, record: &Record) {
        match record {
            Record::Mesh(mesh) => {
                self.failures.remove(&None);
                self.mesh = Some(mesh.clone());
            }
            Record::Frame(frame) => {
                self.there(frame.frame);
                self.frames.insert(frame.frame, Some(frame.clone()));
            }
            Record::Kept { frames, .. } => {
                for frame in frames {
                    self.there(*frame);
                    self.frames.entry(*frame).or_default();
                }
            }
            Record::Failed { frame, message, .. } => {
                self.failures.insert(*frame, message.clone());
            }
            Record::Start { .. } | Record::End { .. } => {}
        }
    }

    fn there(&mut self, frame: u32) {
        self.failures.remove(&None);
        self.failures.remove(&Some(frame));
    }

    /// Its file's name.
    pub fn name(&self) -> &str {
        self.input.rsplit('/').next().unwrap_or(&self.input)
    }

    /// Seconds of rays and files of all frames on record.
    pub fn seconds(&self) -> f64 {
        self.records().map(|frame| frame.render_s + frame.write_s).sum()
    }

    /// Rays of all frames on record.
    pub fn rays(&self) -> u64 {
        self.records().flat_map(|frame| frame.rays.values()).sum()
    }

    /// Warnings of the mesh and of all frames.
    pub fn warnings(&self) -> Vec<&str> {
        let mesh = self.mesh.iter().flat_map(|mesh| &mesh.warnings);
        let all = mesh.chain(self.records().flat_map(|frame| &frame.warnings));
        let mut all: Vec<&str> = all.map(String::as_str).collect();
        all.dedup();
        all
    }

    /// What went wrong, each thing once.
    pub fn message(&self) -> Option<String> {
        let mut lines: Vec<&str> = self.failures.values().map(String::as_str).collect();
        lines.dedup();
        (!lines.is_empty()).then(|| lines.join("\n"))
    }

    fn records(&self) -> impl Iterator<Item = &FrameRecord> {
        self.frames.values().flatten()
    }
}
