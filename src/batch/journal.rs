//! The journal `batch.jsonl`: one line of JSON per event.
//!
//! Each line is appended by itself, so a kill at any time loses at most the last line. Later runs
//! append to the file. A folder may have several journals. The record of the latest run counts.

use std::collections::BTreeMap;
use std::fs::{File, OpenOptions};
use std::io::{BufRead, BufReader, Read, Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};
use std::sync::Mutex;
use std::time::{SystemTime, UNIX_EPOCH};

#[cfg(unix)]
use rustix::fs::OFlags;
use serde::{Deserialize, Serialize};
use serde_json::Value;

use crate::error::{Error, Result};
use crate::threads::lock;

/// Most bytes of a line that is read. A longer one is damaged: a file system may leave zeros.
const MAX_LINE_BYTES: u64 = 64 << 20;

/// One line of the journal.
#[derive(Debug, Clone, Serialize, Deserialize)]
#[serde(tag = "event", rename_all = "lowercase")]
pub enum JournalRecord {
    /// Start of a run.
    Start {
        /// Time in seconds since 1970.
        time: f64,
        /// Version of the program.
        version: String,
        /// Frame indices of this run: the first, and one past the last.
        range: [u64; 2],
    },
    /// A mesh or scene was loaded and its accelerator built.
    Mesh(MeshRecord),
    /// A frame was rendered and written.
    Frame(FrameRecord),
    /// Existing frames were kept.
    Kept {
        /// Path of the input, as in [`FrameRecord`].
        input: String,
        /// Identity of the input, as in [`FrameRecord`].
        name: Option<String>,
        /// Indices of the frames within the input, as in [`FrameRecord`].
        frames: Vec<u32>,
    },
    /// An input, or a frame of it, failed.
    Failed {
        /// Path of the input.
        input: String,
        /// Identity of the input, as in [`FrameRecord`].
        name: Option<String>,
        /// Index of the frame within the input; `None` if all its frames in the run failed.
        frame: Option<u32>,
        /// Text of the error.
        message: String,
    },
    /// End of a run.
    End {
        /// Time in seconds since 1970.
        time: f64,
        /// Number of frames rendered.
        rendered: u64,
        /// Number of existing frames that were kept.
        kept: u64,
        /// Number of frames that failed.
        failed: u64,
        /// Number of the signal that stopped the run.
        signal: Option<i32>,
    },
}

/// Size and cost of a loaded mesh or scene.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct MeshRecord {
    /// Path of the input.
    pub input: String,
    /// Identity of the input, as in [`FrameRecord`].
    pub name: Option<String>,
    /// Number of triangles of all shapes.
    pub triangles: u64,
    /// Wall-clock seconds of reading and framing.
    pub load_s: f64,
    /// Wall-clock seconds of building the accelerator.
    pub build_s: f64,
    /// Bytes of mesh arrays, textures and accelerator.
    pub bytes: u64,
    /// Camera of frame 0, in the form of scenes and job files.
    pub camera: Value,
    /// Warnings of reading and building.
    pub warnings: Vec<String>,
}

/// Files and cost of a rendered frame.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct FrameRecord {
    /// Index of the frame among all frames of the job.
    pub index: u64,
    /// Path of the input.
    pub input: String,
    /// [`Job::identity`](super::job::Job::identity) of the input; `None` in old journals.
    pub name: Option<String>,
    /// Index of the frame within its input.
    pub frame: u32,
    /// Paths of its files, relative to the journal.
    pub outputs: Vec<PathBuf>,
    /// XXH3 hashes of `outputs` (128 bits, hexadecimal), in the same order.
    #[serde(default)]
    pub xxh3: Vec<String>,
    /// Reason why an existing frame was rendered again.
    pub again: Option<String>,
    /// Fingerprint of scene, files and settings; `None` if a mesh came through a pipe.
    pub fingerprint: Option<String>,
    /// Wall-clock seconds of tracing.
    pub render_s: f64,
    /// Wall-clock seconds of writing its files.
    pub write_s: f64,
    /// Number of rays by class.
    pub rays: BTreeMap<String, u64>,
    /// Largest resident set of the process so far.
    pub peak_bytes: u64,
    /// Warnings of this frame.
    pub warnings: Vec<String>,
}

