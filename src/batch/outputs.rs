//! Checks that no output of a job is an input of the run, and that no input is a pipe.

use std::path::{Path, PathBuf};

use crate::error::{Error, Result};
use crate::files::FileSet;
use crate::layers::LayerPlan;
use crate::monitor::Monitor;
use crate::output::{Outputs, atomic, finished};
use crate::parallel;
use crate::picture::{self, PictureFiles};
use crate::studio;
use crate::world::{self, MissingImage, Sources};

use super::inputs::not_a_file;
use super::job::{Job, JobInput};
use super::names::PAGE;
use super::tasks::Task;
use super::{scene, sheet};

/// Returns all files that a job reads: its own files, the texture for its meshes, its inputs, and
/// the files that these name.
///
/// Reads scenes and mesh headers on the threads of the current rayon pool.
///
/// # Errors
/// `Interrupted` if a signal arrives. A pipe or a device among the files of an input: they are read
/// more than once.
pub fn inputs(job: &Job, monitor: &Monitor) -> Result<FileSet> {
    // Meshes with the same settings have the same studio, whose files are found once.
    let first = job.inputs.iter().find(|input| studio::is_mesh(&input.path));
    let first = first.and_then(|input| Some((input, files_of_scene(job, input)?)));
    let named = parallel::map(job.inputs.iter(), |input| {
        if monitor.stopped() {
            return Sources::default();
        }
        let is_alike =
            |other: &JobInput| studio::is_mesh(&input.path) && other.overrides == input.overrides;
        let mut named = match &first {
            Some((other, _)) if is_alike(other) => None,
            _ => files_of_scene(job, input),
        }
        // A mesh header names its texture even if the scene around it is invalid.
        .unwrap_or_else(|| world::mesh_sources(&input.path));
        named.files.push(input.path.clone());
        named
    });
    monitor.check()?;
    let named: Vec<_> = first.into_iter().map(|(_, named)| named).chain(named).collect();
    let read: Vec<_> = named.iter().flat_map(|named| &named.files).collect();
    let refused = parallel::map(read.into_iter(), |path| not_a_file(path));
    let refused = refused.into_iter().chain(job.looks.texture.iter().map(|path| not_a_file(path)));
    refused.flatten().next().map_or(Ok(()), Err)?;
    let own = job.job_file.iter().chain(&job.files).chain(&job.looks.texture);
    let files = named.iter().flat_map(|named| &named.files);
    let mut all: FileSet = own.chain(files).collect();
    let missing = named.iter().flat_map(|named| &named.missing);
    missing.for_each(|MissingImage { mesh, image }| all.add_missing(image, mesh));
    Ok(all)
}

/// Returns the paths of the files that an input's scene names; `None` if the scene is invalid.
fn files_of_scene(job: &Job, input: &JobInput) -> Option<Sources> {
    scene::with_default_placement(job, input).ok().map(|scene| world::sources(&scene))
}

/// Refuses frames, journals and contact sheets that would overwrite an input. Also refuses frames
/// whose names are too long.
///
/// # Errors
/// The first such output.
pub fn refuse(job: &Job, tasks: &[Task], journal: &Path, inputs: &FileSet) -> Result<()> {
    let beside = sheet::paths(job).chain([journal.to_owned()]);
    beside.into_iter().try_for_each(|output| refuse_if_input(&output, inputs))?;
    each_file(job, tasks, |output| {
        atomic::check_length(output)?;
        refuse_if_input(output, inputs)
    })
}

/// Refuses frames whose names are too long.
///
/// # Errors
/// The first such frame.
pub fn check_lengths(job: &Job, tasks: &[Task]) -> Result<()> {
    each_file(job, tasks, atomic::check_length)
}

/// Checks every file of every frame, on the threads of the current rayon pool.
fn each_file(job: &Job, tasks: &[Task], check: impl Fn(&Path) -> Result<()> + Sync) -> Result<()> {
    let checked = parallel::map(tasks.iter(), |task| {
        let mut files = task.frames.clone().flat_map(|frame| frame_files(job, task.input, frame));
        files.try_for_each(|file| check(&file))
    });
    checked.into_iter().collect()
}

