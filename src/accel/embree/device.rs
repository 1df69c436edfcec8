//! Loads the Embree library and owns a device: version, errors and memory.

use std::ffi::{CStr, CString, c_char, c_void};
use std::path::Path;
use std::ptr::NonNull;
use std::sync::atomic::{AtomicBool, AtomicI64, Ordering::Relaxed};
use std::sync::{Arc, Mutex, PoisonError};

use super::ffi::{self, Api, DeviceHandle, Enum};
use super::fixed::PinnedBox;
use super::search;
use crate::accel::accelerator::over_limit;
use crate::error::{Error, ErrorKind, Problem, Result};
use crate::process::{left_by_limits, number};

/// Memory counters and errors of a device. Embree's callbacks write them, and [`Device`] reads
/// them.
#[derive(Debug)]
pub struct DeviceMonitor {
    /// Bytes that Embree holds now.
    pub bytes: AtomicI64,
    /// Largest number of bytes held so far.
    pub peak_bytes: AtomicI64,
    limit_bytes: i64,
    limit_hit: AtomicBool,
    last_error: Mutex<Option<(Enum, String)>>,
}

/// An owned Embree device (`RTCDevice`) with its memory counters.
pub struct Device {
    raw: Raw,
    threads: usize,
    watch: PinnedBox<DeviceMonitor>,
    version: [u8; 3],
}

/// A device's handle and the entry points that use it.
struct Raw {
    api: Arc<Api>,
    handle: NonNull<DeviceHandle>,
}

// SAFETY: Embree's API is thread-safe on devices.
unsafe impl Send for Raw {}
// SAFETY: as above.
unsafe impl Sync for Raw {}

/// Unused devices with one build thread. They are kept and never released.
///
/// Creating or releasing such a device sets TBB's limit of one thread. If that happens after a
/// build, workers of TBB (2021 and later) spin for the rest of the process, one for every other
/// processor. So as many devices as a process is likely to need at once are created before the
/// first of them builds anything.
static IDLE: Mutex<Option<Vec<Raw>>> = Mutex::new(None);

/// Number of one-thread devices that are created at once. One takes 50 microseconds and 20 kB.
const BATCH: usize = 16;

/// How a user gets an Embree that works. An installed program has no Makefile.
const INSTALL: &str = "install libembree4-4 (Debian 13 and later), in a checkout of lightpath run `make setup`, or \
     name the folder of libembree4.so.4 in LD_LIBRARY_PATH";

/// Opens the library: see [`search::library`].
///
/// # Errors
/// `Unsupported` if the library is missing or not Embree 4, `Retry` if memory ran out.
pub fn load_library() -> Result<Arc<Api>> {
    let found = search::library();
    let file = &found.file.display().to_string();
    let missing = |error: &dyn std::fmt::Display| {
        let error = error.to_string();
        let help = match needed_library(&error, file) {
            Some(name) => format!("install {name}, which Embree needs"),
            None => found.help().unwrap_or_else(|| INSTALL.into()),
        };
        let problem = Problem::new("Embree", format!("cannot load {file}: {error}"));
        Error::new(ErrorKind::Unsupported, problem.help(help))
    };
    // SAFETY: Embree's and TBB's initialisers have no preconditions.
    let library = unsafe { libloading::Library::new(&found.file) };
    let library = library.map_err(|error| match has_room(LIBRARY_BYTES) {
        true => missing(&error),
        false => Error::no_memory("Embree", format!("cannot load {file}: out of memory: {error}")),
    })?;
    Ok(Arc::new(Api::resolve(library).map_err(|e| missing(&e))?))
}

/// Returns the library that the loader's message `error` misses, if it is not `file` itself but one
/// that `file` needs: a small system may lack libstdc++.
fn needed_library<'a>(error: &'a str, file: &str) -> Option<&'a str> {
    let (name, _) = error.split_once(": cannot open shared object file")?;
    (name != file).then_some(name)
}

/// Settings of every device.
///
/// The cache of tessellated subdivision surfaces, which no scene has, would take 128 MiB of address
/// space. If they are not to be had, Embree keeps a spin lock, and the next device waits without
/// end.
const CONFIG: &str = "set_affinity=0,tessellation_cache_size=0";

