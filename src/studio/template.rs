//! The text of a scene, wherever it comes from.

use std::{
    io::Read,
    path::{Path, PathBuf},
};

use crate::{
    error::{Error, Result},
    scene::Source,
};

/// Longest scene on stdin; longer files are refused by the parser too.
const MAX_STDIN_BYTES: u64 = 256 << 20;

/// The text of a scene and what its paths are relative to.
#[derive(Debug)]
pub struct Template {
    /// For messages.
    pub name: String,
    /// JSON.
    pub text: Vec<u8>,
    /// Of relative paths; empty is the working folder.
    pub folder: PathBuf,
    /// It is part of the program: its materials are ours to change.
    pub builtin: bool,
}

impl Template {
    /// As the parser takes it.
    pub fn source(&self) -> Source<'_> {
        Source::Text { name: &self.name, text: &self.text, folder: &self.folder }
    }

    /// The text of the built-in studio.
    pub const STUDIO: &str = include_str!("../../assets/studio.json");

    /// A scene that is part of the program.
    pub fn builtin(name: &str, text: &str) -> Self {
        Self { name: name.to_string(), text: text.into(), folder: PathBuf::new(), builtin: true }
    }

    /// The built-in studio.
    pub fn studio() -> Self {
        Self::builtin("<studio>", Self::STUDIO)
    }

    /// The scene file at `path`.
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

    /// The scene on standard input.
    pub fn stdin() -> Result<Self> {
        let mut text = Vec::new();
        let read = std::io::stdin().take(MAX_STDIN_BYTES).read_to_end(&mut text);
        read.map_err(|error| Error::io("<stdin>".as_ref(), "read", &error))?;
        Ok(Self { name: "<stdin>".to_string(), text, folder: PathBuf::new(), builtin: false })
    }
}
