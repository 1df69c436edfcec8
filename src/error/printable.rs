//! Escapes names and texts from outside, so that they are safe for a terminal or a log.

use std::borrow::Cow;

/// Returns `text` on one line without control characters, for terminals and logs.
///
/// Control characters move the cursor. A line break may start a line that a render farm reads as a
/// command (`openjd_fail:`). Bidirectional marks, embeddings, overrides and isolates show a name
/// in another order. All of these are escaped as in Rust: `\n`, `\u{1b}`.
pub fn printable(text: &str) -> Cow<'_, str> {
    escaped(text, is_hidden)
}

/// [`printable`] for a text of several lines: keeps its line breaks.
pub fn printable_lines(text: &str) -> Cow<'_, str> {
    escaped(text, |c| c != '\n' && is_hidden(c))
}

/// Returns true if [`printable`] escapes `c`: a control character, a line or paragraph separator,
/// or a bidirectional mark, embedding, override or isolate.
pub fn is_hidden(c: char) -> bool {
    let is_mark = matches!(c, '\u{61c}' | '\u{200e}' | '\u{200f}');
    is_mark || c.is_control() || matches!(c, '\u{2028}'..='\u{202e}' | '\u{2066}'..='\u{2069}')
}

fn escaped(text: &str, hides: impl Fn(char) -> bool) -> Cow<'_, str> {
    if !text.contains(&hides) {
        return Cow::Borrowed(text);
    }
    let mut out = String::with_capacity(text.len() + 8);
    for c in text.chars() {
        if hides(c) { out.extend(c.escape_default()) } else { out.push(c) }
    }
    Cow::Owned(out)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn control_and_bidirectional_characters_are_escaped() {
        assert!(matches!(printable("Größe \\ \"a b\""), Cow::Borrowed(_)));
        assert_eq!(printable("a\nopenjd_fail: \u{1b}[2J\t"), "a\\nopenjd_fail: \\u{1b}[2J\\t");
        assert_eq!(printable("\u{9b}2J\u{202e}x"), "\\u{9b}2J\\u{202e}x");
        assert_eq!(printable("\u{61c}\u{200e}x\u{200f}"), "\\u{61c}\\u{200e}x\\u{200f}");
        assert_eq!(printable_lines("a\n\rb"), "a\n\\rb");
    }
}