impl JournalRecord {
    /// Returns the path and the identity of the input that the record is about.
    pub fn input(&self) -> Option<(&str, Option<&str>)> {
        let (input, name) = match self {
            Self::Mesh(mesh) => (&mesh.input, &mesh.name),
            Self::Frame(frame) => (&frame.input, &frame.name),
            Self::Kept { input, name, .. } | Self::Failed { input, name, .. } => (input, name),
            Self::Start { .. } | Self::End { .. } => return None,
        };
        Some((input, name.as_deref()))
    }
}

/// A journal that is open for appending.
#[derive(Debug)]
pub struct Journal {
    path: PathBuf,
    lines: Mutex<Lines<File>>,
}

/// Writes lines. A line of which only a part could be written spoils no other.
#[derive(Debug)]
struct Lines<W> {
    to: W,
    /// True if the last line may have no end.
    torn: bool,
}

impl<W: Write> Lines<W> {
    /// Writes a line, by one system call unless the system splits it.
    fn add(&mut self, line: &str) -> std::io::Result<()> {
        let start = if self.torn { "\n" } else { "" };
        let written = self.to.write_all(format!("{start}{line}\n").as_bytes());
        self.torn = written.is_err();
        written
    }
}

impl Journal {
    /// Opens or creates a journal for appending.
    ///
    /// # Errors
    /// A file that cannot be written, a link, a pipe, or a device.
    pub fn open(path: &Path) -> Result<Self> {
        let failed = |error: std::io::Error| Error::io(path, "write", &error);
        let mut file = open(path)?;
        // A crash of the machine can cut off the last line. The next record must start on a new
        // one.
        if file.seek(SeekFrom::End(-1)).is_ok() {
            let mut last = [0];
            file.read_exact(&mut last).map_err(failed)?;
            if last != *b"\n" {
                file.write_all(b"\n").map_err(failed)?;
            }
        }
        let lines = Mutex::new(Lines { to: file, torn: false });
        Ok(Self { path: path.to_owned(), lines })
    }

    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Appends a record: one line.
    ///
    /// # Errors
    /// `Retry` if the disk is full; a name that is not UTF-8.
    pub fn add(&self, record: &JournalRecord) -> Result<()> {
        let place = || self.path.display().to_string();
        let line = serde_json::to_string(record)
            .map_err(|error| Error::invalid(place(), format!("cannot write: {error}")))?;
        lock(&self.lines).add(&line).map_err(|error| Error::io(&self.path, "write", &error))
    }
}

/// Opens a journal, which must be a regular file. A link could lead out of the folder, and opening
/// a pipe could block.
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

/// Returns the records of all journals in a folder, run after run in the order of their starts.
/// Skips lines that cannot be parsed.
pub fn read(folder: &Path) -> Vec<JournalRecord> {
    let (mut all, mut started) = (Vec::new(), f64::NEG_INFINITY);
    each(folder, |record| {
        if let JournalRecord::Start { time, .. } = record {
            started = time;
        }
        all.push((started, record));
    });
    // Stable: the records of a run keep their order.
    all.sort_by(|(a, _), (b, _)| a.total_cmp(b));
    all.into_iter().map(|(_, record)| record).collect()
}

/// Returns the path of a frame's file relative to the journal's folder.
pub fn seen_from<'p>(path: &'p Path, folder: &Path) -> &'p Path {
    path.strip_prefix(folder).unwrap_or(path)
}

/// Calls `take` for every record that [`read`] returns, but journal after journal in the order of
/// their names.
pub fn each(folder: &Path, mut take: impl FnMut(JournalRecord)) {
    let ours = |path: &PathBuf| {
        let name = path.file_name().and_then(|name| name.to_str()).unwrap_or_default();
        name.starts_with("batch") && name.ends_with(".jsonl")
    };
    let entries = std::fs::read_dir(folder).into_iter().flatten().flatten();
    // Skips links and pipes: no journal is ever written to one.
    let entries = entries.filter(|entry| entry.file_type().is_ok_and(|kind| kind.is_file()));
    let mut paths: Vec<PathBuf> = entries.map(|entry| entry.path()).filter(ours).collect();
    paths.sort();
    for file in paths.iter().filter_map(|path| File::open(path).ok()) {
        let (mut file, mut line) = (BufReader::new(file), Vec::new());
        while next_line(&mut file, &mut line).is_ok_and(|found| found) {
            if let Ok(record) = serde_json::from_slice(&line) {
                take(record);
            }
        }
    }
}

