//! The program: one file per subcommand, each thin; the work is in the modules below.
//!
//! Results and the paths of written files go to stdout, messages to stderr. Only `main` turns an
//! error into an exit code. A flag that changes the scene becomes a `--set` override, so that flags
//! and overrides pass the same checks (`overrides`).

mod accuracy;
mod accuracy_markdown;
mod accuracy_page;
mod accuracy_table;
mod args;
mod batch;
mod batch_args;
mod batch_progress;
mod bench;
mod bench_page;
mod bench_table;
mod compare;
mod compare_page;
mod compare_text;
mod converge;
mod converge_page;
mod converge_text;
mod crosscheck;
mod crosscheck_text;
mod file_args;
mod info;
mod info_scene;
mod job;
mod layers;
mod machine;
mod measure_args;
mod merge;
mod names;
mod overrides;
mod progress;
mod render;
mod render_progress;
mod report;
mod sampling;
mod schema;
mod shell;
mod signals;
mod split;
mod stats;
mod submit;
mod version;

pub use args::{Arguments, Command};

use std::{
    io::Write,
    path::{Path, PathBuf},
};

use clap::{
    Parser,
    builder::Styles,
    error::{ContextKind, ContextValue},
};

use crate::{
    error::{Error, Result, is_hidden, printable, printable_lines},
    memory, paths, units,
};

/// Prints a message; a stderr that is closed or full must not stop a render. Coloured where clap's messages
/// are: on a terminal, unless the environment says otherwise (`NO_COLOR`, `CLICOLOR`, `TERM=dumb`).
pub fn note(text: &str) {
    let text = printable_lines(text);
    let lines: Vec<String> = text.lines().map(colored).collect();
    let _ = writeln!(anstream::stderr(), "{}", lines.join("\n"));
}

/// A line of a message, its first word in clap's colours.
fn colored(line: &str) -> String {
    let styles = Styles::styled();
    let words = [
        ("error:", styles.get_error()),
        ("warning:", styles.get_invalid()),
        ("  help:", styles.get_valid()),
    ];
    for (word, style) in words {
        if let Some(rest) = line.strip_prefix(word) {
            return format!("{style}{word}{style:#}{rest}");
        }
    }
    line.to_string()
}

/// Prints a usage error, or help, and returns the exit code.
pub fn usage(error: clap::Error) -> u8 {
    // clap repeats words as they are: again with words that can be shown.
    let words = std::env::args_os().map(|word| printable(&word.to_string_lossy()).into_owned());
    let shown = Arguments::try_parse_from(words).err().unwrap_or(error);
    let error = with_hint(shown);
    let _ = error.print();
    // Help goes to stdout with code 0, usage errors to stderr with code 2.
    u8::try_from(error.exit_code()).unwrap_or(2)
}

/// Adds what was probably meant: a file alone is to be rendered.
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
/// Everything that went wrong; the kind decides the exit code.
pub fn run(arguments: &Arguments) -> Result<()> {
    signals::outlive_size_limits();
    if arguments.version {
        return print(&version::text(arguments.verbose));
    }
    use Command::{Bench, Converge, Info, Submit};
    if let Some(Info(_) | Bench(_) | Converge(_) | Submit(_)) = &arguments.command {
        // They read files before, or without, a pool of their own.
        machine::default_pool()?;
    }
    match &arguments.command {
        Some(Command::Render(args)) => render::run(args),
        Some(Command::Batch(args)) => batch::run(args),
        Some(Command::Info(args)) => info::run(args),
        Some(Command::Bench(args)) => bench::run(args),
        Some(Command::Crosscheck(args)) => crosscheck::run(args),
        Some(Command::Accuracy(args)) => accuracy::run(args),
        Some(Command::Compare(args)) => compare::run(args),
        Some(Command::Converge(args)) => converge::run(args),
        Some(Command::Merge(args)) => merge::run(args),
        Some(Command::Submit(args)) => submit::run(args),
        Some(Command::Schema { of }) => schema::run(*of),
        Some(Command::Completions { shell }) => shell::completions(*shell),
        Some(Command::Man) => shell::man(),
        None => Err(Error::invalid("", "no command given")
            .help("`lightpath render scene.json`, or `lightpath --help`")),
    }
}

/// Writes a result to stdout. A reader that has gone (`| head`) is no error.
fn print(text: &str) -> Result<()> {
    print_bytes(printable_lines(text).as_bytes())
}

/// Writes a JSON value and a line break to stdout.
fn print_json(value: &impl serde::Serialize) -> Result<()> {
    let text = serde_json::to_string(value).unwrap_or_default();
    // serde leaves some of these as they are; all stand within strings, where JSON has another way to write them.
    let escaped = |c: char| match is_hidden(c) {
        true => format!("\\u{:04x}", u32::from(c)),
        false => c.to_string(),
    };
    let text = match text.contains(is_hidden) {
        true => text.chars().map(escaped).collect(),
        false => text,
    };
    print_bytes((text + "\n").as_bytes())
}

/// Prints the names of written files, one a line.
fn print_paths(paths: &[PathBuf]) -> Result<()> {
    print_bytes(&path_lines(paths))
}

/// The names of written files, one a line. No output has control characters in its name.
fn path_lines(paths: &[PathBuf]) -> Vec<u8> {
    let mut lines = Vec::new();
    for path in paths.iter().filter(|path| *path != Path::new("/dev/stdout")) {
        // A name need not be UTF-8.
        let name = path.as_os_str().as_encoded_bytes();
        // What render farms read as a command at the beginning of a line.
        if name.starts_with(b"openjd_") || name.starts_with(b"ALF_") {
            lines.extend_from_slice(b"./");
        }
        lines.extend_from_slice(name);
        lines.push(b'\n');
    }
    lines
}

fn print_bytes(bytes: &[u8]) -> Result<()> {
    let mut stdout = std::io::stdout().lock();
    match stdout.write_all(bytes).and_then(|()| stdout.flush()) {
        Err(error) if error.kind() != std::io::ErrorKind::BrokenPipe => {
            Err(Error::io("<stdout>".as_ref(), "write", &error))
        }
        _ => Ok(()),
    }
}
