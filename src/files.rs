//! Identity of files: refuses outputs that would overwrite an input, and detects files that change
//! between two reads.

use std::collections::{HashMap, HashSet};
use std::ffi::OsString;
use std::fs::{File, Metadata};
use std::io::{self, Read};
use std::path::{Path, PathBuf};
use std::time::SystemTime;

use crate::error::{Error, ErrorKind, Problem, Result};

/// Device and inode of a file.
type Inode = (u64, u64);
/// Time of an inode's last change: seconds since 1970, and nanoseconds.
type InodeTime = (i64, i64);

/// Identity and version of a file: device and inode, size, time of the last write, and on Unix that
/// of the last change of the inode, which no program can set back. Two reads with equal stamps have
/// read the same bytes, except for two writes of equally many bytes within one tick of the file
/// system's clock. On other systems a stamp also misses a writer that restores size and time.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub struct Stamp {
    node: Option<Inode>,
    bytes: u64,
    modified: Option<SystemTime>,
    changed: Option<InodeTime>,
}

impl Stamp {
    /// Returns the stamp of an open file, or `None` for a pipe or device, whose bytes can be read
    /// only once.
    pub fn of(data: &Metadata) -> Option<Self> {
        let modified = data.modified().ok();
        let (node, bytes, changed) = (node(data), data.len(), inode_time(data));
        data.is_file().then_some(Self { node, bytes, modified, changed })
    }
}

/// Reads a file of at most `most` MiB. `expected` names the kind of file in messages.
///
/// # Errors
/// A file that cannot be read or is longer.
pub fn read_within(path: &Path, most: u64, expected: &str) -> Result<Vec<u8>> {
    let failed = |error| Error::io(path, "read", &error);
    let mut bytes = Vec::new();
    let file = File::open(path).map_err(failed)?;
    // A device or a pipe may be endless.
    file.take((most << 20) + 1).read_to_end(&mut bytes).map_err(failed)?;
    if bytes.len() as u64 > most << 20 {
        let message = format!("found more than {most} MiB, expected {expected}");
        return Err(Error::invalid(path.display().to_string(), message));
    }
    Ok(bytes)
}

/// Makes the error for a file whose stamp has changed since it was first read. The stamp does not
/// tell a new mode from new bytes whose writer has restored size and date.
pub fn changed(path: &Path) -> Error {
    let message = "changed while it was read";
    let problem = Problem::new(path.display().to_string(), message);
    let help =
        "wait until no program writes it or changes its mode, owner or links, then try again";
    Error::new(ErrorKind::Retry, problem.help(help))
}

#[cfg(unix)]
fn node(data: &Metadata) -> Option<Inode> {
    use std::os::unix::fs::MetadataExt;
    Some((data.dev(), data.ino()))
}

#[cfg(unix)]
fn inode_time(data: &Metadata) -> Option<InodeTime> {
    use std::os::unix::fs::MetadataExt;
    Some((data.ctime(), data.ctime_nsec()))
}

#[cfg(not(unix))]
fn node(_: &Metadata) -> Option<Inode> {
    None
}

#[cfg(not(unix))]
fn inode_time(_: &Metadata) -> Option<InodeTime> {
    None
}

/// Folders of the names of open files.
const OPEN_FILES: [&str; 2] = ["/proc", "/dev/fd"];
/// Maximum number of links to follow. Linux follows 40.
const MAX_LINKS: usize = 40;

/// Returns the system's name of an open file of a process, such as `/proc/7/fd/1`, if `path` is
/// this name or leads to it through links, as `/dev/stdout` does. Any other name in `/proc` counts
/// too. Returns `None` for all other paths.
///
/// The metadata of such a path is the metadata of the file, but a file renamed to the path would
/// replace a link of the system.
pub fn open_file(path: &Path) -> Option<PathBuf> {
    let mut path = path.to_owned();
    for _ in 0..MAX_LINKS {
        let folder = path.parent().filter(|folder| *folder != Path::new(""));
        let folder = folder.unwrap_or(Path::new(".")).canonicalize().ok()?;
        path = folder.join(path.file_name()?);
        if OPEN_FILES.iter().any(|known| folder.starts_with(known)) {
            return Some(path);
        }
        path = folder.join(std::fs::read_link(&path).ok()?);
    }
    None
}

