//! Parallel loops over tasks that are coarse enough for a virtual call each. Rayon's part of them
//! is compiled once: it takes a compiler longer than most loops' own code.

use std::ops::Range;
use std::sync::atomic::AtomicBool;
use std::sync::atomic::Ordering::Relaxed;
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

/// Returns the results of all items, in order, or an error. After an error no work begins.
///
/// # Errors
/// Of the errors found until then, that of the first item.
pub fn try_map<I: ExactSizeIterator + Send, T: Send, E: Send>(
    items: I,
    work: impl Fn(I::Item) -> Result<T, E> + Sync,
) -> Result<Vec<T>, E> {
    let failed = AtomicBool::new(false);
    let results = map(items, |item| {
        let result = (!failed.load(Relaxed)).then(|| work(item));
        failed.fetch_or(matches!(result, Some(Err(_))), Relaxed);
        result
    });
    results.into_iter().flatten().collect()
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

#[cfg(test)]
mod tests {
    use std::sync::atomic::AtomicUsize;

    use super::*;

    #[test]
    fn results_are_in_order() {
        for count in [0, 1, 5000] {
            let squares: Vec<usize> = (0..count).map(|i| i * i).collect();
            assert_eq!(map(0..count, |i| i * i), squares);
            assert_eq!(values(count, |i| i * i), squares);
            assert_eq!(try_map(0..count, |i| Ok::<_, ()>(i * i)), Ok(squares));
            let parts: Vec<usize> = ranges(count, 7).flatten().collect();
            assert!(parts.into_iter().eq(0..count));
        }
        assert_eq!([first(9, &|i| i * i > 20), first(9, &|i| i > 9)], [Some(5), None]);
    }

    #[test]
    fn no_work_begins_after_an_error() {
        let begun = AtomicUsize::new(0);
        let found = try_map(0..100_000, |i| {
            begun.fetch_add(1, Relaxed);
            if i == 3 { Err("three") } else { Ok(()) }
        });
        assert_eq!(found, Err("three"));
        // Other threads do not wait for the error.
        assert!(begun.into_inner() < 50_000);
    }
}
