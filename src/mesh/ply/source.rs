//! The bytes of a mesh file: a memory map where possible, else a stream.
//!
//! A map costs no memory and lets every thread read its own part. Its price: where another program
//! cuts the file short, or the disk fails, reading what is gone raises SIGBUS. A handler then puts
//! pages of zeros there, so that reading goes on, and the file is refused afterwards
//! ([`Map::intact`]). Compressed files and pipes are streams, and every file that is not to be
//! mapped.

use std::fs::File;
use std::io::{Chain, Cursor, Read};
use std::path::Path;

use super::header;
use super::unpack::Packing;
use crate::error::{Error, Kind, Problem, Result};
use crate::files::Stamp;
use crate::reserve::Room;

/// Bytes in which almost every header ends.
const FIRST_READ: u64 = 1 << 16;

/// A file to be read.
pub(super) struct Source {
    pub(super) bytes: Bytes,
    /// None for a pipe.
    pub(super) stamp: Option<Stamp>,
}

/// Its bytes.
pub(super) enum Bytes {
    Mapped(Map),
    Stream(Stream),
}

/// A file to be read from its beginning to its end.
pub(super) struct Stream {
    pub(super) bytes: Box<dyn Read + Send>,
    /// Length of the data, if it is known.
    pub(super) length: Option<u64>,
    pub(super) packing: Option<Packing>,
}

impl Source {
    /// The file at `path`, mapped if it can and shall be.
    pub(super) fn open(path: &Path, map: bool, room: Option<Room>) -> Result<Self> {
        let opened = Opened::open(path)?;
        let (stamp, length) = (opened.stamp, opened.length);
        let length = length.filter(|_| map && opened.packing.is_none());
        let bytes = match length.and_then(|length| Map::new(&opened.file, length)) {
            Some(map) => Bytes::Mapped(map),
            None => Bytes::Stream(opened.stream(path, room)?),
        };
        Ok(Self { bytes, stamp })
    }
}

/// The beginning of a file: at least the header, by reading at most `limit` bytes.
pub(super) struct Head {
    pub(super) bytes: Vec<u8>,
    /// Size of the file; of a pipe, what was read.
    pub(super) file_bytes: u64,
    pub(super) packing: Option<Packing>,
}

impl Head {
    pub(super) fn read(path: &Path, limit: u64) -> Result<Self> {
        let opened = Opened::open(path)?;
        let (packing, length) = (opened.packing, opened.length);
        let mut stream = opened.stream(path, None)?.bytes;
        let mut bytes = Vec::new();
        let mut next = FIRST_READ.min(limit);
        while next > 0 {
            let read = stream.by_ref().take(next).read_to_end(&mut bytes);
            let read = read.map_err(|e| failed(path, packing, &e))? as u64;
            if read < next || header::is_complete(&bytes) {
                break;
            }
            next = (limit - bytes.len() as u64).min(bytes.len() as u64);
        }
        let file_bytes = length.unwrap_or(bytes.len() as u64);
        Ok(Self { bytes, file_bytes, packing })
    }
}

/// The error of a stream.
pub(super) fn failed(path: &Path, packing: Option<Packing>, error: &std::io::Error) -> Error {
    use std::io::ErrorKind as E;
    let name = path.display().to_string();
    match (packing, error.kind()) {
        (Some(packing), E::InvalidData | E::InvalidInput | E::UnexpectedEof) => {
            Error::invalid(name, format!("cannot unpack the {} data: {error}", packing.name()))
                .help("the file is cut short or damaged: write it again")
        }
        _ => Error::io(path, "read", error),
    }
}

/// A file, and its first bytes: a pipe gives them only once.
struct Opened {
    file: File,
    start: Vec<u8>,
    /// Of a regular file.
    length: Option<u64>,
    stamp: Option<Stamp>,
    packing: Option<Packing>,
}

