//! SIGINT and SIGTERM: the first asks the job to stop, which removes what was being written; the
//! second does not wait.

use std::sync::{Arc, atomic::Ordering::Relaxed};

use signal_hook::{
    consts::{SIGINT, SIGTERM},
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
    let mut signals = Signals::new([SIGINT, SIGTERM]).map_err(failed)?;
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
