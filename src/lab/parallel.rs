//! The parallel loop over the packets of a check.

use crate::error::Result;
use crate::monitor::Monitor;
use crate::parallel;

/// Number of indices whose results are held in memory at a time.
const PORTION: u64 = 4096;

/// Calls `work` for every index below `count` on the current rayon pool. Calls `take` with the
/// results of each portion of indices, in order.
///
/// Portions bound the memory of the results. After a signal, the rest of the portion is skipped and
/// none of its results reach `take`.
///
/// # Errors
/// `Interrupted` after a signal.
pub fn in_portions<T: Send>(
    count: u64,
    monitor: &Monitor,
    work: &(dyn Fn(u64) -> T + Sync),
    take: &mut dyn FnMut(Vec<T>),
) -> Result<()> {
    for first in (0..count).step_by(PORTION as usize) {
        let portion = 0..(count - first).min(PORTION) as usize;
        let work = |i| (!monitor.stopped()).then(|| work(first + i as u64));
        let portion = parallel::map(portion, work);
        monitor.check()?;
        take(portion.into_iter().flatten().collect());
    }
    Ok(())
}
