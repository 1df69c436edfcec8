//! Checks that the files that a scene names exist. The readers of the files check their contents.

use std::fs::File;
use std::io::{ErrorKind, Read};
use std::path::{Path, PathBuf};

use crate::nearest::did_you_mean;

use super::context::Check;

/// Help for a mesh that is not PLY.
pub const CONVERT: &str = "convert other formats to PLY first, for example with MeshLab or Blender";

/// Path of a mesh that exists only in memory. No file can have it. Messages show it without the
/// NUL.
pub const IN_MEMORY: &str = "mesh\0";

/// Maximum number of names in a folder that are compared with a misspelt one.
const MAX_LISTED: usize = 10_000;

impl Check<'_, '_> {
    /// Checks the path of a mesh. Returns it joined to the folder of the scene.
    pub(super) fn mesh_file(&mut self, pointer: &str, written: &str) -> PathBuf {
        if written == IN_MEMORY {
            return PathBuf::from(written);
        }
        if self.are_files_known {
            return self.folder.join(written);
        }
        let lower = written.to_ascii_lowercase();
        if [".ply", ".ply.gz", ".ply.zst"].iter().any(|end| lower.ends_with(end)) {
            return self.file(pointer, written, "a mesh");
        }
        let path = self.folder.join(written);
        if begins_as_ply(&path) {
            return path;
        }
        let message = format!("found {written:?}, expected the path of a .ply file");
        self.problems.error(pointer, message, Some(CONVERT.into()));
        path
    }

    /// Checks that a file exists. Returns its path joined to the folder of the scene.
    pub(super) fn file(&mut self, pointer: &str, written: &str, what: &str) -> PathBuf {
        let path = self.folder.join(written);
        if self.are_files_known {
            return path;
        }
        let (message, error) = match std::fs::metadata(&path) {
            Ok(data) if data.is_dir() => {
                let message = format!("found {written:?}, which is a folder, expected {what}");
                (message, ErrorKind::IsADirectory.into())
            }
            Ok(_) => return path,
            Err(error) => {
                let file = path.display();
                let reason = match error.kind() {
                    ErrorKind::NotFound => format!("there is no file {file}"),
                    _ => format!("cannot look at {file}: {error}"),
                };
                (format!("found {written:?}, expected {what}: {reason}"), error)
            }
        };
        self.problems.error(pointer, message, near_file(&path));
        self.problems.failed_file(&path, &error);
        path
    }
}

/// Returns true if a regular file begins as PLY files do, whatever its name is.
pub fn begins_as_ply(path: &Path) -> bool {
    // A pipe is not read: its reader needs those bytes.
    if !std::fs::metadata(path).is_ok_and(|data| data.is_file()) {
        return false;
    }
    let mut start = [0; 4];
    let read = File::open(path).and_then(|mut file| file.read_exact(&mut start));
    read.is_ok() && matches!(&start, b"ply\n" | b"ply\r")
}

/// Returns a help text for a missing file: the nearest name in its folder, or the missing folder.
pub fn near_file(path: &Path) -> Option<String> {
    let folder = match path.parent()? {
        here if here.as_os_str().is_empty() => Path::new("."),
        folder => folder,
    };
    if !folder.is_dir() {
        return Some(format!("there is no folder {}", folder.display()));
    }
    let entries = std::fs::read_dir(folder).ok()?.flatten().take(MAX_LISTED);
    let mut names: Vec<String> = entries.filter_map(|e| e.file_name().into_string().ok()).collect();
    names.sort_unstable();
    let wanted = path.file_name()?.to_str()?;
    did_you_mean(wanted, names.iter().map(String::as_str).filter(|name| *name != wanted))
}
