//! Pools of worker threads, by number of threads.

use std::collections::HashMap;
use std::sync::{Arc, Mutex, PoisonError};

use pyo3::prelude::*;
use rayon::ThreadPool;

use crate::errors;

/// The pools of a process.
struct Pools {
    /// The process that started the threads. They do not exist in a forked child.
    process: u32,
    by_threads: HashMap<usize, Arc<ThreadPool>>,
}

static POOLS: Mutex<Option<Pools>> = Mutex::new(None);

/// Returns the pool of `threads` threads; of all processors if `None`. Started at the first use.
pub fn pool(py: Python<'_>, threads: Option<usize>) -> PyResult<Arc<ThreadPool>> {
    let available = || std::thread::available_parallelism().map_or(1, |n| n.get());
    let threads = threads.unwrap_or_else(available);
    let process = std::process::id();
    let mut pools = POOLS.lock().unwrap_or_else(PoisonError::into_inner);
    if let Some(old) = pools.take_if(|pools| pools.process != process) {
        // To drop them would wait for threads of the parent.
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
