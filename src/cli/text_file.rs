//! Text files that the program writes to a path from a flag.

use std::fs::{File, OpenOptions};
use std::io::{ErrorKind, Write};
use std::path::{Path, PathBuf};

#[cfg(unix)]
use std::{ffi::OsStr, os::fd::AsFd};

use crate::error::{Error, Result};
use crate::output::atomic::PartFile;
use crate::{files, paths};

use super::signals;

/// A small text file that is written atomically. A device, a pipe or a file that a process has open
/// (`/dev/stdout`) is written directly.
#[derive(Debug)]
pub enum TextFile {
    /// A file that is renamed when it is complete, and the name that the user gave it.
    Part(PathBuf, PartFile),
    /// A file that is not renamed.
    Direct(PathBuf, File),
}

impl TextFile {
    /// Opens `target` for writing: creates a part file, or opens the device, pipe or open file. A
    /// symbolic link stays, and the file behind it is replaced or created.
    ///
    /// # Errors
    /// The same as [`PartFile::create`] for a file. A control character in the name of a link, or
    /// in the name of a device. A device that cannot be opened.
    pub fn create(target: &Path) -> Result<Self> {
        let failed = |error| Error::io(target, "open", &error);
        let open = files::open_file(target);
        let named = target.to_owned();
        match std::fs::metadata(target) {
            Ok(data) if !data.is_dir() && (!data.is_file() || open.is_some()) => {
                paths::refuse_control_characters(target)?;
                let opened = match open {
                    Some(open) => signals::end_while(|| writer(&open)),
                    // A pipe waits for its reader.
                    None => signals::end_while(|| OpenOptions::new().write(true).open(target)),
                };
                Ok(Self::Direct(named, opened.map_err(failed)?))
            }
            Ok(data) if data.is_file() && target.is_symlink() => {
                paths::refuse_control_characters(target)?;
                let real = target.canonicalize().map_err(failed)?;
                Ok(Self::Part(named, PartFile::create(&real)?))
            }
            // The system may keep a user from a link of somebody else in a folder of all.
            Err(error) if error.kind() == ErrorKind::PermissionDenied => Err(failed(error)),
            _ => {
                paths::refuse_control_characters(target)?;
                Ok(Self::Part(named, PartFile::create(&files::behind_link(target))?))
            }
        }
    }

    /// Writes the whole text and returns the name that the user gave. A part file gets its final
    /// name.
    ///
    /// # Errors
    /// The same as [`PartFile::finish`]. A device may have received some of the text.
    pub fn finish(self, text: &str) -> Result<PathBuf> {
        match self {
            Self::Part(named, part) => part.finish(text).map(|_| named),
            Self::Direct(path, mut file) => {
                // Buffered output to the same file comes first.
                let _ = std::io::stdout().flush();
                let written = signals::end_while(|| file.write_all(text.as_bytes()));
                written.map_err(|error| Error::io(&path, "write", &error))?;
                Ok(path)
            }
        }
    }
}

/// Opens an open file again, to write after all that was written to it before. `path` is its name
/// from [`files::open_file`].
fn writer(path: &Path) -> std::io::Result<File> {
    // A second opening of stdout would have a position of its own and overwrite other output.
    #[cfg(unix)]
    if Path::new("/dev/fd").canonicalize().is_ok_and(|own| path.parent() == Some(own.as_path())) {
        match path.file_name().and_then(OsStr::to_str) {
            Some("1") => return std::io::stdout().as_fd().try_clone_to_owned().map(File::from),
            Some("2") => return std::io::stderr().as_fd().try_clone_to_owned().map(File::from),
            _ => {}
        }
    }
    OpenOptions::new().append(true).open(path)
}

#[cfg(all(test, unix))]
mod tests {
    use super::*;
    use std::os::fd::AsRawFd;
    use std::os::unix::fs::symlink;

    #[test]
    fn a_text_is_written_through_links() {
        let folder = tempfile::tempdir().unwrap();
        let path = |name: &str| folder.path().join(name);
        let read = |name: &str| std::fs::read_to_string(path(name)).unwrap();
        let write = |name: &str| {
            let target = path(name);
            assert_eq!(TextFile::create(&target).unwrap().finish("new\n").unwrap(), target);
        };
        std::fs::write(path("real"), "old\n").unwrap();
        symlink("real", path("link")).unwrap();
        write("link");
        assert!(path("link").is_symlink());
        assert_eq!(read("real"), "new\n");

        // The file does not exist yet.
        symlink("second", path("first")).unwrap();
        symlink("later", path("second")).unwrap();
        write("first");
        assert!(path("first").is_symlink() && path("second").is_symlink());
        assert_eq!(read("later"), "new\n");

        // An open file, as behind `/dev/stdout`.
        let mut open = File::create(path("open")).unwrap();
        open.write_all(b"old\n").unwrap();
        symlink(format!("/proc/self/fd/{}", open.as_raw_fd()), path("descriptor")).unwrap();
        if path("descriptor").exists() {
            write("descriptor");
            assert!(path("descriptor").is_symlink());
            assert_eq!(read("open"), "old\nnew\n");
            assert!(PartFile::create(&path("descriptor")).is_err());
        }
        let names = std::fs::read_dir(folder.path()).unwrap().flatten();
        assert!(names.map(|entry| entry.path()).all(|name| name.extension().is_none()));
    }

    #[cfg(target_os = "linux")]
    #[test]
    fn devices_are_written_directly() {
        let full = TextFile::create(Path::new("/dev/full")).unwrap();
        let error = full.finish("text").unwrap_err();
        assert_eq!(error.exit_code(), 3, "{error}");
        TextFile::create(Path::new("/dev/null")).unwrap().finish("text").unwrap();
        assert!(!std::fs::metadata("/dev/null").unwrap().is_file());
    }
}
