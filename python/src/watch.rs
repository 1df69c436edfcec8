//! Runs work without the GIL. Meanwhile, Ctrl-C can stop it, and a callback receives its progress.

use std::sync::atomic::Ordering::Relaxed;
use std::sync::{Condvar, Mutex, PoisonError};
use std::time::Duration;

use lightpath::Monitor;
use pyo3::prelude::*;

use crate::errors;
use crate::pools::Pool;

/// Period of the checks for signals and of the calls of `progress`.
const PERIOD: Duration = Duration::from_millis(50);

/// Work of fewer items is not watched, if there is no callback: it ends before a check would
/// matter.
const FEW: usize = 1 << 14;

/// Runs `work`, which has about `items` items, in `pool`. Calls `progress(done, total)` every
/// [`PERIOD`], and once more after success, but not while the total is 0.
///
/// # Errors
/// The error of `work`, or the exception that the callback or a signal handler raises. The
/// exception stops the work first.
pub fn run<T: Send>(
    py: Python<'_>,
    pool: &Pool,
    items: usize,
    progress: Option<&Bound<'_, PyAny>>,
    work: impl FnOnce(&Monitor) -> lightpath::Result<T> + Send,
) -> PyResult<T> {
    let monitor = Monitor::default();
    if items < FEW && progress.is_none() {
        let answer = py.detach(|| pool.install(|| work(&monitor)));
        return answer.map_err(|error| errors::to_python(py, error));
    }
    let (answer, finished) = (Mutex::new(None), Condvar::new());
    let mut raised = Ok(());
    std::thread::scope(|scope| {
        scope.spawn(|| {
            let panics = std::panic::AssertUnwindSafe(|| pool.install(|| work(&monitor)));
            let result = std::panic::catch_unwind(panics);
            *answer.lock().unwrap_or_else(PoisonError::into_inner) = Some(result);
            finished.notify_all();
        });
        loop {
            let is_done = py.detach(|| {
                let guard = answer.lock().unwrap_or_else(PoisonError::into_inner);
                let waited = finished.wait_timeout_while(guard, PERIOD, |answer| answer.is_none());
                waited.unwrap_or_else(PoisonError::into_inner).0.is_some()
            });
            if is_done {
                break;
            }
            if raised.is_ok() {
                raised = py.check_signals().and_then(|()| report(progress, &monitor));
                if raised.is_err() {
                    monitor.signal.store(2, Relaxed);
                }
            }
        }
    });
    raised?;
    match answer.into_inner().unwrap_or_else(PoisonError::into_inner) {
        Some(Ok(result)) => {
            let result = result.map_err(|error| errors::to_python(py, error))?;
            report(progress, &monitor)?;
            Ok(result)
        }
        Some(Err(panic)) => std::panic::resume_unwind(panic),
        None => unreachable!("the loop ends with an answer"),
    }
}

fn report(progress: Option<&Bound<'_, PyAny>>, monitor: &Monitor) -> PyResult<()> {
    let Some(progress) = progress else { return Ok(()) };
    let (done, total) = (monitor.done.load(Relaxed), monitor.total.load(Relaxed));
    if total == 0 {
        return Ok(());
    }
    progress.call1((done.min(total), total)).map(drop)
}