/// Refuses frames of a list of cameras that would overwrite a picture that no batch has rendered.
/// They are named after photographs, which the job need not read: only the folder tells the two
/// apart.
///
/// # Errors
/// The first such frame.
pub fn refuse_photographs(job: &Job, tasks: &[Task]) -> Result<()> {
    if job.poses.is_none() {
        return Ok(());
    }
    let foreign = |task: &Task| {
        let prefixes = task.frames.clone().map(|frame| job.prefix(task.input, frame));
        prefixes.flat_map(|prefix| Outputs::names(&prefix)).find(|path| finished::is_foreign(path))
    };
    let output = parallel::map(tasks.iter(), foreign).into_iter().flatten().next();
    output.map_or(Ok(()), |output| Err(would_be_lost(&output, "frame")))
}

/// Refuses a contact sheet of a list of cameras that would overwrite a page or a picture that no
/// batch has made, for the same reason.
///
/// # Errors
/// The first such file.
pub fn refuse_foreign_sheet(job: &Job) -> Result<()> {
    let output = job.poses.as_ref().and_then(|_| sheet::foreign(job));
    output.map_or(Ok(()), |output| Err(would_be_lost(&output, "contact sheet")))
}

fn would_be_lost(output: &Path, kind: &str) -> Error {
    let what = if output.ends_with(PAGE) { "page" } else { "picture" };
    let message =
        format!("found a {what} that is no {kind} of a batch, which would be overwritten");
    Error::invalid(output.display().to_string(), message)
        .help(format!("choose another folder: -o DIR, or remove the {what}"))
}

/// Refuses a contact sheet that would overwrite an input.
///
/// # Errors
/// The first such file; those of `inputs`.
pub fn refuse_sheet(job: &Job) -> Result<()> {
    refuse_files(job, sheet::paths(job))
}

/// Refuses files beside the frames that would overwrite an input.
///
/// # Errors
/// The first such file; those of `inputs`.
pub fn refuse_files(job: &Job, mut outputs: impl Iterator<Item = PathBuf>) -> Result<()> {
    let inputs = inputs(job, &Monitor::default())?;
    outputs.try_for_each(|output| refuse_if_input(&output, &inputs))
}

fn refuse_if_input(output: &Path, inputs: &FileSet) -> Result<()> {
    inputs.refuse(output, "choose another folder: -o DIR")
}

/// Returns the paths of the files of each frame of a task, as `picture::write` does. An input
/// that is invalid counts as one without manifests.
pub fn task_files(job: &Job, task: &Task) -> Vec<Vec<PathBuf>> {
    // Only manifests depend on the input.
    let scene = job.storage.crypto_sidecar.then(|| {
        let scene = scene::with_default_placement(job, &job.inputs[task.input]);
        scene.map(|scene| LayerPlan::new(&scene))
    });
    let plan = scene.and_then(Result::ok);
    let prefixes = task.frames.clone().map(|frame| job.prefix(task.input, frame));
    let names = prefixes.map(|prefix| match &plan {
        Some(plan) => PictureFiles::names(&prefix, plan, job.storage),
        None => Outputs::names(&prefix).into(),
    });
    names.collect()
}

/// Returns the paths of every file that the frames of a run may have.
pub fn run_files<'a>(job: &'a Job, tasks: &'a [Task]) -> impl Iterator<Item = PathBuf> + 'a {
    let frames = tasks.iter().flat_map(|task| task.frames.clone().map(|n| (task.input, n)));
    frames.flat_map(|(input, frame)| frame_files(job, input, frame))
}

/// Returns the paths of every file that a frame may have.
fn frame_files(job: &Job, input: usize, frame: u32) -> impl Iterator<Item = PathBuf> {
    let prefix = job.prefix(input, frame);
    let kinds = if job.storage.crypto_sidecar { &picture::MANIFESTS[..] } else { &[] };
    let manifests: Vec<PathBuf> =
        kinds.iter().map(|kind| picture::manifest_path(&prefix, kind)).collect();
    Outputs::names(&prefix).into_iter().chain(manifests)
}
