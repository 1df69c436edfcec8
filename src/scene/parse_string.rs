//! Parses JSON strings: escapes and surrogate pairs. Control characters are errors.

use super::parse::{Parsed, Parser};

impl Parser<'_> {
    /// Parses a string from its opening quote on.
    pub(super) fn string(&mut self) -> Parsed<String> {
        let start = self.at;
        let opening = |p: &Self| p.error_at(start, "found a string without a closing quote");
        self.at += 1;
        let mut string = String::new();
        loop {
            let rest = &self.text[self.at..];
            let Some(plain) = rest.find(|c: char| c == '"' || c == '\\' || c < ' ') else {
                return Err(opening(self));
            };
            string.push_str(&rest[..plain]);
            self.at += plain;
            match self.peek() {
                Some(b'"') => {
                    self.at += 1;
                    return Ok(string);
                }
                Some(b'\\') => string.push(self.escape()?),
                Some(b'\n' | b'\r') => return Err(opening(self)),
                _ => {
                    return Err(self.unexpected(
                        "an escape such as \\t: control characters are not allowed in strings",
                    ));
                }
            }
        }
    }

    fn escape(&mut self) -> Parsed<char> {
        const ESCAPES: &str = "\\\" \\\\ \\/ \\b \\f \\n \\r \\t \\uXXXX";
        let start = self.at;
        let bad =
            |p: &Self| p.error_at(start, format!("found a bad escape, expected one of {ESCAPES}"));
        self.at += 1;
        let byte = self.peek();
        let plain = match byte {
            Some(b'"') => '"',
            Some(b'\\') => '\\',
            Some(b'/') => '/',
            Some(b'b') => '\u{8}',
            Some(b'f') => '\u{c}',
            Some(b'n') => '\n',
            Some(b'r') => '\r',
            Some(b't') => '\t',
            Some(b'u') => {
                let mut units = Vec::with_capacity(2);
                while units.len() < 2 && self.text[self.at..].starts_with('u') {
                    let Some(unit) = self.hex_unit() else {
                        return Err(bad(self));
                    };
                    units.push(unit);
                    let high = (0xd800..0xdc00).contains(&unit);
                    if units.len() == 2 || !high || !self.text[self.at..].starts_with("\\u") {
                        break;
                    }
                    self.at += 1;
                }
                return match char::decode_utf16(units).next() {
                    Some(Ok(c)) => Ok(c),
                    _ => Err(self
                        .error_at(start, "found half of a surrogate pair, expected both halves")),
                };
            }
            _ => return Err(bad(self)),
        };
        self.at += 1;
        Ok(plain)
    }

    /// Parses `uXXXX`, the part of an escape after the backslash.
    fn hex_unit(&mut self) -> Option<u16> {
        let digits = self.text.as_bytes().get(self.at + 1..self.at + 5)?;
        if !digits.iter().all(u8::is_ascii_hexdigit) {
            return None;
        }
        let unit = u16::from_str_radix(std::str::from_utf8(digits).ok()?, 16).ok()?;
        self.at += 5;
        Some(unit)
    }
}
