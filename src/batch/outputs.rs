//! Checks the outputs of a job: all differ from each other, and none is an input of the run.

use std::{
    hash::{DefaultHasher, Hash, Hasher},
    path::{Path, PathBuf},
};

use rayon::prelude::*;

use crate::{
    error::{Error, Result},
    files::{self, Files},
    output::Outputs,
    picture, world,
};

use super::{
    job::{Input, Job},
    names::Pattern,
    plan::Task,
    scene, sheet,
};

/// Returns all files that a job reads: its own files, the texture for its meshes, its inputs, and
/// the files that these name.
///
/// Reads scenes and mesh headers on the threads of the current rayon pool.
pub fn inputs(job: &Job) -> Files {
    let named = job.inputs.par_iter().map(|input| named(job, input)).collect::<Vec<_>>();
    job.files.iter().chain(&job.looks.texture).chain(named.iter().flatten()).collect()
}

/// Returns an input's path and the paths of the files that it names, as far as these can be found
/// out.
fn named(job: &Job, input: &Input) -> Vec<PathBuf> {
    let named = match scene::with_default_placement(job, input) {
        Ok(scene) => world::sources(&scene),
        // A mesh header names its texture even if the scene around it is invalid.
        Err(_) => world::mesh_sources(&input.path),
    };
    [input.path.clone()].into_iter().chain(named).collect()
}

/// Refuses frames, journals and contact sheets that would overwrite an input.
///
/// # Errors
/// The first such output.
pub fn refuse(job: &Job, tasks: &[Task], journal: &Path, inputs: &Files) -> Result<()> {
    let beside = sheet::paths(job).chain([journal.to_owned()]);
    beside.into_iter().try_for_each(|output| refuse_if_input(&output, inputs))?;
    tasks.par_iter().try_for_each(|task| {
        let mut outputs = task.frames.clone().flat_map(|frame| frame_files(job, task.input, frame));
        outputs.try_for_each(|output| refuse_if_input(&output, inputs))
    })
}

/// Refuses a contact sheet that would overwrite an input.
///
/// # Errors
/// The first such file.
pub fn refuse_sheet(job: &Job) -> Result<()> {
    refuse_files(job, sheet::paths(job))
}

/// Refuses files beside the frames that would overwrite an input.
///
/// # Errors
/// The first such file.
pub fn refuse_files(job: &Job, mut outputs: impl Iterator<Item = PathBuf>) -> Result<()> {
    let inputs = inputs(job);
    outputs.try_for_each(|output| refuse_if_input(&output, &inputs))
}

fn refuse_if_input(output: &Path, inputs: &Files) -> Result<()> {
    match inputs.has(output) {
        true => Err(files::over(output, "choose another folder: -o DIR")),
        false => Ok(()),
    }
}

/// Returns the paths of every file that a frame may have.
fn frame_files(job: &Job, input: usize, frame: u32) -> impl Iterator<Item = PathBuf> {
    let prefix = job.prefix(input, frame);
    let kinds = if job.storage.crypto_sidecar { &picture::MANIFESTS[..] } else { &[] };
    let manifests: Vec<PathBuf> =
        kinds.iter().map(|kind| picture::manifest_path(&prefix, kind)).collect();
    Outputs::names(&prefix).into_iter().chain(manifests)
}

/// Hash of a frame's name, number of its input, and number of the frame.
type HashedName = (u64, u32, u32);

/// Refuses two frames with the same name, and a frame with the name of a contact sheet. `text` is
/// the pattern for messages.
///
/// # Errors
/// The first such pair in the order of the job.
pub fn distinct(name: &Pattern, inputs: &[Input], frames: u32, text: &str) -> Result<()> {
    if frames > 1 && !name.has_frame_number() {
        let message = format!("found {text:?} for {frames} frames, expected {{frame}} in it");
        return Err(Error::invalid("output name", message).help("{stem}/{stem}.{frame:04}"));
    }
    let of = |&(_, input, frame): &HashedName| {
        name.of(&inputs[input as usize].path, input as usize, frame)
    };
    let mut all: Vec<HashedName> = Vec::new();
    let (sheets, mut first) = (sheet::names(inputs.len()), None);
    for input in 0..inputs.len() as u32 {
        for frame in 0..frames {
            let path = of(&(0, input, frame));
            let mut hasher = DefaultHasher::new();
            path.hash(&mut hasher);
            let named = (hasher.finish(), input, frame);
            let [_, png] = Outputs::names(&path);
            let png = png.strip_prefix(".").unwrap_or(&png);
            if first.is_none() && sheets.iter().any(|sheet| Path::new(sheet) == png) {
                first = Some((named, None));
            }
            all.push(named);
        }
    }
    all.sort_unstable();
    // Equal names have equal hashes. Only names with equal hashes are compared.
    for alike in all.chunk_by(|a, b| a.0 == b.0).filter(|alike| alike.len() > 1) {
        let same = |(i, a): (usize, &HashedName)| {
            let b = alike[i + 1..].iter().find(|b| of(a) == of(b))?;
            Some((*a, Some(*b)))
        };
        let pair = alike.iter().enumerate().find_map(same);
        first = [first, pair].into_iter().flatten().min_by_key(|((_, i, frame), _)| (*i, *frame));
    }
    let Some((one, other)) = first else { return Ok(()) };
    let called = |&(_, input, frame): &HashedName| {
        let path = inputs[input as usize].path.display();
        if frames > 1 { format!("frame {frame} of {path}") } else { path.to_string() }
    };
    let other = other.as_ref().map_or("the contact sheet".to_string(), called);
    let path = of(&one);
    let message =
        format!("{} and {other} would both be written to {:?}", called(&one), path.display());
    Err(Error::invalid("output name", message)
        .help("tell them apart: --name '{parent}/{stem}', or '{input:03}-{stem}.{frame:04}'"))
}
