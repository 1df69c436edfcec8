//! The command-line program.

use clap::Parser;
use pyo3::prelude::*;

/// Runs the program `lightpath` and returns its exit code. `arguments` begin with the program's
/// name.
#[pyfunction]
pub fn main(py: Python<'_>, arguments: Vec<String>) -> u8 {
    py.detach(|| match lightpath::cli::Arguments::try_parse_from(arguments) {
        Err(error) => lightpath::cli::usage(error),
        Ok(arguments) => match lightpath::cli::run(&arguments) {
            Ok(()) => 0,
            Err(error) => {
                lightpath::cli::note(&error.to_string());
                error.exit_code()
            }
        },
    })
}
