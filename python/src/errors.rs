//! Errors of the library as Python exceptions.

use std::io;

use lightpath::{ErrorKind, Problem};
use pyo3::create_exception;
use pyo3::exceptions::{PyKeyboardInterrupt, PyMemoryError, PyValueError};
use pyo3::prelude::*;

create_exception!(
    lightpath,
    Error,
    PyValueError,
    "Invalid input. The attribute `problems` lists all problems as tuples (place, message, help)."
);

/// Converts an error. `Interrupted` becomes `KeyboardInterrupt`, a `Retry` for lack of memory
/// `MemoryError`. All others become `lightpath.Error`, a `ValueError`; a `Retry`, or if all problems
/// are those of files, one of its classes that are also `OSError`s: that of their common cause.
pub fn to_python(py: Python<'_>, mut error: lightpath::Error) -> PyErr {
    error.problems = error.problems.into_iter().map(translated).collect();
    let lines: Vec<String> = error.problems.iter().map(|problem| problem.to_string()).collect();
    let text = lines.join("\n");
    let causes: Vec<_> = error.problems.iter().map(|problem| problem.cause).collect();
    match error.kind {
        ErrorKind::Interrupted(_) => PyKeyboardInterrupt::new_err(text),
        ErrorKind::Retry if causes.contains(&Some(io::ErrorKind::OutOfMemory)) => {
            PyMemoryError::new_err(text)
        }
        _ => {
            let first = &error.problems[0];
            let same = causes.iter().all(|cause| *cause == first.cause);
            let of_files = causes.iter().all(Option::is_some);
            let exception = if error.kind == ErrorKind::Retry || of_files {
                of_file(py, text, first, same)
            } else {
                Error::new_err(text)
            };
            let problems: Vec<(String, String, Option<String>)> =
                error.problems.into_iter().map(|p| (p.place, p.message, p.help)).collect();
            match exception.value(py).setattr("problems", problems) {
                Ok(()) => exception,
                Err(error) => error,
            }
        }
    }
}

/// Returns a problem without the words of the command line: places are JSON pointers, and help
/// that names a flag is left out.
pub fn translated(mut problem: Problem) -> Problem {
    if let Some(pointer) = problem.place.strip_prefix("--set ") {
        problem.place = pointer.to_string();
    }
    problem.help = problem.help.filter(|help| !help.contains("--"));
    problem
}

/// Makes an exception of a class in `lightpath._errors`: a native class has only one base. Its
/// `errno` and `filename` are those of a problem. `errno` selects the class if it is `specific`.
fn of_file(py: Python<'_>, text: String, problem: &Problem, specific: bool) -> PyErr {
    let number = problem.errno.or_else(|| problem.cause.and_then(number));
    let make = py.import("lightpath._errors").and_then(|module| module.getattr("of_file"));
    match make.and_then(|make| make.call1((text, number, problem.file.as_ref(), specific))) {
        Ok(exception) => PyErr::from_value(exception),
        Err(error) => error,
    }
}

/// The number of an error on Linux, for those of files that the program itself found.
fn number(cause: io::ErrorKind) -> Option<i32> {
    use io::ErrorKind as E;
    Some(match cause {
        E::NotFound => 2,
        E::PermissionDenied => 13,
        E::AlreadyExists => 17,
        E::NotADirectory => 20,
        E::IsADirectory => 21,
        E::InvalidInput => 22,
        E::FileTooLarge => 27,
        E::StorageFull => 28,
        E::ReadOnlyFilesystem => 30,
        _ => return None,
    })
}
