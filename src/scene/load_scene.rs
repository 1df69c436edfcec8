//! Loads a scene: parses the text, applies overrides, checks the structure, checks the values.
//! After the parsing, all problems are reported together.

use std::fs::File;
use std::io::Read;
use std::path::Path;

use schemars::JsonSchema;
use serde::de::DeserializeOwned;

use crate::error::{Error, ErrorKind, Problem, Result};

use super::checked::Scene;
use super::description::{CameraDescription, SceneDescription};
use super::document::Document;
use super::schema::{self, schema, schema_of};
use super::{check, problems, structure, write};

/// Maximum size of a scene file in bytes. Meshes and images are separate files.
const MAX_FILE_BYTES: u64 = 256 << 20;

/// The text of a scene, or the file that holds it.
#[derive(Debug, Clone, Copy)]
pub enum Source<'a> {
    /// A file. Paths in it are relative to its folder.
    File(&'a Path),
    /// A text in memory.
    Text {
        /// Name of the text in messages, such as `<stdin>`.
        name: &'a str,
        /// The JSON text in UTF-8.
        text: &'a [u8],
        /// Folder to which paths in the text are relative.
        folder: &'a Path,
    },
}

/// A scene that passed every check.
#[derive(Debug, Clone)]
pub struct Loaded {
    /// The scene with all values checked and all names resolved.
    pub scene: Scene,
    /// The scene as written, with overrides applied.
    pub description: SceneDescription,
    /// Valid values that are most likely mistakes, in text order.
    pub warnings: Vec<Problem>,
    /// SHA-256 (hexadecimal) of the canonical JSON. Two files have the same hash if they differ
    /// only in spacing, `comment` keys, key order, or defaults written out.
    pub hash: String,
}

/// Loads a scene and applies `--set` overrides (`/json/pointer=VALUE`) in order.
///
/// # Errors
/// A file that cannot be read, or the first syntax error. Otherwise every problem of the file in
/// text order, then every problem of the overrides.
pub fn load(source: Source, overrides: &[String]) -> Result<Loaded> {
    let (document, folder) = document(source)?;
    check_document(document, (folder, false), overrides)
}

/// Parses the text of a scene. Also returns the folder to which its paths are relative.
///
/// # Errors
/// A file that cannot be read, or the first syntax error.
pub fn document(source: Source<'_>) -> Result<(Document, &Path)> {
    match source {
        Source::Text { name, text, folder } => Ok((Document::parse(name, text)?, folder)),
        Source::File(path) => {
            let document = Document::parse(&path.display().to_string(), &read(path)?)?;
            Ok((document, path.parent().unwrap_or(Path::new(""))))
        }
    }
}

/// Checks a scene made by code as if it had been read from a file in `folder`. Messages name it as
/// `name`.
///
/// # Errors
/// Every problem of the scene, then every problem of the overrides.
pub fn from_description(
    name: &str,
    description: &SceneDescription,
    folder: &Path,
    overrides: &[String],
) -> Result<Loaded> {
    let document = Document::from_value(name, &description.to_json());
    check_document(document, (folder, false), overrides)
}

/// Loads a scene made by code whose files are those of a scene that was loaded before.
fn with_known_files(name: &str, description: &SceneDescription, folder: &Path) -> Result<Loaded> {
    check_document(Document::from_value(name, &description.to_json()), (folder, true), &[])
}

impl Loaded {
    /// Returns the scene with another camera. Messages name the camera as `name`. Paths of the
    /// scene are relative to `folder`.
    ///
    /// # Errors
    /// Every problem of the camera.
    pub fn with_camera(
        &self,
        name: &str,
        camera: &CameraDescription,
        folder: &Path,
    ) -> Result<Self> {
        let description = SceneDescription { camera: camera.clone(), ..self.description.clone() };
        let found = with_known_files(name, &description, folder)?;
        // The description has neither the paths as the user gave them, nor the order of the
        // materials, which the shapes count.
        let scene = Scene { camera: found.scene.camera, ..self.scene.clone() };
        Ok(Self { scene, ..found })
    }

    /// Returns the scene of another description, with the backend of this scene. A description
    /// holds only the name of a backend, not its mode or instruction set. Messages name the
    /// description as `name`. Its paths are relative to `folder`.
    ///
    /// # Errors
    /// Every problem of the description.
    pub fn with_description(
        &self,
        name: &str,
        description: &SceneDescription,
        folder: &Path,
    ) -> Result<Self> {
        let mut found = from_description(name, description, folder, &[])?;
        found.scene.backend = self.scene.backend;
        Ok(found)
    }

    /// [`Loaded::with_description`] for another frame, with the files of this scene, which are not
    /// looked for again.
    ///
    /// # Errors
    /// Every problem of the description.
    pub fn with_frame(
        &self,
        name: &str,
        description: &SceneDescription,
        folder: &Path,
    ) -> Result<Self> {
        let mut found = with_known_files(name, description, folder)?;
        found.scene.backend = self.scene.backend;
        Ok(found)
    }
}

