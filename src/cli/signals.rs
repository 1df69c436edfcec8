//! Signals that end a job: the first asks it to stop, which removes what was being written; the second
//! does not wait.

use std::sync::{
    Arc,
    atomic::{AtomicBool, Ordering::Relaxed},
};

use signal_hook::{
    consts::{SIGHUP, SIGINT, SIGQUIT, SIGTERM, SIGXFSZ},
    iterator::Signals,
};

use crate::{
    error::{Error, Result},
    monitor::Monitor,
};

/// Watches for signals as long as the process lives.
///
/// # Errors
/// Where the system refuses a handler or a thread.
pub fn watch(monitor: &Arc<Monitor>) -> Result<()> {
    let failed = |error: std::io::Error| Error::io("<signals>".as_ref(), "watch", &error);
    let mut ending = vec![SIGINT, SIGTERM, SIGQUIT];
    // `nohup` asks for a job that outlives its terminal.
    if !is_ignored(SIGHUP) {
        ending.push(SIGHUP);
    }
    let mut signals = Signals::new(ending).map_err(failed)?;
    let monitor = Arc::clone(monitor);
    std::thread::Builder::new()
        .name("signals".into())
        .spawn(move || {
            for signal in signals.forever() {
                if monitor.signal.swap(signal, Relaxed) != 0 {
                    // Asked twice: the one place outside `main` that ends the process.
                    signal_hook::low_level::exit(128 + signal);
                }
            }
        })
        .map_err(failed)?;
    Ok(())
}

/// Makes a write beyond `ulimit -f` an error like others, and not the end of the process.
pub fn outlive_size_limits() {
    // Where the system refuses a handler, all is as it was.
    let _ = signal_hook::flag::register(SIGXFSZ, Arc::new(AtomicBool::new(false)));
}

/// Whether the process was started with a signal ignored; false where the system does not tell.
fn is_ignored(signal: i32) -> bool {
    let status = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
    let mask = status.lines().find_map(|line| line.strip_prefix("SigIgn:"));
    let mask = mask.and_then(|mask| u64::from_str_radix(mask.trim(), 16).ok()).unwrap_or(0);
    mask >> (signal - 1) & 1 == 1
}
