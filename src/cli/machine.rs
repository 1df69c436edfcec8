//! Threads and instruction set of the machine.

use rayon::{ThreadPool, ThreadPoolBuilder};

use super::args::IsaName;
use crate::error::{Error, Kind, Problem, Result};
use crate::simd::Isa;

/// Returns the number of threads: `--threads`, else the batch system's grant, else what the process
/// may use.
pub fn threads(asked: Option<u16>) -> usize {
    let granted = || {
        let text = std::env::var("SLURM_CPUS_PER_TASK").ok()?;
        text.trim().parse().ok().filter(|n| (1..=1024).contains(n))
    };
    asked
        .map(usize::from)
        .or_else(granted)
        .unwrap_or_else(|| std::thread::available_parallelism().map_or(1, usize::from))
}

/// Starts a pool of worker threads.
///
/// # Errors
/// `Retry` if the system cannot start that many.
pub fn pool(asked: Option<u16>) -> Result<ThreadPool> {
    let threads = threads(asked);
    ThreadPoolBuilder::new().num_threads(threads).build().map_err(|error| {
        let message = format!("cannot start {threads} threads: {error}");
        Error::new(Kind::Retry, Problem::new("--threads", message))
    })
}

/// Starts rayon's global pool, which is used where no pool is named.
///
/// rayon would start it on first use, and panic if the system cannot start the threads.
///
/// # Errors
/// As for [`pool`].
pub fn default_pool() -> Result<()> {
    ThreadPoolBuilder::new().build_global().map_err(|error| {
        let message = format!("cannot start threads: {error}");
        Error::new(Kind::Retry, Problem::new("", message))
    })
}

/// Returns the instruction set of `--isa`, or the best of this machine.
///
/// # Errors
/// `Unsupported` if this machine or this build lacks it.
pub fn isa(asked: Option<IsaName>) -> Result<Isa> {
    asked.map_or(Ok(Isa::detect()), |name| tier("--isa", name))
}

/// Returns the instruction set that a flag names.
///
/// # Errors
/// As for [`isa`].
pub fn tier(flag: &str, name: IsaName) -> Result<Isa> {
    let wanted = match name {
        IsaName::Portable => Isa::Portable,
        IsaName::Avx2 => Isa::Avx2,
        IsaName::Avx512 => Isa::Avx512,
    };
    wanted.supported(flag)
}
