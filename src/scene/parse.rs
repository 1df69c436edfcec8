//! Parses JSON text into [`JsonNode`]s with places: strict RFC 8259, nothing more.
//!
//! There are three reasons for a parser of our own. Messages need line and column of every value.
//! Duplicate keys and the source text of numbers must be kept. Nesting must be limited before it
//! exhausts the stack. The parser refuses what lenient parsers accept: comments, trailing or
//! missing commas, single quotes, unquoted names, `NaN`, hexadecimal. A test compares it with
//! `serde_json`.

use super::node::{JsonNode, JsonPlace, Member, NodeKind};

/// Maximum nesting of arrays and objects. A scene needs 6 levels.
pub const MAX_DEPTH: usize = 64;
/// Maximum number of values in a text. A value takes some 90 bytes of memory in the tree, and up to
/// 1 kB until the scene is checked and hashed.
const MAX_VALUES: usize = 1 << 25;

/// A syntax error: why a text is not JSON, and where.
#[derive(Debug)]
pub struct SyntaxError {
    /// Line number, from 1.
    pub line: u32,
    /// Column in characters, from 1.
    pub column: u32,
    /// What was found, and what was expected.
    pub message: String,
    /// A help text for common mistakes.
    pub help: Option<&'static str>,
}

pub(super) type Parsed<T> = Result<T, SyntaxError>;

/// Parses exactly one value.
pub fn parse(text: &str) -> Parsed<JsonNode> {
    let mut parser = Parser { text, at: 0, line: 1, mark: (0, 1), depth: 0, values: 0 };
    parser.skip_space();
    let node = parser.value()?;
    parser.skip_space();
    match parser.peek() {
        None => Ok(node),
        Some(_) => Err(parser.unexpected("the end of the file")),
    }
}

pub(super) struct Parser<'a> {
    pub(super) text: &'a str,
    /// Byte offset, always on a character boundary.
    pub(super) at: usize,
    line: u32,
    /// A byte offset in this line, and its column. Columns are counted from here, so that a file
    /// with one long line is parsed in linear time.
    mark: (usize, u32),
    depth: usize,
    values: usize,
}

