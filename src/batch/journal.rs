//! `batch.jsonl`: a line of JSON for everything that happened, appended at once in one write, so that
//! it can be read after a kill at any time. Runs add to it; what is said last counts.

use std::{
    collections::BTreeMap,
    fs::{File, OpenOptions},
    io::{BufRead, BufReader, Read, Seek, SeekFrom, Write},
    path::{Path, PathBuf},
    sync::{Mutex, PoisonError},
    time::{SystemTime, UNIX_EPOCH},
};

#[cfg(unix)]
use rustix::fs::OFlags;
use serde::{Deserialize, Serialize};
use serde_json::Value;

use crate::error::{Error, Result};

/// One line.
#[derive(Debug, Clone, Serialize, Deserialize)]
#[serde(tag = "event", rename_all = "lowercase")]
pub enum Record {
    /// A run begins.
    Start {
        /// Seconds since 1970.
        time: f64,
        /// Of the program.
        version: String,
        /// Frame numbers of this run: from, to (excluded).
        range: [u64; 2],
    },
    /// A mesh or scene is loaded and built.
    Mesh(MeshRecord),
    /// A frame is finished.
    Frame(FrameRecord),
    /// Finished frames stay as they are.
    Kept {
        /// As in [`FrameRecord`].
        input: String,
        /// As in [`FrameRecord`].
        frames: Vec<u32>,
    },
    /// An input, or a frame of it, failed.
    Failed {
        /// Its file.
        input: String,
        /// The frame, if it is not all of them.
        frame: Option<u32>,
        /// What is wrong.
        message: String,
    },
    /// The run ends.
    End {
        /// Seconds since 1970.
        time: f64,
        /// Frames rendered.
        rendered: u64,
        /// Frames that were there.
        kept: u64,
        /// Inputs with failures.
        failed: u64,
        /// The signal that stopped it.
        signal: Option<i32>,
    },
}

/// What a mesh cost.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct MeshRecord {
    /// Its file.
    pub input: String,
    /// Of all shapes.
    pub triangles: u64,
    /// Wall-clock seconds of reading and framing it.
    pub load_s: f64,
    /// Wall-clock seconds of the accelerator.
    pub build_s: f64,
    /// Bytes of mesh arrays, textures and accelerator.
    pub bytes: u64,
    /// The camera of frame 0, as scenes and job files write it.
    pub camera: Value,
    /// Of loading.
    pub warnings: Vec<String>,
}

/// What a frame cost.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct FrameRecord {
    /// Number among all frames of the job.
    pub index: u64,
    /// The input's file.
    pub input: String,
    /// Number among its frames.
    pub frame: u32,
    /// Files, relative to the journal.
    pub outputs: Vec<PathBuf>,
    /// XXH3 hashes (128 bits, hexadecimal) of these, in their order.
    #[serde(default)]
    pub xxh3: Vec<String>,
    /// Why a frame that was there was rendered again.
    pub again: Option<String>,
    /// What it was made of, if that can be known.
    pub fingerprint: Option<String>,
    /// Wall-clock seconds of its rays.
    pub render_s: f64,
    /// Wall-clock seconds of its files.
    pub write_s: f64,
    /// Rays by class.
    pub rays: BTreeMap<String, u64>,
    /// Largest resident set of the process so far.
    pub peak_bytes: u64,
    /// Of this frame.
    pub warnings: Vec<String>,
}

/// An open journal.
#[derive(Debug)]
pub struct Journal {
    path: PathBuf,
    file: Mutex<File>,
}

impl Journal {
    /// Opens a journal to append to.
    ///
    /// # Errors
    /// Where it cannot be written.
    pub fn open(path: &Path) -> Result<Self> {
        let failed = |error: std::io::Error| Error::io(path, "write", &error);
        let mut file = open(path)?;
        // A line that a crash of the machine cut off must not swallow the next one.
        if file.seek(SeekFrom::End(-1)).is_ok() {
            let mut last = [0];
            file.read_exact(&mut last).map_err(failed)?;
            if last != *b"\n" {
                file.write_all(b"\n").map_err(failed)?;
            }
        }
        Ok(Self { path: path.to_owned(), file: Mutex::new(file) })
    }

