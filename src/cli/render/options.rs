//! Turns the arguments of `render` into checked options: [`request`] before the scene is loaded,
//! [`RenderOptions::resolve`] with the scene.

use std::path::PathBuf;

use crate::cli::flags;
use crate::cli::load::{SceneJob, SceneRequest};
use crate::cli::outputs::OutputFlags;
use crate::cli::overrides;
use crate::error::{Problem, Result};
use crate::layers::LayerPlan;
use crate::memory::{self, Budget};
use crate::picture::{self, Storage};
use crate::render::{Adaptive, sampling};
use crate::scene::Overrides;
use crate::{paths, studio};

use super::args::RenderArgs;
use super::dataset::DatasetPaths;
use super::layers;
use super::part::PicturePart;
use super::plate::PlateImage;

/// Converts the arguments to a request for [`crate::cli::load::load`].
///
/// # Errors
/// Flags for a mesh without a mesh; an instruction set that this machine or this build lacks.
pub fn request(args: &RenderArgs) -> Result<SceneRequest<'_>> {
    if !studio::is_mesh(&args.input) {
        let mesh = &args.mesh;
        let given = (&mesh.placement, mesh.template.as_deref(), &mesh.looks);
        flags::refuse_mesh_flags(given, &args.input.display().to_string())?;
    }
    let mut overrides = overrides::from_flags(&args.scene, &args.machine)?;
    if args.scene.spp.is_none() {
        let mut count = Overrides::default();
        count.flag("--of", "/spp", args.split.of);
        overrides.prepend(count);
    }
    Ok(SceneRequest {
        overrides,
        light_samples: args.scene.light_samples,
        template: args.mesh.template.as_deref(),
        max_memory: args.machine.max_memory,
        subject: args.mesh.subject(&args.input)?,
        ..SceneRequest::new(&args.input)
    })
}

/// Arguments of one render, and what follows from them, checked against its scene.
#[derive(Debug)]
pub struct RenderOptions<'a> {
    /// The arguments.
    pub args: &'a RenderArgs,
    /// Channels of the film.
    pub plan: LayerPlan,
    /// The part of the picture that this render makes.
    pub part: PicturePart,
    /// Settings of adaptive sampling; `None` if every pixel gets the same number of samples.
    pub adaptive: Option<Adaptive>,
    /// Limits that follow from `--max-memory`.
    pub budget: Option<Budget>,
    /// Path of the picture's files without their endings.
    pub prefix: PathBuf,
    /// Format of the picture, or of the merged picture if this is a part.
    pub storage: Storage,
    /// Layers that are also written as PNGs, with the paths of the PNGs.
    pub previews: Vec<(String, PathBuf)>,
    /// Paths of the files of `--visible-faces` and `--png-ids`.
    pub dataset: DatasetPaths,
    /// Image of `--over`: the PNG shows the picture over it.
    pub plate: Option<PlateImage>,
}

impl<'a> RenderOptions<'a> {
    /// Checks the arguments against the loaded scene. `threads` is the size of the thread pool.
    ///
    /// # Errors
    /// Flags that contradict each other or the scene; a scene that does not fit the memory limit.
    pub fn resolve(args: &'a RenderArgs, job: &SceneJob, threads: usize) -> Result<Self> {
        let scene = &job.loaded.scene;
        let storage = args.files.storage();
        picture::check_storage(scene, storage)?;
        let plan = LayerPlan::new(scene);
        let part = PicturePart::new(args, scene, &plan)?;
        let adaptive = sampling::adaptive(&args.sampling.sampling(), scene)?;
        args.split.check_sampling(adaptive.is_some())?;
        let budget = args.machine.max_memory.map(|limit| {
            let window = part.window;
            let sums = adaptive.map_or(0, |adaptive| sampling::bytes(&adaptive, scene, window));
            let deep_png_bytes = memory::deeper_png_bytes(window, storage.depth);
            let plate = args.files.plate.bytes(window)?;
            let other_bytes = sums.saturating_add(deep_png_bytes).saturating_add(plate);
            let faces = args.files.dataset.bytes(scene, window, adaptive.as_ref(), threads)?;
            let other_bytes = other_bytes.saturating_add(faces);
            Budget::check(limit, scene, (window, part.channels().len(), other_bytes), threads)
        });
        let budget = budget.transpose()?;
        let prefix = paths::prefix(args.output.as_deref(), &args.input);
        let previews = layers::preview_paths(&args.files.png_layer, scene, &prefix)?;
        let dataset = args.files.dataset.paths(scene, &prefix)?;
        let plate = args.files.plate.plate(scene, args.machine.max_memory)?;
        Ok(Self { args, plan, part, adaptive, budget, prefix, storage, previews, dataset, plate })
    }

    /// Returns warnings about options that make the picture irreproducible or have no effect, and
    /// about the plate.
    pub fn warnings(&self) -> Vec<Problem> {
        let sidecar = self.storage.crypto_sidecar && self.plan.mattes.is_empty();
        let sidecar = sidecar.then(|| layers::no_mattes().help("--aov cryptomatte"));
        let previews = !self.args.files.png_layer.is_empty() && self.previews.is_empty();
        let previews = previews.then(|| layers::no_layers().help("--aov all"));
        let sampling = self.adaptive.as_ref().and_then(sampling::warning);
        let plate = self.plate.iter().flat_map(PlateImage::warnings);
        sampling.into_iter().chain(plate).chain(sidecar).chain(previews).collect()
    }

    /// Returns the format of the picture's files. The file of a part keeps every bit; its attribute
    /// holds the format of the merged picture.
    pub fn file_storage(&self) -> Storage {
        match self.part.exact {
            true => Storage { float: true, depth: self.storage.depth, ..Storage::default() },
            false => self.storage,
        }
    }

    /// Returns the flags that name text files.
    pub fn text_files(&self) -> OutputFlags<'_> {
        let RenderArgs { mesh, report, .. } = self.args;
        OutputFlags(vec![("--stats", &report.stats), ("--write-scene", &mesh.write_scene)])
    }

    /// Returns the paths of all files that will be written.
    pub fn outputs(&self) -> Vec<PathBuf> {
        let pictures =
            picture::PictureFiles::names(&self.prefix, &self.plan, self.storage).into_iter();
        let previews = self.previews.iter().map(|(_, path)| path.clone());
        let others = self.text_files().paths().collect::<Vec<_>>();
        pictures.chain(previews).chain(self.dataset.all().cloned()).chain(others).collect()
    }
}
