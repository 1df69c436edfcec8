//! Parallel loops over tasks that are coarse enough for a virtual call each. Rayon's part of them
//! is compiled once: it takes a compiler longer than most loops' own code.

use std::ops::Range;
use std::sync::{Mutex, PoisonError};

use rayon::prelude::*;

/// Elements of a task, if each takes some nanoseconds.
pub const GRAIN: usize = 1 << 12;

/// Calls `work` for each index below `count`, on the current rayon pool.
fn times(count: usize, work: &(dyn Fn() + Sync)) {
    // One at a time. Else a thread gets the last tasks many at a time, and others wait for it.
    (0..count).into_par_iter().with_max_len(1).for_each(|_| work());
}

/// Calls `work` for each item, in parallel. Threads take the items in turn.
pub fn each<I: ExactSizeIterator + Send>(items: I, work: impl Fn(I::Item) + Sync) {
    let (count, items) = (items.len(), Mutex::new(items));
    times(count, &|| {
        let next = items.lock().unwrap_or_else(PoisonError::into_inner).next();
        if let Some(item) = next {
            work(item);
        }
    });
}

/// Returns the result of each item, in order.
pub fn map<I: ExactSizeIterator + Send, T: Send>(
    items: I,
    work: impl Fn(I::Item) -> T + Sync,
) -> Vec<T> {
    let mut results = Vec::new();
    results.resize_with(items.len(), || None);
    each(results.iter_mut().zip(items), |(result, item)| *result = Some(work(item)));
    let mut all = Vec::with_capacity(results.len());
    results.into_iter().for_each(|result| all.extend(result));
    all
}

/// Sets each element to the value of its index.
pub fn fill<T: Send>(all: &mut [T], value: impl Fn(usize) -> T + Sync) {
    each(all.chunks_mut(GRAIN).enumerate(), |(part, all)| {
        for (to, i) in all.iter_mut().zip(part * GRAIN..) {
            *to = value(i);
        }
    });
}

/// Returns the values of the indices below `count`.
pub fn values<T: Clone + Default + Send>(count: usize, of: impl Fn(usize) -> T + Sync) -> Vec<T> {
    let mut all = vec![T::default(); count];
    fill(&mut all, of);
    all
}

/// Returns the first index below `count` for which `found` is true.
pub fn first(count: usize, found: &(dyn Fn(usize) -> bool + Sync)) -> Option<usize> {
    (0..count).into_par_iter().find_first(|&i| found(i))
}

/// The ranges of `size` indices, the last of fewer, that are together those below `count`.
pub fn ranges(count: usize, size: usize) -> impl ExactSizeIterator<Item = Range<usize>> + Send {
    (0..count.div_ceil(size)).map(move |part| part * size..count.min((part + 1) * size))
}
