//! Locks of part files. A part file is locked while its writer is alive; the system releases the
//! lock when the process ends. Without locks no part file is known to be abandoned.

use std::fs::File;
use std::path::Path;

#[cfg(unix)]
use rustix::{
    fs::{FlockOperation, flock},
    io::Errno,
};

/// Locks a new file. Returns false if another process has removed the file in the meantime, or
/// holds its lock to remove it. Other failures are ignored: on a file system without locks, no
/// file is ever swept.
#[cfg(unix)]
pub fn lock_new(file: &File) -> bool {
    let locked = flock(file, FlockOperation::NonBlockingLockExclusive);
    let links = |data: std::fs::Metadata| std::os::unix::fs::MetadataExt::nlink(&data);
    locked != Err(Errno::WOULDBLOCK) && file.metadata().map_or(true, |data| links(data) > 0)
}

/// Removes the file if it can be locked, so that no process holds its lock. Holds the lock until
/// the file is removed: its writer may be about to lock it.
#[cfg(unix)]
pub fn remove_if_abandoned(path: &Path) -> bool {
    let Ok(file) = File::open(path) else { return false };
    let locked = flock(&file, FlockOperation::NonBlockingLockExclusive);
    locked.is_ok() && std::fs::remove_file(path).is_ok()
}

#[cfg(not(unix))]
pub fn lock_new(_: &File) -> bool {
    true
}

#[cfg(not(unix))]
pub fn remove_if_abandoned(_: &Path) -> bool {
    false
}
