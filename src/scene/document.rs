//! A JSON text as a tree that stores the place of every value.
//!
//! Messages name line and column, both for syntax errors and for values that a later check rejects.
//! The tree keeps what a plain JSON value loses: places, duplicate keys, the source text of
//! numbers. Scenes and job files are parsed here. Only one key has a meaning here: `comment`, which
//! any object may have.

use serde_json::Value;

use crate::error::{Error, ErrorKind, Problem, Result};

use super::node::{JsonNode, JsonPlace};
use super::parse::{self, SyntaxError};

/// Maximum number of characters that a message quotes from the input. Longer text ends in `...`.
const MAX_SHOWN_CHARS: usize = 200;

/// A parsed JSON text.
#[derive(Debug, Clone)]
pub struct Document {
    /// Name of the document in messages: a path or `<stdin>`.
    pub name: String,
    /// The value at the top level.
    pub root: JsonNode,
}

impl Document {
    /// Parses strict JSON in UTF-8. A byte order mark is skipped.
    ///
    /// # Errors
    /// The first syntax error, with its place.
    pub fn parse(name: &str, bytes: &[u8]) -> Result<Self> {
        if let Some((other, help)) = other_format(bytes) {
            let error = Error::invalid(name, format!("found {other}, expected a JSON object"));
            return Err(error.maybe_help(help));
        }
        let bytes = bytes.strip_prefix(b"\xef\xbb\xbf").unwrap_or(bytes);
        let text =
            std::str::from_utf8(bytes).map_err(|e| not_utf8(name, bytes, e.valid_up_to()))?;
        if text.trim().is_empty() {
            return Err(Error::invalid(name, "found an empty file, expected a JSON object"));
        }
        let root = parse::parse(text).map_err(|e| syntax_error(name, e))?;
        Ok(Self { name: name.to_string(), root })
    }

    /// Makes a document from a value, for scenes made by code. Its nodes have no line and column.
    pub fn from_value(name: &str, value: &Value) -> Self {
        Self { name: name.to_string(), root: JsonNode::from_value(value) }
    }

    /// Returns the node at a JSON pointer. The empty pointer is the root.
    pub fn get(&self, pointer: &str) -> Option<&JsonNode> {
        tokens(pointer).try_fold(&self.root, |node, token| node.step(&token))
    }

    /// Returns the node at `pointer`, or else its nearest ancestor that exists.
    pub(super) fn nearest(&self, pointer: &str) -> &JsonNode {
        let mut node = &self.root;
        for token in tokens(pointer) {
            match node.step(&token) {
                Some(child) => node = child,
                None => break,
            }
        }
        node
    }

    /// Formats the place of the node at `pointer` for messages. If there is no such node, line and
    /// column are those of its nearest ancestor.
    pub fn place(&self, pointer: &str) -> String {
        self.describe(&self.nearest(pointer).place, pointer)
    }

    /// Formats a place for messages: `FILE:LINE:COL (/json/pointer)`. A node that an override set
    /// is `--set /a`; a node below it is `--set /a (/a/b)`.
    pub fn describe(&self, place: &JsonPlace, pointer: &str) -> String {
        let shown_pointer = shown(pointer);
        let what = match place {
            JsonPlace::Text { line, column } => format!("{}:{line}:{column}", self.name),
            JsonPlace::Set(at) if **at == *pointer => return format!("--set {shown_pointer}"),
            JsonPlace::Set(at) => format!("--set {}", shown(at)),
            JsonPlace::Code => self.name.clone(),
        };
        if pointer.is_empty() { what } else { format!("{what} ({shown_pointer})") }
    }
}

/// Formats a piece of the input for a message: cut after [`MAX_SHOWN_CHARS`] characters, control
/// characters escaped.
pub(super) fn shown(text: &str) -> String {
    let mut shown = String::new();
    for (i, c) in text.chars().enumerate() {
        match c {
            _ if i == MAX_SHOWN_CHARS => return shown + "...",
            c if c.is_control() => shown.extend(c.escape_default()),
            c => shown.push(c),
        }
    }
    shown
}

/// Returns the unescaped steps of a JSON pointer (RFC 6901). The empty pointer has none, and
/// neither has a text without a leading `/`.
pub(super) fn tokens(pointer: &str) -> impl Iterator<Item = String> + '_ {
    let steps = pointer.strip_prefix('/').map(|rest| rest.split('/'));
    steps.into_iter().flatten().map(|t| t.replace("~1", "/").replace("~0", "~"))
}

/// Escapes a key as a step of a JSON pointer (RFC 6901).
pub fn escaped(key: &str) -> String {
    key.replace('~', "~0").replace('/', "~1")
}

/// Returns `pointer` extended by one key.
pub(super) fn join(pointer: &str, key: &str) -> String {
    format!("{pointer}/{}", escaped(key))
}

fn syntax_error(name: &str, error: SyntaxError) -> Error {
    let place = format!("{name}:{}:{}", error.line, error.column);
    let help = error.help.map(str::to_string);
    let problem = Problem { help, ..Problem::new(place, error.message) };
    Error::new(ErrorKind::Invalid, problem)
}

/// Returns the format of a file that is not JSON, by its first bytes, and what to do with a mesh.
/// Users often pass such files in place of a scene. `None` for any other file.
fn other_format(bytes: &[u8]) -> Option<(&'static str, Option<&'static str>)> {
    const MESH: Option<&str> = Some("save the mesh to a file, or name the pipe FILE.ply");
    const PACKED: Option<&str> =
        Some("save a packed mesh to FILE.ply.gz or FILE.ply.zst; unpack a scene");
    const KNOWN: [(&[u8], &str, Option<&str>); 7] = [
        (b"\x89PNG", "a PNG picture", None),
        (b"v/1\x01", "an EXR picture", None),
        (b"\xff\xd8\xff", "a JPEG picture", None),
        (b"ply\n", "a PLY mesh", MESH),
        (b"ply\r", "a PLY mesh", MESH),
        (b"\x1f\x8b", "a gzip archive", PACKED),
        (b"\x28\xb5\x2f\xfd", "a Zstandard archive", PACKED),
    ];
    KNOWN.iter().find(|(start, ..)| bytes.starts_with(start)).map(|(_, name, help)| (*name, *help))
}

fn not_utf8(name: &str, bytes: &[u8], at: usize) -> Error {
    let before = String::from_utf8_lossy(&bytes[..at]);
    let line = before.matches('\n').count() + 1;
    let column = before.chars().rev().take_while(|c| *c != '\n').count() + 1;
    let place = format!("{name}:{line}:{column}");
    let byte = bytes.get(at).copied().unwrap_or(0);
    let error = Error::invalid(
        place,
        format!("found byte 0x{byte:02x}, which is not UTF-8, expected JSON text"),
    );
    match bytes {
        [0xff, 0xfe, ..] | [0xfe, 0xff, ..] => {
            error.help("this looks like UTF-16: save the file as UTF-8")
        }
        _ => error.help("save the file as UTF-8"),
    }
}
