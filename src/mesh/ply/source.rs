//! The bytes of a mesh file: a memory map where possible, else a plain read.
//!
//! A map costs no memory and lets every thread read its own part. Its price: a file that another
//! program cuts short while it is being read ends this process with SIGBUS. Where files may
//! change under the reader (network drives, a scanner still writing) map = false is safe.

use std::fs::File;
use std::io::Read;
use std::path::Path;

use crate::error::{Error, Result};

/// Bytes in which almost every header ends.
const FIRST_READ: u64 = 1 << 16;

/// The whole file, or its head.
pub(super) enum Source {
    Mapped(memmap2::Mmap),
    Read(Vec<u8>),
}

impl Source {
    /// All bytes of the file at `path`.
    pub(super) fn open(path: &Path, map: bool) -> Result<Self> {
        let (file, length) = open(path)?;
        if let (true, Some(_)) = (map, length) {
            // SAFETY: the map is read only and private to this reader. Another process may still
            // change or cut the file; every value read is checked as untrusted input, and the
            // module's documentation states what cutting does.
            if let Ok(map) = unsafe { memmap2::Mmap::map(&file) } {
                return Ok(Self::Mapped(map));
            }
        }
        read(path, file, length)
    }

    /// At least the header, by plain reading of at most `limit` bytes, and the length of the whole
    /// file.
    pub(super) fn head(path: &Path, limit: u64) -> Result<(Self, u64)> {
        let (mut file, length) = open(path)?;
        let mut bytes = Vec::new();
        let mut next = FIRST_READ.min(limit);
        while next > 0 {
            let read = file.by_ref().take(next).read_to_end(&mut bytes);
            let read = read.map_err(|e| Error::io(path, "read", &e))? as u64;
            if read < next || has_header(&bytes) {
                break;
            }
            next = (limit - bytes.len() as u64).min(bytes.len() as u64);
        }
        if bytes.is_empty() {
            return Err(empty(path.display().to_string()));
        }
        let length = length.unwrap_or(bytes.len() as u64);
        Ok((Self::Read(bytes), length))
    }

    pub(super) fn bytes(&self) -> &[u8] {
        match self {
            Self::Mapped(map) => map,
            Self::Read(bytes) => bytes,
        }
    }
}

/// Whether the header's last line is there, with the end of that line.
fn has_header(bytes: &[u8]) -> bool {
    const LAST: &[u8] = b"end_header";
    // The last byte may be the first half of a line's end.
    let (_, bytes) = bytes.split_last().unwrap_or((&0, &[]));
    let mut lines = bytes.split_inclusive(|byte| matches!(byte, b'\r' | b'\n'));
    lines.any(|line| line.starts_with(LAST) && line.len() > LAST.len())
}

/// Opens a regular file (its length is known) or a pipe (it is not).
fn open(path: &Path) -> Result<(File, Option<u64>)> {
    let name = path.display().to_string();
    let meta = std::fs::metadata(path).map_err(|e| Error::io(path, "read", &e))?;
    if meta.is_dir() {
        return Err(
            Error::invalid(name, "is a folder, not a PLY file").help("name a .ply file inside it")
        );
    }
    let file = File::open(path).map_err(|e| Error::io(path, "read", &e))?;
    if !meta.is_file() {
        return if is_pipe(&meta) {
            Ok((file, None))
        } else {
            Err(Error::invalid(name, "is a device, not a PLY file"))
        };
    }
    if meta.len() == 0 {
        return Err(empty(name));
    }
    Ok((file, Some(meta.len())))
}

fn empty(name: String) -> Error {
    Error::invalid(name, "is empty (0 bytes)").help("the program that wrote it may have failed")
}

fn read(path: &Path, mut file: File, length: Option<u64>) -> Result<Source> {
    let mut bytes = Vec::new();
    let io = |e: std::io::Error| Error::io(path, "read", &e);
    if let Ok(expected) = usize::try_from(length.unwrap_or(0)) {
        // The length is the file system's, not the header's: it may be reserved.
        bytes
            .try_reserve_exact(expected)
            .map_err(|_| io(std::io::ErrorKind::OutOfMemory.into()))?;
    }
    file.read_to_end(&mut bytes).map_err(io)?;
    if bytes.is_empty() {
        return Err(empty(path.display().to_string()));
    }
    Ok(Source::Read(bytes))
}

#[cfg(unix)]
fn is_pipe(meta: &std::fs::Metadata) -> bool {
    use std::os::unix::fs::FileTypeExt;
    meta.file_type().is_fifo()
}

#[cfg(not(unix))]
fn is_pipe(_: &std::fs::Metadata) -> bool {
    false
}
