//! Hashes of finished files: what a journal keeps of a frame's bytes, and what `--resume` holds against
//! them.
//!
//! XXH3 with 128 bits: it notices what disks, cables and broken copies do. Who changes files on purpose can
//! change the journal, too.

use std::{
    collections::HashMap,
    fs::File,
    io::Read,
    path::{Path, PathBuf},
};

use xxhash_rust::xxh3::Xxh3;

use crate::error::{Error, Result};

use super::journal::{self, Record};

/// Bytes that are read at once.
const CHUNK: usize = 1 << 18;

/// The hash of a file, in hexadecimal.
///
/// # Errors
/// A file that cannot be read.
pub fn sum(path: &Path) -> Result<String> {
    let read = || -> std::io::Result<String> {
        let mut file = File::open(path)?;
        let mut hash = Xxh3::new();
        let mut some = vec![0; CHUNK];
        loop {
            match file.read(&mut some) {
                Ok(0) => return Ok(format!("{:032x}", hash.digest128())),
                Ok(count) => hash.update(&some[..count]),
                Err(error) if error.kind() == std::io::ErrorKind::Interrupted => {}
                Err(error) => return Err(error),
            }
        }
    };
    read().map_err(|error| Error::io(path, "read", &error))
}

/// The hashes that the journals of a folder have, by file as seen from there. A file that was written
/// several times has several: any of them is a whole file, and the file itself says of what.
#[derive(Debug)]
pub struct Sums {
    folder: PathBuf,
    known: HashMap<PathBuf, Vec<String>>,
}

impl Sums {
    /// Reads the journals of a folder.
    pub fn read(folder: &Path) -> Self {
        let mut known: HashMap<PathBuf, Vec<String>> = HashMap::new();
        journal::each(folder, |record| {
            let Record::Frame(frame) = record else { return };
            for (path, sum) in frame.outputs.into_iter().zip(frame.xxh3) {
                let sums = known.entry(path).or_default();
                if !sums.contains(&sum) {
                    sums.push(sum);
                }
            }
        });
        Self { folder: folder.to_owned(), known }
    }

    /// Why a file may not be as it was written; `None` where its bytes are those of a journal.
    pub fn doubt(&self, path: &Path) -> Option<String> {
        let name = path.display();
        let Some(known) = self.known.get(journal::seen_from(path, &self.folder)) else {
            return Some(format!("{name}: no journal knows its bytes"));
        };
        match sum(path) {
            Ok(sum) if known.contains(&sum) => None,
            _ => Some(format!("{name}: its bytes are not those that were written")),
        }
    }
}
