//! Turns one input of a batch into the scenes of its frames.

use std::path::{Path, PathBuf};

use glam::DVec3;

use crate::error::{Error, Problem, Result};
use crate::layers::LayerPlan;
use crate::memory::{self, Prediction};
use crate::mesh::Mesh;
use crate::monitor::Monitor;
use crate::parallel;
use crate::picture::{self, Manifest, PictureFiles};
use crate::render::{checked_overscan, overscan_window, sampling};
use crate::reserve::MemoryLimit;
use crate::scene::{CheckedCamera, Document, Loaded, Overrides, Scene, Source};
use crate::studio::{self, MeshScene, Subject, Template};
use crate::world::{self, ContentHashes};

use super::fingerprint::{Settings, fingerprint};
use super::job::{Job, JobInput, LEGEND};
use super::resume::{self, Decision, Resume};
use super::tasks::{self, Task};

/// Pointer that `--tonemap` sets.
const OPERATOR: &str = "/tonemap/operator";

/// Number of frames whose files are checked in one parallel pass.
const FRAMES_PER_CHECK: usize = 256;

/// An input that is read and, if it is a mesh, framed.
#[derive(Debug)]
pub struct Ready {
    /// Scene of the input: the scene of frame 0, unless a turntable starts at another angle than 0
    /// or the job has a list of cameras.
    pub loaded: Loaded,
    /// The mesh with its path; empty for a scene.
    pub mesh: Vec<(PathBuf, Mesh)>,
    /// Warnings of loading the input.
    pub warnings: Vec<Problem>,
    /// Folder that the scene's paths are relative to.
    folder: PathBuf,
    /// A point on the turntable's axis.
    pivot: DVec3,
}

/// A frame that has to be rendered. Its scene is made again for rendering ([`Ready::frame`]): the
/// scenes of all frames together may be large.
#[derive(Debug)]
pub struct Frame {
    /// Index of the frame among all frames of the job.
    pub index: u64,
    /// Index of the frame within its input.
    pub number: u32,
    pub camera: CheckedCamera,
    /// Path of its files without the ending.
    pub prefix: PathBuf,
    /// Hash of all that determines its pixels. `None` if a mesh came through a pipe.
    pub hash: Option<String>,
    /// [`fingerprint()`] of the frame; `None` if there is no hash.
    pub fingerprint: Option<String>,
    /// Reason why it is rendered although its files exist.
    pub again: Option<String>,
}

/// Predicts the memory of a task from file headers, without the accelerator. Also returns the scene
/// of its input, with a mesh in its default placement and the largest picture of its frames.
///
/// # Errors
/// Errors of the scene and of the headers.
pub fn predict(job: &Job, task: &Task) -> Result<(Scene, Prediction)> {
    let scene = with_default_placement(job, &job.inputs[task.input])?;
    fits(job, &scene)?;
    let mut scene = scene;
    let frames = task.frames.start as usize..task.frames.end as usize;
    let poses = job.poses.iter().flat_map(|poses| &poses.list[frames.clone()]);
    let sizes = poses.map(|pose| pose.camera.size());
    // One that is too large is the largest; its error follows.
    let pixels = |size| overscan_window(job.overscan, size).map_or(u64::MAX, |(_, w)| w.pixels());
    let largest = sizes.max_by_key(|size| pixels(*size));
    if let Some([width, height]) = largest {
        (scene.camera.width, scene.camera.height) = (width, height);
    }
    let (_, window) = overscan_window(job.overscan, [scene.camera.width, scene.camera.height])?;
    let deeper = memory::deeper_png_bytes(window, job.storage.depth);
    let prediction = memory::predict(&scene, window)?.with_film_bytes(deeper);
    Ok((scene, prediction))
}

