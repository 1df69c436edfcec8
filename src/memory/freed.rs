//! Makes the allocator keep less memory and fewer addresses.

#[cfg(all(target_os = "linux", target_env = "gnu"))]
use std::path::Path;

#[cfg(all(target_os = "linux", target_env = "gnu"))]
use crate::process::left_by_limits;

/// Arrays from this size on are returned when they are freed. Those of small meshes stay below it:
/// they are used again by the next build of a batch.
#[cfg(all(target_os = "linux", target_env = "gnu"))]
const LARGE_BYTES: libc::c_int = 4 << 20;

/// Up to so many freed bytes at the end of the heap are kept. The heap holds all smaller arrays.
/// With glibc's default of 128 KiB, every build of a small mesh would take its pages anew.
#[cfg(all(target_os = "linux", target_env = "gnu"))]
const KEPT_BYTES: libc::c_int = 4 << 20;

/// From now on, returns large arrays to the system as soon as they are freed.
///
/// Otherwise the allocator keeps them once a large array was freed: the peak of a build would
/// depend on the order in which threads allocate. Does nothing unless the C library is glibc on
/// Linux.
pub fn return_large_arrays() {
    // SAFETY: may be called at any time, from any thread; touches no live allocation.
    #[cfg(all(target_os = "linux", target_env = "gnu"))]
    unsafe {
        libc::mallopt(libc::M_MMAP_THRESHOLD, LARGE_BYTES);
        libc::mallopt(libc::M_TRIM_THRESHOLD, KEPT_BYTES);
    }
}

/// With a limit of address space, lets the arenas of the allocator take about an eighth of it. Call
/// it before other threads start.
///
/// An arena reserves 64 MiB of addresses. Threads have one each, up to 8 for each processor.
/// Threads that share an arena allocate one after another. Does nothing if the user limits the
/// arenas, or unless the C library is glibc on Linux.
pub fn limit_arenas() {
    #[cfg(all(target_os = "linux", target_env = "gnu"))]
    if let (Some(left), None, None) = (
        left_by_limits(Path::new("/")),
        std::env::var_os("MALLOC_ARENA_MAX"),
        std::env::var_os("GLIBC_TUNABLES"),
    ) {
        let usual = 8 * std::thread::available_parallelism().map_or(1, usize::from) as u64;
        let arenas = (left / 8 / (64 << 20)).clamp(1, usual);
        // SAFETY: may be called at any time, from any thread; touches no live allocation.
        unsafe { libc::mallopt(libc::M_ARENA_MAX, arenas as libc::c_int) };
    }
}

/// Returns memory that this process has freed to the system. Takes 0.2 to 2 milliseconds, so call
/// it only when memory is short, or before the allocation that reaches the peak. Does nothing
/// unless the C library is glibc on Linux.
pub fn release_freed() {
    // SAFETY: may be called at any time, from any thread; touches no live allocation.
    #[cfg(all(target_os = "linux", target_env = "gnu"))]
    unsafe {
        libc::malloc_trim(0);
    }
}