    /// Its file.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Appends a record.
    ///
    /// # Errors
    /// `Retry` for a full disk.
    pub fn add(&self, record: &Record) -> Result<()> {
        let mut line = serde_json::to_string(record).unwrap_or_default();
        line.push('\n');
        let mut file = self.file.lock().unwrap_or_else(PoisonError::into_inner);
        file.write_all(line.as_bytes()).map_err(|error| Error::io(&self.path, "write", &error))
    }
}

/// Opens a regular file of this very name. Through a link the journal would grow somewhere else, and
/// opening a pipe waits for its reader.
fn open(path: &Path) -> Result<File> {
    let place = || path.display().to_string();
    let expected = "expected the journal of this folder, a regular file";
    let strange = |what: &str| {
        let error = Error::invalid(place(), format!("found {what}, {expected}"));
        Err(error.help("remove it, or choose another folder: -o DIR"))
    };
    let mut options = OpenOptions::new();
    options.read(true).append(true).create(true);
    #[cfg(unix)]
    std::os::unix::fs::OpenOptionsExt::custom_flags(
        &mut options,
        (OFlags::NOFOLLOW | OFlags::NONBLOCK).bits() as i32,
    );
    if path.is_symlink() {
        return strange("a link");
    }
    let file = options.open(path).map_err(|error| Error::io(path, "write", &error))?;
    match file.metadata() {
        Ok(data) if data.is_file() => Ok(file),
        Ok(_) => strange("a pipe or a device"),
        Err(error) => Err(Error::io(path, "read", &error)),
    }
}

/// All records of all journals in a folder, in the order of their names; lines that cannot be read
/// are left out.
pub fn read(folder: &Path) -> Vec<Record> {
    let mut all = Vec::new();
    each(folder, |record| all.push(record));
    all
}

/// A file of a frame as a journal in `folder` names it.
pub fn seen_from<'p>(path: &'p Path, folder: &Path) -> &'p Path {
    path.strip_prefix(folder).unwrap_or(path)
}

/// [`read`], one record after the other.
pub fn each(folder: &Path, mut take: impl FnMut(Record)) {
    let ours = |path: &PathBuf| {
        let name = path.file_name().and_then(|name| name.to_str()).unwrap_or_default();
        name.starts_with("batch") && name.ends_with(".jsonl")
    };
    let entries = std::fs::read_dir(folder).into_iter().flatten().flatten();
    // Neither links nor pipes, as they are not written either.
    let entries = entries.filter(|entry| entry.file_type().is_ok_and(|kind| kind.is_file()));
    let mut paths: Vec<PathBuf> = entries.map(|entry| entry.path()).filter(ours).collect();
    paths.sort();
    for file in paths.iter().filter_map(|path| File::open(path).ok()) {
        let lines = BufReader::new(file).split(b'\n').map_while(std::result::Result::ok);
        lines.filter_map(|line| serde_json::from_slice(&line).ok()).for_each(&mut take);
    }
}

/// Seconds since 1970.
pub fn now() -> f64 {
    SystemTime::now().duration_since(UNIX_EPOCH).map_or(0.0, |time| time.as_secs_f64())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_cut_line_costs_only_itself() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("batch.jsonl");
        let kept = Record::Kept { input: "a.ply".into(), frames: vec![1, 3] };
        Journal::open(&path).unwrap().add(&kept).unwrap();
        let mut text = std::fs::read_to_string(&path).unwrap();
        let half = text[..text.len() / 2].to_owned();
        text += &half;
        std::fs::write(&path, text).unwrap();
        Journal::open(&path).unwrap().add(&kept).unwrap();
        assert_eq!(std::fs::read_to_string(&path).unwrap().lines().count(), 3);
        assert_eq!(read(folder.path()).len(), 2);
    }
}