impl Parser<'_> {
    pub(super) fn peek(&self) -> Option<u8> {
        self.text.as_bytes().get(self.at).copied()
    }

    /// Moves past the next byte and returns true if the byte is one of `bytes`.
    fn accept(&mut self, bytes: &[u8]) -> bool {
        let found = self.peek().is_some_and(|byte| bytes.contains(&byte));
        self.at += usize::from(found);
        found
    }

    fn place(&mut self) -> JsonPlace {
        self.mark = (self.at, self.column_of(self.at));
        JsonPlace::Text { line: self.line, column: self.mark.1 }
    }

    /// Returns the column of an offset in this line that is not before the mark.
    fn column_of(&self, at: usize) -> u32 {
        let chars = self.text[self.mark.0.min(at)..at].chars().count();
        u32::try_from(chars).map_or(u32::MAX, |n| self.mark.1.saturating_add(n))
    }

    fn error(&self, message: impl Into<String>) -> SyntaxError {
        self.error_at(self.at, message)
    }

    pub(super) fn error_at(&self, at: usize, message: impl Into<String>) -> SyntaxError {
        SyntaxError {
            line: self.line,
            column: self.column_of(at),
            message: message.into(),
            help: None,
        }
    }

    fn skip_space(&mut self) {
        while let Some(byte) = self.peek() {
            match byte {
                b' ' | b'\t' | b'\r' => self.at += 1,
                b'\n' => {
                    self.at += 1;
                    self.line = self.line.saturating_add(1);
                    self.mark = (self.at, 1);
                }
                _ => break,
            }
        }
    }

    /// Makes the error for the character or word at the current position, with help for common
    /// mistakes.
    pub(super) fn unexpected(&self, expected: &str) -> SyntaxError {
        let rest = &self.text[self.at..];
        let word: String = rest
            .chars()
            .take_while(|c| c.is_alphanumeric() || "_+-.".contains(*c))
            .take(30)
            .collect();
        let found = match rest.chars().next() {
            None => "the end of the file".to_string(),
            Some(c) if word.is_empty() => format!("`{}`", c.escape_debug()),
            Some(_) => format!("`{word}`"),
        };
        let mut error = self.error(format!("found {found}, expected {expected}"));
        let lower = word.trim_start_matches(['+', '-']).to_ascii_lowercase();
        error.help = match lower.as_str() {
            "nan" | "inf" | "infinity" => Some("JSON has no NaN and no infinity; write a number"),
            "true" | "false" | "null" => Some("JSON words are lower case"),
            _ if rest.starts_with(['/', '#']) => {
                Some("JSON has no comments; any object may have a `comment` key")
            }
            _ if rest.starts_with('\'') => Some("JSON strings take double quotes"),
            _ if rest.starts_with('+') => Some("JSON numbers take no leading +"),
            _ if rest.starts_with('.') => Some("write 0 before the decimal point"),
            _ => None,
        };
        error
    }

    fn value(&mut self) -> Parsed<JsonNode> {
        self.values += 1;
        if self.values > MAX_VALUES {
            return Err(self.error(format!("found more than {MAX_VALUES} values")));
        }
        let place = self.place();
        let kind = match self.peek() {
            Some(b'{') => self.nested(Self::object)?,
            Some(b'[') => self.nested(Self::list)?,
            Some(b'"') => NodeKind::String(self.string()?),
            Some(b'-' | b'0'..=b'9') => NodeKind::Number(self.number()?),
            _ => self.word()?,
        };
        Ok(JsonNode { place, kind })
    }

    fn word(&mut self) -> Parsed<NodeKind> {
        let words = [
            ("true", NodeKind::Bool(true)),
            ("false", NodeKind::Bool(false)),
            ("null", NodeKind::Null),
        ];
        for (word, kind) in words {
            if self.text[self.at..].starts_with(word) {
                self.at += word.len();
                return Ok(kind);
            }
        }
        Err(self.unexpected("a value"))
    }

    fn nested(&mut self, read: fn(&mut Self) -> Parsed<NodeKind>) -> Parsed<NodeKind> {
        if self.depth == MAX_DEPTH {
            return Err(self.error(format!("found nesting deeper than {MAX_DEPTH} levels")));
        }
        self.depth += 1;
        self.at += 1;
        self.skip_space();
        let kind = read(self)?;
        self.depth -= 1;
        Ok(kind)
    }

    /// Moves to the next item of a list or an object: past the comma, or only past white space if
    /// the item is the `first`. Returns false if it moved past `close`.
    fn another(&mut self, first: bool, close: u8, expected: &str) -> Parsed<bool> {
        self.skip_space();
        if self.accept(&[close]) {
            return Ok(false);
        }
        if first {
            return Ok(true);
        }
        let comma = self.error("found a comma after the last item");
        if !self.accept(b",") {
            return Err(self.unexpected(expected));
        }
        self.skip_space();
        match self.peek() == Some(close) {
            true => Err(SyntaxError { help: Some("remove the comma"), ..comma }),
            false => Ok(true),
        }
    }

    fn list(&mut self) -> Parsed<NodeKind> {
        let mut items = Vec::new();
        while self.another(items.is_empty(), b']', "a comma or `]`")? {
            items.push(self.value()?);
        }
        Ok(NodeKind::List(items))
    }

    fn object(&mut self) -> Parsed<NodeKind> {
        let mut members = Vec::new();
        while self.another(members.is_empty(), b'}', "a comma or `}`")? {
            let place = self.place();
            if self.peek() != Some(b'"') {
                return Err(self.unexpected("a key in double quotes"));
            }
            let key = self.string()?;
            self.skip_space();
            if !self.accept(b":") {
                return Err(self.unexpected(&format!("`:` after the key {key:?}")));
            }
            self.skip_space();
            let value = self.value()?;
            members.push(Member { place, key, value });
        }
        Ok(NodeKind::Object(members))
    }

    fn digits(&mut self) -> Parsed<()> {
        let start = self.at;
        while matches!(self.peek(), Some(b'0'..=b'9')) {
            self.at += 1;
        }
        if self.at == start { Err(self.unexpected("a digit")) } else { Ok(()) }
    }

    fn number(&mut self) -> Parsed<String> {
        let start = self.at;
        self.accept(b"-");
        if !self.accept(b"0") {
            self.digits()?;
        }
        if self.accept(b".") {
            self.digits()?;
        }
        if self.accept(b"eE") {
            self.accept(b"+-");
            self.digits()?;
        }
        if matches!(self.peek(), Some(b'0'..=b'9' | b'a'..=b'z' | b'A'..=b'Z' | b'.' | b'_')) {
            self.at = start;
            let mut error = self.unexpected("a number");
            error.help = Some("JSON numbers are decimal, without leading zeros or a suffix");
            return Err(error);
        }
        Ok(self.text[start..self.at].to_string())
    }
}
