//! The text of a scene: built in, from a file, or from standard input.

use std::{
    io::Read,
    path::{Path, PathBuf},
};

use super::builtin::Studio;
use crate::{
    error::{Error, Result},
    scene::{Loaded, ShapeKind, Source, Trimesh},
};

/// Maximum number of bytes that are read. A longer text is cut, so the parser finds it incomplete.
const MAX_STDIN_BYTES: u64 = 256 << 20;

/// The text of a scene, and the folder of its paths.
#[derive(Debug)]
pub struct Template {
    /// Name of the scene in messages.
    pub name: String,
    /// The text, which should be JSON.
    pub text: Vec<u8>,
    /// Folder to which paths are relative; empty for the working folder.
    pub folder: PathBuf,
    /// True if the scene is part of the program. Then its materials may be changed.
    pub builtin: bool,
}

impl Template {
    /// Returns the text as a source for [`load`](crate::scene::load).
    pub fn source(&self) -> Source<'_> {
        Source::Text { name: &self.name, text: &self.text, folder: &self.folder }
    }

    /// Makes a template from a scene that is part of the program.
    pub fn builtin(name: &str, text: &str) -> Self {
        Self { name: name.to_string(), text: text.into(), folder: PathBuf::new(), builtin: true }
    }

    /// Makes the template of a built-in studio.
    pub fn studio(studio: Studio) -> Self {
        Self::builtin("<studio>", studio.text())
    }

    /// Reads the scene file at `path`.
    pub fn file(path: &Path) -> Result<Self> {
        let read = || {
            let file = std::fs::File::open(path)?;
            let mut text = Vec::new();
            file.take(MAX_STDIN_BYTES).read_to_end(&mut text)?;
            Ok(text)
        };
        Ok(Self {
            name: path.display().to_string(),
            text: read().map_err(|error| Error::io(path, "read", &error))?,
            folder: path.parent().unwrap_or(Path::new("")).to_owned(),
            builtin: false,
        })
    }

    /// Reads a scene from standard input.
    pub fn stdin() -> Result<Self> {
        let mut text = Vec::new();
        let read = std::io::stdin().take(MAX_STDIN_BYTES).read_to_end(&mut text);
        read.map_err(|error| Error::io("<stdin>".as_ref(), "read", &error))?;
        Ok(Self { name: "<stdin>".to_string(), text, folder: PathBuf::new(), builtin: false })
    }
}

/// Returns the trimesh at the JSON pointer `shape` of a loaded scene.
pub fn trimesh<'a>(loaded: &'a Loaded, shape: &str) -> Option<&'a Trimesh> {
    let index: usize = shape.rsplit('/').next()?.parse().ok()?;
    match &loaded.scene.shapes.get(index)?.kind {
        ShapeKind::Trimesh(spec) => Some(spec),
        _ => None,
    }
}
