//! Lists the files that decide the picture of a scene.

use std::fs::Metadata;
use std::path::{Path, PathBuf};

use crate::error::Problem;
use crate::files::Stamp;
use crate::mesh::{self, Mesh};
use crate::scene::{Scene, ShapeKind};

/// Returns all files that a scene names: meshes, textures of its materials, images of environments,
/// and the images that the meshes themselves name, used or not. Reads the headers of the meshes.
/// Pipes are not opened.
pub fn sources(scene: &Scene) -> Vec<PathBuf> {
    let mut all = Vec::new();
    for shape in &scene.shapes {
        let ShapeKind::Trimesh(spec) = &shape.kind else { continue };
        all.push(spec.path.clone());
        all.extend(mesh_sources(&spec.path));
    }
    let textures = scene.materials.iter().filter_map(|m| m.texture.as_ref());
    all.extend(textures.map(|texture| texture.path.clone()));
    all.extend(scene.maps().map(|map| map.path.clone()));
    all
}

/// Returns the images that a mesh file names; none if the file is a pipe or its header is invalid.
/// An image that is missing counts under every path where it is looked for.
pub fn mesh_sources(path: &Path) -> Vec<PathBuf> {
    if !std::fs::metadata(path).is_ok_and(|data: Metadata| data.is_file()) {
        return Vec::new();
    }
    // Errors of the header are reported when the mesh is read.
    let named = mesh::inspect_ply(path).map(|summary| summary.texture_files);
    let all = |name: &String| {
        let image = beside(path, name);
        if image.is_file() { vec![image] } else { candidates(path, name) }
    };
    named.unwrap_or_default().iter().flat_map(all).collect()
}

/// Returns the images that a render of the mesh at `path` decodes if its material has no texture. A
/// header does not tell which images the faces use, so these are all that they can use. None if the
/// file is a pipe, its header is invalid or it has no texture coordinates.
pub fn own_images(path: &Path) -> Vec<PathBuf> {
    if !std::fs::metadata(path).is_ok_and(|data: Metadata| data.is_file()) {
        return Vec::new();
    }
    let Ok(summary) = mesh::inspect_ply(path) else { return Vec::new() };
    let most = match (summary.uvs, summary.used.iter().any(|name| name == "face.texnumber")) {
        (None, _) => 0,
        (Some(_), false) => 1,
        (Some(_), true) => summary.texture_files.len(),
    };
    let mut images: Vec<PathBuf> = Vec::new();
    for name in summary.texture_files.iter().take(most) {
        let image = beside(path, name);
        if image.is_file() && !images.contains(&image) {
            images.push(image);
        }
    }
    images
}

/// Returns the path of the image that a mesh names: beside the file at `path`.
pub fn own_texture(path: &Path, mesh: &Mesh) -> Option<PathBuf> {
    mesh.texture_file.as_ref().map(|name| beside(path, name))
}

/// Returns the path of the image `name` of the mesh at `mesh`: the first of its [`candidates`] that
/// exists, else the first.
pub(super) fn beside(mesh: &Path, name: &str) -> PathBuf {
    let mut paths = candidates(mesh, name);
    let found = paths.iter().position(|image| image.is_file());
    paths.swap_remove(found.unwrap_or(0))
}

/// Returns the paths where the image `name` of a mesh is looked for, all relative to the mesh's
/// folder: the name as it is, with `/` in place of the `\` of Windows, and without folders, because
/// those of another computer are not here.
fn candidates(mesh: &Path, name: &str) -> Vec<PathBuf> {
    let folder = mesh.parent().unwrap_or(Path::new(""));
    let slashes = name.replace('\\', "/");
    let base = slashes.rsplit('/').next().unwrap_or_default();
    let mut paths = vec![folder.join(name)];
    // The header has this character for bytes that are not UTF-8: such a name is not used.
    if !name.contains(char::REPLACEMENT_CHARACTER) {
        for other in [&slashes, base] {
            let path = folder.join(other);
            if !other.is_empty() && !paths.contains(&path) {
                paths.push(path);
            }
        }
    }
    paths
}

/// Files that were read, with their stamps at that time. Pipes have no stamp.
#[derive(Debug, Clone, Default)]
pub struct ReadFiles(pub(super) Vec<(PathBuf, Option<Stamp>)>);

/// What the load of a world reports beside the world.
#[derive(Debug, Default)]
pub(super) struct LoadLog {
    /// The files that were read.
    pub read: ReadFiles,
    /// Warnings about the scene and its files.
    pub warnings: Vec<Problem>,
}

impl ReadFiles {
    /// Paths of all files that were read.
    pub fn paths(&self) -> impl Iterator<Item = &Path> {
        self.0.iter().map(|(path, _)| path.as_path())
    }
}
