//! The text of a scene: built in, from a file, or from standard input.

use std::path::{Path, PathBuf};

use glam::DAffine3;

use super::builtin::Studio;
use crate::error::Result;
use crate::scene::{self, Loaded, ShapeKind, Source, Trimesh};

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
    ///
    /// # Errors
    /// As for [`scene::read`].
    pub fn file(path: &Path) -> Result<Self> {
        Ok(Self {
            name: path.display().to_string(),
            text: scene::read(path)?,
            folder: path.parent().unwrap_or(Path::new("")).to_owned(),
            builtin: false,
        })
    }

    /// Reads a scene from standard input.
    ///
    /// # Errors
    /// As for [`scene::read_stdin`].
    pub fn stdin() -> Result<Self> {
        let name = "<stdin>".to_string();
        let text = scene::read_stdin(&name)?;
        Ok(Self { name, text, folder: PathBuf::new(), builtin: false })
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

/// Returns the transforms of all instances of the trimesh at the JSON pointer `shape`; none if it
/// has no `instances`.
pub fn copies(loaded: &Loaded, shape: &str) -> Vec<DAffine3> {
    let index: Option<usize> = shape.rsplit('/').next().and_then(|index| index.parse().ok());
    let first = trimesh(loaded, shape).and_then(|spec| spec.transform.as_deref());
    let others = loaded.scene.shapes.iter().filter_map(|other| match &other.kind {
        ShapeKind::Instance { of, transform } if Some(*of) == index => Some(&**transform),
        _ => None,
    });
    first.into_iter().chain(others).copied().collect()
}