/// Checks that the settings of the job and its flags fit at least one input. Otherwise they are a
/// mistake of the whole job. Inputs that are invalid by themselves do not count.
///
/// # Errors
/// The problems of the settings with the first input that is valid without them.
pub fn check_settings(job: &Job) -> Result<()> {
    let mut first = None;
    for input in &job.inputs {
        // With the legend of the whole job, which at least one input must be able to have.
        let checked =
            placed_by_default(job, input, &input.overrides).and_then(|scene| fits(job, &scene));
        let Err(error) = checked else { return Ok(()) };
        // Without overrides, only the job sets what a mesh is rendered with.
        let plain =
            |path| studio::load(Source::File(path), Overrides::default(), None, &mut vec![]);
        if studio::is_mesh(&input.path) || plain(&input.path).is_ok() {
            first.get_or_insert(error);
        }
    }
    first.map_or(Ok(()), Err)
}

/// Checks that the job's settings fit a scene. Cameras of a list are checked with their frames.
fn fits(job: &Job, scene: &Scene) -> Result<()> {
    picture::check_storage(scene, job.storage)?;
    sampling::adaptive(&job.sampling, scene)?;
    match job.poses {
        Some(_) => Ok(()),
        None => checked_overscan(job.overscan, &scene.camera).map(drop),
    }
}

/// Returns the scene of an input without reading a mesh: the mesh is neither rotated nor framed.
///
/// # Errors
/// Errors of the scene.
pub fn with_default_placement(job: &Job, input: &JobInput) -> Result<Scene> {
    placed_by_default(job, input, &overrides(job, input))
}

/// Returns a warning if nothing sets the tone curve of an input of a job with several pictures: by
/// default each PNG is divided by its own largest value. An input that cannot be read has none.
pub fn flicker(job: &Job, input: &JobInput) -> Option<Problem> {
    if job.inputs.len() as u64 * u64::from(job.frames()) < 2 {
        return None;
    }
    let own = (!studio::is_mesh(&input.path)).then(|| Template::file(&input.path));
    let own = own.transpose().ok()?;
    let Template { name, text, .. } = own.as_ref().unwrap_or(&job.template);
    let mut document = Document::parse(name, text).ok()?;
    overrides(job, input).apply(&mut document);
    let message = "found no operator: each PNG is divided by its own largest value, so the frames \
                   differ in brightness";
    let problem = Problem::new("tonemap", message).help("--tonemap clamp, or in the scene");
    document.get(OPERATOR).is_none().then_some(problem)
}

fn placed_by_default(job: &Job, input: &JobInput, overrides: &Overrides) -> Result<Scene> {
    let path = &input.path;
    let loaded = match studio::is_mesh(path) {
        true => {
            let subject = Subject { looks: job.looks.clone(), ..Subject::new(path) };
            studio::with_default_placement(&subject, &job.template, overrides)?
        }
        false => {
            let source = Source::File(path);
            studio::load(source, overrides.clone(), job.light_samples, &mut Vec::new())?
        }
    };
    Ok(loaded.scene)
}

/// Returns the overrides of an input: without the legend of the whole job if it shows no property.
fn overrides(job: &Job, input: &JobInput) -> Overrides {
    let all = input.overrides.clone();
    if !input.legend_of_job {
        return all;
    }
    let mut without = all.clone();
    without.flag("--legend", LEGEND, Some(false));
    match placed_by_default(job, input, &without) {
        Ok(scene) if !scene.shows_property() => without,
        // An error is reported when the input is loaded.
        _ => all,
    }
}

