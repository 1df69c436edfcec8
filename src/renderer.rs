//! The library's main interface: a scene and meshes -> [`LoadedScene`] -> [`Renderer`] -> [`Film`]
//! -> files.

mod loading;
mod ray_query;
mod shown;
mod views;

pub use ray_query::{Hit, Ray};
pub use shown::{PictureWriter, WrittenPicture};
pub use views::{MakeMesh, Views};

use std::fmt;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use self::loading::{
    add_meshes, build, in_default_studio, load_with, load_world, of_text, readable,
};
use self::ray_query::{ShapeNumber, closest_of_packet, occlusion_of_packet};
use self::shown::{SceneFiles, ShownScene};
use crate::accel::Accelerator;
use crate::error::{Problem, Result};
use crate::film::Film;
use crate::mesh::Mesh;
use crate::monitor::Monitor;
use crate::parallel;
use crate::ray::LANES;
use crate::scene::{self, Loaded, Source};
use crate::studio::{self, MeshScene};
use crate::world::World;

/// A scene whose files are in memory. [`LoadedScene::renderer`] makes it ready for rays.
///
/// A scene is JSON (docs/guide/scene-format.md). It also holds the settings of the render: picture
/// size, samples, layers, backend. Each constructor takes overrides `/json/pointer=VALUE`, which
/// change or add values. VALUE is JSON; other text is taken as a string.
///
/// ```
/// use lightpath::LoadedScene;
///
/// # fn main() -> lightpath::Result<()> {
/// let scene = r#"{ "camera": { "type": "pinhole", "width": 640, "height": 480, "fov": 40,
///                              "position": [0, 0, 5], "lookat": [0, 0, -1], "up": [0, 1, 0] },
///                  "scene": { "lightsources": [{ "type": "pointlight", "position": [0, 5, 5],
///                                                "id": [1, 1, 1] }],
///                             "shapes": [{ "type": "sphere", "center": [0, 0, 0], "radius": 1,
///                                          "material": {} }] } }"#;
/// let overrides = ["/camera/width=33", "/camera/height=25", r#"/output/layers=["Z"]"#];
/// let scene = LoadedScene::from_json(scene, &overrides)?;
/// let film = scene.renderer()?.render()?;
/// assert_eq!(film.frame, [33, 25]);
/// let depth = film.planes.index("Z").expect("the layer that was asked for");
/// let middle = film.planes.float(depth, 33 * 12 + 16);
/// assert!((middle - 4.0).abs() < 1e-3, "the sphere begins 4 units before the camera");
/// # Ok(())
/// # }
/// ```
///
/// Clones share everything.
#[derive(Debug, Clone)]
pub struct LoadedScene {
    shown: Arc<ShownScene>,
    world: Arc<World>,
    /// How hits name the shapes of the scene.
    numbers: Arc<[ShapeNumber]>,
}

impl LoadedScene {
    /// Reads a scene file with its meshes and textures. Paths in it are relative to its folder.
    ///
    /// # Errors
    /// All problems of the scene, or else all problems of its files.
    pub fn read(path: impl AsRef<Path>, overrides: &[&str]) -> Result<Self> {
        Self::read_watched(path, overrides, &Monitor::default())
    }

    /// [`LoadedScene::read`] with a monitor that can stop it, but not while it waits for a pipe.
    ///
    /// # Errors
    /// As [`LoadedScene::read`]; `Interrupted` if the monitor was stopped.
    pub fn read_watched(
        path: impl AsRef<Path>,
        overrides: &[&str],
        monitor: &Monitor,
    ) -> Result<Self> {
        Self::load(Source::File(path.as_ref()), overrides, Vec::new(), monitor)
    }

    /// Takes a scene from its JSON text. Paths in it are relative to the working folder.
    ///
    /// # Errors
    /// As [`LoadedScene::read`]. Problems of the text have line and column.
    pub fn from_json(text: &str, overrides: &[&str]) -> Result<Self> {
        Self::with_meshes(text, overrides, Vec::new())
    }

