//! Opens a mesh file: as a memory map if possible, else as a stream.
//!
//! A map needs no memory of its own, and every thread can read its own part. It has one risk. If
//! another program truncates the file, or the disk fails, reading a missing page raises SIGBUS. A
//! handler then maps pages of zeros there, so that reading continues. The file is refused
//! afterwards ([`Map::intact`]). Streams are used for compressed files, pipes, files that the
//! options forbid to map, and files that cannot be mapped.

use std::fs::File;
use std::io::{Chain, Cursor, Read};
use std::path::Path;

use super::header;
use super::unpack::Packing;
use crate::error::{Error, ErrorKind, Problem, Result};
use crate::files::Stamp;
use crate::reserve::MemoryLimit;

/// Number of bytes to read first. Almost every header is shorter.
const FIRST_READ: u64 = 1 << 16;

/// An open mesh file.
pub(super) struct MeshSource {
    pub(super) bytes: Bytes,
    /// Identity and time stamp of the file. `None` for a pipe.
    pub(super) stamp: Option<Stamp>,
}

/// The contents of a file, mapped or streamed.
pub(super) enum Bytes {
    Mapped(Map),
    Stream(Stream),
}

/// A file that can only be read from beginning to end.
pub(super) struct Stream {
    pub(super) bytes: Box<dyn Read + Send>,
    /// Length of the unpacked data, if it is known.
    pub(super) length: Option<u64>,
    pub(super) packing: Option<Packing>,
}

impl MeshSource {
    /// Opens the file at `path`. It is mapped if `map` is set, the file is not compressed, and the
    /// system can map it. `memory_limit` limits the memory for unpacking.
    pub(super) fn open(path: &Path, map: bool, memory_limit: Option<MemoryLimit>) -> Result<Self> {
        let opened = Opened::open(path)?;
        let (stamp, length) = (opened.stamp, opened.length);
        let length = length.filter(|_| map && opened.packing.is_none());
        let bytes = match length.and_then(|length| Map::new(&opened.file, length)) {
            Some(map) => Bytes::Mapped(map),
            None => Bytes::Stream(opened.stream(path, memory_limit)?),
        };
        Ok(Self { bytes, stamp })
    }
}

/// The first bytes of a file, unpacked. They contain the whole header if it ends within the limit
/// of [`Head::read`].
pub(super) struct Head {
    pub(super) bytes: Vec<u8>,
    /// Size of the file as stored; for a pipe, the number of bytes read.
    pub(super) file_bytes: u64,
    pub(super) packing: Option<Packing>,
}

impl Head {
    /// Reads the beginning of the file at `path`: at most `limit` bytes of unpacked data.
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

/// Converts an error of a stream to an error about the file.
pub(super) fn failed(path: &Path, packing: Option<Packing>, error: &std::io::Error) -> Error {
    use std::io::ErrorKind as E;
    let name = path.display().to_string();
    match (packing, error.kind()) {
        (Some(packing), E::InvalidData | E::InvalidInput | E::UnexpectedEof) => {
            Error::invalid(name, format!("cannot unpack the {} data: {error}", packing.name()))
                .help("the file is cut short or damaged: write it again")
        }
        (Some(packing), E::FileTooLarge) => {
            Error::invalid(name, format!("cannot unpack the {} data: {error}", packing.name()))
                .help("pack it without --ultra and --long, or raise --max-memory")
        }
        _ => Error::io(path, "read", error),
    }
}

/// An open file with its first bytes, which are kept because a pipe can be read only once.
struct Opened {
    file: File,
    start: Vec<u8>,
    /// Size of a regular file in bytes. `None` for a pipe.
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
            let message = "is a folder, not a PLY file";
            return Err(Error::of_file(path, std::io::ErrorKind::IsADirectory, message)
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
        let packing = Packing::detect(&start);
        let length = meta.is_file().then_some(meta.len());
        Ok(Self { file, start, length, stamp: Stamp::of(&meta), packing })
    }

