//! Runs the program, and sets the exit code also where memory runs out.

mod exhausted;

use std::process::ExitCode;

#[global_allocator]
static ALLOCATOR: exhausted::FailureRecordingAllocator = exhausted::FailureRecordingAllocator;

fn main() -> ExitCode {
    exhausted::exit_instead_of_abort();
    let others = std::panic::take_hook();
    std::panic::set_hook(Box::new(move |panic| {
        exhausted::exit_on_panic_for_memory(panic);
        others(panic);
    }));
    ExitCode::from(lightpath::cli::main(&std::env::args_os().collect::<Vec<_>>(), None))
}
