//! Prints results to stdout and messages to stderr.

use std::io::Write;
use std::path::{Path, PathBuf};

use clap::builder::Styles;

use crate::error::{Error, Result, is_hidden, printable_lines};
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

/// Most problems of an error that are printed.
const MAX_PROBLEMS: usize = 200;

/// Prints an error to stderr as [`note`] does: its first problems, and how many more it has.
pub fn error(error: &Error) {
    note(&first_problems(error));
}

fn first_problems(error: &Error) -> String {
    let more = error.problems.len().saturating_sub(MAX_PROBLEMS);
    if more == 0 {
        return error.to_string();
    }
    let shown = Error { kind: error.kind, problems: error.problems[..MAX_PROBLEMS].to_vec() };
    format!("{shown}\nerror: and {}", plural(more, "more problem"))
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
        if name.starts_with(b"openjd_") || name.starts_with(b"ALF_") {
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
    match stdout.write_all(bytes).and_then(|()| stdout.flush()) {
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::error::{ErrorKind, Problem};

    #[test]
    fn an_error_of_many_problems_says_how_many_more_there_are() {
        let lines = |count: usize| {
            let problems = (0..count).map(|i| Problem::new("a", i.to_string())).collect();
            let text = first_problems(&Error { kind: ErrorKind::Invalid, problems });
            (text.lines().count(), text.lines().last().unwrap_or_default().to_string())
        };
        assert_eq!(lines(200), (200, "error: a: 199".into()));
        assert_eq!(lines(201), (201, "error: and 1 more problem".into()));
        assert_eq!(lines(1200).1, "error: and 1,000 more problems");
    }
}
