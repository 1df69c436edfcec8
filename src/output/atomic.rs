//! Writes files atomically: under its final name, a file is complete or absent.
//!
//! A [`PartFile`] is the file `NAME.lp<unique>.part` in the target's folder. A rename within one
//! folder is atomic; across file systems it is a copy. Dropping a [`PartFile`] removes the file, so
//! an error or a signal that stops the work leaves no file. `kill -9` may leave a `.part`, but
//! never a broken target. The data is on the disk before the rename. So after a power cut the final
//! name still refers to a complete file.

mod lock;
mod rights;

use std::collections::HashMap;
use std::ffi::{OsStr, OsString};
use std::fs::{File, OpenOptions};
use std::io::{self, Write};
use std::os::unix::fs::OpenOptionsExt;
use std::path::{Path, PathBuf};
use std::sync::Mutex;

use tempfile::NamedTempFile;

use crate::error::{Error, ErrorKind, Problem, Result};
use crate::{farm, files, paths, threads};

use self::rights::Replaced;

/// File name ending of incomplete files.
const SUFFIX: &str = ".part";
/// Start of the word before the ending. It tells part files from files of the user, such as
/// `x.exr.backup.part`, which are never swept.
const MARK: &str = "lp";
/// Number of letters and digits that make the name of a part file unique.
const UNIQUE: usize = 6;
/// Maximum length in bytes of a target's name. File systems allow 255 bytes, and the name of the
/// part file is longer.
const MAX_NAME: usize = 255 - 1 - MARK.len() - UNIQUE - SUFFIX.len();

/// The part files of this process.
static LIVE: Mutex<Vec<PathBuf>> = Mutex::new(Vec::new());

/// Removes the part files of this process. For a process that ends without running destructors.
/// Waits for no lock: if another thread is creating or dropping a [`PartFile`], all part files
/// stay. Allocates no memory, except for a path too long for the standard library's stack buffer.
pub fn remove_parts() {
    let live = LIVE.try_lock();
    live.iter().flat_map(|live| live.iter()).for_each(|path| {
        let _ = std::fs::remove_file(path);
    });
}

/// A file that gets its final name once it is complete.
#[derive(Debug)]
pub struct PartFile {
    target: PathBuf,
    file: NamedTempFile,
    live: Live,
}

/// Keeps a path in [`LIVE`] until it is dropped.
#[derive(Debug)]
struct Live(PathBuf);

impl Live {
    fn new(path: &Path) -> Self {
        threads::lock(&LIVE).push(path.to_owned());
        Self(path.to_owned())
    }
}

impl Drop for Live {
    fn drop(&mut self) {
        let mut live = threads::lock(&LIVE);
        if let Some(at) = live.iter().position(|path| *path == self.0) {
            live.swap_remove(at);
        }
    }
}