/// Reads the next line. It is empty if it is longer than [`MAX_LINE_BYTES`]. Returns false at the
/// end of the file.
fn next_line(file: &mut BufReader<File>, line: &mut Vec<u8>) -> std::io::Result<bool> {
    line.clear();
    if file.by_ref().take(MAX_LINE_BYTES).read_until(b'\n', line)? == 0 {
        return Ok(false);
    }
    if line.last() != Some(&b'\n') && line.len() as u64 == MAX_LINE_BYTES {
        line.clear();
        file.skip_until(b'\n')?;
    }
    Ok(true)
}

/// Returns the current time in seconds since 1970.
pub fn now() -> f64 {
    SystemTime::now().duration_since(UNIX_EPOCH).map_or(0.0, |time| time.as_secs_f64())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_cut_off_line_loses_only_its_own_record() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("batch.jsonl");
        let kept = JournalRecord::Kept { input: "a.ply".into(), name: None, frames: vec![1, 3] };
        Journal::open(&path).unwrap().add(&kept).unwrap();
        let mut text = std::fs::read_to_string(&path).unwrap();
        let half = text[..text.len() / 2].to_owned();
        text += &half;
        std::fs::write(&path, text).unwrap();
        Journal::open(&path).unwrap().add(&kept).unwrap();
        assert_eq!(std::fs::read_to_string(&path).unwrap().lines().count(), 3);
        assert_eq!(read(folder.path()).len(), 2);
    }

    /// A disk that is full for a while.
    #[test]
    fn a_line_that_is_written_in_part_loses_only_its_own_record() {
        struct Disk {
            bytes: Vec<u8>,
            free: usize,
        }
        impl Write for Disk {
            fn write(&mut self, bytes: &[u8]) -> std::io::Result<usize> {
                let count = bytes.len().min(self.free);
                self.free -= count;
                self.bytes.extend(&bytes[..count]);
                match count {
                    0 => Err(std::io::ErrorKind::StorageFull.into()),
                    _ => Ok(count),
                }
            }

            fn flush(&mut self) -> std::io::Result<()> {
                Ok(())
            }
        }
        let mut lines = Lines { to: Disk { bytes: Vec::new(), free: 6 }, torn: false };
        lines.add("one").unwrap();
        lines.add("two").unwrap_err();
        lines.to.free = 100;
        lines.add("three").unwrap();
        lines.add("four").unwrap();
        assert_eq!(lines.to.bytes, b"one\ntw\nthree\nfour\n");
    }

    #[test]
    fn a_long_line_is_skipped() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("batch.jsonl");
        // What a crash of the machine may leave.
        File::create(&path).unwrap().set_len(3 * MAX_LINE_BYTES).unwrap();
        let mut file = BufReader::new(File::open(&path).unwrap());
        let mut line = Vec::new();
        assert!(next_line(&mut file, &mut line).unwrap());
        assert!(line.is_empty() && line.capacity() as u64 <= 2 * MAX_LINE_BYTES);
        assert!(!next_line(&mut file, &mut line).unwrap());
        let kept = JournalRecord::Kept { input: "a.ply".into(), name: None, frames: vec![1] };
        Journal::open(&path).unwrap().add(&kept).unwrap();
        assert_eq!(read(folder.path()).len(), 1);
    }

    /// A run of all frames fails. A later run of a range renders the frame. By name the journal of
    /// the range comes first.
    #[test]
    fn records_are_sorted_by_the_start_of_their_run() {
        let folder = tempfile::tempdir().unwrap();
        let start = |time| JournalRecord::Start { time, version: String::new(), range: [0, 1] };
        let failed = |text: &str| JournalRecord::Failed {
            input: "a.ply".into(),
            name: None,
            frame: None,
            message: text.into(),
        };
        for (name, records) in [
            ("batch.jsonl", [start(1.0), failed("first"), start(3.0), failed("third")]),
            ("batch.0-1.jsonl", [start(2.0), failed("second"), start(4.0), failed("fourth")]),
        ] {
            let journal = Journal::open(&folder.path().join(name)).unwrap();
            records.iter().for_each(|record| journal.add(record).unwrap());
        }
        let messages: Vec<String> = read(folder.path())
            .into_iter()
            .filter_map(|record| match record {
                JournalRecord::Failed { message, .. } => Some(message),
                _ => None,
            })
            .collect();
        assert_eq!(messages, ["first", "second", "third", "fourth"]);
    }
}