/// Returns the path of the file that would be created through `path`, if it is a symbolic link to
/// nothing. Any other path is returned unchanged.
pub fn behind_link(path: &Path) -> PathBuf {
    let mut behind = path.to_owned();
    // Not one that the system refuses to follow. A link that has gone since is a plain name.
    if !std::fs::metadata(path).is_err_and(|error| error.kind() == io::ErrorKind::NotFound) {
        return behind;
    }
    for _ in 0..MAX_LINKS {
        match std::fs::read_link(&behind) {
            Ok(to) => behind = behind.parent().unwrap_or(Path::new("")).join(to),
            Err(_) => return behind,
        }
    }
    // The link leads to itself.
    path.to_owned()
}

/// A set of files. A file is identified by its path with links resolved, and by device and inode.
#[derive(Debug, Default)]
pub struct FileSet {
    paths: HashSet<PathBuf>,
    /// Last components of the paths.
    names: HashSet<OsString>,
    nodes: HashSet<Inode>,
    /// Those of `paths` that are missing textures, with the meshes that name them.
    textures: HashMap<PathBuf, PathBuf>,
}

impl FileSet {
    /// Adds a file, which need not exist yet.
    pub fn add(&mut self, path: &Path) {
        let real = real(path);
        self.names.extend(real.file_name().map(ToOwned::to_owned));
        self.paths.insert(real);
        let data = std::fs::metadata(path).ok();
        self.nodes.extend(data.filter(Metadata::is_file).as_ref().and_then(node));
    }

    /// Adds an image that does not exist and that `mesh` names as its texture.
    pub fn add_missing(&mut self, image: &Path, mesh: &Path) {
        self.add(image);
        self.textures.insert(real(image), mesh.to_owned());
    }

    /// Refuses an output that is one of the files.
    ///
    /// # Errors
    /// `Invalid`, with `help` as the next step.
    pub fn refuse(&self, output: &Path, help: &str) -> Result<()> {
        if !self.has(output) {
            return Ok(());
        }
        let message = match self.textures.get(&real(output)) {
            Some(mesh) => format!(
                "would be the texture that {} names: the next render would show it",
                mesh.display()
            ),
            None => "would overwrite an input or another output".to_string(),
        };
        Err(Error::invalid(output.display().to_string(), message).help(help))
    }

    /// Refuses outputs that are among the files or twice among the outputs. Pipes and devices are
    /// exempt.
    ///
    /// # Errors
    /// As for [`FileSet::refuse`].
    pub fn refuse_all<P: AsRef<Path>>(
        mut self,
        outputs: impl IntoIterator<Item = P>,
        help: &str,
    ) -> Result<()> {
        for output in outputs {
            let output = output.as_ref();
            if std::fs::metadata(output).is_ok_and(|data| !data.is_file()) {
                continue;
            }
            self.refuse(output, help)?;
            self.add(output);
        }
        Ok(())
    }

    /// Returns true if the set has no files.
    pub fn is_empty(&self) -> bool {
        self.paths.is_empty()
    }

    /// Returns true if `path` is one of the files, also through links. A file that does not exist
    /// yet is identified by its future path; a link to such a file is not followed.
    pub fn has(&self, path: &Path) -> bool {
        match std::fs::metadata(path) {
            Ok(data) if node(&data).is_some_and(|node| self.nodes.contains(&node)) => true,
            // A new file whose name is not in the set needs no second disk access. So a check of
            // many new outputs takes one access each.
            Err(_) if !path.file_name().is_some_and(|name| self.names.contains(name)) => false,
            _ => self.paths.contains(&real(path)),
        }
    }
}

impl<P: AsRef<Path>> FromIterator<P> for FileSet {
    fn from_iter<I: IntoIterator<Item = P>>(paths: I) -> Self {
        let mut all = Self::default();
        paths.into_iter().for_each(|path| all.add(path.as_ref()));
        all
    }
}

/// Returns the error of a pipe or a device. Does not open it: that would wait for a writer.
pub fn not_a_file(path: &Path) -> Option<Error> {
    let data = std::fs::metadata(path).ok()?;
    let message = "found a pipe or a device, expected a file";
    let is_special = !data.is_file() && !data.is_dir();
    is_special.then(|| Error::invalid(path.display().to_string(), message))
}

