//! The command-line program: a folder or file per command, which calls the library's modules.
//!
//! Results and the paths of written files go to stdout, messages to stderr (`print`). `main` turns
//! an error into an exit code. A flag that sets a value of the scene becomes an override like those
//! of `--set` (`overrides`). So both pass the same checks.

mod about;
mod accuracy;
mod args;
mod batch;
mod bench;
mod compare;
mod converge;
mod crosscheck;
mod flags;
mod info;
mod load;
mod machine;
mod merge;
mod outputs;
mod overrides;
mod print;
mod progress;
mod render;
mod signals;
mod submit;
mod text_file;
mod version;

use std::ffi::OsString;
use std::io::Write;
use std::path::Path;

use clap::Parser;
use clap::error::{ContextKind, ContextValue};

use crate::error::{Error, Result, printable};
use crate::memory;

use args::{Arguments, Command};

/// Runs the program, prints its error and returns the exit code.
///
/// `words` are its name and its arguments. `program` is the file that other machines run; `None`
/// for the program of this process.
pub fn main(words: &[OsString], program: Option<&Path>) -> u8 {
    let arguments = match Arguments::try_parse_from(words) {
        Ok(arguments) => arguments,
        Err(error) => return usage(error, words),
    };
    finish(run(&arguments, words, program))
}

/// Prints an error and returns the exit code.
fn finish(result: Result<()>) -> u8 {
    match result {
        Ok(()) => 0,
        Err(error) => {
            print::error(&error);
            error.exit_code()
        }
    }
}

/// Prints help or a usage error and returns the exit code.
fn usage(error: clap::Error, words: &[OsString]) -> u8 {
    // clap repeats arguments unchanged in its message. So the arguments are parsed again, with
    // hidden characters escaped.
    let words = words.iter().map(|word| printable(&word.to_string_lossy()).into_owned());
    let shown = Arguments::try_parse_from(words).err().unwrap_or(error);
    let error = with_hint(shown);
    let printed = error.print().and_then(|()| std::io::stdout().flush());
    // Help goes to stdout with exit code 0, a usage error to stderr with exit code 2.
    if !error.use_stderr() {
        return finish(print::written(printed));
    }
    u8::try_from(error.exit_code()).unwrap_or(2)
}

/// Adds a suggestion to the message if the user gave a file in place of a command.
fn with_hint(mut error: clap::Error) -> clap::Error {
    let Some(ContextValue::String(word)) = error.get(ContextKind::InvalidSubcommand) else {
        return error;
    };
    let path = Path::new(word);
    if path.is_file() || path.extension().is_some_and(|end| end == "json" || end == "ply") {
        let hint = format!("to render it: lightpath render {word}");
        error.insert(ContextKind::Suggested, ContextValue::StyledStrs(vec![hint.into()]));
    }
    error
}

/// Runs one command.
///
/// # Errors
/// The errors of the command. Their kind decides the exit code.
fn run(arguments: &Arguments, words: &[OsString], program: Option<&Path>) -> Result<()> {
    signals::survive_size_limit_signal();
    memory::return_large_arrays();
    memory::limit_arenas();
    if arguments.version {
        return about::version(arguments.verbose);
    }
    use Command::{Bench, Converge, Info, Submit};
    if let Some(Info(_) | Bench(_) | Converge(_) | Submit(_)) = &arguments.command {
        // These commands read files before they have a thread pool, or without one.
        machine::default_pool()?;
    }
    match &arguments.command {
        Some(Command::Render(args)) => render::run(args),
        Some(Command::Batch(args)) => batch::run(args),
        Some(Command::Info(args)) => info::run(args),
        Some(Command::Bench(args)) => bench::run(args, words),
        Some(Command::Crosscheck(args)) => crosscheck::run(args),
        Some(Command::Accuracy(args)) => accuracy::run(args),
        Some(Command::Compare(args)) => compare::run(args),
        Some(Command::Converge(args)) => converge::run(args),
        Some(Command::Merge(args)) => merge::run(args),
        Some(Command::Submit(args)) => submit::run(args, program),
        Some(Command::Schema { of }) => about::schemas(*of),
        Some(Command::Completions { shell }) => about::completions(*shell),
        Some(Command::Man) => about::man(),
        None => Err(Error::invalid("", "no command given")
            .help("`lightpath render scene.json`, or `lightpath --help`")),
    }
}
