//! The command-line program: one thin file per command, which calls the modules below.
//!
//! Results and the paths of written files go to stdout, messages to stderr. Only `main` turns an
//! error into an exit code. A flag that changes the scene becomes a `--set` override (`overrides`),
//! so flags and overrides pass the same checks.

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

/// Prints a message to stderr. Ignores errors: a closed or full stderr must not stop a render.
///
/// Colours follow clap's rules: on a terminal, unless the environment disables them (`NO_COLOR`,
/// `CLICOLOR`, `TERM=dumb`).
pub fn note(text: &str) {
    let text = printable_lines(text);
    let lines: Vec<String> = text.lines().map(colored).collect();
    let _ = writeln!(anstream::stderr(), "{}", lines.join("\n"));
}

/// Colours the first word of a message line as clap does.
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

/// Prints help or a usage error and returns the exit code.
pub fn usage(error: clap::Error) -> u8 {
    // clap repeats arguments unchanged. Parse again with hidden characters escaped.
    let words = std::env::args_os().map(|word| printable(&word.to_string_lossy()).into_owned());
    let shown = Arguments::try_parse_from(words).err().unwrap_or(error);
    let error = with_hint(shown);
    let _ = error.print();
    // Help goes to stdout with exit code 0, a usage error to stderr with exit code 2.
    u8::try_from(error.exit_code()).unwrap_or(2)
}

/// Adds a suggestion if the user gave a file in place of a command.
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
pub fn run(arguments: &Arguments) -> Result<()> {
    signals::ignore_size_limit_signal();
    if arguments.version {
        return print(&version::text(arguments.verbose));
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

/// Writes a result to stdout. A closed reader (`| head`) is not an error.
fn print(text: &str) -> Result<()> {
    print_bytes(printable_lines(text).as_bytes())
}

/// Writes a JSON value and a line break to stdout.
fn print_json(value: &impl serde::Serialize) -> Result<()> {
    let text = serde_json::to_string(value).unwrap_or_default();
    // serde_json leaves some hidden characters unescaped. They occur only in strings, so `\u`
    // escapes are valid.
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

/// Prints the paths of written files, one per line.
fn print_paths(paths: &[PathBuf]) -> Result<()> {
    print_bytes(&path_lines(paths))
}

/// Formats the paths of written files, one per line. Output names contain no control characters.
fn path_lines(paths: &[PathBuf]) -> Vec<u8> {
    let mut lines = Vec::new();
    for path in paths.iter().filter(|path| *path != Path::new("/dev/stdout")) {
        // A name may be invalid UTF-8.
        let name = path.as_os_str().as_encoded_bytes();
        // Render farms read such a prefix at the start of a line as a command.
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