/// Refuses outputs that would overwrite an input or another output. Pipes and devices are exempt.
///
/// # Errors
/// `Invalid`, with `help` as the next step.
pub fn refuse_overwrites<P: AsRef<Path>, Q: AsRef<Path>>(
    inputs: impl IntoIterator<Item = P>,
    outputs: impl IntoIterator<Item = Q>,
    help: &str,
) -> Result<()> {
    inputs.into_iter().collect::<FileSet>().refuse_all(outputs, help)
}

/// Resolves the links in a path. If the file does not exist, resolves those of its folder.
fn real(path: &Path) -> PathBuf {
    let folder = path.parent().filter(|f| !f.as_os_str().is_empty()).unwrap_or(Path::new("."));
    path.canonicalize().unwrap_or_else(|_| {
        let folder = folder.canonicalize().unwrap_or_else(|_| absolute(folder));
        folder.join(path.file_name().unwrap_or_default())
    })
}

/// Returns the future path of a folder that does not exist yet, without `.` and `..`.
fn absolute(folder: &Path) -> PathBuf {
    use std::path::Component;
    let mut plain = PathBuf::new();
    for part in std::path::absolute(folder).unwrap_or_else(|_| folder.to_owned()).components() {
        match part {
            Component::ParentDir => {
                plain.pop();
            }
            Component::CurDir => {}
            part => plain.push(part),
        }
    }
    // Resolves links in the part of the path that exists.
    let there = plain.ancestors().find_map(|above| Some((above, above.canonicalize().ok()?)));
    match there {
        Some((above, real)) => match plain.strip_prefix(above) {
            Ok(rest) => real.join(rest),
            Err(_) => plain,
        },
        None => plain,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_file_is_found_under_all_its_names() {
        let folder = tempfile::tempdir().unwrap();
        let path = |name: &str| folder.path().join(name);
        std::fs::create_dir(path("sub")).unwrap();
        std::fs::write(path("a"), "1").unwrap();
        std::fs::write(path("other"), "1").unwrap();
        let files: FileSet = [path("a"), path("new"), path("later/x")].into_iter().collect();
        for same in ["a", "sub/../a", "new", "sub/../new", "./new", "later/x", "no/../later/x"] {
            assert!(files.has(&path(same)), "{same}");
        }
        for another in ["other", "sub/a", "sub", "none", "later/y", "no/later/x"] {
            assert!(!files.has(&path(another)), "{another}");
        }
        #[cfg(unix)]
        {
            std::fs::hard_link(path("a"), path("hard")).unwrap();
            std::os::unix::fs::symlink("a", path("soft")).unwrap();
            std::os::unix::fs::symlink(folder.path(), path("sub/up")).unwrap();
            for same in ["hard", "soft", "sub/up/a", "sub/up/new", "sub/up/later/x"] {
                assert!(files.has(&path(same)), "{same}");
            }
        }
    }

    #[test]
    fn a_file_is_read_up_to_its_limit() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a");
        let file = File::create(&path).unwrap();
        file.set_len(1 << 20).unwrap();
        assert_eq!(read_within(&path, 1, "a text").unwrap().len(), 1 << 20);
        file.set_len((1 << 20) + 1).unwrap();
        let error = read_within(&path, 1, "a text").unwrap_err().to_string();
        assert!(error.ends_with("a: found more than 1 MiB, expected a text"), "{error}");
        #[cfg(target_os = "linux")]
        assert!(read_within(Path::new("/dev/zero"), 1, "a text").is_err());
    }

    #[test]
    fn a_stamp_changes_with_the_contents() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a");
        let stamp = || Stamp::of(&std::fs::metadata(&path).unwrap()).unwrap();
        std::fs::write(&path, "one").unwrap();
        let first = stamp();
        assert_eq!(first, stamp());
        std::fs::write(&path, "three").unwrap();
        assert_ne!(first, stamp());
        #[cfg(unix)]
        {
            let (before, date) = (stamp(), std::fs::metadata(&path).unwrap().modified().unwrap());
            // More than a tick of the file system's clock.
            std::thread::sleep(std::time::Duration::from_millis(50));
            std::fs::write(&path, "seven").unwrap();
            File::options().write(true).open(&path).unwrap().set_modified(date).unwrap();
            assert_eq!(std::fs::metadata(&path).unwrap().modified().unwrap(), date);
            assert_ne!(before, stamp());
        }
        assert_eq!(Stamp::of(&std::fs::metadata(folder.path()).unwrap()), None);
    }
}
