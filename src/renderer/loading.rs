//! Loads scenes and builds accelerators for the library, within the memory of the machine.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use super::shown::drop_nuls;
use crate::accel::{self, Accelerator, BuildOptions};
use crate::error::{Error, Problem, Result};
use crate::memory;
use crate::mesh::Mesh;
use crate::monitor::Monitor;
use crate::scene::{
    self, Backend, CheckedShape, Loaded, Overrides, ShapeKind, Smooth, Source, Trimesh,
};
use crate::studio::{Studio, Subject, Template};
use crate::world::{LoadOptions, World};

/// Loads the files of a scene, except the meshes in `ready`, by the path in the scene. Returns
/// warnings, too.
pub fn load_world(
    loaded: &Loaded,
    ready: Vec<(PathBuf, Mesh)>,
    monitor: &Monitor,
) -> Result<(World, Vec<Problem>)> {
    World::load(&loaded.scene, load_options(ready), monitor).map_err(readable)
}

/// Options for reading a scene's files, but for the meshes in `ready`.
pub fn load_options(ready: Vec<(PathBuf, Mesh)>) -> LoadOptions {
    let memory_limit = memory::limit_of_machine();
    LoadOptions { ready, memory_limit, ..LoadOptions::default() }
}

/// Builds the accelerator of a world on the threads of the current rayon pool, if the machine has
/// the memory.
pub fn build(world: &World, backend: Backend, monitor: &Monitor) -> Result<Box<dyn Accelerator>> {
    let threads = rayon::current_num_threads();
    memory::ensure_build_may_fit(backend, threads, world.primitives())?;
    let options = BuildOptions { threads, max_bytes: None };
    accel::build_shared(Arc::clone(&world.geometry), backend, &options, monitor)
}

/// The JSON text of a scene. Paths in it are relative to the working folder.
pub fn of_text(text: &str) -> Source<'_> {
    Source::Text { name: "scene", text: text.as_bytes(), folder: Path::new("") }
}

/// Reads and checks a scene, with overrides `/json/pointer=VALUE`.
///
/// # Errors
/// All problems of the scene.
pub fn load_with(source: Source, overrides: &[&str]) -> Result<Loaded> {
    let overrides: Vec<String> = overrides.iter().map(|set| set.to_string()).collect();
    scene::load(source, &overrides)
}

/// Adds meshes from memory to a scene: name, material, mesh in world space. Returns the meshes with
/// their paths in the scene.
///
/// # Errors
/// A material that the scene does not have; arrays that do not fit each other.
pub fn add_meshes(
    loaded: &mut Loaded,
    meshes: Vec<(&str, &str, Mesh)>,
) -> Result<Vec<(PathBuf, Mesh)>> {
    let Loaded { scene, warnings, .. } = loaded;
    let mut ready = Vec::new();
    for (name, material, mesh) in meshes {
        let of_name = |m: &scene::CheckedMaterial| m.name.as_deref() == Some(material);
        let Some(index) = scene.materials.iter().position(of_name) else {
            let message = format!("found the material {material:?}, which the scene does not have");
            return Err(Error::invalid(name, message));
        };
        mesh.check(name)?;
        use_material(warnings, material);
        // No file name contains a NUL, so this path cannot be the path of a file. Meshes of the
        // same name differ in their numbers of NULs.
        let path = PathBuf::from(format!("{name}{}", "\0".repeat(ready.len() + 1)));
        let kind = ShapeKind::Trimesh(Box::new(in_world_space(name, &path, &mesh)));
        let name = Some(name.to_string());
        let (visible, role, semantic) = Default::default();
        scene.shapes.push(CheckedShape { name, material: index, kind, visible, role, semantic });
        ready.push((path, mesh));
    }
    Ok(ready)
}

/// Removes the warning that no shape uses a material.
pub fn use_material(warnings: &mut Vec<Problem>, material: &str) {
    warnings.retain(|warning| warning.message != scene::unused_material(material));
}

/// Returns what the studio shows of the mesh at `path`, the built-in studio, and the overrides.
pub fn in_default_studio<'a>(
    path: &'a Path,
    overrides: &[&str],
) -> (Subject<'a>, Template, Overrides) {
    let mut user = Overrides::default();
    overrides.iter().for_each(|set| user.set(set));
    let subject = Subject { memory_limit: memory::limit_of_machine(), ..Subject::new(path) };
    (subject, Template::studio(Studio::default()), user)
}

/// Removes the NULs from the names of meshes from memory.
pub fn readable(mut error: Error) -> Error {
    error.problems.iter_mut().for_each(drop_nuls);
    error
}

/// Returns the shape for a mesh from memory, without any transformation.
fn in_world_space(name: &str, path: &Path, mesh: &Mesh) -> Trimesh {
    Trimesh {
        place: name.to_string(),
        path: path.to_owned(),
        fit: None,
        rotate_deg: glam::DVec3::ZERO,
        size: 1.0,
        center: glam::DVec3::ZERO,
        smooth: if mesh.normals.is_some() { Smooth::All } else { Smooth::Off },
        bvh: true,
        vertex_colors: mesh.colors.is_some() || mesh.face_colors.is_some(),
        vertex_color_space: None,
        color: None,
        points: None,
        transform: None,
    }
}