impl Opened {
    fn open(path: &Path) -> Result<Self> {
        let name = path.display().to_string();
        let io = |e: std::io::Error| Error::io(path, "read", &e);
        let meta = std::fs::metadata(path).map_err(io)?;
        if meta.is_dir() {
            return Err(Error::invalid(name, "is a folder, not a PLY file")
                .help("name a .ply file inside it"));
        }
        let mut file = File::open(path).map_err(io)?;
        let meta = file.metadata().map_err(io)?;
        if !meta.is_file() && !is_pipe(&meta) {
            return Err(Error::invalid(name, "is a device, not a PLY file"));
        }
        let mut start = Vec::new();
        file.by_ref().take(4).read_to_end(&mut start).map_err(io)?;
        if start.is_empty() {
            return Err(Error::invalid(name, "is empty (0 bytes)")
                .help("the program that wrote it may have failed"));
        }
        let packing = Packing::of(&start);
        let length = meta.is_file().then_some(meta.len());
        Ok(Self { file, start, length, stamp: Stamp::of(&meta), packing })
    }

    fn stream(self, path: &Path, room: Option<Room>) -> Result<Stream> {
        let bytes: Chain<Cursor<Vec<u8>>, File> = Cursor::new(self.start).chain(self.file);
        Ok(match self.packing {
            None => Stream { bytes: Box::new(bytes), length: self.length, packing: None },
            Some(packing) => {
                let bytes = packing.open(bytes, self.length, room);
                let bytes = bytes.map_err(|e| Error::io(path, "read", &e))?;
                Stream { bytes, length: None, packing: Some(packing) }
            }
        })
    }
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

/// A file in memory, whose loss is noticed.
pub(super) struct Map {
    // Goes first: its addresses must not outlive the map.
    guard: guard::Guard,
    bytes: memmap2::Mmap,
    file: File,
}

impl Map {
    /// Maps all of `file`; `None` where that cannot be done, or not safely.
    fn new(file: &File, length: u64) -> Option<Self> {
        let file = file.try_clone().ok()?;
        // SAFETY: the map is read only and private to this reader. Another process may still
        // change the file: every value is read once and then checked as untrusted input. Where it
        // cuts the file short, the guard keeps the process alive and `intact` tells.
        let bytes = unsafe { memmap2::Mmap::map(&file) }.ok()?;
        // Shorter since its length was looked up.
        if bytes.len() as u64 != length {
            return None;
        }
        let guard = guard::Guard::new(&bytes)?;
        Some(Self { bytes, file, guard })
    }

    pub(super) fn bytes(&self) -> &[u8] {
        &self.bytes
    }

    /// An error if what was read may not have been the file.
    pub(super) fn intact(&self, path: &Path) -> Result<()> {
        let mapped = self.bytes.len() as u64;
        let now = self.file.metadata().map_or(0, |meta| meta.len());
        let message = if now < mapped {
            format!("was cut short while it was read: from {mapped} to {now} bytes")
        } else if self.guard.hit() {
            "could not be read to its end: it was changed meanwhile, or its disk fails".to_string()
        } else {
            return Ok(());
        };
        let problem = Problem::new(path.display().to_string(), message);
        Err(Error::new(Kind::Retry, problem.help("wait until it is written, then try again")))
    }
}

/// Zeros for pages of a map that have gone, as in systemd's `sigbus.c`.
#[cfg(unix)]
mod guard {
    use std::sync::OnceLock;
    use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering::SeqCst};

    /// Files that can be mapped at the same time; more are streamed.
    const MOST: usize = 64;

    /// A range of addresses whose faults are ours.
    struct Range {
        taken: AtomicBool,
        start: AtomicUsize,
        end: AtomicUsize,
        hit: AtomicBool,
    }

    static RANGES: [Range; MOST] = [const {
        Range {
            taken: AtomicBool::new(false),
            start: AtomicUsize::new(0),
            end: AtomicUsize::new(0),
            hit: AtomicBool::new(false),
        }
    }; MOST];