impl PartFile {
    /// Creates the part file in the folder of `target`, with the permissions that umask gives new
    /// files, or those of a file of the user at `target`.
    ///
    /// # Errors
    /// `Invalid` if the folder is missing, is not a folder or is not writable. `Invalid` if
    /// `target` is a folder or a device, has no file name or a name that is too long, or contains a
    /// control character. `Retry` if the disk is full.
    pub fn create(target: &Path) -> Result<Self> {
        let place = || target.display().to_string();
        paths::refuse_control_characters(target)?;
        let Some(name) = target.file_name() else {
            return Err(Error::invalid(place(), "found no file name to write to"));
        };
        // `file_name` ignores a slash at the end, but a rename does not.
        let bytes = target.as_os_str().as_encoded_bytes();
        if bytes.ends_with(b"/") || bytes.ends_with(b"/.") {
            return Err(Error::invalid(place(), "found a slash at the end of a file's name"));
        }
        match std::fs::metadata(target) {
            Ok(data) if data.is_dir() => {
                let message = "cannot write a file here: it is a folder";
                return Err(Error::of_file(target, std::io::ErrorKind::IsADirectory, message)
                    .help("choose another output name"));
            }
            Ok(data) if !data.is_file() || files::open_file(target).is_some() => {
                return Err(Error::invalid(place(), "found a device, expected a regular file"));
            }
            _ => {}
        }
        check_length(target)?;
        let mut prefix = name.to_owned();
        prefix.push(".");
        prefix.push(MARK);
        let old = Replaced::at(target);
        // A file that was closed to others is so from its first byte on.
        let mode = if old.as_ref().is_some_and(|old| old.is_own) { 0o600 } else { 0o666 };
        // `tempfile` would add the name of the part file to every error.
        let create = |path: &Path| {
            OpenOptions::new().read(true).write(true).create_new(true).mode(mode).open(path)
        };
        // Another process may sweep the file before it is locked, because it looks abandoned. Then
        // try again.
        for _ in 0..8 {
            let file = tempfile::Builder::new()
                .prefix(&prefix)
                .rand_bytes(UNIQUE)
                .suffix(SUFFIX)
                .make_in(folder_of(target), create)
                .map_err(|error| folder_error(target, &error))?;
            if let Some(old) = &old {
                old.give_rights(file.as_file());
            }
            if lock::lock_new(file.as_file()) {
                let live = Live::new(file.path());
                return Ok(Self { target: target.to_owned(), file, live });
            }
        }
        Err(lost(target, "its part file is removed again and again"))
    }

    /// Returns the final name.
    pub fn target(&self) -> &Path {
        &self.target
    }

    /// Writes all bytes and waits until they are on the disk.
    ///
    /// # Errors
    /// `Retry` if the disk is full or fails.
    pub fn fill(&mut self, bytes: &[u8]) -> Result<()> {
        self.fill_by(|file, target| {
            file.write_all(bytes).map_err(|error| Error::io(target, "write", &error))
        })
    }

    /// Lets `write` fill the file, then waits until the data is on the disk. `write` gets the final
    /// name for its messages.
    ///
    /// # Errors
    /// Those of `write`, and `Retry` if the disk is full or fails.
    pub fn fill_by(&mut self, write: impl FnOnce(&mut File, &Path) -> Result<()>) -> Result<()> {
        write(self.file.as_file_mut(), &self.target)?;
        let synced = self.file.as_file_mut().sync_all();
        synced.map_err(|error| Error::io(&self.target, "write", &error))
    }

    /// Writes the whole content and gives the file its final name.
    ///
    /// # Errors
    /// Those of [`PartFile::fill`] and [`PartFile::commit`].
    pub fn finish(mut self, content: impl AsRef<[u8]>) -> Result<PathBuf> {
        self.fill(content.as_ref())?;
        self.commit().map(|(path, _)| path)
    }

    /// Renames the file to its final name and replaces any file of that name. Call
    /// [`PartFile::fill`] first. Returns the final name, and the open file, which somebody may
    /// already have moved.
    ///
    /// # Errors
    /// A failed rename: the part file is removed, and the target is unchanged. `Retry` if another
    /// process has removed the part file, as one does on a file system whose locks it cannot see.
    /// `Retry` if the disk fails or is full after the rename: the target is the new file, which a
    /// power cut may undo.
    pub fn commit(self) -> Result<(PathBuf, File)> {
        let Self { target, file, live } = self;
        let file = file.persist(&target).map_err(|error| match error.error.kind() {
            io::ErrorKind::NotFound => {
                lost(&target, "its part file was removed while it was written")
            }
            _ => Error::io(&target, "rename the finished file to this name", &error.error),
        })?;
        drop(live);
        // Syncing the folder writes the rename to the disk.
        let synced = File::open(folder_of(&target)).map(|folder| folder.sync_all());
        match synced {
            Ok(Err(error)) if loses_data(&error) => Err(Error::io(&target, "write", &error)),
            _ => Ok((target, file)),
        }
    }
}

/// Makes the error of a part file that another process has removed.
fn lost(target: &Path, message: &str) -> Error {
    let problem = Problem::new(target.display().to_string(), message);
    Error::new(ErrorKind::Retry, problem.cause_of(target, io::ErrorKind::NotFound))
}

