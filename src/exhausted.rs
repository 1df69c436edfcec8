//! Memory that runs out where nobody can be told: exit 3 with a message, in place of an abort.
//!
//! What is as large as a file or a scene is reserved first and its lack is an error (`reserve`). What is
//! left is small: where it fails, Rust's library says so and aborts, which raises SIGABRT in the same
//! thread. A handler takes part files away and ends the process with the exit code that promises that
//! another try may help. An abort for any other reason stays an abort.

use std::{
    alloc::{GlobalAlloc, Layout, System},
    cell::Cell,
};

thread_local! {
    /// An allocation of this thread failed. Not cleared: on the way to the abort Rust's library may allocate again,
    /// for a backtrace.
    static FAILED: Cell<bool> = const { Cell::new(false) };
}

/// The system's allocator, which notes what fails.
pub struct Noting;

impl Noting {
    #[inline]
    fn note(pointer: *mut u8) -> *mut u8 {
        if pointer.is_null() {
            FAILED.set(true);
        }
        pointer
    }
}

// SAFETY: every call goes to the system's allocator with what the caller promised; a cell without a
// destructor neither allocates nor unwinds.
unsafe impl GlobalAlloc for Noting {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        // SAFETY: as promised to us.
        Self::note(unsafe { System.alloc(layout) })
    }

    unsafe fn alloc_zeroed(&self, layout: Layout) -> *mut u8 {
        // SAFETY: as promised to us.
        Self::note(unsafe { System.alloc_zeroed(layout) })
    }

    unsafe fn realloc(&self, pointer: *mut u8, layout: Layout, size: usize) -> *mut u8 {
        // SAFETY: as promised to us.
        Self::note(unsafe { System.realloc(pointer, layout, size) })
    }

    unsafe fn dealloc(&self, pointer: *mut u8, layout: Layout) {
        // SAFETY: as promised to us.
        unsafe { System.dealloc(pointer, layout) }
    }
}

/// Ends the process with exit code 3 where an abort follows a failed allocation.
#[cfg(unix)]
pub fn exit_in_place_of_abort() {
    // SAFETY: plain calls with valid pointers; an all-zero `sigaction` is a valid value.
    unsafe {
        let mut action: libc::sigaction = std::mem::zeroed();
        action.sa_sigaction = on_abort as *const () as usize;
        libc::sigemptyset(&raw mut action.sa_mask);
        libc::sigaction(libc::SIGABRT, &raw const action, std::ptr::null_mut());
    }
}

/// Nothing to hold on to.
#[cfg(not(unix))]
pub fn exit_in_place_of_abort() {}

/// Runs in the thread that aborts, inside of no allocator. If it returns, the abort goes on.
#[cfg(unix)]
extern "C" fn on_abort(_: libc::c_int) {
    if !FAILED.get() {
        return;
    }
    const SAID: &[u8] = b"error: no memory is left\n  \
        help: free some memory, or raise the limit of this process\n";
    lightpath::output::atomic::remove_parts();
    // SAFETY: a valid buffer of that length; both functions may be called in a signal handler.
    unsafe {
        libc::write(2, SAID.as_ptr().cast(), SAID.len());
        libc::_exit(3);
    }
}