    /// Takes a scene from its JSON text, with meshes from memory. Each tuple is a shape's name, the
    /// name of a material of the scene, and a mesh in world space. Normals are interpolated if the
    /// mesh has normals. A texture that a mesh names is looked for in the working folder.
    ///
    /// # Errors
    /// A material that the scene does not have; all problems of the scene, or else of its files and
    /// meshes.
    pub fn with_meshes(
        text: &str,
        overrides: &[&str],
        meshes: Vec<(&str, &str, Mesh)>,
    ) -> Result<Self> {
        Self::with_meshes_watched(text, overrides, meshes, &Monitor::default())
    }

    /// [`LoadedScene::with_meshes`] with a monitor that can stop it.
    ///
    /// # Errors
    /// As [`LoadedScene::with_meshes`]; `Interrupted` if the monitor was stopped.
    pub fn with_meshes_watched(
        text: &str,
        overrides: &[&str],
        meshes: Vec<(&str, &str, Mesh)>,
        monitor: &Monitor,
    ) -> Result<Self> {
        Self::load(of_text(text), overrides, meshes, monitor)
    }

    /// Makes a scene of a mesh alone, in its own coordinates, for tracing rays. It has no light, so
    /// its picture is black.
    ///
    /// # Errors
    /// Coordinates beyond 1e18; arrays that do not fit each other.
    pub fn of_mesh(mesh: Mesh) -> Result<Self> {
        let scene = r#"{ "camera": { "type": "pinhole", "width": 1, "height": 1, "fov": 40,
              "position": [0, 0, 1], "lookat": [0, 0, -1], "up": [0, 1, 0] },
            "scene": { "materials": { "mesh": {} }, "shapes": [] } }"#;
        let mut loaded = load_with(of_text(scene), &[])?;
        let ready = add_meshes(&mut loaded, vec![("mesh", "mesh", mesh)])?;
        let (world, _) = load_world(&loaded, ready, &Monitor::default())?;
        // Nobody uses the camera, so a warning that it does not see the mesh would be noise.
        loaded.warnings.clear();
        Ok(Self::new(loaded, world, [], None))
    }

    /// Makes a scene of a mesh in the built-in studio: scaled, set on the ground, lit, with a
    /// camera that sees all of the mesh.
    ///
    /// `path` is the file of the mesh. A texture that the mesh names is looked for beside it. For a
    /// mesh without a file, see [`LoadedScene::of_mesh_in_studio`].
    ///
    /// ```
    /// use lightpath::{LoadedScene, Mesh};
    ///
    /// # fn main() -> Result<(), Box<dyn std::error::Error>> {
    /// let folder = tempfile::tempdir()?;
    /// let path = folder.path().join("roof.ply");
    /// std::fs::write(&path, "ply\nformat ascii 1.0\nelement vertex 4\nproperty float x\n\
    ///     property float y\nproperty float z\nelement face 2\n\
    ///     property list uchar int vertex_indices\nend_header\n\
    ///     -1 0 1\n1 0 1\n1 1 0\n-1 1 0\n3 0 1 2\n3 0 2 3\n")?;
    ///
    /// let mesh = Mesh::read(&path)?;
    /// let overrides = ["/camera/width=48", "/camera/height=48", "/spp=1"];
    /// let scene = LoadedScene::in_studio(mesh, &path, &overrides)?;
    /// let renderer = scene.renderer()?;
    /// let film = renderer.render()?;
    /// // The middle of the picture shows the mesh, lit by the studio.
    /// let [red, green, blue, _] = film.pixels[48 * 24 + 24];
    /// assert!(red > 0.05 && green > 0.05 && blue > 0.05);
    ///
    /// let [exr, png] = renderer.write(&film, folder.path().join("roof"))?.files;
    /// assert!(exr.ends_with("roof.exr") && std::fs::metadata(exr)?.len() > 0);
    /// assert!(png.ends_with("roof.png") && std::fs::metadata(png)?.len() > 0);
    /// # Ok(())
    /// # }
    /// ```
    ///
    /// # Errors
    /// All problems of the overrides; arrays that do not fit each other; a path that is no PLY
    /// file's or not UTF-8; a texture that cannot be read.
    pub fn in_studio(mesh: Mesh, path: impl AsRef<Path>, overrides: &[&str]) -> Result<Self> {
        Self::in_studio_watched(mesh, path, overrides, &Monitor::default())
    }

    /// [`LoadedScene::in_studio`] with a monitor that can stop it.
    ///
    /// # Errors
    /// As [`LoadedScene::in_studio`]; `Interrupted` if the monitor was stopped.
    pub fn in_studio_watched(
        mesh: Mesh,
        path: impl AsRef<Path>,
        overrides: &[&str],
        monitor: &Monitor,
    ) -> Result<Self> {
        mesh.check("mesh")?;
        let (subject, template, user) = in_default_studio(path.as_ref(), overrides);
        let shown = studio::show_mesh(&subject, mesh, &template, user, None).map_err(readable)?;
        let MeshScene { loaded, warnings, mesh, .. } = shown;
        Self::with_ready(Loaded { warnings, ..loaded }, vec![mesh], monitor)
    }

    /// [`LoadedScene::in_studio`] for a mesh without a file. A texture that it names is looked for
    /// in the working folder.
    ///
    /// # Errors
    /// As [`LoadedScene::in_studio`].
    pub fn of_mesh_in_studio(mesh: Mesh, overrides: &[&str]) -> Result<Self> {
        Self::in_studio(mesh, scene::IN_MEMORY, overrides)
    }

    /// Warnings: problems that do not prevent a render.
    pub fn warnings(&self) -> &[Problem] {
        &self.shown.warnings
    }

    /// Builds the acceleration structure, with the backend that the scene names
    /// (`/scene/accelerator`, by default `bvh`), on the threads of the current rayon pool.
    ///
    /// Embree (`libembree4.so.4`) is looked for in `LD_LIBRARY_PATH`, in `../lib/lightpath` of a
    /// program in a folder `bin`, in the folder that `EMBREE_DIR` named when this crate was built,
    /// in `vendor/embree` of its checkout, among the system's libraries.
    ///
    /// # Errors
    /// `Unsupported` for a backend that cannot run here; `Limit` for more primitives than it can
    /// count; `Retry` for too little memory.
    pub fn renderer(&self) -> Result<Renderer> {
        self.renderer_watched(&Monitor::default())
    }

    /// [`LoadedScene::renderer`] with a monitor that counts thousandths of the build and can stop
    /// it.
    ///
    /// # Errors
    /// As [`LoadedScene::renderer`]; `Interrupted` if the monitor was stopped.
    pub fn renderer_watched(&self, monitor: &Monitor) -> Result<Renderer> {
        let accelerator = build(&self.world, self.shown.loaded.scene.backend, monitor)?;
        Ok(Renderer { scene: self.clone(), accelerator })
    }

    fn load(
        source: Source,
        overrides: &[&str],
        meshes: Vec<(&str, &str, Mesh)>,
        monitor: &Monitor,
    ) -> Result<Self> {
        let mut loaded = load_with(source, overrides)?;
        let ready = add_meshes(&mut loaded, meshes)?;
        Self::with_ready(loaded, ready, monitor)
    }

    /// Loads the files of a scene, except the meshes in `ready`, by the path in the scene.
    fn with_ready(loaded: Loaded, ready: Vec<(PathBuf, Mesh)>, monitor: &Monitor) -> Result<Self> {
        let is_of_files = ready.is_empty();
        let (mut world, warnings) = load_world(&loaded, ready, monitor)?;
        let files = is_of_files.then(|| SceneFiles::of(&mut world));
        Ok(Self::new(loaded, world, warnings, files))
    }

    fn new(
        loaded: Loaded,
        world: World,
        warnings: impl IntoIterator<Item = Problem>,
        files: Option<Arc<SceneFiles>>,
    ) -> Self {
        let numbers = ShapeNumber::of_all(&loaded.scene.shapes).into();
        let legend = world.legend.clone();
        let shown = Arc::new(ShownScene::new(loaded, warnings, legend, files));
        Self { shown, world: Arc::new(world), numbers }
    }
}

