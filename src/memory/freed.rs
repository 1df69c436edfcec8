//! Returns freed memory that the allocator keeps to the system, for when memory is short.

/// Returns memory that this process has freed to the system. It takes milliseconds, so it is for
/// when memory is short.
pub fn release() {
    // SAFETY: may be called at any time, from any thread; touches no live allocation.
    #[cfg(all(target_os = "linux", target_env = "gnu"))]
    unsafe {
        libc::malloc_trim(0);
    }
}
