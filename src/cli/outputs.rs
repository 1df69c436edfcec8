//! Output files that flags name: checked and created before the long work, written after it.

use std::path::{Path, PathBuf};

use serde::Serialize;

use crate::error::{Error, Result};
use crate::files;

use super::text_file::TextFile;

/// Refuses outputs that would overwrite an input or another output. The help names `flags`.
///
/// # Errors
/// `Invalid` for the first such output.
pub fn refuse_overwrites<P: AsRef<Path>, Q: AsRef<Path>>(
    inputs: impl IntoIterator<Item = P>,
    outputs: impl IntoIterator<Item = Q>,
    flags: &str,
) -> Result<()> {
    files::refuse_overwrites(inputs, outputs, &format!("choose another name: {flags}"))
}

/// Flags that each name an output file, written with the value: `--json FILE`.
#[derive(Debug)]
pub struct OutputFlags<'a>(pub Vec<(&'static str, &'a Option<PathBuf>)>);

impl OutputFlags<'_> {
    /// Refuses files that would overwrite an input or another one of these files.
    ///
    /// # Errors
    /// As for [`refuse_overwrites`].
    pub fn refuse_overwrites<P: AsRef<Path>>(
        &self,
        inputs: impl IntoIterator<Item = P>,
    ) -> Result<()> {
        let flags: Vec<&str> = self.0.iter().map(|(flag, _)| *flag).collect();
        refuse_overwrites(inputs, self.paths(), &flags.join(", "))
    }

    /// Returns the paths of the files. They are written through links.
    pub fn paths(&self) -> impl Iterator<Item = PathBuf> {
        self.0.iter().filter_map(|(_, path)| path.as_deref().map(files::behind_link))
    }

    /// Creates the files, so that a bad output folder is found before the long work.
    ///
    /// # Errors
    /// As for [`TextFile::create`]; the name `-`.
    pub fn create(&self) -> Result<TextOutputs> {
        let mut files = Vec::new();
        for (flag, path) in &self.0 {
            if let Some(path) = path {
                if path == Path::new("-") {
                    let message = "found `-`, expected the name of a file";
                    return Err(Error::invalid(*flag, message)
                        .help("/dev/stdout is the standard output, ./- a file of this name"));
                }
                files.push((*flag, TextFile::create(path)?));
            }
        }
        Ok(TextOutputs { files, written: Vec::new() })
    }
}

/// Text files that wait for their content.
#[derive(Debug)]
pub struct TextOutputs {
    files: Vec<(&'static str, TextFile)>,
    written: Vec<PathBuf>,
}

impl TextOutputs {
    /// Returns whether no file waits.
    pub fn is_empty(&self) -> bool {
        self.files.is_empty()
    }

    /// Writes the file that `flag` names. Does nothing if the user did not give the flag.
    ///
    /// # Errors
    /// As for [`TextFile::finish`].
    pub fn write(&mut self, flag: &str, text: impl FnOnce() -> String) -> Result<()> {
        let named = |name: &str| name.split(' ').next() == Some(flag);
        if let Some(index) = self.files.iter().position(|(name, _)| named(name)) {
            let (_, file) = self.files.remove(index);
            self.written.push(file.finish(&text())?);
        }
        Ok(())
    }

    /// Writes a value as indented JSON. Does nothing if the user did not give the flag.
    ///
    /// # Errors
    /// As for [`TextFile::finish`].
    pub fn write_json(&mut self, flag: &str, value: &impl Serialize) -> Result<()> {
        self.write(flag, || serde_json::to_string_pretty(value).unwrap_or_default() + "\n")
    }

    /// Returns the paths of the written files, in the order of writing.
    pub fn written(self) -> Vec<PathBuf> {
        self.written
    }
}
