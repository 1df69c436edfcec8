//! Parse, run, print what went wrong, exit code.

use std::process::ExitCode;

use clap::Parser;

fn main() -> ExitCode {
    let arguments = match lightpath::cli::Arguments::try_parse() {
        Ok(arguments) => arguments,
        Err(error) => {
            return ExitCode::from(lightpath::cli::usage(error));
        }
    };
    match lightpath::cli::run(&arguments) {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            lightpath::cli::note(&error.to_string());
            ExitCode::from(error.exit_code())
        }
    }
}
