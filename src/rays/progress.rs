//! Loops over many rays or points, which count progress and can be stopped.

use std::sync::atomic::Ordering::Relaxed;

use crate::error::Result;
use crate::monitor::{Monitor, Phase};
use crate::parallel;

/// Rays or points of a task. A multiple of a packet.
pub(super) const CHUNK: usize = 1024;

/// Computes `answer` for the ranges of [`CHUNK`] items below `count`, in parallel. Returns the
/// answers in order.
///
/// # Errors
/// `Interrupted` if the monitor was stopped, and those of `answer`.
pub(super) fn in_chunks<T: Send>(
    count: usize,
    monitor: &Monitor,
    answer: impl Fn(std::ops::Range<usize>) -> Result<T> + Sync,
) -> Result<Vec<T>> {
    monitor.begin(Phase::Check, count as u64);
    parallel::try_map(parallel::ranges(count, CHUNK), |range| {
        monitor.check()?;
        let length = range.len() as u64;
        let answer = answer(range)?;
        monitor.done.fetch_add(length, Relaxed);
        Ok(answer)
    })
}

/// Fills `all` by one call per [`CHUNK`] items, in parallel. `fill` gets the index of the first
/// item and the items.
///
/// # Errors
/// `Interrupted` if the monitor was stopped, and those of `fill`.
pub(super) fn fill<T: Send>(
    all: &mut [T],
    monitor: &Monitor,
    fill: impl Fn(usize, &mut [T]) -> Result<()> + Sync,
) -> Result<()> {
    monitor.begin(Phase::Check, all.len() as u64);
    let done = parallel::try_map(all.chunks_mut(CHUNK).enumerate(), |(chunk, items)| {
        monitor.check()?;
        fill(chunk * CHUNK, items)?;
        monitor.done.fetch_add(items.len() as u64, Relaxed);
        Ok(())
    });
    done.map(drop)
}