/// A loaded scene with its acceleration structure: renders its picture, and traces rays.
///
/// It can be used any number of times, by any number of threads. Everything runs on the threads of
/// the current rayon pool. Nothing is printed and no error ends the process: an
/// [`Error`](crate::Error) holds all problems that were found.
///
/// ```
/// use lightpath::{LoadedScene, Mesh, Positions, Ray};
///
/// # fn main() -> lightpath::Result<()> {
/// // A floor at y = 0, of two triangles.
/// let corners = vec![[0.0, 0.0, 0.0], [0.0, 0.0, 4.0], [4.0, 0.0, 4.0], [4.0, 0.0, 0.0]];
/// let mesh = Mesh::new(Positions::F32(corners), vec![[0, 1, 2], [0, 2, 3]])?;
/// let scene = LoadedScene::of_mesh(mesh)?;
/// let renderer = scene.renderer()?;
///
/// let down = [0.0, -2.0, 0.0];
/// let rays = [Ray::new([3.0, 6.0, 1.0], down), Ray::new([9.0, 6.0, 1.0], down)];
/// let hits = renderer.closest(&rays);
/// assert_eq!(hits[1], None);
/// let hit = hits[0].expect("the first ray meets the floor");
/// assert_eq!((hit.t, hit.primitive), (3.0, 1));
/// assert_eq!(hit.point, [3.0, 0.0, 1.0]);
/// assert_eq!(hit.normal, [0.0, 1.0, 0.0]);
///
/// // A lamp sees the floor from above, not from below.
/// let lamp = [1.0, 2.0, 1.0];
/// let (above, below) = ([2.0, 0.5, 2.0], [2.0, -0.5, 2.0]);
/// let dark = renderer.occluded(&[Ray::between(above, lamp), Ray::between(below, lamp)]);
/// assert_eq!(dark, [false, true]);
/// // Nor does the floor shadow itself.
/// assert_eq!(renderer.occluded(&[hit.ray([0.0, 1.0, 0.0])]), [false]);
/// # Ok(())
/// # }
/// ```
pub struct Renderer {
    scene: LoadedScene,
    accelerator: Box<dyn Accelerator>,
}

