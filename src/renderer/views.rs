//! Pictures of one scene from several cameras.

use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::{fmt, mem};

use super::loading::{add_meshes, build, in_default_studio, load_options, load_with, of_text};
use super::loading::{readable, use_material};
use super::shown::{PictureWriter, SceneFiles, ShownScene};
use crate::accel::Accelerator;
use crate::error::{ErrorKind, Problem, Result};
use crate::film::Film;
use crate::mesh::Mesh;
use crate::monitor::Monitor;
use crate::scene::{self, CheckedMaterial, Loaded, Source};
use crate::studio::{self, MeshScene, Stand};
use crate::world::World;

/// Makes a mesh from memory, once or each time that it is needed again.
pub type MakeMesh = Box<dyn Fn() -> Result<Mesh> + Send + Sync>;

type NamedMesh = (String, String, MakeMesh);

/// A scene, or a mesh in the built-in studio, that is rendered from one camera after another.
///
/// Each picture has the bits that [`LoadedScene`](super::LoadedScene) has for its camera alone.
/// Files are read and the acceleration structure is built for the first view. They are kept for the
/// next view unless its camera changes more than itself: the origin of the coordinates, or how a
/// mesh stands in the studio. Only one acceleration structure is in memory at a time.
///
/// ```
/// use lightpath::{Mesh, Monitor, Positions, Views};
///
/// # fn main() -> lightpath::Result<()> {
/// let corners = vec![[-1.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]];
/// let mesh = Mesh::new(Positions::F32(corners), vec![[0, 1, 2]])?;
/// let mut views = Views::of_mesh(Box::new(move || Ok(mesh.clone())));
/// for position in ["/camera/position=[0,2,5]", "/camera/position=[3,2,5]"] {
///     let small = ["/camera/width=32", "/camera/height=24", "/camera/target=[0,1,0]", position];
///     let (film, _) = views.render(&small, &Monitor::default())?;
///     assert_eq!(film.frame, [32, 24]);
/// }
/// # Ok(())
/// # }
/// ```
pub struct Views {
    subject: Subject,
    kept: Option<Kept>,
}

enum Subject {
    /// A scene file.
    File(PathBuf),
    /// The text of a scene, and meshes in world space: name, material, mesh.
    Text(String, Vec<NamedMesh>),
    /// A mesh in the studio, from memory or from a file.
    Mesh { path: PathBuf, make: Option<MakeMesh> },
}

/// A subject as one camera shows it.
struct Found {
    loaded: Loaded,
    /// The meshes that are in memory. `None` if they were not needed.
    meshes: Option<Vec<(PathBuf, Mesh)>>,
    stand: Option<Stand>,
}

/// What views share.
struct Kept {
    /// The scene with the camera of the last view.
    shown: Arc<ShownScene>,
    stand: Option<Stand>,
    world: World,
    accelerator: Box<dyn Accelerator>,
    /// Warnings of the files, which do not depend on a camera.
    warnings: Vec<Problem>,
    files: Option<Arc<SceneFiles>>,
}

impl fmt::Debug for Views {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let info = self.kept.as_ref().map(|kept| kept.accelerator.info());
        f.debug_struct("Views").field("accelerator", &info).finish_non_exhaustive()
    }
}

impl Views {
    /// Shows a scene file (`.json`), or a mesh file in the studio.
    pub fn of_file(path: impl Into<PathBuf>) -> Self {
        let path = path.into();
        let is_scene = path.extension().is_some_and(|end| end.eq_ignore_ascii_case("json"));
        let subject =
            if is_scene { Subject::File(path) } else { Subject::Mesh { path, make: None } };
        Self { subject, kept: None }
    }

    /// Shows a scene with meshes from memory: name, material, mesh. See
    /// [`LoadedScene::with_meshes`](super::LoadedScene::with_meshes).
    pub fn of_scene(text: &str, meshes: Vec<(String, String, MakeMesh)>) -> Self {
        Self { subject: Subject::Text(text.to_string(), meshes), kept: None }
    }