/// Address space for the files of Embree and TBB, which have 44 MB.
const LIBRARY_BYTES: usize = 128 << 20;

/// Address space for a device without its threads. With less, TBB may abort the process or wait
/// without end.
const DEVICE_BYTES: usize = 128 << 20;

/// Address space for each thread that TBB starts, as [`DEVICE_BYTES`].
const THREAD_BYTES: usize = 32 << 20;

/// Stack of a worker of TBB.
const STACK_BYTES: usize = 4 << 20;

/// Returns the number of workers that TBB may start. It starts no more threads than there are
/// processors, and the thread that builds is one of them.
fn worker_count(threads: usize, processors: usize) -> usize {
    let all = if threads == 0 { processors } else { threads.min(processors) };
    all.saturating_sub(1)
}

/// Starts as many threads as TBB may start, and ends them: TBB aborts the process if it cannot
/// start one.
///
/// # Errors
/// `Retry` if the system refuses a thread.
fn ensure_workers_start(count: usize) -> Result<()> {
    let counted = || number("/proc/self/status".as_ref(), "Threads:");
    let before = counted();
    let gate = Mutex::new(());
    std::thread::scope(|scope| {
        // All threads live until the last one has started.
        let closed = gate.lock();
        let start = || {
            let thread = std::thread::Builder::new().stack_size(STACK_BYTES);
            thread.spawn_scoped(scope, || drop(gate.lock()))
        };
        let started: std::io::Result<Vec<_>> = (0..count).map(|_| start()).collect();
        drop(closed);
        started.map(drop)
    })
    .map_err(|error| Error::io("Embree".as_ref(), "start threads", &error))?;
    // The system still counts a thread for some microseconds after its end.
    for _ in 0..200 {
        if count == 0 || counted() <= before {
            break;
        }
        std::thread::yield_now();
    }
    Ok(())
}

/// Returns whether so much address space is left.
///
/// The errors of the loader and of TBB do not distinguish a lack of memory from other failures.
fn has_room(bytes: usize) -> bool {
    // Under a limit, no trial: it would take the memory away from builds on other threads.
    match left_by_limits(Path::new("/")) {
        Some(left) => left >= bytes as u64,
        None => Vec::<u8>::new().try_reserve_exact(bytes).is_ok(),
    }
}

impl Raw {
    fn new(api: Arc<Api>, threads: usize) -> Result<Self> {
        let processors = std::thread::available_parallelism().map_or(1, usize::from);
        if !has_room(DEVICE_BYTES + worker_count(threads, processors) * THREAD_BYTES) {
            return Err(Error::no_memory("Embree", "cannot create a device: out of memory"));
        }
        ensure_workers_start(worker_count(threads, processors))?;
        let config = format!("threads={threads},{CONFIG}");
        let config = CString::new(config).map_err(|e| Error::invalid("Embree", e.to_string()))?;
        // SAFETY: a NUL-terminated string.
        let handle = unsafe { (api.new_device)(config.as_ptr()) };
        let Some(handle) = NonNull::new(handle) else {
            // SAFETY: a null device is allowed; it returns this thread's error of `rtcNewDevice`.
            let code = unsafe { (api.get_device_error)(std::ptr::null_mut()) };
            let message = format!("cannot create a device: {}", error_name(code));
            return Err(match code {
                ffi::RTC_ERROR_OUT_OF_MEMORY => Error::no_memory("Embree", message),
                _ => unsupported(message),
            });
        };
        Ok(Self { api, handle })
    }

    /// Takes a device with one build thread out of [`IDLE`], or creates one.
    fn single_threaded(api: &Arc<Api>) -> Result<Self> {
        let mut idle = IDLE.lock().unwrap_or_else(PoisonError::into_inner);
        if idle.is_none() {
            *idle = Some((0..BATCH).map(|_| Self::new(api.clone(), 1)).collect::<Result<_>>()?);
        }
        let Some(raw) = idle.as_mut().and_then(Vec::pop) else {
            return Self::new(api.clone(), 1);
        };
        // SAFETY: a live device; reading clears the error code of its former user.
        unsafe { (raw.api.get_device_error)(raw.handle.as_ptr()) };
        Ok(raw)
    }

