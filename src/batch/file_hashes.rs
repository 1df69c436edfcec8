//! Hashes of finished files. The journal records them; `--resume` compares files with them.
//!
//! XXH3 with 128 bits detects errors of disks, cables and copies. It does not protect against
//! deliberate changes: whoever changes a file can change the journal, too.

use std::collections::HashMap;
use std::fs::File;
use std::io::{self, BufReader, Seek};
use std::path::{Path, PathBuf};

use xxhash_rust::xxh3::Xxh3;

use crate::error::{Error, Result};

use super::journal::{self, JournalRecord};

/// Number of bytes per read.
const CHUNK: usize = 1 << 18;

/// Returns the XXH3 hash of a file in hexadecimal.
///
/// # Errors
/// A file that cannot be read.
pub fn sum(path: &Path) -> Result<String> {
    let file = File::open(path).map_err(|error| Error::io(path, "read", &error))?;
    sum_of(file, path)
}

/// Returns the same of an open file, from its start. `path` is for messages.
///
/// # Errors
/// A file that cannot be read.
pub fn sum_of(mut file: File, path: &Path) -> Result<String> {
    let mut hash = Xxh3::new();
    file.rewind()
        .and_then(|()| io::copy(&mut BufReader::with_capacity(CHUNK, file), &mut hash))
        .map_err(|error| Error::io(path, "read", &error))?;
    Ok(format!("{:032x}", hash.digest128()))
}

/// Hashes of the files of a run from all journals of its folder, by path relative to the folder.
///
/// A file that was written several times has several hashes. Each is the hash of a complete file.
/// The fingerprint in a file says which version it is.
#[derive(Debug)]
pub struct FileHashes {
    folder: PathBuf,
    known: HashMap<PathBuf, Vec<String>>,
}

impl FileHashes {
    /// Reads all journals of a folder, and keeps what is about `files`, those of a run: a task of a
    /// farm has few of the files in the journals.
    pub fn read(folder: &Path, files: impl Iterator<Item = PathBuf>) -> Self {
        let own = files.map(|path| (journal::seen_from(&path, folder).to_owned(), Vec::new()));
        let mut known: HashMap<PathBuf, Vec<String>> = own.collect();
        journal::each(folder, |record| {
            let JournalRecord::Frame(frame) = record else { return };
            for (path, sum) in frame.outputs.into_iter().zip(frame.xxh3) {
                if let Some(sums) = known.get_mut(&path).filter(|sums| !sums.contains(&sum)) {
                    sums.push(sum);
                }
            }
        });
        Self { folder: folder.to_owned(), known }
    }

    /// Returns the reason why a file may have changed since it was written, or `None` if its hash
    /// is in a journal.
    pub fn mismatch(&self, path: &Path) -> Option<String> {
        let name = path.display();
        let known = self.known.get(journal::seen_from(path, &self.folder));
        let Some(known) = known.filter(|known| !known.is_empty()) else {
            return Some(format!("{name}: no journal knows its bytes"));
        };
        match sum(path) {
            Ok(sum) if known.contains(&sum) => None,
            _ => Some(format!("{name}: its bytes are not those that were written")),
        }
    }
}
