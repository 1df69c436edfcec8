//! One input of a batch: from its file to the scenes of its frames.

use std::path::{Path, PathBuf};

use glam::DVec3;

use crate::{
    accel::EmbreeMode,
    error::{Error, Problem, Result},
    film::Window,
    layers::Plan,
    memory::{self, Prediction},
    mesh::{self, Mesh},
    monitor::Monitor,
    paths,
    picture::{self, Files},
    scene::{self, Loaded, Scene, ShapeKind, Source},
    studio::{self, Shown, Subject},
    world::{self, Contents},
};

use super::{
    fingerprint::{Settings, fingerprint},
    job::{Input, Job},
    plan::{self, Task},
    resume::{self, Verdict},
};

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
pub fn predict(job: &Job, input: &Input, embree: EmbreeMode) -> Result<(Scene, Prediction)> {
    let loaded = match studio::is_mesh(&input.path) {
        true => studio::unframed(&input.path, &job.template, &input.overrides)?,
        false => {
            let source = Source::File(&input.path);
            studio::load(source, input.overrides.clone(), job.light_samples, &mut Vec::new())?
        }
    };
    picture::suits(&loaded.scene, embree, job.storage)?;
    let camera = &loaded.scene.camera;
    let window = Window::full(camera.width, camera.height);
    let deeper = memory::deeper_png_bytes(window, job.storage.depth);
    let prediction = memory::predict(&loaded.scene, window)?.beside_film(deeper);
    Ok((loaded.scene, prediction))
}

/// Reads an input: a scene file, or a mesh that is read and framed in the template.
///
/// # Errors
/// Everything that is wrong with it.
pub fn read(job: &Job, input: &Input, monitor: &Monitor) -> Result<Ready> {
    let path = &input.path;
    let (overrides, samples) = (input.overrides.clone(), job.light_samples);
    if studio::is_mesh(path) {
        let subject = Subject {
            up: input.up,
            rotate: input.rotate,
            margin: job.margin,
            turning: job.frames() > 1,
            repair: job.repair,
            no_mmap: job.no_mmap,
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
    /// are: none unless `resume`.
    ///
    /// # Errors
    /// Files that cannot be read; a frame that would be written over one of them.
    pub fn frames(
        &self,
        job: &Job,
        task: &Task,
        resume: bool,
        settings: &Settings,
    ) -> Result<(Vec<Frame>, Vec<u32>)> {
        // Read once for all frames.
        let mut contents = Contents::default();
        let plan = Plan::new(&self.loaded.scene);
        let inputs: Vec<PathBuf> = self.files().iter().map(|path| paths::identity(path)).collect();
        let (mut frames, mut kept) = (Vec::new(), Vec::new());
        for number in task.frames.clone() {
            let loaded = self.frame(job, number)?;
            let prefix = job.prefix(task.input, number);
            let hash = world::fingerprint(&loaded, settings.repair, &mut contents)?;
            let fingerprint = hash.as_ref().map(|hash| fingerprint(&loaded, settings, hash));
            let files = Files::names(&prefix, &plan, job.storage);
            for output in &files {
                if inputs.contains(&paths::identity(output)) {
                    let message = "would be written over what the batch reads";
                    return Err(Error::invalid(output.display().to_string(), message)
                        .help("choose another folder: -o DIR"));
                }
            }
            let verdict = match &fingerprint {
                Some(fingerprint) if resume => resume::look(&files, fingerprint),
                _ => Verdict::Render,
            };
            let again = match verdict {
                Verdict::Keep => {
                    kept.push(number);
                    continue;
                }
                Verdict::Render => None,
                Verdict::Again(reason) => Some(reason),
            };
            let index = plan::index(job.frames(), task.input, number);
            frames.push(Frame { index, number, loaded, prefix, hash, fingerprint, again });
        }
        Ok((frames, kept))
    }

    fn frame(&self, job: &Job, number: u32) -> Result<Loaded> {
        let Some(turntable) = &job.turntable else {
            return Ok(self.loaded.clone());
        };
        let turned = turntable.frame(&self.loaded.description, self.pivot, number);
        scene::from_description("frame", &turned, &self.folder, &[])
    }

    /// Everything that is read for the picture: what the scene names, and the textures that its meshes
    /// name.
    fn files(&self) -> Vec<PathBuf> {
        let scene = &self.loaded.scene;
        let meshes = scene.shapes.iter().filter_map(|shape| match &shape.kind {
            ShapeKind::Trimesh(spec) => Some(spec.path.clone()),
            _ => None,
        });
        let mut files: Vec<PathBuf> = meshes.collect();
        for mesh in files.clone() {
            let folder = mesh.parent().unwrap_or(Path::new(""));
            let named = mesh::inspect_ply(&mesh).map(|summary| summary.texture_files);
            files.extend(named.unwrap_or_default().iter().map(|name| folder.join(name)));
        }
        let textures = scene.materials.iter().filter_map(|m| m.texture.as_ref());
        files.extend(textures.map(|texture| texture.path.clone()));
        files
    }
}