/// Returns true if a sync failed because the disk fails or is full. Not every file system can sync
/// a folder, which is no failure.
fn loses_data(error: &io::Error) -> bool {
    use io::ErrorKind as E;
    let full_or_gone = [E::StorageFull, E::QuotaExceeded, E::StaleNetworkFileHandle];
    // EIO has no name.
    full_or_gone.contains(&error.kind()) || error.raw_os_error() == Some(5)
}

/// Checks that the name of `target` is short enough for a part file.
///
/// # Errors
/// `Invalid` for a name that is too long.
pub fn check_length(target: &Path) -> Result<()> {
    let found = target.file_name().map_or(0, OsStr::len);
    if found <= MAX_NAME {
        return Ok(());
    }
    let message = format!("found a file name of {found} bytes, expected at most {MAX_NAME}");
    let help = "choose a shorter name: while a file is written, its name is longer";
    Err(Error::invalid(target.display().to_string(), message).help(help))
}

/// Removes part files whose writers have died. Each folder is listed only once.
#[derive(Debug, Default)]
pub struct Sweep(Mutex<HashMap<PathBuf, HashMap<OsString, Vec<PathBuf>>>>);

impl Sweep {
    /// Removes the abandoned part files of `target` that existed when its folder was listed. Part
    /// files with a living writer stay. Returns the number of removed files, 0 from the second call
    /// on.
    pub fn target(&self, target: &Path) -> usize {
        let mut folders = threads::lock(&self.0);
        let folder = folder_of(target);
        let parts = folders.entry(folder.to_owned()).or_insert_with(|| parts_in(folder));
        let parts = target.file_name().and_then(|name| parts.remove(name)).unwrap_or_default();
        drop(folders);
        parts.iter().filter(|part| lock::remove_if_abandoned(part)).count()
    }
}

/// Returns the part files in a folder, grouped by the file name of their target.
fn parts_in(folder: &Path) -> HashMap<OsString, Vec<PathBuf>> {
    let mut parts: HashMap<OsString, Vec<PathBuf>> = HashMap::new();
    for entry in std::fs::read_dir(folder).into_iter().flatten().flatten() {
        // Opening a pipe would wait for its writer.
        let is_file = entry.file_type().is_ok_and(|kind| kind.is_file());
        if let Some(target) = target_of(&entry.file_name()).filter(|_| is_file) {
            parts.entry(target.to_owned()).or_default().push(entry.path());
        }
    }
    parts
}

/// Returns the target's name for the name of a part file: `x.exr` for `x.exr.lpAb12Cd.part`.
/// `None` for all other names, such as `x.part`.
fn target_of(part: &OsStr) -> Option<&OsStr> {
    let part = Path::new(part);
    part.extension().filter(|end| *end == "part")?;
    let rest = Path::new(part.file_stem()?);
    let unique = rest.extension()?.as_encoded_bytes().strip_prefix(MARK.as_bytes())?;
    let fits = unique.len() == UNIQUE && unique.iter().all(u8::is_ascii_alphanumeric);
    rest.file_stem().filter(|_| fits)
}

/// Returns the folder of a file: `.` for a bare name.
fn folder_of(path: &Path) -> &Path {
    match path.parent() {
        Some(folder) if !folder.as_os_str().is_empty() => folder,
        _ => Path::new("."),
    }
}

