//! Prints results to stdout and messages to stderr.

use std::io::{self, Write};
use std::path::{Path, PathBuf};

use clap::builder::Styles;

use crate::error::{Error, ErrorKind, Result, is_hidden, printable_lines};
use crate::units::plural;

/// Prints a message to stderr. Ignores errors: a closed or full stderr must not stop a render.
///
/// Colours follow clap's rules: on a terminal, unless the environment disables them (`NO_COLOR`,
/// `CLICOLOR`, `TERM=dumb`).
pub fn note(text: &str) {
    let text = printable_lines(text);
    let lines: Vec<String> = text.lines().map(colored).collect();
    let _ = writeln!(anstream::stderr(), "{}", lines.join("\n"));
}

/// Prints an error to stderr as [`note`] does.
///
/// Of the problems of an input, the first are printed, and how many more it has. The failures of a
/// batch and of checks are of many inputs, so all are printed.
pub fn error(error: &Error) {
    let of_many = matches!(error.kind, ErrorKind::Check | ErrorKind::Retry);
    let first = || error.clone().shortened(|more| plural(more, "more problem"));
    note(&if of_many { error.to_string() } else { first().to_string() });
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

/// Writes a result to stdout, with hidden characters escaped. A closed reader (`| head`) is not an
/// error.
pub fn text(text: &str) -> Result<()> {
    bytes(printable_lines(text).as_bytes())
}

/// A result that is printed piece by piece, beside files that hold it, too.
#[derive(Debug)]
pub struct Report {
    waits: bool,
    printed: Result<()>,
}

impl Report {
    /// Begins a report. If there are files to write, a stdout that fails does not end the work: the
    /// error waits for [`Report::end`].
    pub fn new(has_files: bool) -> Self {
        Self { waits: has_files, printed: Ok(()) }
    }

    /// Prints a piece as [`text`] does.
    ///
    /// # Errors
    /// A stdout that fails, if no error may wait.
    pub fn text(&mut self, piece: &str) -> Result<()> {
        if !self.waits {
            return text(piece);
        }
        if self.printed.is_ok() {
            self.printed = text(piece);
        }
        Ok(())
    }

    /// Ends the report, after all files are written.
    ///
    /// # Errors
    /// The first error that waits.
    pub fn end(self) -> Result<()> {
        self.printed
    }
}

/// Writes a JSON value and a line break to stdout.
pub fn json(value: &impl serde::Serialize) -> Result<()> {
    let text = serde_json::to_string(value).unwrap_or_default();
    // serde_json leaves some hidden characters unescaped. They occur only in strings, so `\u`
    // escapes are valid.
    let escaped = |c: char| match is_hidden(c) {
        true => format!("\\u{:04x}", u32::from(c)),
        false => c.to_string(),
    };
    let text = if text.contains(is_hidden) { text.chars().map(escaped).collect() } else { text };
    bytes((text + "\n").as_bytes())
}

/// Prints the paths of written files, one per line.
pub fn paths(paths: &[PathBuf]) -> Result<()> {
    bytes(&path_lines(paths))
}

/// Formats the paths of written files, one per line. The names contain no control characters: part
/// files refuse them.
pub fn path_lines(paths: &[PathBuf]) -> Vec<u8> {
    let mut lines = Vec::new();
    for path in paths.iter().filter(|path| *path != Path::new("/dev/stdout")) {
        // Bytes, because a name need not be valid UTF-8.
        let name = path.as_os_str().as_encoded_bytes();
        // Render farms read a line that begins with such a prefix as a command.
        if [&b"openjd_"[..], b"ALF_", b"TR_"].iter().any(|prefix| name.starts_with(prefix)) {
            lines.extend_from_slice(b"./");
        }
        lines.extend_from_slice(name);
        lines.push(b'\n');
    }
    lines
}

/// Writes bytes to stdout. A closed reader is not an error.
pub fn bytes(bytes: &[u8]) -> Result<()> {
    let mut stdout = std::io::stdout().lock();
    written(stdout.write_all(bytes).and_then(|()| stdout.flush()))
}

/// Converts the result of writing to stdout. A closed reader is not an error.
pub fn written(result: io::Result<()>) -> Result<()> {
    match result {
        Err(error) if error.kind() != std::io::ErrorKind::BrokenPipe => {
            Err(Error::io("<stdout>".as_ref(), "write", &error))
        }
        _ => Ok(()),
    }
}

/// Returns the rows of a table as lines with aligned columns.
pub fn aligned(rows: &[Vec<String>]) -> Vec<String> {
    let columns = rows.iter().map(Vec::len).max().unwrap_or(0);
    let width = |c: usize| {
        rows.iter().filter_map(|r| r.get(c)).map(|t| t.chars().count()).max().unwrap_or(0)
    };
    let widths: Vec<usize> = (0..columns).map(width).collect();
    let line = |row: &Vec<String>| {
        let cells = row.iter().zip(&widths).map(|(text, width)| format!("{text:width$}"));
        cells.collect::<Vec<_>>().join("  ").trim_end().to_string()
    };
    rows.iter().map(line).collect()
}
