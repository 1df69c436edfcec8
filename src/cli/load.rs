//! Loads the scene that a command asks for: a file, stdin, or a mesh in a template.

use std::path::{Path, PathBuf};

use crate::error::{Problem, Result};
use crate::memory;
use crate::mesh::Mesh;
use crate::monitor::Monitor;
use crate::paths::seen_from;
use crate::scene::{Loaded, Overrides};
use crate::studio::{self, MeshScene, Subject, Template};
use crate::world::{LoadOptions, OwnImage, Sources, World, own_texture, sources};

/// A checked scene, ready to be rendered.
#[derive(Debug)]
pub struct SceneJob {
    /// The scene with all overrides applied.
    pub loaded: Loaded,
    /// Folder that the scene's paths are relative to.
    pub folder: PathBuf,
    /// Warnings of loading the input.
    pub warnings: Vec<Problem>,
    /// Meshes that are read already, because the camera depends on them.
    pub ready: Vec<(PathBuf, Mesh)>,
}

impl SceneJob {
    /// Returns the paths of all files that the render reads.
    pub fn inputs(&self, input: &Path) -> Vec<PathBuf> {
        self.sources(input).files
    }

    /// Returns `input` and all files that the scene names.
    pub fn sources(&self, input: &Path) -> Sources {
        let mut all = sources(&self.loaded.scene);
        all.files.push(input.to_owned());
        // The header of a mesh from a pipe is read only once. Errors are reported by the render.
        for (path, mesh) in self.ready.iter().filter(|(path, _)| !path.is_file()) {
            if let Some(image) = own_texture(path, mesh).ok().flatten().and_then(OwnImage::file) {
                all.files.push(image);
            }
        }
        all
    }

    /// Loads the world, with copies of instanced meshes if `copy_instances`. Calls `note` with each
    /// warning of the scene and of its files.
    ///
    /// # Errors
    /// As for [`World::load`].
    pub fn world(
        &mut self,
        monitor: &Monitor,
        copy_instances: bool,
        note: impl Fn(&str),
    ) -> Result<World> {
        let ready = std::mem::take(&mut self.ready);
        let memory_limit = memory::limit_of_machine();
        let options = LoadOptions { ready, copy_instances, memory_limit, ..LoadOptions::default() };
        let (world, more) = World::load(&self.loaded.scene, options, monitor)?;
        for warning in self.warnings.iter().chain(&more) {
            note(&format!("warning: {warning}"));
        }
        Ok(world)
    }
}

/// Input of [`load`]: the file to load, with checked options.
#[derive(Debug)]
pub struct SceneRequest<'a> {
    /// Overrides of the scene's values.
    pub overrides: Overrides,
    /// Samples on every area light, sun and environment per shading point.
    pub light_samples: Option<u32>,
    /// Scene file in which a mesh is shown, in place of the studio.
    pub template: Option<&'a Path>,
    /// Text of a scene in which a mesh is shown, in place of the studio, if `template` is `None`.
    pub studio: Option<&'a str>,
    /// Limit of the memory in bytes.
    pub max_memory: Option<u64>,
    /// The input, with the options for a mesh.
    pub subject: Subject<'a>,
}

impl<'a> SceneRequest<'a> {
    /// Makes a request for `input` with default options: a scene file, `-` for stdin, or a mesh.
    pub fn new(input: &'a Path) -> Self {
        Self {
            overrides: Overrides::default(),
            light_samples: None,
            template: None,
            studio: None,
            max_memory: None,
            subject: Subject::new(input),
        }
    }
}

/// Loads a scene, or a mesh in a scene. If the monitor has a stop request, reading a mesh ends with
/// an error.
///
/// # Errors
/// All problems of the scene and its overrides; a mesh that cannot be read or does not fit the
/// memory limit.
pub fn load(request: SceneRequest, monitor: &Monitor) -> Result<SceneJob> {
    let input = request.subject.path;
    if studio::is_mesh(input) {
        return load_mesh(request, monitor);
    }
    let SceneRequest { overrides, light_samples, .. } = request;
    // The text is parsed twice with `--light-samples`, and a pipe can be read only once.
    let scene = if input == Path::new("-") { Template::stdin()? } else { Template::file(input)? };
    let mut warnings = Vec::new();
    let loaded = studio::load(scene.source(), overrides, light_samples, &mut warnings)?;
    Ok(SceneJob { loaded, folder: scene.folder, warnings, ready: Vec::new() })
}

/// Reads a mesh, and makes a scene of the template that shows the whole mesh.
fn load_mesh(request: SceneRequest, monitor: &Monitor) -> Result<SceneJob> {
    let SceneRequest { overrides, light_samples, template, studio, max_memory, subject } = request;
    let template = match (template, studio) {
        (Some(template), _) => Template::file(template)?,
        (None, Some(text)) => Template::builtin("<studio>", text),
        (None, None) => Template::studio(subject.looks.studio.unwrap_or_default()),
    };
    if let Some(limit) = max_memory {
        let alone = memory::predict_mesh(subject.path, subject.looks.points.is_some())?;
        let help = "film and accelerator come on top: `lightpath info` predicts all";
        alone.check(limit).map_err(|error| error.help(help))?;
    }
    let memory_limit = max_memory.map(memory::limit_for_meshes).or_else(memory::limit_of_machine);
    let subject = Subject { memory_limit, ..subject };
    let shown = studio::show(&subject, &template, overrides, light_samples, monitor)?;
    let MeshScene { loaded, warnings, mesh, .. } = shown;
    Ok(SceneJob { loaded, folder: template.folder, warnings, ready: vec![mesh] })
}

/// Returns the text of the scene for the file `target`, with paths relative to its folder.
///
/// # Errors
/// A path that is not UTF-8.
pub fn saved(job: &SceneJob, target: &Path) -> Result<String> {
    let to = target.parent().unwrap_or(Path::new(""));
    let mut description = job.loaded.description.clone();
    for path in description.paths_mut() {
        path.0 = seen_from(&job.folder.join(&path.0), to)?;
    }
    Ok(description.to_text())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::error::ErrorKind;
    use std::sync::atomic::Ordering::Relaxed;

    #[test]
    fn a_stop_request_ends_the_reading_of_a_mesh() {
        let mesh = Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/assets/ball.ply"));
        let monitor = Monitor::default();
        assert!(load(SceneRequest::new(mesh), &monitor).is_ok());
        monitor.signal.store(2, Relaxed);
        let stopped = load(SceneRequest::new(mesh), &monitor).unwrap_err();
        assert_eq!(stopped.kind, ErrorKind::Interrupted(2));
    }
}