/// Reads a document as any type that has a schema, such as a job file. The structural checks are
/// those of scene files: no unknown keys, places in messages, the nearest known key as help.
///
/// # Errors
/// Every structural problem, in text order.
pub fn read_as<T: JsonSchema + DeserializeOwned>(document: &Document) -> Result<T> {
    let mut problems = problems::Problems::new(document);
    structure::check(&schema_of::<T>(""), &mut problems);
    Error::check(ErrorKind::Invalid, problems.finish().0)?;
    serde_json::from_value(document.root.to_value())
        .map_err(|e| Error::invalid(&document.name, e.to_string()))
}

/// Checks a camera made by code as if it were the camera of a scene. Messages name it as `name`.
///
/// # Errors
/// Every problem of the camera.
pub fn check_camera(name: &str, camera: &CameraDescription) -> Result<()> {
    let document = Document::from_value(name, &write::camera(camera));
    let mut problems = problems::Problems::new(&document);
    let broken = structure::check(schema::of_camera(), &mut problems);
    check::check_camera(&mut problems, broken);
    Error::check(ErrorKind::Invalid, problems.finish().0)
}

/// Checks a document with overrides. `files`: the folder of its files, and whether they are known.
fn check_document(
    mut document: Document,
    files: (&Path, bool),
    overrides: &[String],
) -> Result<Loaded> {
    if document.get("/inputs").is_some() && document.get("/scene").is_none() {
        let message = "found a job file of `lightpath batch`, expected a scene";
        let help = format!("run it by itself: lightpath batch {}", document.name);
        return Err(Error::invalid(document.place("/inputs"), message).help(help));
    }
    let set = overrides.iter().filter_map(|o| document.apply_set(o).err());
    let bad_overrides: Vec<Problem> = set.collect();
    let mut problems = problems::Problems::new(&document);
    let broken = structure::check(schema(), &mut problems);
    let checked = check::check(&mut problems, broken, files);
    let kind = if bad_overrides.is_empty() { problems.kind() } else { ErrorKind::Invalid };
    let (mut errors, warnings) = problems.finish();
    errors.extend(bad_overrides);
    // A large scene needs its memory for the hash.
    drop(document);
    match checked {
        Some((description, scene)) if errors.is_empty() => {
            Ok(Loaded { scene, hash: description.hash(), description, warnings })
        }
        _ => Err(Error { kind, problems: errors }),
    }
}

/// File name extensions of mesh formats that cannot be read.
const OTHER_MESHES: [&str; 11] =
    ["obj", "stl", "off", "glb", "gltf", "fbx", "dae", "3ds", "usd", "usdz", "abc"];

/// Reads the scene file at `path`.
///
/// # Errors
/// A file that cannot be read, whose name ends like a mesh of another format than PLY, or that is
/// longer than 256 MiB.
pub fn read(path: &Path) -> Result<Vec<u8>> {
    let failed = |error: std::io::Error| match error.kind() {
        cause @ std::io::ErrorKind::IsADirectory => {
            Error::of_file(path, cause, "found a folder, expected a scene file")
                .help("name the .json file in it")
        }
        _ => {
            let missing = error.kind() == std::io::ErrorKind::NotFound;
            let near = check::near_file(path).filter(|_| missing);
            Error::io(path, "read", &error).maybe_help(near)
        }
    };
    let file = File::open(path).map_err(failed)?;
    let kind = path.extension().and_then(|end| end.to_str()).map(str::to_ascii_lowercase);
    if let Some(kind) = kind.filter(|kind| OTHER_MESHES.contains(&kind.as_str())) {
        let message = format!("found a .{kind} file, expected a PLY mesh or a JSON scene");
        return Err(Error::invalid(path.display().to_string(), message).help(check::CONVERT));
    }
    read_all(file, &path.display().to_string(), failed)
}

/// Reads the text of a scene from standard input, which messages name as `name`.
///
/// # Errors
/// Input that cannot be read, or that is longer than 256 MiB.
pub fn read_stdin(name: &str) -> Result<Vec<u8>> {
    read_all(std::io::stdin(), name, |error| Error::io(name.as_ref(), "read", &error))
}

/// Reads the text of a scene to its end.
fn read_all(
    source: impl Read,
    name: &str,
    failed: impl Fn(std::io::Error) -> Error,
) -> Result<Vec<u8>> {
    let mut bytes = Vec::new();
    source.take(MAX_FILE_BYTES + 1).read_to_end(&mut bytes).map_err(failed)?;
    if bytes.len() as u64 > MAX_FILE_BYTES {
        let message =
            format!("found more than {} MiB, expected a scene file", MAX_FILE_BYTES >> 20);
        return Err(Error::invalid(name, message).help("put geometry into .ply files"));
    }
    Ok(bytes)
}
