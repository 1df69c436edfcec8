//! Who can change a folder.

use std::fs::{self, Metadata};
use std::os::unix::fs::MetadataExt;
use std::path::Path;

use crate::error::{Error, Result};

/// Checks that not everybody can replace the scripts in `folder` before the user names them to
/// `sbatch`. `file` is of one of them: it has the owner that the file system gives to files of this
/// user.
///
/// # Errors
/// `Invalid` if the folder is of another user or a link, or if it or one above can be changed by
/// all.
pub fn check_owner(folder: &Path, file: &Metadata) -> Result<()> {
    let data_of =
        |path: &Path| fs::symlink_metadata(path).map_err(|error| Error::io(path, "read", &error));
    let refused = |folder: &Path, what: String| {
        let message =
            format!("found a folder that others can change ({what}), expected one of your own");
        Err(Error::invalid(folder.display().to_string(), message)
            .help("scripts in it could run in your name: choose another output folder"))
    };
    let mode = |data: &Metadata| format!("mode {:o}", data.mode() & 0o7777);
    let data = data_of(folder)?;
    if !data.is_dir() {
        return refused(folder, "a link".into());
    }
    if data.uid() != file.uid() {
        return refused(folder, format!("it belongs to user {}", data.uid()));
    }
    if data.mode() & 0o002 != 0 {
        return refused(folder, mode(&data));
    }
    let real = folder.canonicalize().map_err(|error| Error::io(folder, "read", &error))?;
    // In a namespace of users, the system has another number.
    let system = data_of("/".as_ref())?.uid();
    for above in real.ancestors().skip(1) {
        let data = data_of(above)?;
        // In a sticky folder only its owner can rename what belongs to others.
        let is_sticky = data.mode() & 0o1000 != 0 && [system, file.uid()].contains(&data.uid());
        if data.mode() & 0o002 != 0 && !is_sticky {
            return refused(above, mode(&data));
        }
    }
    Ok(())
}
