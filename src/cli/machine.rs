//! Threads, instruction set and processor of the machine.

use rayon::ThreadPoolBuilder;

use crate::error::{Error, ErrorKind, Problem, Result};
use crate::lab::result::Machine;
use crate::simd::Isa;
use crate::threads::{self, Pool};

use super::version;

/// Returns the number of threads: `--threads`, else `SLURM_CPUS_PER_TASK`, else the processors that
/// the process may use.
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

/// Starts a pool of [`threads`] worker threads.
///
/// # Errors
/// `Retry` if the system cannot start that many.
pub fn pool(asked: Option<u16>) -> Result<Pool> {
    threads::pool(self::threads(asked))
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
        Error::new(ErrorKind::Retry, Problem::new("", message))
    })
}

/// Returns the model name of the processor, or the architecture if the system does not report one.
pub fn cpu() -> String {
    let info = std::fs::read_to_string("/proc/cpuinfo").unwrap_or_default();
    let name = info.lines().find_map(|line| {
        let (key, value) = line.split_once(':')?;
        (key.trim() == "model name").then(|| value.trim().to_string())
    });
    name.unwrap_or_else(|| std::env::consts::ARCH.to_string())
}

/// Returns the versions of the program and its libraries, for the head of a report.
pub fn versions(machine: &Machine) -> String {
    let versions = machine.versions.iter().map(|(name, version)| format!("{name} {version}"));
    versions.collect::<Vec<_>>().join(", ")
}

/// Describes this machine for a report. `isa` is the instruction set in use.
pub fn describe(isa: Isa) -> Machine {
    let mut versions = version::versions("");
    versions.remove("backend");
    Machine {
        cpu: cpu(),
        cores: std::thread::available_parallelism().map_or(1, usize::from),
        isa: isa.to_string(),
        versions,
    }
}
