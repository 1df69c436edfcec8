//! Errors of the library as Python exceptions.

use lightpath::ErrorKind;
use pyo3::create_exception;
use pyo3::exceptions::{PyKeyboardInterrupt, PyMemoryError, PyOSError, PyValueError};
use pyo3::prelude::*;

create_exception!(
    lightpath,
    Error,
    PyValueError,
    "Invalid input. The attribute `problems` lists all problems as tuples (place, message, help)."
);

/// Converts an error. `Interrupted` becomes `KeyboardInterrupt`. `Retry` becomes `MemoryError` if
/// its text says "memory", else `OSError`. All others become `lightpath.Error`, a `ValueError`.
pub fn to_python(py: Python<'_>, error: lightpath::Error) -> PyErr {
    let lines: Vec<String> = error.problems.iter().map(|problem| problem.to_string()).collect();
    let text = lines.join("\n");
    match error.kind {
        ErrorKind::Interrupted(_) => PyKeyboardInterrupt::new_err(text),
        ErrorKind::Retry if text.contains("memory") => PyMemoryError::new_err(text),
        ErrorKind::Retry => PyOSError::new_err(text),
        _ => {
            let exception = Error::new_err(text);
            let problems: Vec<(String, String, Option<String>)> =
                error.problems.into_iter().map(|p| (p.place, p.message, p.help)).collect();
            match exception.value(py).setattr("problems", problems) {
                Ok(()) => exception,
                Err(error) => error,
            }
        }
    }
}
