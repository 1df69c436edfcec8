//! Arrays that several threads fill, and that are not zeroed before.
//!
//! Zeroing an array that comes from the heap takes a pass over its memory, on one thread.

use std::mem::{MaybeUninit, take};
use std::sync::atomic::{AtomicUsize, Ordering::Relaxed};

use crate::error::Result;
use crate::reserve;
use crate::simd::prefetch_line;

/// An array that is being filled.
pub(super) struct Filling<T> {
    /// Empty, with the capacity of all elements.
    array: Vec<T>,
    count: usize,
    /// Number of elements written through the current parts.
    written: AtomicUsize,
}

impl<T: Copy> Filling<T> {
    /// Reserves an array of `count` elements.
    ///
    /// # Errors
    /// `Retry` if the system refuses the memory.
    pub fn new(count: usize, what: &str) -> Result<Self> {
        let mut array = Vec::new();
        reserve::exact(&mut array, count, what)?;
        Ok(Self { array, count, written: AtomicUsize::new(0) })
    }

    /// Splits the array into consecutive parts of these lengths. What earlier parts wrote is
    /// forgotten.
    ///
    /// # Panics
    /// If the lengths exceed the array.
    pub fn parts(&mut self, lengths: impl Iterator<Item = usize>) -> Vec<Part<'_, T>> {
        *self.written.get_mut() = 0;
        let mut rest = &mut self.array.spare_capacity_mut()[..self.count];
        let part = |length| {
            let (slots, others) = take(&mut rest).split_at_mut(length);
            rest = others;
            Part { slots, written: 0, total: &self.written }
        };
        lengths.map(part).collect()
    }

    /// Returns the array.
    ///
    /// # Panics
    /// If an element was not written.
    pub fn finish(mut self) -> Vec<T> {
        assert_eq!(*self.written.get_mut(), self.count, "elements written");
        // SAFETY: parts do not overlap, and each counts the elements that it wrote once. Their sum
        // is that of all elements, so all are written.
        unsafe { self.array.set_len(self.count) };
        self.array
    }
}

/// A part of an array, which is written from its start.
pub(super) struct Part<'a, T> {
    /// What is not yet written.
    slots: &'a mut [MaybeUninit<T>],
    written: usize,
    total: &'a AtomicUsize,
}

impl<T: Copy> Part<'_, T> {
    /// Appends values.
    ///
    /// # Panics
    /// If the part has no room for them.
    #[inline(always)]
    pub fn extend(&mut self, values: &[T]) {
        let (slots, rest) = take(&mut self.slots).split_at_mut(values.len());
        for (slot, value) in slots.iter_mut().zip(values) {
            slot.write(*value);
        }
        self.slots = rest;
        self.written += values.len();
    }

    /// Prefetches the memory of `count` elements, from the one that is `ahead` of the next.
    #[inline(always)]
    pub fn prefetch(&self, ahead: usize, count: usize) {
        for line in 0..(count * size_of::<T>()).div_ceil(64) {
            prefetch_line(self.slots, ahead, line);
        }
    }

    /// Number of elements that are not yet written.
    #[inline(always)]
    pub fn room(&self) -> usize {
        self.slots.len()
    }
}

impl<T> Drop for Part<'_, T> {
    fn drop(&mut self) {
        self.total.fetch_add(self.written, Relaxed);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn parts_make_one_array() {
        let mut filling = Filling::new(5, "x").expect("memory");
        let mut parts = filling.parts([2, 0, 3].into_iter());
        parts[2].extend(&[3, 4]);
        parts[0].extend(&[1, 2]);
        assert_eq!((parts[0].room(), parts[2].room()), (0, 1));
        parts[2].extend(&[5]);
        drop(parts);
        assert_eq!(filling.finish(), [1, 2, 3, 4, 5]);
    }

    #[test]
    #[should_panic(expected = "elements written")]
    fn an_array_with_a_hole_is_not_returned() {
        let mut filling = Filling::new(4, "x").expect("memory");
        // The first two parts write all elements but the last, the second two the last alone.
        filling.parts([3, 1].into_iter())[0].extend(&[1, 2, 3]);
        filling.parts([3, 1].into_iter())[1].extend(&[4]);
        filling.finish();
    }
}
