//! Runs work without the GIL, while Ctrl-C stops it and a callback gets its progress.

use std::sync::atomic::Ordering::Relaxed;
use std::sync::{Condvar, Mutex, PoisonError};
use std::time::Duration;

use lightpath::Monitor;
use pyo3::prelude::*;
use rayon::ThreadPool;

use crate::errors;

/// How often signals are looked for.
const PERIOD: Duration = Duration::from_millis(50);

/// Work of fewer items runs at once, without a thread that watches it.
const FEW: usize = 1 << 14;

/// Runs `work`, of some `items` items, in `pool`. Calls `progress(done, total)` every 50 ms.
///
/// # Errors
/// What `work` returns; what the callback or a signal handler raises, after the work has stopped.
pub fn run<T: Send>(
    py: Python<'_>,
    pool: &ThreadPool,
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
    progress.call1((done.min(total), total)).map(drop)
}
