//! Pools of worker threads, and their locks.

use std::sync::{Mutex, MutexGuard, PoisonError};

use rayon::{ThreadPool, ThreadPoolBuilder};

use crate::error::{Error, ErrorKind, Problem, Result};

/// A pool of worker threads.
pub struct Pool(pub ThreadPool);

impl Pool {
    /// Runs `work` on the pool's threads. Rayon's part is compiled once for all kinds of work.
    pub fn install<T: Send>(&self, work: impl FnOnce() -> T + Send) -> T {
        let (mut work, mut result) = (Some(work), None);
        let mut run = || result = work.take().map(|work| work());
        self.0.install::<&mut (dyn FnMut() + Send), ()>(&mut run);
        result.expect("the work has run")
    }
}

/// Starts a pool of `threads` threads.
///
/// # Errors
/// `Retry` if the system cannot start them.
pub fn pool(threads: usize) -> Result<Pool> {
    ThreadPoolBuilder::new().num_threads(threads).build().map(Pool).map_err(|error| {
        let message = format!("cannot start {threads} threads: {error}");
        Error::new(ErrorKind::Retry, Problem::new("--threads", message))
    })
}

/// Locks a mutex, even if a thread panicked while it held the lock.
pub fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}