/// Makes the error for a file that cannot be created in the folder of `target`.
fn folder_error(target: &Path, error: &std::io::Error) -> Error {
    let folder = folder_of(target);
    let what = format!("write {}", target.display());
    let of_target = |folder: &Path, message: String, cause| {
        let problem = Problem::new(folder.display().to_string(), message);
        Error::new(ErrorKind::Invalid, problem.cause_of(target, cause))
    };
    match std::fs::metadata(folder) {
        Err(missing) if missing.kind() == std::io::ErrorKind::NotFound => {
            let message = format!("cannot {what}: there is no such folder");
            of_target(folder, message, std::io::ErrorKind::NotFound)
                .help(farm::command_line("mkdir", &["-p".into(), folder.display().to_string()]))
        }
        Ok(data) if !data.is_dir() => {
            let message = format!("cannot {what}: found a file, expected a folder");
            of_target(folder, message, std::io::ErrorKind::NotADirectory)
        }
        _ => {
            let mut failed = Error::io(folder, &what, error);
            failed.problems.iter_mut().for_each(|problem| problem.file = Some(target.to_owned()));
            failed
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[cfg(unix)]
    #[test]
    fn a_sweep_removes_only_abandoned_part_files_of_its_targets() {
        let folder = tempfile::tempdir().unwrap();
        let path = |name: &str| folder.path().join(name);
        let alive = PartFile::create(&path("a.exr")).unwrap();
        for name in ["a.exr.lpdead12.part", "b.exr.lpdead12.part", "a.exr", "a.part"] {
            std::fs::write(path(name), "x").unwrap();
        }
        let sweep = Sweep::default();
        assert_eq!([sweep.target(&path("a.exr")), sweep.target(&path("a.exr"))], [1, 0]);
        assert!(!path("a.exr.lpdead12.part").exists());
        let others = ["b.exr.lpdead12.part", "a.exr", "a.part"];
        assert!(others.iter().all(|name| path(name).exists()));
        alive.commit().unwrap();
    }

    /// EIO and ENOSPC; EINVAL and ENOSYS are what file systems say that cannot sync a folder.
    #[cfg(target_os = "linux")]
    #[test]
    fn a_folder_that_cannot_be_synced_is_no_failure_and_a_failing_disk_is() {
        let loses = |number| loses_data(&io::Error::from_raw_os_error(number));
        assert_eq!([5, 28, 22, 38].map(loses), [true, true, false, false]);
    }

    #[test]
    fn another_try_may_cure_the_loss_of_a_part_file() {
        let folder = tempfile::tempdir().unwrap();
        let mut part = PartFile::create(&folder.path().join("a.exr")).unwrap();
        part.fill(b"x").unwrap();
        for entry in std::fs::read_dir(folder.path()).unwrap() {
            std::fs::remove_file(entry.unwrap().path()).unwrap();
        }
        let error = part.commit().unwrap_err();
        assert_eq!(error.kind, ErrorKind::Retry, "{error}");
    }

    #[test]
    fn a_slash_at_the_end_is_refused_at_once() {
        let folder = tempfile::tempdir().unwrap();
        for name in ["a.exr/", "a.exr/."] {
            let error = PartFile::create(&folder.path().join("").join(name)).unwrap_err();
            assert!(error.to_string().contains("a slash at the end"), "{error}");
        }
    }

    #[cfg(unix)]
    #[test]
    fn other_files_are_not_part_files_of_a_target_without_extension() {
        let folder = tempfile::tempdir().unwrap();
        let path = |name: &str| folder.path().join(name);
        let others = [
            "a.part",
            "a.foo.part",
            "a.backup.part",
            "a.lpback.part",
            "a.lpdead.12.part",
            "a.lpdead-2.part",
        ];
        for name in others.iter().chain(&["a.lpdead12.part"]) {
            std::fs::write(path(name), "x").unwrap();
        }
        assert_eq!(Sweep::default().target(&path("a")), 1);
        assert!(others.iter().all(|name| path(name).exists()));
    }

    #[test]
    fn a_name_too_long_for_its_part_file_is_refused() {
        let folder = tempfile::tempdir().unwrap();
        let create = |length: usize| PartFile::create(&folder.path().join("x".repeat(length)));
        create(MAX_NAME).unwrap().finish("x").unwrap();
        let error = create(MAX_NAME + 1).unwrap_err();
        let expected = format!("found a file name of {} bytes, expected at most", MAX_NAME + 1);
        assert!(error.to_string().contains(&expected), "{error}");
        assert_eq!(error.exit_code(), 2);
    }
}
