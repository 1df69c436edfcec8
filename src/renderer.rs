//! The library's main interface: a [`Scene`] and meshes -> an [`Accelerator`] -> a [`Film`] ->
//! files.

use std::path::{Path, PathBuf};

use crate::accel::{self, Accelerator, BuildOptions};
use crate::error::{Error, Problem, Result};
use crate::film::{Film, ReservedFilm, Window};
use crate::layers::LayerPlan;
use crate::mesh::Mesh;
use crate::monitor::Monitor;
use crate::output::Outputs;
use crate::output::exr::Sequence;
use crate::picture::{self, PictureHeader, Storage};
use crate::render;
use crate::scene::{self, Scene, Shape, ShapeKind, Smooth, Source, Trimesh};
use crate::world::{LoadOptions, World};

/// A scene whose files are loaded. It can be rendered any number of times.
///
/// Everything runs on the threads of the current rayon pool. Nothing is printed and no error ends
/// the process: an [`Error`] holds all problems that were found. [`crate::render`],
/// [`crate::accel`] and [`crate::output`] offer more control: crops, progress, cancellation.
#[derive(Debug)]
pub struct Renderer {
    scene: Scene,
    world: World,
    plan: LayerPlan,
    warnings: Vec<Problem>,
    monitor: Monitor,
}

impl Renderer {
    /// Loads the scene's meshes and textures.
    ///
    /// # Errors
    /// All problems of these files.
    pub fn new(scene: Scene) -> Result<Self> {
        Self::with_meshes(scene, Vec::new())
    }

    /// [`Renderer::new`] with meshes from memory. Each tuple is a shape's name, the name of a
    /// material of the scene, and a mesh in world units. Normals are interpolated if the mesh has
    /// normals.
    ///
    /// # Errors
    /// A material that the scene does not have; all problems of its files.
    pub fn with_meshes(mut scene: Scene, meshes: Vec<(&str, &str, Mesh)>) -> Result<Self> {
        let mut ready = Vec::new();
        for (name, material, mesh) in meshes {
            let of_name = |m: &scene::Material| m.name.as_deref() == Some(material);
            let Some(index) = scene.materials.iter().position(of_name) else {
                let message =
                    format!("found the material {material:?}, which the scene does not have");
                return Err(Error::invalid(name, message));
            };
            // The NUL at the start keeps the name apart from all file names.
            let path = PathBuf::from(format!("\0{}/{name}", ready.len()));
            let trimesh = Trimesh {
                place: name.to_string(),
                path: path.clone(),
                fit: None,
                rotate_deg: glam::DVec3::ZERO,
                size: 1.0,
                center: glam::DVec3::ZERO,
                smooth: if mesh.normals.is_some() { Smooth::All } else { Smooth::Off },
                bvh: true,
                vertex_colors: mesh.colors.is_some(),
                vertex_color_space: None,
            };
            let kind = ShapeKind::Trimesh(Box::new(trimesh));
            scene.shapes.push(Shape { name: Some(name.to_string()), material: index, kind });
            ready.push((path, mesh));
        }
        let monitor = Monitor::default();
        let options = LoadOptions { ready, ..LoadOptions::default() };
        let (world, warnings) = World::load(&scene, options, &monitor)?;
        let plan = LayerPlan::new(&scene);
        Ok(Self { scene, world, plan, warnings, monitor })
    }

    /// Warnings about the scene: problems that do not prevent a render.
    pub fn warnings(&self) -> &[Problem] {
        &self.warnings
    }

    /// Builds the acceleration structure, with the backend that the scene names (`accelerator`, by
    /// default `bvh`).
    ///
    /// # Errors
    /// A backend that cannot run here; no memory.
    pub fn accelerator(&self) -> Result<Box<dyn Accelerator + '_>> {
        let options = BuildOptions { threads: rayon::current_num_threads(), max_bytes: None };
        accel::build(&self.world.geometry, self.scene.backend, &options, &self.monitor)
    }

    /// Renders the whole frame with its layers. The bits are the same for any number of threads.
    ///
    /// # Errors
    /// No memory for the film.
    pub fn render(&self, accelerator: &dyn Accelerator) -> Result<Film> {
        let [width, height] = self.world.frame;
        let window = Window::full(width, height);
        let mut film =
            ReservedFilm::new([width, height], window, self.plan.recipe.channels.clone())?.film();
        let (isa, plan) = (self.scene.backend.isa(), &self.plan);
        render::render_layers(&self.world, accelerator, isa, &mut film, plan, &self.monitor)?;
        Ok(film)
    }

    /// Writes a film to `PREFIX.exr` and `PREFIX.png`, whole or not at all. Returns their names.
    /// The header is the same as the command line's, `accelerator` included, but without
    /// `lightpath:sceneHash`, which covers files.
    ///
    /// # Errors
    /// A folder that cannot be written to; a full disk.
    pub fn write(
        &self,
        film: &Film,
        accelerator: &dyn Accelerator,
        prefix: &Path,
    ) -> Result<[PathBuf; 2]> {
        let says = PictureHeader {
            more: &[],
            info: &accelerator.info(),
            scene_hash: None,
            spp: None,
            sequence: Sequence::default(),
            render_seconds: None,
            fingerprint: None,
        };
        let storage = Storage::default();
        let files = picture::Files::create(prefix, &self.plan, storage)?;
        picture::write(files, film, &self.scene, says, storage, &self.monitor)?;
        Ok(Outputs::names(prefix))
    }
}

impl Scene {
    /// Reads a scene from its JSON text (docs/guide/scene-format.md). Paths are relative to the
    /// working folder.
    ///
    /// # Errors
    /// All problems of the text, each with line and column.
    pub fn from_json(text: &str) -> Result<Self> {
        let source = Source::Text { name: "scene", text: text.as_bytes(), folder: Path::new("") };
        Ok(scene::load(source, &[])?.scene)
    }
}
