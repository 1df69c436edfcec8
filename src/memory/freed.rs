//! Memory that was freed and that the allocator keeps: given back to the system where it is short.

/// Gives back what this process has freed. Costs milliseconds, so only where memory is short.
pub fn give_back() {
    // SAFETY: may be called at any time, from any thread; touches no live allocation.
    #[cfg(all(target_os = "linux", target_env = "gnu"))]
    unsafe {
        libc::malloc_trim(0);
    }
}
