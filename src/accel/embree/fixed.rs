//! Data at a fixed address, for data to which the C library keeps a pointer.

use std::ffi::c_void;
use std::ops::Deref;
use std::ptr::NonNull;

/// An owned value at a fixed address.
///
/// It is not a `Box`: moving a box asserts that nobody else holds a pointer to its content, but
/// Embree's callbacks do.
#[derive(Debug)]
pub struct PinnedBox<T>(NonNull<T>);

impl<T> PinnedBox<T> {
    /// Moves `value` to the heap, where it stays.
    pub fn new(value: T) -> Self {
        Self(NonNull::from(Box::leak(Box::new(value))))
    }

    /// Returns the pointer for the callbacks, which only read through it.
    pub fn user_data(&self) -> *mut c_void {
        self.0.as_ptr().cast()
    }
}

impl<T> Deref for PinnedBox<T> {
    type Target = T;
    fn deref(&self) -> &T {
        // SAFETY: made from a box in `new`, freed in `drop` alone, and never borrowed mutably.
        unsafe { self.0.as_ref() }
    }
}

impl<T> Drop for PinnedBox<T> {
    fn drop(&mut self) {
        // SAFETY: the box that `new` leaked, freed once.
        drop(unsafe { Box::from_raw(self.0.as_ptr()) });
    }
}