/// Reads an input: a scene, or a mesh that is framed in the template. `memory_limit` limits the
/// mesh's arrays.
///
/// # Errors
/// All problems of the input.
pub fn read(
    job: &Job,
    input: &JobInput,
    memory_limit: Option<MemoryLimit>,
    monitor: &Monitor,
) -> Result<Ready> {
    let path = &input.path;
    let (overrides, samples) = (overrides(job, input), job.light_samples);
    if studio::is_mesh(path) {
        let subject = Subject {
            up: input.up,
            rotate: input.rotate,
            margin: job.margin,
            looks: job.looks.clone(),
            turning: job.turntable.is_some_and(|turntable| turntable.turns()),
            pivot: job.pivot,
            calibrated: job.poses.is_some(),
            repair: job.repair,
            no_mmap: job.no_mmap,
            memory_limit,
            ..Subject::new(path)
        };
        let MeshScene { loaded, warnings, mesh, middle, .. } =
            studio::show(&subject, &job.template, overrides, samples, monitor)?;
        let folder = job.template.folder.clone();
        let pivot = job.pivot.unwrap_or(middle);
        return Ok(Ready { loaded, mesh: vec![mesh], warnings, folder, pivot });
    }
    let mut warnings = Vec::new();
    let loaded = studio::load(Source::File(path), overrides, samples, &mut warnings)?;
    let target = loaded.description.camera.target().map(|target| target.vec());
    let pivot = match job.pivot.or(target) {
        Some(pivot) => pivot,
        None if !job.turntable.is_some_and(|turntable| turntable.turns()) => DVec3::ZERO,
        None => {
            let place = path.display().to_string();
            let message = "found a turntable of a scene whose camera has no `target`";
            return Err(Error::invalid(place, message)
                .help("set a point on its axis: --pivot X,Y,Z, or give the camera a target"));
        }
    };
    let folder = path.parent().unwrap_or(Path::new("")).to_owned();
    Ok(Ready { loaded, mesh: Vec::new(), warnings, folder, pivot })
}

impl Ready {
    /// Splits a task into the frames to render and the indices of the frames to keep.
    ///
    /// `contents` caches the files of the scene, which are read once for all frames. Runs on the
    /// threads of the current rayon pool.
    ///
    /// # Errors
    /// Files that cannot be read; a stop request in the monitor.
    pub fn frames(
        &self,
        (job, task): (&Job, &Task),
        resume: Resume,
        settings: &Settings,
        contents: &mut ContentHashes,
        monitor: &Monitor,
    ) -> Result<(Vec<Frame>, Vec<u32>)> {
        let plan = LayerPlan::new(&self.loaded.scene);
        let (mut frames, mut kept) = (Vec::new(), Vec::new());
        let numbers: Vec<u32> = task.frames.clone().collect();
        for some in numbers.chunks(FRAMES_PER_CHECK) {
            let some: Vec<Frame> = some
                .iter()
                .map(|&number| {
                    monitor.check()?;
                    let loaded = self.frame(job, number)?;
                    let prefix = job.prefix(task.input, number);
                    let hash = world::fingerprint(&loaded, settings.repair, contents)?;
                    let settings = Settings { sequence: job.sequence(number), ..*settings };
                    let fingerprint =
                        hash.as_ref().map(|hash| fingerprint(&loaded, &settings, hash));
                    let index = tasks::index(job.frames(), task.input, number);
                    let camera = loaded.scene.camera;
                    Ok(Frame { index, number, camera, prefix, hash, fingerprint, again: None })
                })
                .collect::<Result<_>>()?;
            let decide = |frame: &Frame| match (&frame.fingerprint, resume) {
                (Some(fingerprint), Resume::Keep(hashes)) => {
                    monitor.check()?;
                    let files = PictureFiles::names(&frame.prefix, &plan, job.storage);
                    let manifests = Manifest::beside(&frame.prefix, &plan, job.storage)?;
                    Ok(resume::decide((&files, &manifests), fingerprint, hashes))
                }
                _ => Ok(Decision::Render),
            };
            let verdicts = parallel::try_map(some.iter(), decide)?;
            for (frame, verdict) in some.into_iter().zip(verdicts) {
                match verdict {
                    Decision::Keep => kept.push(frame.number),
                    Decision::Render => frames.push(frame),
                    Decision::Again(reason) => frames.push(Frame { again: Some(reason), ..frame }),
                }
            }
        }
        Ok((frames, kept))
    }

    /// Returns the scene of a frame, given with its index within the input.
    ///
    /// # Errors
    /// Every problem of the scene.
    pub fn frame(&self, job: &Job, number: u32) -> Result<Loaded> {
        if let Some(poses) = &job.poses {
            let pose = &poses.list[number as usize % poses.list.len()];
            return self.loaded.with_camera(&pose.image, &pose.camera, &self.folder);
        }
        let Some(turntable) = &job.turntable else {
            return Ok(self.loaded.clone());
        };
        let turned = turntable.frame(&self.loaded.description, self.pivot, number);
        self.loaded.with_frame("frame", &turned, &self.folder)
    }
}