    /// Shows a mesh from memory in the studio: see
    /// [`LoadedScene::of_mesh_in_studio`](super::LoadedScene::of_mesh_in_studio).
    pub fn of_mesh(mesh: MakeMesh) -> Self {
        let (path, make) = (PathBuf::from(scene::IN_MEMORY), Some(mesh));
        Self { subject: Subject::Mesh { path, make }, kept: None }
    }

    /// Renders the picture of one camera, on the threads of the current rayon pool. Overrides
    /// outside `/camera` should be those of the last view: others load and build again. After an
    /// error another view can be rendered.
    ///
    /// # Errors
    /// All problems of the scene, or else of its files; a backend that cannot run here; too little
    /// memory; `Interrupted` if the monitor was stopped.
    pub fn render(
        &mut self,
        overrides: &[&str],
        monitor: &Monitor,
    ) -> Result<(Film, PictureWriter)> {
        let rendered = self.prepare(overrides, monitor)?.render(monitor);
        let is_stop = |kind| matches!(kind, ErrorKind::Interrupted(_));
        if rendered.as_ref().is_err_and(|error| !is_stop(error.kind)) {
            // A texture whose file cannot be read any more stays so in memory.
            self.kept = None;
        }
        rendered
    }

    /// Returns the scene of a camera. Loads and builds only if what is kept does not serve it.
    fn prepare(&mut self, overrides: &[&str], monitor: &Monitor) -> Result<&Kept> {
        let mut found = self.subject.load(overrides, self.kept.as_ref(), monitor)?;
        let kept = match self.kept.take().filter(|kept| kept.serves(&mut found.loaded)) {
            Some(mut kept) => {
                kept.show(found.loaded);
                kept
            }
            // The memory of what was kept is free now, before another scene takes its own.
            None => {
                if found.meshes.is_none() {
                    found = self.subject.load(overrides, None, monitor)?;
                }
                Kept::new(found, self.subject.is_of_files(), monitor)?
            }
        };
        Ok(self.kept.insert(kept))
    }
}

impl Subject {
    /// Returns true if no mesh is from memory.
    fn is_of_files(&self) -> bool {
        match self {
            Self::File(_) => true,
            Self::Text(_, meshes) => meshes.is_empty(),
            Self::Mesh { make, .. } => make.is_none(),
        }
    }

    /// Loads the scene. `kept` is that of another view, which may have what this one needs.
    fn load(&self, overrides: &[&str], kept: Option<&Kept>, monitor: &Monitor) -> Result<Found> {
        match self {
            Self::File(path) => load_scene((Source::File(path), &[]), overrides, kept),
            Self::Text(text, meshes) => load_scene((of_text(text), meshes), overrides, kept),
            Self::Mesh { path, make } => load_mesh((path, make.as_ref()), overrides, kept, monitor),
        }
    }
}

fn load_scene(
    (source, meshes): (Source, &[NamedMesh]),
    overrides: &[&str],
    kept: Option<&Kept>,
) -> Result<Found> {
    let mut loaded = load_with(source, overrides)?;
    if let Some(kept) = kept {
        // The shapes of the meshes from memory are the last ones.
        let shapes = &kept.shown.loaded.scene.shapes;
        loaded.scene.shapes.extend_from_slice(&shapes[shapes.len() - meshes.len()..]);
        for (_, material, _) in meshes {
            use_material(&mut loaded.warnings, material);
        }
        return Ok(Found { loaded, meshes: None, stand: None });
    }
    let mut ready = Vec::new();
    for (name, material, make) in meshes {
        ready.push((&name[..], &material[..], make()?));
    }
    let meshes = Some(add_meshes(&mut loaded, ready)?);
    Ok(Found { loaded, meshes, stand: None })
}

