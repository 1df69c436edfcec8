//! Signals that end a command.
//!
//! A job with a monitor ([`watch`]) stops at the first signal and removes its unfinished files. A
//! second signal does not wait for the job. A command without a monitor ([`end_at_once`]) ends at
//! the first signal. Before the process ends, its unfinished files are removed.
//!
//! A signal that was ignored when the process began stays ignored.

use std::sync::Arc;
use std::sync::atomic::Ordering::{Relaxed, SeqCst};
use std::sync::atomic::{AtomicBool, AtomicI32};
use std::time::{Duration, Instant};

use signal_hook::consts::{SIGHUP, SIGINT, SIGQUIT, SIGTERM, SIGXCPU, SIGXFSZ};
use signal_hook::iterator::Signals;

use crate::cli::print;
use crate::error::{Error, Result};
use crate::monitor::Monitor;
use crate::output::atomic::remove_parts;

/// Time after the first signal within which another one is the same request. `timeout` signals the
/// process and then the group that it is in.
const SAME_REQUEST: Duration = Duration::from_millis(200);

/// Number of the first signal of a job with a monitor, 0 before it.
static FIRST: AtomicI32 = AtomicI32::new(0);
/// Whether the job waits for a pipe and does not poll its monitor.
static WAITS: AtomicBool = AtomicBool::new(false);

/// Calls `wait`, which may wait for the other end of a pipe. The first signal ends the process
/// then, also one that came before. Call it from one thread at a time.
pub fn end_while<T>(wait: impl FnOnce() -> T) -> T {
    WAITS.store(true, SeqCst);
    match FIRST.load(SeqCst) {
        0 => {}
        signal => end_now(signal),
    }
    let done = wait();
    WAITS.store(false, SeqCst);
    done
}

/// Handles signals until the process ends, for a job that polls the monitor. The first signal is
/// stored in the monitor. A signal more than [`SAME_REQUEST`] after it removes unfinished files and
/// ends the process.
///
/// # Errors
/// The system refuses the signal handler or the thread.
pub fn watch(monitor: &Arc<Monitor>) -> Result<()> {
    let monitor = Arc::clone(monitor);
    let mut first = None;
    spawn(move |signal| match first {
        None => {
            first = Some(Instant::now());
            monitor.signal.store(signal, Relaxed);
            FIRST.store(signal, SeqCst);
            if WAITS.load(SeqCst) {
                end_now(signal);
            }
        }
        // The kernel repeats this one in every second of processor time.
        Some(_) if signal == SIGXCPU => {}
        // The user does not want to wait for the job.
        Some(first) if first.elapsed() > SAME_REQUEST => end(signal),
        Some(_) => {}
    })
}

/// Handles signals until the process ends, for a job without a monitor. The first signal removes
/// unfinished files and ends the process.
///
/// # Errors
/// The system refuses the signal handler or the thread.
pub fn end_at_once() -> Result<()> {
    spawn(end_now)
}

/// Says that a signal stopped the job, removes unfinished files and ends the process.
fn end_now(signal: i32) {
    print::note("error: stopped by a signal");
    end(signal);
}

/// Removes unfinished files and ends the process with exit code 128 + `signal`.
fn end(signal: i32) {
    remove_parts();
    signal_hook::low_level::exit(128 + signal);
}

/// Starts a thread that calls `act` for every signal that ends a job.
fn spawn(mut act: impl FnMut(i32) + Send + 'static) -> Result<()> {
    let failed = |error: std::io::Error| Error::io("<signals>".as_ref(), "watch", &error);
    // `nohup` ignores SIGHUP so that the job survives its terminal. A script ignores SIGINT and
    // SIGQUIT for a job that it starts with `&`.
    let mut ending = vec![SIGHUP, SIGINT, SIGQUIT, SIGXCPU];
    ending.retain(|&signal| !is_ignored(signal));
    ending.push(SIGTERM);
    let mut signals = Signals::new(ending).map_err(failed)?;
    let thread = std::thread::Builder::new().name("signals".into());
    thread.spawn(move || signals.forever().for_each(&mut act)).map_err(failed)?;
    Ok(())
}

/// Keeps SIGXFSZ from ending the process. A write beyond `ulimit -f` is then an I/O error.
///
/// Only the default action of the signal ends the process. With any handler, the write just fails.
/// The handler here sets a flag that nothing reads.
pub fn survive_size_limit_signal() {
    // If the system refuses the handler, the default action stays.
    let _ = signal_hook::flag::register(SIGXFSZ, Arc::new(AtomicBool::new(false)));
}

/// Returns true if the process was started with this signal ignored. Returns false if the system
/// does not report ignored signals.
fn is_ignored(signal: i32) -> bool {
    let status = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
    let mask = status.lines().find_map(|line| line.strip_prefix("SigIgn:"));
    let mask = mask.and_then(|mask| u64::from_str_radix(mask.trim(), 16).ok()).unwrap_or(0);
    mask >> (signal - 1) & 1 == 1
}
