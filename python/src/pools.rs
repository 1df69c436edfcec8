//! Pools of worker threads: one for each number of threads in use. Scenes that exist keep theirs.

use std::collections::HashMap;
use std::sync::{Arc, Mutex, PoisonError, Weak};

use pyo3::prelude::*;
use rayon::ThreadPool;

use crate::errors;

/// A pool of threads, which end when it is dropped.
pub struct Pool {
    /// Id of the process that started the threads. A forked child does not have them.
    process: u32,
    /// `None` only while it is dropped.
    threads: Option<ThreadPool>,
}

impl Pool {
    /// Runs `work` on the threads.
    pub fn install<T: Send>(&self, work: impl FnOnce() -> T + Send) -> T {
        self.threads.as_ref().expect("a pool that is in use has threads").install(work)
    }
}

impl Drop for Pool {
    fn drop(&mut self) {
        // A forked child has none of the threads, and they may hold locks for ever.
        if self.process != std::process::id() {
            std::mem::forget(self.threads.take());
        }
    }
}

/// The pools of this process, by their number of threads.
#[derive(Default)]
struct Pools {
    known: HashMap<usize, Weak<Pool>>,
    /// The pool that was used last, so that calls without a scene do not start threads each time.
    last: Option<Arc<Pool>>,
}

static POOLS: Mutex<Option<Pools>> = Mutex::new(None);

/// Returns the pool of `threads` threads, or one thread per processor if `None`. The threads start
/// at the first use, and end when nothing holds the pool and another one is used.
///
/// # Errors
/// `lightpath.Error` if the threads cannot be started.
pub fn pool(py: Python<'_>, threads: Option<usize>) -> PyResult<Arc<Pool>> {
    let available = || std::thread::available_parallelism().map_or(1, |n| n.get());
    let threads = threads.unwrap_or_else(available);
    let process = std::process::id();
    let mut pools = POOLS.lock().unwrap_or_else(PoisonError::into_inner);
    let Pools { known, last } = pools.get_or_insert_with(Pools::default);
    let own = known.get(&threads).and_then(Weak::upgrade);
    if let Some(pool) = own.filter(|pool| pool.process == process) {
        *last = Some(Arc::clone(&pool));
        return Ok(pool);
    }
    let place = |error| {
        let message = format!("cannot start {threads} threads: {error}");
        errors::to_python(py, lightpath::Error::invalid("threads", message))
    };
    let builder = rayon::ThreadPoolBuilder::new().num_threads(threads);
    let pool = Pool { process, threads: Some(builder.build().map_err(place)?) };
    let pool = Arc::new(pool);
    known.insert(threads, Arc::downgrade(&pool));
    *last = Some(Arc::clone(&pool));
    Ok(pool)
}