fn load_mesh(
    (path, make): (&Path, Option<&MakeMesh>),
    overrides: &[&str],
    kept: Option<&Kept>,
    monitor: &Monitor,
) -> Result<Found> {
    let (subject, template, user) = in_default_studio(path, overrides);
    if let Some(stand) = kept.and_then(|kept| kept.stand.as_ref()) {
        let again = studio::show_again(stand, &subject, &template, user.clone());
        if let Some((loaded, warnings)) = again.map_err(readable)? {
            let loaded = Loaded { warnings, ..loaded };
            return Ok(Found { loaded, meshes: None, stand: None });
        }
    }
    let shown = match make {
        None => studio::show(&subject, &template, user, None, monitor),
        Some(make) => {
            let mesh = make()?;
            mesh.check("mesh")?;
            studio::show_mesh(&subject, mesh, &template, user, None)
        }
    };
    let MeshScene { loaded, warnings, mesh, stand, .. } = shown.map_err(readable)?;
    let loaded = Loaded { warnings, ..loaded };
    Ok(Found { loaded, meshes: Some(vec![mesh]), stand })
}

impl Kept {
    /// Loads the files of a scene and builds its accelerator.
    fn new(found: Found, is_of_files: bool, monitor: &Monitor) -> Result<Self> {
        let Found { loaded, meshes, stand } = found;
        let options = load_options(meshes.unwrap_or_default());
        let (mut world, warnings) =
            World::load_unseen(&loaded.scene, options, monitor).map_err(readable)?;
        let accelerator = build(&world, loaded.scene.backend, monitor)?;
        let files = is_of_files.then(|| SceneFiles::of(&mut world));
        let shown = shown(loaded, &world, &warnings, files.as_ref());
        Ok(Self { shown, stand, world, accelerator, warnings, files })
    }

    /// Returns whether another scene of the same subject differs only in its camera, and a render
    /// of it alone would have the same origin.
    fn serves(&self, other: &mut Loaded) -> bool {
        let kept = &self.shown.loaded;
        // Large scenes are not copied to compare all but their cameras.
        let camera = mem::replace(&mut other.description.camera, kept.description.camera.clone());
        let is_same = other.description == kept.description
            && names(&other.scene.materials).eq(names(&kept.scene.materials));
        other.description.camera = camera;
        is_same && self.world.view(&kept.scene, &other.scene.camera).is_own()
    }

    /// Takes the scene of another camera, which this one serves.
    fn show(&mut self, loaded: Loaded) {
        self.shown = shown(loaded, &self.world, &self.warnings, self.files.as_ref());
    }

    fn render(&self, monitor: &Monitor) -> Result<(Film, PictureWriter)> {
        let world = self.world.frame_of(&self.shown.loaded.scene);
        let film = self.shown.render(&world, self.accelerator.as_ref(), monitor)?;
        Ok((film, PictureWriter::new(&self.shown, self.accelerator.info())))
    }
}

/// The names of materials in their order, in which shapes count them. Descriptions that differ only
/// in it are equal.
fn names(materials: &[CheckedMaterial]) -> impl Iterator<Item = Option<&str>> {
    materials.iter().map(|material| material.name.as_deref())
}

/// Returns what the files of a picture tell of a scene whose world is loaded, with the warnings of
/// the world and those of the camera.
fn shown(
    loaded: Loaded,
    world: &World,
    warnings: &[Problem],
    files: Option<&Arc<SceneFiles>>,
) -> Arc<ShownScene> {
    let camera = &loaded.scene.camera;
    let of_camera = world.camera_warnings(&loaded.scene, std::slice::from_ref(camera));
    let of_origin = world.origin_warnings(&loaded.scene);
    let more: Vec<_> = warnings.iter().cloned().chain(of_camera).chain(of_origin).collect();
    Arc::new(ShownScene::new(loaded, more, world.legend.clone(), files.cloned()))
}
