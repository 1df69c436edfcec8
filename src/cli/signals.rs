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
    output::atomic::remove_parts,
};

/// Watches for signals as long as the process lives, for a job that asks the monitor.
///
/// # Errors
/// Where the system refuses a handler or a thread.
pub fn watch(monitor: &Arc<Monitor>) -> Result<()> {
    let monitor = Arc::clone(monitor);
    spawn(move |signal| {
        // Asked twice: nothing waits for the job any more.
        if monitor.signal.swap(signal, Relaxed) != 0 {
            end(signal);
        }
    })
}

/// Watches for signals as long as the process lives, for a job without a monitor: the first ends the process, and
/// what was being written is removed.
///
/// # Errors
/// Where the system refuses a handler or a thread.
pub fn end_at_once() -> Result<()> {
    spawn(|signal| {
        super::note("error: stopped by a signal");
        end(signal);
    })
}

/// Ends the process: the one place outside of `main` that does.
fn end(signal: i32) {
    remove_parts();
    signal_hook::low_level::exit(128 + signal);
}

/// Starts a thread that hands over every signal that ends a job.
fn spawn(mut act: impl FnMut(i32) + Send + 'static) -> Result<()> {
    let failed = |error: std::io::Error| Error::io("<signals>".as_ref(), "watch", &error);
    let mut ending = vec![SIGINT, SIGTERM, SIGQUIT];
    // `nohup` asks for a job that outlives its terminal.
    if !is_ignored(SIGHUP) {
        ending.push(SIGHUP);
    }
    let mut signals = Signals::new(ending).map_err(failed)?;
    let thread = std::thread::Builder::new().name("signals".into());
    thread.spawn(move || signals.forever().for_each(&mut act)).map_err(failed)?;
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
