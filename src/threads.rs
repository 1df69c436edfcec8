//! Pools of worker threads.

use rayon::{ThreadPool, ThreadPoolBuilder};

use crate::error::{Error, Kind, Problem, Result};

/// Starts a pool of `threads` threads.
///
/// # Errors
/// `Retry` if the system cannot start them.
pub fn pool(threads: usize) -> Result<ThreadPool> {
    ThreadPoolBuilder::new().num_threads(threads).build().map_err(|error| {
        let message = format!("cannot start {threads} threads: {error}");
        Error::new(Kind::Retry, Problem::new("--threads", message))
    })
}
