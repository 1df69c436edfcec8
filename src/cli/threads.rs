//! How many threads work.

use rayon::{ThreadPool, ThreadPoolBuilder};

use crate::error::{Error, Kind, Problem, Result};

/// Worker threads: `--threads`, else what a batch system grants, else what this process may use.
///
/// # Errors
/// `Retry` where the system does not give that many.
pub fn pool(asked: Option<u16>) -> Result<ThreadPool> {
    let granted = || {
        let text = std::env::var("SLURM_CPUS_PER_TASK").ok()?;
        text.trim().parse().ok().filter(|n| (1..=1024).contains(n))
    };
    let threads = asked
        .map(usize::from)
        .or_else(granted)
        .unwrap_or_else(|| std::thread::available_parallelism().map_or(1, usize::from));
    ThreadPoolBuilder::new().num_threads(threads).build().map_err(|error| {
        let message = format!("cannot start {threads} threads: {error}");
        Error::new(Kind::Retry, Problem::new("--threads", message))
    })
}
