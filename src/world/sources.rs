//! Lists the files that decide the picture of a scene.

use std::fs::Metadata;
use std::path::{Path, PathBuf};

use crate::error::{Error, ErrorKind, Problem, Result};
use crate::files::Stamp;
use crate::mesh::{self, Mesh};
use crate::scene::{Scene, ShapeKind};

/// Files that a scene names.
#[derive(Debug, Default)]
pub struct Sources {
    /// Meshes, textures of materials, images of environments, and the images that the meshes
    /// themselves name, used or not.
    pub files: Vec<PathBuf>,
    /// Images that meshes with texture coordinates name and that do not exist.
    pub missing: Vec<MissingImage>,
}

/// An image that a mesh names and that does not exist.
#[derive(Debug, PartialEq, Eq)]
pub struct MissingImage {
    /// Path of the mesh.
    pub mesh: PathBuf,
    /// Path of the image as the mesh names it.
    pub image: PathBuf,
}

/// Returns all files that a scene names. Reads the headers of the meshes. Pipes are not opened.
pub fn sources(scene: &Scene) -> Sources {
    let mut all = Sources::default();
    for shape in &scene.shapes {
        let ShapeKind::Trimesh(spec) = &shape.kind else { continue };
        all.files.push(spec.path.clone());
        let Sources { files, missing } = mesh_sources(&spec.path);
        all.files.extend(files);
        all.missing.extend(missing);
    }
    let textures = scene.materials.iter().filter_map(|m| m.texture.as_ref());
    all.files.extend(textures.map(|texture| texture.path.clone()));
    all.files.extend(scene.maps().map(|map| map.path.clone()));
    all
}

/// Returns the images that a mesh file names; none if the file is a pipe or its header is invalid.
/// Without texture coordinates no image is missing, and the pictures of a render are none.
pub fn mesh_sources(path: &Path) -> Sources {
    let mut all = Sources::default();
    if !std::fs::metadata(path).is_ok_and(|data: Metadata| data.is_file()) {
        return all;
    }
    // Errors of the header are reported when the mesh is read.
    let Ok(summary) = mesh::inspect_ply(path) else { return all };
    let has_uvs = summary.uvs.is_some();
    for name in &summary.texture_files {
        match own_image(path, name) {
            Ok(OwnImage::Named(file)) if !has_uvs && is_render(&file) => {}
            Ok(OwnImage::Named(file) | OwnImage::Moved(file)) => all.files.push(file),
            Ok(OwnImage::Missing(image)) if has_uvs && !image.exists() => {
                all.missing.push(MissingImage { mesh: path.to_owned(), image });
            }
            Ok(OwnImage::Missing(_)) => {}
            // The error is reported when the image is read.
            Err(_) => all.files.push(as_named(path, name)),
        }
    }
    all
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
        // Errors are reported when the image is read.
        let image = own_image(path, name).ok().and_then(OwnImage::file);
        images.extend(image.filter(|image| !images.contains(image)));
    }
    images
}

/// Returns where the one image is that the mesh at `path` names, if it names one.
///
/// # Errors
/// `Retry` if the disk fails while the image is looked for.
pub fn own_texture(path: &Path, mesh: &Mesh) -> Result<Option<OwnImage>> {
    mesh.texture_file.as_ref().map(|name| own_image(path, name)).transpose()
}

/// Where an image is that a mesh names.
#[derive(Debug, PartialEq, Eq)]
pub enum OwnImage {
    /// At the path that the mesh names.
    Named(PathBuf),
    /// In the mesh's folder: without the folders of the name.
    Moved(PathBuf),
    /// Nowhere. The path is the one that the mesh names.
    Missing(PathBuf),
}

impl OwnImage {
    /// Returns the path of the image if it exists.
    pub fn file(self) -> Option<PathBuf> {
        match self {
            Self::Named(file) | Self::Moved(file) => Some(file),
            Self::Missing(_) => None,
        }
    }
}

/// Looks for the image `name` of the mesh at `mesh`, relative to the mesh's folder: the name as it
/// is, with `/` in place of the `\` of Windows, and without folders, because those of another
/// computer are not here. The last may not be a picture of a render.
///
/// # Errors
/// `Retry` if the system does not tell whether a file exists: another one would be a wrong image.
pub(super) fn own_image(mesh: &Path, name: &str) -> Result<OwnImage> {
    let folder = mesh.parent().unwrap_or(Path::new(""));
    let named = as_named(mesh, name);
    // The header has this character for bytes that are not UTF-8: such a name is not used.
    if name.contains(char::REPLACEMENT_CHARACTER) {
        return Ok(OwnImage::Missing(named));
    }
    if is_file(&named, std::fs::metadata(&named))? {
        return Ok(OwnImage::Named(named));
    }
    let slashes = name.replace('\\', "/");
    let here = folder.join(&slashes);
    if is_file(&here, std::fs::metadata(&here))? {
        return Ok(OwnImage::Named(here));
    }
    let moved = folder.join(slashes.rsplit('/').next().unwrap_or_default());
    if !is_file(&moved, std::fs::metadata(&moved))? {
        return Ok(OwnImage::Missing(named));
    }
    Ok(if is_render(&moved) { OwnImage::Missing(named) } else { OwnImage::Moved(moved) })
}

/// Returns whether the file seems to be a picture of a render, which leaves `NAME.exr` and
/// `NAME.png`.
pub(super) fn is_render(file: &Path) -> bool {
    let both = ["exr", "png"].map(|end| file.with_extension(end));
    both.iter().any(|one| one == file) && both.iter().all(|file| file.exists())
}

fn as_named(mesh: &Path, name: &str) -> PathBuf {
    mesh.parent().unwrap_or(Path::new("")).join(name)
}

/// Returns whether there is a file at `path`, by what the system says of it.
///
/// # Errors
/// `Retry` for an error that may pass. All others mean that no such file can be read.
fn is_file(path: &Path, found: std::io::Result<Metadata>) -> Result<bool> {
    match found.map_err(|error| Error::io(path, "read", &error)) {
        Ok(data) => Ok(data.is_file()),
        Err(error) if error.kind == ErrorKind::Retry => Err(error),
        Err(_) => Ok(false),
    }
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

#[cfg(test)]
mod tests {
    use super::*;
    use std::io;

    /// A disk that fails for a moment must not put another image on the mesh.
    #[test]
    fn only_an_error_that_stays_means_that_there_is_no_file() {
        let path = Path::new("a.png");
        let file = |error: io::Error| is_file(path, Err(error));
        use io::ErrorKind as E;
        for kind in [E::NotFound, E::NotADirectory, E::PermissionDenied, E::InvalidInput] {
            assert_eq!(file(kind.into()), Ok(false), "{kind}");
        }
        // ENAMETOOLONG and ELOOP.
        for number in [36, 40] {
            assert_eq!(file(io::Error::from_raw_os_error(number)), Ok(false), "{number}");
        }
        // EIO, ESTALE and ETIMEDOUT.
        for number in [5, 116, 110] {
            let error = file(io::Error::from_raw_os_error(number)).unwrap_err();
            assert_eq!(error.kind, ErrorKind::Retry, "{error}");
        }
        assert_eq!(is_file(path, std::fs::metadata("/dev/null")), Ok(false));
    }
}
