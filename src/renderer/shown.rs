//! What the files of a picture tell of its scene, and the writer of these files.

use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, OnceLock};

use crate::accel::{Accelerator, BuildInfo};
use crate::error::{Error, Problem, Result};
use crate::film::{Channel, Film, ReservedFilm, Window};
use crate::layers::LayerPlan;
use crate::memory;
use crate::monitor::Monitor;
use crate::output::Outputs;
use crate::output::legend::Legend;
use crate::picture::{self, PictureHeader, Storage};
use crate::render::{RenderContext, render_layers};
use crate::scene::Loaded;
use crate::threads::lock;
use crate::world::{ContentHashes, ReadFiles, World, fingerprint};

/// What the files of a picture tell of its scene, without the world.
#[derive(Debug)]
pub(super) struct ShownScene {
    pub loaded: Loaded,
    plan: LayerPlan,
    pub warnings: Vec<Problem>,
    legend: Option<Legend>,
    /// `None` if a mesh is from memory: a hash would not cover it.
    files: Option<Arc<SceneFiles>>,
    /// [`fingerprint`] of scene and files, once a picture was written.
    hash: OnceLock<Option<String>>,
}

/// The files of a scene, which several pictures share.
#[derive(Debug)]
pub(super) struct SceneFiles {
    read: ReadFiles,
    /// Filled once a picture was written.
    contents: Mutex<ContentHashes>,
}

impl SceneFiles {
    pub fn of(world: &mut World) -> Arc<Self> {
        let (read, contents) = (std::mem::take(&mut world.read), Mutex::default());
        Arc::new(Self { read, contents })
    }
}

impl ShownScene {
    /// `more` are warnings of the scene's files.
    pub fn new(
        mut loaded: Loaded,
        more: impl IntoIterator<Item = Problem>,
        legend: Option<Legend>,
        files: Option<Arc<SceneFiles>>,
    ) -> Self {
        let mut warnings = std::mem::take(&mut loaded.warnings);
        warnings.extend(more);
        warnings.iter_mut().for_each(drop_nuls);
        let plan = LayerPlan::new(&loaded.scene);
        Self { loaded, plan, warnings, legend, files, hash: OnceLock::new() }
    }

    /// Renders the whole frame.
    pub fn render(
        &self,
        world: &World,
        accelerator: &dyn Accelerator,
        monitor: &Monitor,
    ) -> Result<Film> {
        let [width, height] = world.frame;
        let window = Window::full(width, height);
        let channels = self.plan.layout.channels.clone();
        memory::ensure_film_fits(window, channels.len())?;
        let mut film = ReservedFilm::new([width, height], window, channels)?.film();
        let isa = self.loaded.scene.backend.isa();
        let context = RenderContext { world, accelerator, isa, monitor };
        render_layers(context, &mut film, &self.plan, None)?;
        Ok(film)
    }

    /// The hash of the scene and its files, unless a mesh is from memory or a pipe, or a file has
    /// changed since it was read.
    fn hash(&self) -> Option<&str> {
        let files = self.files.as_ref()?;
        let hash = self.hash.get_or_init(|| {
            let mut contents = lock(&files.contents);
            let hash = fingerprint(&self.loaded, false, &mut contents).ok()??;
            contents.check(&files.read).ok().map(|()| hash)
        });
        hash.as_deref()
    }
}

/// Removes the NULs of the paths of meshes from memory.
pub(super) fn drop_nuls(problem: &mut Problem) {
    for text in [&mut problem.place, &mut problem.message] {
        text.retain(|c| c != '\0');
    }
}

/// The files that a [`PictureWriter`] wrote.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct WrittenPicture {
    /// Paths of the EXR and the PNG.
    pub files: [PathBuf; 2],
    /// Warnings about values that the EXR does not hold: numbers that are not finite or beyond a
    /// half, coverage beyond the ranks of cryptomattes.
    pub warnings: Vec<Problem>,
    /// Warnings about what the PNG does not show: a legend for which it is too small.
    pub png_warnings: Vec<Problem>,
}

/// Writes the films of a [`Renderer`](super::Renderer), also after the renderer and its scene are
/// dropped.
#[derive(Debug, Clone)]
pub struct PictureWriter {
    shown: Arc<ShownScene>,
    info: BuildInfo,
    float: bool,
}

impl PictureWriter {
    pub(super) fn new(shown: &Arc<ShownScene>, info: BuildInfo) -> Self {
        Self { shown: Arc::clone(shown), info, float: false }
    }

    /// Selects 32-bit floats for the EXR, or 16-bit floats, the default.
    pub fn float(self, float: bool) -> Self {
        Self { float, ..self }
    }

    /// Warnings of the scene, and of its files.
    pub fn warnings(&self) -> &[Problem] {
        &self.shown.warnings
    }

    /// Writes a film: see [`Renderer::write`](super::Renderer::write).
    ///
    /// # Errors
    /// A film with another size or other channels than this scene's, or with too few values; a
    /// folder that cannot be written to; a full disk.
    pub fn write(&self, film: &Film, prefix: impl AsRef<Path>) -> Result<WrittenPicture> {
        self.write_watched(film, prefix, &Monitor::default())
    }

    /// [`PictureWriter::write`] with a monitor that can stop it. Then no file is written.
    ///
    /// # Errors
    /// As [`PictureWriter::write`]; `Interrupted` if the monitor was stopped.
    pub fn write_watched(
        &self,
        film: &Film,
        prefix: impl AsRef<Path>,
        monitor: &Monitor,
    ) -> Result<WrittenPicture> {
        let ShownScene { loaded: Loaded { scene, .. }, plan, legend, .. } = &*self.shown;
        film.check()?;
        let frame = [scene.camera.width, scene.camera.height];
        if film.frame != frame {
            let [found, expected] = [film.frame, frame].map(|[w, h]| format!("{w} x {h}"));
            let message = format!("found a film of {found} pixels, expected {expected}");
            return Err(Error::invalid("film", message));
        }
        if film.planes.channels != plan.layout.channels {
            let names =
                |all: &[Channel]| all.iter().map(|c| &c.name[..]).collect::<Vec<_>>().join(" ");
            let found = format!("found the channels [{}]", names(&film.planes.channels));
            let message = format!("{found}, expected [{}]", names(&plan.layout.channels));
            return Err(Error::invalid("film", message));
        }
        let header = PictureHeader {
            backend_version: &self.info.version,
            scene_hash: self.shown.hash(),
            legend: legend.as_ref(),
            ..PictureHeader::default()
        };
        let storage = Storage { float: self.float, ..Storage::default() };
        let files = picture::PictureFiles::create(prefix.as_ref(), plan, storage)?;
        let (_, oddities) = picture::write(files, film, scene, header, storage, monitor)?;
        Ok(WrittenPicture {
            files: Outputs::names(prefix.as_ref()),
            warnings: picture::exr_warnings(&oddities),
            png_warnings: picture::png_warnings(&oddities),
        })
    }
}
