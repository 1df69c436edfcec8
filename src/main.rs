//! Parses the arguments, runs the command, prints its error and sets the exit code.

mod exhausted;

use std::process::ExitCode;

use clap::Parser;

#[global_allocator]
static ALLOCATOR: exhausted::FailureRecordingAllocator = exhausted::FailureRecordingAllocator;

fn main() -> ExitCode {
    exhausted::exit_instead_of_abort();
    let others = std::panic::take_hook();
    std::panic::set_hook(Box::new(move |panic| {
        exhausted::exit_without_signal_stack(panic);
        others(panic);
    }));
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