    /// Sets the [`DeviceMonitor`] that receives errors and memory figures; a null pointer stops the
    /// reports.
    ///
    /// # Safety
    /// `watch` points to a [`DeviceMonitor`] that outlives the device or the next call.
    unsafe fn report_to(&self, watch: *mut c_void) {
        let on_error = (!watch.is_null()).then_some(on_error as ffi::ErrorFunction);
        let on_memory = (!watch.is_null()).then_some(on_memory as ffi::MemoryFunction);
        // SAFETY: a live device; the caller promises that `watch` is valid for the callbacks.
        unsafe {
            (self.api.set_error_function)(self.handle.as_ptr(), on_error, watch);
            (self.api.set_memory_function)(self.handle.as_ptr(), on_memory, watch);
        }
    }
}

impl Device {
    /// Creates a device with `threads` build threads. 0 means one for each processor.
    ///
    /// Builds on the device fail once it would hold more than `max_bytes`.
    ///
    /// # Errors
    /// `Unsupported` for a library outside [4.3.0, 5) or a processor that it cannot use, `Retry` if
    /// memory ran out.
    pub fn new(api: Arc<Api>, threads: usize, max_bytes: Option<u64>) -> Result<Self> {
        let raw = if threads == 1 { Raw::single_threaded(&api)? } else { Raw::new(api, threads)? };
        let watch = PinnedBox::new(DeviceMonitor {
            bytes: AtomicI64::new(0),
            peak_bytes: AtomicI64::new(0),
            limit_bytes: max_bytes.and_then(|n| i64::try_from(n).ok()).unwrap_or(i64::MAX),
            limit_hit: AtomicBool::new(false),
            last_error: Mutex::new(None),
        });
        let mut device = Self { raw, threads, watch, version: [0; 3] };
        let version = device.property(ffi::RTC_DEVICE_PROPERTY_VERSION);
        device.version = [version / 10_000, version / 100 % 100, version % 100].map(|n| n as u8);
        if !(40_300..50_000).contains(&version) {
            let [major, minor, patch] = device.version;
            return Err(unsupported(format!(
                "found Embree {major}.{minor}.{patch}, expected at least 4.3.0 and below 5"
            )));
        }
        let watch = device.watch.user_data();
        // SAFETY: `watch` stays where it is until `Drop` takes it back.
        unsafe { device.raw.report_to(watch) };
        device.check()?;
        Ok(device)
    }

    /// Returns the entry points of the loaded library.
    pub fn api(&self) -> &Api {
        &self.raw.api
    }

    /// Returns the `RTCDevice`, which this value owns.
    pub fn handle(&self) -> *mut DeviceHandle {
        self.raw.handle.as_ptr()
    }

    /// Returns the memory counters, the errors and the limit.
    pub fn watch(&self) -> &DeviceMonitor {
        &self.watch
    }

    /// Returns Embree's version: major, minor, patch.
    pub fn version(&self) -> [u8; 3] {
        self.version
    }

    /// Returns the name of the instruction set that Embree uses on this processor.
    pub fn isa(&self) -> &'static str {
        if self.has_packets_of_16() {
            "AVX-512"
        } else if self.has_packets_of_8() {
            "AVX/AVX2"
        } else {
            "SSE"
        }
    }

    /// Whether Embree has kernels for packets of 8 rays.
    pub fn has_packets_of_8(&self) -> bool {
        self.property(ffi::RTC_DEVICE_PROPERTY_NATIVE_RAY8_SUPPORTED) != 0
    }

    /// Whether Embree has kernels for packets of 16 rays.
    pub fn has_packets_of_16(&self) -> bool {
        self.property(ffi::RTC_DEVICE_PROPERTY_NATIVE_RAY16_SUPPORTED) != 0
    }

    fn property(&self, property: Enum) -> isize {
        // SAFETY: a live device.
        unsafe { (self.raw.api.get_device_property)(self.handle(), property) }
    }

    /// Returns the first error on any thread since the last check. The kind is `Limit` once the
    /// memory limit was hit, `Retry` if memory ran out, else `Unsupported`.
    pub fn check(&self) -> Result<()> {
        // SAFETY: a live device; reading clears the code of this thread.
        let code = unsafe { (self.raw.api.get_device_error)(self.handle()) };
        let logged = self.watch.last_error.lock().map_or(None, |mut last| last.take());
        let (code, text) = match (code, logged) {
            (0, None) => return Ok(()),
            (code, None) => (code, String::new()),
            (_, Some(logged)) => logged,
        };
        if self.watch.limit_hit.load(Relaxed) {
            return Err(over_limit(self.watch.limit_bytes.unsigned_abs()));
        }
        let message = format!("{}: {text}", error_name(code));
        Err(match code {
            ffi::RTC_ERROR_OUT_OF_MEMORY => Error::no_memory("Embree", message),
            _ => Error::new(ErrorKind::Unsupported, Problem::new("Embree", message)),
        })
    }
}

