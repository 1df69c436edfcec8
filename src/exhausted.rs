//! Exit code 3 in place of an abort when a small allocation fails.
//!
//! Large arrays are reserved first, and a failure is an ordinary error (`reserve`). The remaining
//! allocations are small. If one fails, Rust's library prints a message and aborts, which raises
//! SIGABRT in the same thread. The handler here removes unfinished `.part` files, if no other
//! thread holds their list. It ends the process with the exit code for failures worth retrying. The
//! C library aborts in the same way, where the allocator here does not see it. An abort stays one
//! if all allocations of its thread succeeded and the system still has memory.

use std::alloc::{GlobalAlloc, Layout, System};
use std::cell::Cell;
use std::panic::PanicHookInfo;

thread_local! {
    /// True once an allocation of this thread has failed, also one that `reserve` reports as an
    /// error. Never cleared: before it aborts, Rust's library may allocate memory for a backtrace,
    /// and that may succeed.
    static FAILED: Cell<bool> = const { Cell::new(false) };
}

/// The system's allocator, which records failed allocations.
pub struct FailureRecordingAllocator;

impl FailureRecordingAllocator {
    #[inline]
    fn note(pointer: *mut u8) -> *mut u8 {
        if pointer.is_null() {
            FAILED.set(true);
        }
        pointer
    }
}

// SAFETY: every call goes to the system's allocator under the caller's contract. A cell without a
// destructor neither allocates nor unwinds.
unsafe impl GlobalAlloc for FailureRecordingAllocator {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        // SAFETY: the caller upholds the contract of `alloc`.
        Self::note(unsafe { System.alloc(layout) })
    }

    unsafe fn alloc_zeroed(&self, layout: Layout) -> *mut u8 {
        // SAFETY: the caller upholds the contract of `alloc_zeroed`.
        Self::note(unsafe { System.alloc_zeroed(layout) })
    }

    unsafe fn realloc(&self, pointer: *mut u8, layout: Layout, size: usize) -> *mut u8 {
        // SAFETY: the caller upholds the contract of `realloc`.
        Self::note(unsafe { System.realloc(pointer, layout, size) })
    }

    unsafe fn dealloc(&self, pointer: *mut u8, layout: Layout) {
        // SAFETY: the caller upholds the contract of `dealloc`.
        unsafe { System.dealloc(pointer, layout) }
    }
}

/// Installs the handler that ends the process with exit code 3 if an abort follows a failed
/// allocation.
#[cfg(unix)]
pub fn exit_instead_of_abort() {
    // SAFETY: plain calls with valid pointers; an all-zero `sigaction` is a valid value.
    unsafe {
        let mut action: libc::sigaction = std::mem::zeroed();
        action.sa_sigaction = on_abort as *const () as usize;
        libc::sigemptyset(&raw mut action.sa_mask);
        libc::sigaction(libc::SIGABRT, &raw const action, std::ptr::null_mut());
    }
}

/// Does nothing: outside Unix, Rust's library aborts without a signal that a handler can catch.
#[cfg(not(unix))]
pub fn exit_instead_of_abort() {}

/// Ends the process with exit code 3 if a panic is for lack of memory: that of a new thread without
/// memory for the stack of its signal handlers, outside every `catch_unwind`, and those of the
/// compression libraries in C, whose allocations the allocator here does not see.
///
/// Rust's own hook may wait for ever then: it allocates memory for a backtrace, and the failure of
/// that allocation prints another one.
#[cfg(unix)]
pub fn exit_on_panic_for_memory(panic: &PanicHookInfo) {
    // `libdeflater` and `zstd-safe` panic for lack of memory, or for a bug in them.
    let places = ["stack_overflow.rs", "/libdeflater", "/zstd-safe"];
    let file = panic.location().map_or("", |place| place.file());
    if places.iter().any(|place| file.contains(place)) || !is_memory_left() {
        end();
    }
}

/// Does nothing: outside Unix, a panic is one.
#[cfg(not(unix))]
pub fn exit_on_panic_for_memory(_: &PanicHookInfo) {}

/// Handles SIGABRT in the thread that aborts. A failed allocation has returned by then, so removing
/// files is safe. The process aborts if this function returns.
#[cfg(unix)]
extern "C" fn on_abort(_: libc::c_int) {
    if FAILED.get() || !is_memory_left() {
        end();
    }
}

/// Whether the system still gives 1 MiB of memory. For an allocation that its heaps cannot hold,
/// glibc maps so much, and where it cannot, it may abort the process.
#[cfg(unix)]
fn is_memory_left() -> bool {
    let (size, access) = (1 << 20, libc::PROT_READ | libc::PROT_WRITE);
    let flags = libc::MAP_PRIVATE | libc::MAP_ANONYMOUS;
    // SAFETY: a new mapping that nothing uses; both are plain system calls.
    unsafe {
        let memory = libc::mmap(std::ptr::null_mut(), size, access, flags, -1, 0);
        memory != libc::MAP_FAILED && libc::munmap(memory, size) == 0
    }
}

/// Removes unfinished files and ends the process with exit code 3, without any allocation.
#[cfg(unix)]
fn end() -> ! {
    const MESSAGE: &[u8] = b"error: no memory is left\n  \
        help: free some memory, or raise the limit of this process\n";
    lightpath::output::atomic::remove_parts();
    // SAFETY: a valid buffer of this length; both functions may be called in a signal handler.
    unsafe {
        libc::write(2, MESSAGE.as_ptr().cast(), MESSAGE.len());
        libc::_exit(3);
    }
}