    /// What the handler needs: it may not ask for either.
    struct Installed {
        page: usize,
        before: libc::sigaction,
    }

    static INSTALLED: OnceLock<Option<Installed>> = OnceLock::new();

    /// Guards a range of addresses as long as it lives.
    pub(super) struct Guard(&'static Range);

    impl Guard {
        /// `None` where the handler cannot be installed, or guards enough already.
        pub(super) fn new(bytes: &[u8]) -> Option<Self> {
            INSTALLED.get_or_init(install).as_ref()?;
            let free = |r: &&Range| !r.taken.swap(true, SeqCst);
            let range = RANGES.iter().find(free)?;
            range.hit.store(false, SeqCst);
            range.start.store(bytes.as_ptr() as usize, SeqCst);
            range.end.store(bytes.as_ptr() as usize + bytes.len(), SeqCst);
            Some(Self(range))
        }

        /// Whether a page was missing.
        pub(super) fn hit(&self) -> bool {
            self.0.hit.load(SeqCst)
        }
    }

    impl Drop for Guard {
        fn drop(&mut self) {
            self.0.end.store(0, SeqCst);
            self.0.taken.store(false, SeqCst);
        }
    }

    fn install() -> Option<Installed> {
        // SAFETY: plain calls with valid pointers; an all-zero `sigaction` is a valid value, and the
        // handler has the signature that SA_SIGINFO asks for. SA_ONSTACK because the other cause of
        // this signal is a stack that ran out.
        unsafe {
            let page = usize::try_from(libc::sysconf(libc::_SC_PAGESIZE)).ok()?;
            let mut action: libc::sigaction = std::mem::zeroed();
            action.sa_sigaction = on_fault as *const () as usize;
            action.sa_flags = libc::SA_SIGINFO | libc::SA_ONSTACK;
            libc::sigemptyset(&raw mut action.sa_mask);
            let mut before: libc::sigaction = std::mem::zeroed();
            let done = libc::sigaction(libc::SIGBUS, &raw const action, &raw mut before);
            (done == 0).then_some(Installed { page, before })
        }
    }

    /// Async-signal-safe: atomics, `mmap` and `sigaction` only.
    extern "C" fn on_fault(signal: libc::c_int, info: *mut libc::siginfo_t, _: *mut libc::c_void) {
        let Some(Some(installed)) = INSTALLED.get() else { return };
        // SAFETY: the kernel passes a valid siginfo with SA_SIGINFO.
        let at = unsafe { (*info).si_addr() } as usize;
        let ours = |r: &&Range| (r.start.load(SeqCst)..r.end.load(SeqCst)).contains(&at);
        if let Some(range) = RANGES.iter().find(ours) {
            let start = at & !(installed.page - 1);
            let length = range.end.load(SeqCst) - start;
            let flags = libc::MAP_FIXED | libc::MAP_PRIVATE | libc::MAP_ANONYMOUS;
            // SAFETY: replaces only pages of a read-only map that is alive: its reader is the
            // thread that faulted. From the fault on the file is gone, so nothing is lost.
            let zeros = unsafe {
                libc::mmap(start as *mut libc::c_void, length, libc::PROT_READ, flags, -1, 0)
            };
            if zeros != libc::MAP_FAILED {
                range.hit.store(true, SeqCst);
                return;
            }
        }
        // Not ours: the instruction runs again, under the handler that was there before.
        // SAFETY: `before` came from `sigaction`.
        unsafe { libc::sigaction(signal, &raw const installed.before, std::ptr::null_mut()) };
    }
}

/// Without a handler for missing pages nothing is mapped.
#[cfg(not(unix))]
mod guard {
    pub(super) struct Guard;

    impl Guard {
        pub(super) fn new(_: &[u8]) -> Option<Self> {
            None
        }

        pub(super) fn hit(&self) -> bool {
            false
        }
    }
}