impl fmt::Debug for Renderer {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let info = self.accelerator.info();
        f.debug_struct("Renderer").field("accelerator", &info).finish_non_exhaustive()
    }
}

impl Renderer {
    /// Renders the whole frame with its layers. The bits are the same for any number of threads.
    ///
    /// # Errors
    /// `Retry` for too little memory, and for a texture in temporary files that cannot be read.
    pub fn render(&self) -> Result<Film> {
        self.render_watched(&Monitor::default())
    }

    /// [`Renderer::render`] with a monitor that counts finished pixels and can stop the render.
    ///
    /// # Errors
    /// As [`Renderer::render`]; `Interrupted` if the monitor was stopped.
    pub fn render_watched(&self, monitor: &Monitor) -> Result<Film> {
        let LoadedScene { shown, world, .. } = &self.scene;
        shown.render(world, self.accelerator.as_ref(), monitor)
    }

    /// Returns the closest hit of each ray; `None` for a miss. Uses the threads of the current
    /// rayon pool. Shapes that camera rays cannot hit (`visible`) do not count.
    pub fn closest(&self, rays: &[Ray]) -> Vec<Option<Hit>> {
        let LoadedScene { world, numbers, .. } = &self.scene;
        let closest =
            |rays: &[Ray]| closest_of_packet(self.accelerator.as_ref(), world, numbers, rays);
        let of_part = |part: &[Ray]| part.chunks(LANES).flat_map(closest).collect::<Vec<_>>();
        parallel::map(rays.chunks(64 * LANES), of_part).concat()
    }

