//! One input of a batch: from its file to the scenes of its frames.

use std::path::{Path, PathBuf};

use glam::DVec3;
use rayon::prelude::*;

use crate::{
    error::{Error, Problem, Result},
    film::Window,
    layers::Plan,
    memory::{self, Prediction},
    mesh::Mesh,
    monitor::Monitor,
    picture::{self, Files},
    reserve::Room,
    scene::{self, Loaded, Scene, Source},
    studio::{self, Shown, Subject},
    world::{self, Contents},
};

use super::{
    fingerprint::{Settings, fingerprint},
    job::{Input, Job},
    plan::{self, Task},
    resume::{self, Resume, Verdict},
};

/// Frames whose files are looked at together.
const TOGETHER: usize = 256;

/// An input that is read and framed.
#[derive(Debug)]
pub struct Ready {
    /// Its scene: that of frame 0 of a turntable that starts at 0.
    pub loaded: Loaded,
    /// Its mesh, if that had to be read.
    pub mesh: Vec<(PathBuf, Mesh)>,
    /// What is suspicious so far.
    pub warnings: Vec<Problem>,
    /// What the scene's paths are relative to.
    folder: PathBuf,
    /// Where a turntable's axis stands.
    pivot: DVec3,
}

/// A frame that is to be rendered.
#[derive(Debug)]
pub struct Frame {
    /// Number among all frames of the job.
    pub index: u64,
    /// Number among those of its input.
    pub number: u32,
    /// Its scene.
    pub loaded: Loaded,
    /// Its files, without their endings.
    pub prefix: PathBuf,
    /// What decides its pixels, if that can be known: no mesh came through a pipe.
    pub hash: Option<String>,
    /// The same with how its files are written.
    pub fingerprint: Option<String>,
    /// Why it is rendered although it is there.
    pub again: Option<String>,
}

/// What an input will need, by headers alone, without the accelerator; and its scene, not framed yet.
///
/// # Errors
/// Those of its scene and headers.
pub fn predict(job: &Job, input: &Input) -> Result<(Scene, Prediction)> {
    let scene = unframed(job, input)?;
    picture::suits(&scene, job.storage)?;
    let window = Window::full(scene.camera.width, scene.camera.height);
    let deeper = memory::deeper_png_bytes(window, job.storage.depth);
    let prediction = memory::predict(&scene, window)?.beside_film(deeper);
    Ok((scene, prediction))
}

/// The scene of an input, a mesh where it happens to stand.
///
/// # Errors
/// Those of the scene.
pub fn unframed(job: &Job, input: &Input) -> Result<Scene> {
    let loaded = match studio::is_mesh(&input.path) {
        true => studio::unframed(&input.path, &job.template, &input.overrides)?,
        false => {
            let source = Source::File(&input.path);
            studio::load(source, input.overrides.clone(), job.light_samples, &mut Vec::new())?
        }
    };
    Ok(loaded.scene)
}

/// Reads an input: a scene file, or a mesh that is read, into arrays of at most `room`, and framed in the template.
///
/// # Errors
/// Everything that is wrong with it.
pub fn read(job: &Job, input: &Input, room: Option<Room>, monitor: &Monitor) -> Result<Ready> {
    let path = &input.path;
    let (overrides, samples) = (input.overrides.clone(), job.light_samples);
    if studio::is_mesh(path) {
        let subject = Subject {
            up: input.up,
            rotate: input.rotate,
            margin: job.margin,
            looks: job.looks.clone(),
            turning: job.frames() > 1,
            repair: job.repair,
            no_mmap: job.no_mmap,
            room,
            ..Subject::new(path)
        };
        let Shown { loaded, warnings, mesh, middle } =
            studio::show(&subject, &job.template, overrides, samples, monitor)?;
        let folder = job.template.folder.clone();
        let pivot = job.pivot.unwrap_or(middle);
        return Ok(Ready { loaded, mesh: vec![mesh], warnings, folder, pivot });
    }
    let mut warnings = Vec::new();
    let loaded = studio::load(Source::File(path), overrides, samples, &mut warnings)?;
    let target = loaded.description.camera.target.as_ref().map(|target| target.vec());
    let pivot = match (job.pivot.or(target), job.frames()) {
        (Some(pivot), _) => pivot,
        (None, 1) => DVec3::ZERO,
        (None, _) => {
            let place = path.display().to_string();
            let message = "found a turntable of a scene whose camera has no `target`";
            return Err(Error::invalid(place, message)
                .help("say where its axis stands: --pivot X,Y,Z, or give the camera a target"));
        }
    };
    let folder = path.parent().unwrap_or(Path::new("")).to_owned();
    Ok(Ready { loaded, mesh: Vec::new(), warnings, folder, pivot })
}

impl Ready {
    /// The frames of a task that have to be rendered, and the numbers of those that may stay as they
    /// are. `contents` are read once for all frames. Files are looked at on the threads of the current rayon
    /// pool.
    ///
    /// # Errors
    /// Files that cannot be read.
    pub fn frames(
        &self,
        job: &Job,
        task: &Task,
        resume: Resume,
        settings: &Settings,
        contents: &mut Contents,
    ) -> Result<(Vec<Frame>, Vec<u32>)> {
        let plan = Plan::new(&self.loaded.scene);
        let (mut frames, mut kept) = (Vec::new(), Vec::new());
        let numbers: Vec<u32> = task.frames.clone().collect();
        for some in numbers.chunks(TOGETHER) {
            let some: Vec<Frame> = some
                .iter()
                .map(|&number| {
                    let loaded = self.frame(job, number)?;
                    let prefix = job.prefix(task.input, number);
                    let hash = world::fingerprint(&loaded, settings.repair, contents)?;
                    let fingerprint =
                        hash.as_ref().map(|hash| fingerprint(&loaded, settings, hash));
                    let index = plan::index(job.frames(), task.input, number);
                    Ok(Frame { index, number, loaded, prefix, hash, fingerprint, again: None })
                })
                .collect::<Result<_>>()?;
            let look = |frame: &Frame| match (&frame.fingerprint, resume) {
                (Some(fingerprint), Resume::Keep(sums)) => {
                    let files = Files::names(&frame.prefix, &plan, job.storage);
                    resume::look(&files, fingerprint, sums)
                }
                _ => Verdict::Render,
            };
            let verdicts: Vec<Verdict> = some.par_iter().map(look).collect();
            for (frame, verdict) in some.into_iter().zip(verdicts) {
                match verdict {
                    Verdict::Keep => kept.push(frame.number),
                    Verdict::Render => frames.push(frame),
                    Verdict::Again(reason) => frames.push(Frame { again: Some(reason), ..frame }),
                }
            }
        }
        Ok((frames, kept))
    }

    fn frame(&self, job: &Job, number: u32) -> Result<Loaded> {
        let Some(turntable) = &job.turntable else {
            return Ok(self.loaded.clone());
        };
        let turned = turntable.frame(&self.loaded.description, self.pivot, number);
        let mut frame = scene::from_description("frame", &turned, &self.folder, &[])?;
        // How it works is no part of a description.
        frame.scene.backend = self.loaded.scene.backend;
        Ok(frame)
    }
}
