//! Pools of worker threads: one for each number of threads in use.

use std::collections::HashMap;
use std::sync::{Arc, Mutex, PoisonError};

use pyo3::prelude::*;
use rayon::ThreadPool;

use crate::errors;

/// The pools of a process.
struct Pools {
    /// Id of the process that started the threads. A forked child does not have them.
    process: u32,
    by_threads: HashMap<usize, Arc<ThreadPool>>,
}

static POOLS: Mutex<Option<Pools>> = Mutex::new(None);

/// Returns the pool of `threads` threads, or one thread per processor if `None`. The threads start
/// at the first use.
///
/// # Errors
/// `lightpath.Error` if the threads cannot be started.
pub fn pool(py: Python<'_>, threads: Option<usize>) -> PyResult<Arc<ThreadPool>> {
    let available = || std::thread::available_parallelism().map_or(1, |n| n.get());
    let threads = threads.unwrap_or_else(available);
    let process = std::process::id();
    let mut pools = POOLS.lock().unwrap_or_else(PoisonError::into_inner);
    if let Some(old) = pools.take_if(|pools| pools.process != process) {
        // Dropping the pools would wait for threads that only the parent process has.
        std::mem::forget(old);
    }
    let pools = pools.get_or_insert_with(|| Pools { process, by_threads: HashMap::new() });
    if let Some(pool) = pools.by_threads.get(&threads) {
        return Ok(Arc::clone(pool));
    }
    let place = |error| {
        let message = format!("cannot start {threads} threads: {error}");
        errors::to_python(py, lightpath::Error::invalid("threads", message))
    };
    let builder = rayon::ThreadPoolBuilder::new().num_threads(threads);
    let pool = Arc::new(builder.build().map_err(place)?);
    pools.by_threads.insert(threads, Arc::clone(&pool));
    Ok(pool)
}