    /// Returns true for each ray that hits anything. Faster than [`Renderer::closest`]. Shapes that
    /// cast no shadow (`visible`) do not count.
    pub fn occluded(&self, rays: &[Ray]) -> Vec<bool> {
        let (accelerator, geometry) = (self.accelerator.as_ref(), &self.scene.world.geometry);
        let occlusion = |rays: &[Ray]| {
            occlusion_of_packet(accelerator, geometry, rays).into_iter().take(rays.len())
        };
        let of_part = |part: &[Ray]| part.chunks(LANES).flat_map(occlusion).collect::<Vec<_>>();
        parallel::map(rays.chunks(64 * LANES), of_part).concat()
    }

    /// Writes a film to `PREFIX.exr` and `PREFIX.png`. Neither file ever appears incomplete. The
    /// EXR's header is the header of `lightpath render`. It has no `lightpath:sceneHash` if a mesh
    /// is from memory, or if a file of the scene has changed.
    ///
    /// # Errors
    /// As [`PictureWriter::write`].
    pub fn write(&self, film: &Film, prefix: impl AsRef<Path>) -> Result<WrittenPicture> {
        self.writer().write(film, prefix)
    }

    /// Returns a writer for films of this renderer. It may outlive renderer and scene.
    pub fn writer(&self) -> PictureWriter {
        PictureWriter::new(&self.scene.shown, self.accelerator.info())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::layers::Mattes;
    use crate::mesh::Positions;

    #[test]
    fn a_material_of_a_mesh_from_memory_is_used() {
        let scene = r#"{ "camera": { "type": "pinhole", "width": 8, "height": 8, "fov": 60,
              "position": [0, 0, 4], "lookat": [0, 0, -1], "up": [0, 1, 0] },
            "scene": { "materials": { "clay": {}, "chalk": {} }, "shapes": [] } }"#;
        let meshes = vec![("mesh", "clay", triangle())];
        let loaded = LoadedScene::with_meshes(scene, &[], meshes).unwrap();
        let [warning] = loaded.warnings() else { panic!("{:?}", loaded.warnings()) };
        assert!(warning.message.contains("chalk"), "{warning}");
    }

    #[test]
    fn copies_have_other_names_than_meshes_from_memory() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("box.ply");
        let ply = "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\n\
                   property float z\nelement face 1\nproperty list uchar int vertex_indices\n\
                   end_header\n0 0 0\n1 0 0\n0 1 0\n3 0 1 2\n";
        std::fs::write(&path, ply).unwrap();
        let copy = |x: i32| [[1, 0, 0, x], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]];
        let scene = serde_json::json!({
            "camera": { "type": "pinhole", "width": 8, "height": 8, "fov": 60,
                "position": [0, 0, 4], "lookat": [0, 0, -1], "up": [0, 1, 0] },
            "scene": { "materials": { "clay": {} }, "shapes": [
                { "type": "trimesh", "name": "box", "path": path, "material": "clay",
                  "instances": [copy(0), copy(2)] }] } });
        for (name, copies) in [("box", ["box.2", "box.3"]), ("box.2", ["box", "box.3"])] {
            let meshes = vec![(name, "clay", triangle())];
            let loaded = LoadedScene::with_meshes(&scene.to_string(), &[], meshes).unwrap();
            let attributes = Mattes::objects(&loaded.shown.loaded.scene).attributes();
            let mut texts = attributes.into_iter().filter(|(key, _)| key.ends_with("/manifest"));
            let (_, manifest) = texts.next().unwrap();
            for name in copies.into_iter().chain([name]) {
                assert!(manifest.contains(&format!("\"{name}\":")), "{name}: {manifest}");
            }
        }
    }

    fn triangle() -> Mesh {
        let corners = vec![[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]];
        Mesh::new(Positions::F64(corners), vec![[0, 1, 2]]).unwrap()
    }
}