impl Drop for Device {
    fn drop(&mut self) {
        // SAFETY: a live device without scenes; `watch` is dropped after this call.
        unsafe { self.raw.report_to(std::ptr::null_mut()) };
        if self.threads == 1 {
            let raw = Raw { api: self.raw.api.clone(), handle: self.raw.handle };
            let mut idle = IDLE.lock().unwrap_or_else(PoisonError::into_inner);
            return idle.get_or_insert_default().push(raw);
        }
        // SAFETY: created by `rtcNewDevice`, released once.
        unsafe { (self.raw.api.release_device)(self.handle()) };
    }
}

fn unsupported(message: String) -> Error {
    Error::new(ErrorKind::Unsupported, Problem::new("Embree", message).help(INSTALL))
}

fn error_name(code: Enum) -> &'static str {
    match code {
        0 => "no error",
        2 => "invalid argument",
        3 => "invalid operation",
        4 => "out of memory",
        5 => "unsupported processor",
        6 => "cancelled",
        _ => "unknown error",
    }
}

unsafe extern "C" fn on_error(watch: *mut c_void, code: Enum, text: *const c_char) {
    // SAFETY: `report_to` registered this `watch` for the calling device, and it is still alive.
    let watch = unsafe { &*watch.cast::<DeviceMonitor>() };
    let text = if text.is_null() {
        String::new()
    } else {
        // SAFETY: Embree passes a NUL-terminated string.
        unsafe { CStr::from_ptr(text) }.to_string_lossy().into_owned()
    };
    if let Ok(mut last) = watch.last_error.lock() {
        last.get_or_insert((code, text));
    }
}

unsafe extern "C" fn on_memory(watch: *mut c_void, bytes: isize, _post: bool) -> bool {
    // SAFETY: `report_to` registered this `watch` for the calling device, and it is still alive.
    let watch = unsafe { &*watch.cast::<DeviceMonitor>() };
    let bytes = bytes as i64;
    let now = watch.bytes.fetch_add(bytes, Relaxed) + bytes;
    watch.peak_bytes.fetch_max(now, Relaxed);
    let fits = bytes <= 0 || now <= watch.limit_bytes;
    if !fits {
        watch.limit_hit.store(true, Relaxed);
    }
    fits
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_library_that_embree_needs_is_told_from_embree() {
        let absent = |name: &str| format!("{name}: cannot open shared object file: No such file");
        let file = "libembree4.so.4";
        let of = |error: &str| needed_library(error, file).map(str::to_owned);
        assert_eq!(of(&absent("libstdc++.so.6")).as_deref(), Some("libstdc++.so.6"));
        assert_eq!(of(&absent(file)), None);
        assert_eq!(of("libembree4.so.4: file too short"), None);
    }

    #[test]
    fn only_threads_that_start_need_room() {
        let count = worker_count;
        assert_eq!([count(1, 1), count(1, 64), count(64, 1), count(0, 1)], [0; 4]);
        assert_eq!([count(2, 2), count(64, 2), count(0, 2), count(usize::MAX, 2)], [1; 4]);
        assert_eq!([count(64, 64), count(900, 64), count(0, 64)], [63; 3]);
    }
}
