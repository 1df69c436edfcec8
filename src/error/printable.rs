//! Names and texts from outside, on a terminal or in a log.

use std::borrow::Cow;

/// `text` on one line without control characters, for terminals and logs.
///
/// Control characters move cursors, and a line break may begin a line that a farm reads as a command
/// (`openjd_fail:`). Marks of the direction of writing show a name in another order. All of these are
/// written as in Rust: `\n`, `\u{1b}`.
pub fn printable(text: &str) -> Cow<'_, str> {
    escaped(text, is_hidden)
}

/// The same for a text of several lines: its line breaks stay.
pub fn printable_lines(text: &str) -> Cow<'_, str> {
    escaped(text, |c| c != '\n' && is_hidden(c))
}

/// Whether a terminal does something else with `c` than to show it.
pub fn is_hidden(c: char) -> bool {
    c.is_control() || matches!(c, '\u{2028}'..='\u{202e}' | '\u{2066}'..='\u{2069}')
}

fn escaped(text: &str, hides: impl Fn(char) -> bool) -> Cow<'_, str> {
    if !text.contains(&hides) {
        return Cow::Borrowed(text);
    }
    let mut out = String::with_capacity(text.len() + 8);
    for c in text.chars() {
        match hides(c) {
            true => out.extend(c.escape_default()),
            false => out.push(c),
        }
    }
    Cow::Owned(out)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_seen_is_what_is_there() {
        assert!(matches!(printable("Größe \\ \"a b\""), Cow::Borrowed(_)));
        assert_eq!(printable("a\nopenjd_fail: \u{1b}[2J\t"), "a\\nopenjd_fail: \\u{1b}[2J\\t");
        assert_eq!(printable("\u{9b}2J\u{202e}x"), "\\u{9b}2J\\u{202e}x");
        assert_eq!(printable_lines("a\n\rb"), "a\n\\rb");
    }
}
