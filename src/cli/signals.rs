//! Signals that end a job. The first one asks it to stop and to remove unfinished files. The second
//! one ends the process at once.

use std::sync::{
    Arc,
    atomic::{AtomicBool, Ordering::Relaxed},
};

use signal_hook::{
    consts::{SIGHUP, SIGINT, SIGQUIT, SIGTERM, SIGXFSZ},
    iterator::Signals,
};

use crate::{
    cli::print,
    error::{Error, Result},
    monitor::Monitor,
    output::atomic::remove_parts,
};

/// Handles signals until the process ends, for a job that polls the monitor. The first signal is
/// stored in the monitor; the second ends the process.
///
/// # Errors
/// A handler or thread that the system refuses.
pub fn watch(monitor: &Arc<Monitor>) -> Result<()> {
    let monitor = Arc::clone(monitor);
    spawn(move |signal| {
        // The second signal does not wait for the job.
        if monitor.signal.swap(signal, Relaxed) != 0 {
            end(signal);
        }
    })
}

/// Handles signals until the process ends, for a job without a monitor. The first signal removes
/// unfinished files and ends the process.
///
/// # Errors
/// A handler or thread that the system refuses.
pub fn end_at_once() -> Result<()> {
    spawn(|signal| {
        print::note("error: stopped by a signal");
        end(signal);
    })
}

/// Ends the process. Besides `main`, this is the only place that does.
fn end(signal: i32) {
    remove_parts();
    signal_hook::low_level::exit(128 + signal);
}

/// Starts a thread that calls `act` for every signal that ends a job.
fn spawn(mut act: impl FnMut(i32) + Send + 'static) -> Result<()> {
    let failed = |error: std::io::Error| Error::io("<signals>".as_ref(), "watch", &error);
    let mut ending = vec![SIGINT, SIGTERM, SIGQUIT];
    // `nohup` ignores SIGHUP so that the job survives its terminal.
    if !is_ignored(SIGHUP) {
        ending.push(SIGHUP);
    }
    let mut signals = Signals::new(ending).map_err(failed)?;
    let thread = std::thread::Builder::new().name("signals".into());
    thread.spawn(move || signals.forever().for_each(&mut act)).map_err(failed)?;
    Ok(())
}

/// Turns a write beyond `ulimit -f` into an ordinary error instead of the end of the process.
pub fn ignore_size_limit_signal() {
    // If the system refuses the handler, the default action stays.
    let _ = signal_hook::flag::register(SIGXFSZ, Arc::new(AtomicBool::new(false)));
}

/// Returns true if the process was started with this signal ignored. False if the system does not
/// report it.
fn is_ignored(signal: i32) -> bool {
    let status = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
    let mask = status.lines().find_map(|line| line.strip_prefix("SigIgn:"));
    let mask = mask.and_then(|mask| u64::from_str_radix(mask.trim(), 16).ok()).unwrap_or(0);
    mask >> (signal - 1) & 1 == 1
}