    fn stream(self, path: &Path, memory_limit: Option<MemoryLimit>) -> Result<Stream> {
        let bytes: Chain<Cursor<Vec<u8>>, File> = Cursor::new(self.start).chain(self.file);
        Ok(match self.packing {
            None => Stream { bytes: Box::new(bytes), length: self.length, packing: None },
            Some(packing) => {
                let bytes = packing.open(bytes, self.length, memory_limit);
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

/// A memory map of a file that detects whether the file was truncated.
pub(super) struct Map {
    // Declared first, so that it is dropped first: its addresses must not outlive the map.
    guard: guard::Guard,
    bytes: memmap2::Mmap,
    file: File,
}

impl Map {
    /// Maps the whole `file`. Returns `None` if it cannot be mapped, or not safely.
    fn new(file: &File, length: u64) -> Option<Self> {
        let file = file.try_clone().ok()?;
        // SAFETY: the map is read only and private to this reader. Another process may still change
        // the file, so every value is read once and then checked as untrusted input. If the file is
        // truncated, the guard keeps the process alive and `intact` reports it.
        let bytes = unsafe { memmap2::Mmap::map(&file) }.ok()?;
        // The size of the file may have changed since it was queried.
        if bytes.len() as u64 != length {
            return None;
        }
        let guard = guard::Guard::new(&bytes)?;
        Some(Self { bytes, file, guard })
    }

    pub(super) fn bytes(&self) -> &[u8] {
        &self.bytes
    }

    /// Returns an error if the bytes that were read may not be the bytes of the file.
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
        Err(Error::new(ErrorKind::Retry, problem.help("wait until it is written, then try again")))
    }
}

/// Maps zeros in place of the missing pages of a map, as systemd's `sigbus.c` does.
#[cfg(unix)]
mod guard {
    use std::sync::OnceLock;
    use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering::SeqCst};

    /// Maximum number of files that are mapped at the same time. Further files are streamed.
    const MAX_MAPS: usize = 64;

    /// A range of addresses in which the handler replaces missing pages.
    struct Range {
        taken: AtomicBool,
        start: AtomicUsize,
        end: AtomicUsize,
        hit: AtomicBool,
    }

    static RANGES: [Range; MAX_MAPS] = [const {
        Range {
            taken: AtomicBool::new(false),
            start: AtomicUsize::new(0),
            end: AtomicUsize::new(0),
            hit: AtomicBool::new(false),
        }
    }; MAX_MAPS];

    /// Page size and previous handler. They are stored because the signal handler may not query
    /// them.
    struct Installed {
        page: usize,
        before: libc::sigaction,
    }

    static INSTALLED: OnceLock<Option<Installed>> = OnceLock::new();

    /// Guards a range of addresses while it exists.
    pub(super) struct Guard(&'static Range);

    impl Guard {
        /// Guards the addresses of `bytes`. Returns `None` if the handler cannot be installed, or
        /// if too many ranges are guarded already.
        pub(super) fn new(bytes: &[u8]) -> Option<Self> {
            INSTALLED.get_or_init(install).as_ref()?;
            let free = |r: &&Range| !r.taken.swap(true, SeqCst);
            let range = RANGES.iter().find(free)?;
            range.hit.store(false, SeqCst);
            range.start.store(bytes.as_ptr() as usize, SeqCst);
            range.end.store(bytes.as_ptr() as usize + bytes.len(), SeqCst);
            Some(Self(range))
        }

        /// Returns true if a page was missing.
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
        // SAFETY: plain calls with valid pointers. An all-zero `sigaction` is a valid value, and
        // the handler has the signature that SA_SIGINFO requires. SA_ONSTACK because SIGBUS is also
        // raised by a stack overflow.
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

    /// The signal handler. It is async-signal-safe: it uses only atomics, `mmap`, `sigaction` and
    /// the handler that was there before.
    extern "C" fn on_fault(
        signal: libc::c_int,
        info: *mut libc::siginfo_t,
        context: *mut libc::c_void,
    ) {
        let Some(Some(installed)) = INSTALLED.get() else { return };
        // SAFETY: the kernel passes a valid siginfo with SA_SIGINFO.
        let at = unsafe { (*info).si_addr() } as usize;
        let ours = |r: &&Range| (r.start.load(SeqCst)..r.end.load(SeqCst)).contains(&at);
        if let Some(range) = RANGES.iter().find(ours) {
            let start = at & !(installed.page - 1);
            let length = range.end.load(SeqCst) - start;
            let flags = libc::MAP_FIXED | libc::MAP_PRIVATE | libc::MAP_ANONYMOUS;
            // SAFETY: this replaces only pages of a read-only map that is alive: the thread that
            // faulted is reading it. These pages of the file are gone, so nothing is lost.
            let zeros = unsafe {
                libc::mmap(start as *mut libc::c_void, length, libc::PROT_READ, flags, -1, 0)
            };
            if zeros != libc::MAP_FAILED {
                range.hit.store(true, SeqCst);
                return;
            }
        }
        // The address is not in a guarded range, or mapping zeros failed.
        // SAFETY: `before` came from `sigaction`, the rest from the kernel.
        unsafe { pass_on(&installed.before, signal, info, context) };
    }

    /// Calls the handler that was installed before, which may recover. If there was none, it is
    /// restored: the instruction runs again, and the signal ends the process.
    ///
    /// # Safety
    /// `before` must be from `sigaction`, and the other arguments those of a signal handler.
    unsafe fn pass_on(
        before: &libc::sigaction,
        signal: libc::c_int,
        info: *mut libc::siginfo_t,
        context: *mut libc::c_void,
    ) {
        type Plain = extern "C" fn(libc::c_int);
        type Full = extern "C" fn(libc::c_int, *mut libc::siginfo_t, *mut libc::c_void);
        let handler = before.sa_sigaction;
        // The system knows the function as a number.
        let function = std::ptr::with_exposed_provenance::<()>(handler);
        // SAFETY: a handler that is neither SIG_DFL nor SIG_IGN is a function, with the signature
        // that SA_SIGINFO tells. The caller vouches for the arguments.
        unsafe {
            if handler == libc::SIG_DFL || handler == libc::SIG_IGN {
                libc::sigaction(signal, before, std::ptr::null_mut());
            } else if before.sa_flags & libc::SA_SIGINFO != 0 {
                std::mem::transmute::<*const (), Full>(function)(signal, info, context);
            } else {
                std::mem::transmute::<*const (), Plain>(function)(signal);
            }
        }
    }

    #[cfg(test)]
    mod tests {
        use super::*;
        use std::ptr::null_mut;

        static SEEN: [AtomicBool; 2] = [const { AtomicBool::new(false) }; 2];

        extern "C" fn plain(_: libc::c_int) {
            SEEN[0].store(true, SeqCst);
        }

        extern "C" fn full(_: libc::c_int, _: *mut libc::siginfo_t, _: *mut libc::c_void) {
            SEEN[1].store(true, SeqCst);
        }

        /// A runtime that maps files itself, say, may recover from its own missing pages.
        #[test]
        fn a_handler_that_was_there_before_gets_the_faults_of_others() {
            for (which, handler, flags) in [
                (0, plain as *const () as usize, 0),
                (1, full as *const () as usize, libc::SA_SIGINFO),
            ] {
                // SAFETY: an all-zero `sigaction` is valid, and the handlers use no argument.
                unsafe {
                    let mut before: libc::sigaction = std::mem::zeroed();
                    before.sa_sigaction = handler;
                    before.sa_flags = flags;
                    pass_on(&before, libc::SIGBUS, null_mut(), null_mut());
                }
                assert!(SEEN[which].load(SeqCst));
            }
        }
    }
}

/// There is no handler for missing pages here, so no file is mapped.
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
