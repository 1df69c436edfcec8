//! Parses the header: every line from `ply` to `end_header`, word by word.
//!
//! No memory is allocated from a declared count. Counts stay `u64` until the data has been found.
//! The header is bytes, not UTF-8: comments may contain any bytes.

use super::scalar::{NAMES, Scalar};
use crate::error::{Error, Result};

/// The keyword of the last line. Further words on that line are ignored.
const END: &[u8] = b"end_header";
/// Maximum length of a header line in bytes. A longer line means that the file is not PLY.
const MAX_LINE: usize = 1 << 16;
/// Maximum number of lines in a header.
const MAX_LINES: usize = 10_000;
/// Maximum size of a header in bytes.
pub(super) const MAX_HEADER: usize = 1 << 24;

/// The encoding of the data after the header.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Format {
    Ascii,
    Little,
    Big,
}

impl Format {
    pub(super) fn name(self) -> &'static str {
        match self {
            Self::Ascii => "ascii",
            Self::Little => "binary_little_endian",
            Self::Big => "binary_big_endian",
        }
    }

    /// Returns whether a binary format is big-endian; `None` for text.
    pub(super) fn is_big(self) -> Option<bool> {
        match self {
            Self::Ascii => None,
            Self::Little => Some(false),
            Self::Big => Some(true),
        }
    }
}

/// The type of a property: one number, or a counted list of numbers.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum PropertyType {
    Single(Scalar),
    List { count: Scalar, item: Scalar },
}

impl PropertyType {
    /// Returns the minimum size in bytes of a value in a binary file.
    pub(super) fn min_bytes(self) -> u64 {
        match self {
            Self::Single(kind) | Self::List { count: kind, .. } => kind.size() as u64,
        }
    }
}

#[derive(Debug, Clone)]
pub(super) struct ElementProperty {
    pub(super) name: String,
    pub(super) shape: PropertyType,
}

#[derive(Debug, Clone)]
pub(super) struct Element {
    pub(super) name: String,
    pub(super) count: u64,
    pub(super) properties: Vec<ElementProperty>,
}

impl Element {
    /// Returns the index of the property called `name`.
    pub(super) fn find(&self, name: &str) -> Option<usize> {
        self.properties.iter().position(|p| p.name == name)
    }

    /// Formats a number of rows for messages, for example "3 faces".
    pub(super) fn rows(&self, count: u64) -> String {
        match self.name.as_str() {
            "vertex" if count == 1 => "1 vertex".into(),
            "vertex" => format!("{count} vertices"),
            "face" if count == 1 => "1 face".into(),
            "face" => format!("{count} faces"),
            name if count == 1 => format!("1 row of '{name}'"),
            name => format!("{count} rows of '{name}'"),
        }
    }
}

#[derive(Debug, Clone)]
pub(super) struct Header {
    pub(super) format: Format,
    pub(super) elements: Vec<Element>,
    /// The names in the lines `comment TextureFile NAME`, in file order.
    pub(super) texture_files: Vec<String>,
    /// Offset in bytes of the data from the beginning of the file.
    pub(super) data_start: usize,
    /// Number of lines in the header. The data of an ASCII file starts on the next line.
    pub(super) lines: u64,
}

/// Parses the header from the first bytes of a file. Messages name the file as `name`.
pub(super) fn parse(bytes: &[u8], name: &str) -> Result<Header> {
    let mut lines = Lines { bytes, at: 0, number: 0, name };
    if !bytes.starts_with(b"ply") || lines.next()? != Some(b"ply") {
        return Err(not_a_ply(bytes, name));
    }
    let mut format = None;
    let mut header = Header {
        format: Format::Ascii,
        elements: Vec::new(),
        texture_files: Vec::new(),
        data_start: 0,
        lines: 0,
    };
    loop {
        let Some(line) = lines.next()? else {
            return Err(lines.unfinished());
        };
        let mut words = words(line);
        let keyword = words.next().unwrap_or_default();
        let words: Vec<&[u8]> = match keyword {
            b"comment" | b"obj_info" => Vec::new(),
            // A valid line has at most 4 more words. 8 show that there are too many, in a bounded
            // list.
            _ => words.take(8).collect(),
        };
        match keyword {
            b"comment" => comment(line, &mut header),
            b"obj_info" => {}
            b"format" if format.is_some() => return Err(lines.error("a second format line")),
            b"format" => format = Some(parse_format(&words, &lines)?),
            b"element" => element(&words, &mut header.elements, &lines)?,
            b"property" => property(&words, &mut header.elements, &lines)?,
            END => break,
            b"" => return Err(lines.error("an empty line in the header")),
            other => {
                return Err(lines
                    .error(format!("unknown header word '{}'", show(other)))
                    .help("known: format, comment, obj_info, element, property, end_header"));
            }
        }
    }
    header.format = format.ok_or_else(|| {
        Error::invalid(name, "the header has no format line")
            .help("expected `format ascii 1.0`, or binary_little_endian or binary_big_endian")
    })?;
    header.data_start = lines.at;
    header.lines = lines.number;
    Ok(header)
}

/// Splits a line into words.
fn words(line: &[u8]) -> impl Iterator<Item = &[u8]> {
    line.split(u8::is_ascii_whitespace).filter(|word| !word.is_empty())
}

/// Returns true if `bytes`, the first bytes of a file, contain the last line of the header. Then
/// [`parse`] needs no more bytes.
pub(super) fn is_complete(bytes: &[u8]) -> bool {
    let mut lines = bytes.split_inclusive(|&byte| byte == b'\n');
    lines.any(|line| line.ends_with(b"\n") && words(line).next() == Some(END))
}

/// The lines of the header, without line ends (LF or CRLF) and trailing blanks.
struct Lines<'a> {
    bytes: &'a [u8],
    at: usize,
    number: u64,
    name: &'a str,
}

impl<'a> Lines<'a> {
    /// Returns the next complete line, or `None` if the file ends first.
    fn next(&mut self) -> Result<Option<&'a [u8]>> {
        let rest = &self.bytes[self.at..];
        let window = &rest[..rest.len().min(MAX_LINE)];
        let Some(length) = window.iter().position(|&b| b == b'\n') else {
            // A header whose last line has no line end is refused. Only a file without data can
            // have one.
            if window.len() == MAX_LINE {
                self.number += 1;
                return Err(self.error(format!("the line is longer than {MAX_LINE} bytes")));
            }
            return Ok(None);
        };
        self.number += 1;
        self.at += length + 1;
        if self.number > MAX_LINES as u64 || self.at > MAX_HEADER {
            return Err(self.too_long());
        }
        Ok(Some(rest[..length].trim_ascii_end()))
    }

    /// The error for a file that ends before its header does.
    fn unfinished(&self) -> Error {
        // Of a stream, no more bytes are read.
        if self.bytes.len() >= MAX_HEADER {
            return self.too_long();
        }
        let message =
            format!("the header has no end_header; the file ends after its line {}", self.number);
        Error::invalid(self.name, message).help("the file may be cut short")
    }

    fn too_long(&self) -> Error {
        self.error(format!("the header is longer than {MAX_LINES} lines or {MAX_HEADER} bytes"))
    }

    /// An error about the current line.
    fn error(&self, message: impl Into<String>) -> Error {
        Error::invalid(format!("{}:{}", self.name, self.number), message)
    }
}

fn comment(line: &[u8], header: &mut Header) {
    let text = line.trim_ascii()["comment".len()..].trim_ascii();
    let Some(file) = text.strip_prefix(b"TextureFile") else {
        return;
    };
    if file.first().is_some_and(u8::is_ascii_whitespace) {
        header.texture_files.push(String::from_utf8_lossy(file.trim_ascii()).into_owned());
    }
}

fn parse_format(words: &[&[u8]], lines: &Lines) -> Result<Format> {
    let expected = "expected `format ascii 1.0`, or binary_little_endian or binary_big_endian";
    let word = words.first().copied().unwrap_or_default();
    let formats = [Format::Ascii, Format::Little, Format::Big];
    let Some(format) = formats.into_iter().find(|format| format.name().as_bytes() == word) else {
        return Err(lines.error(format!("unknown format '{}'", show(word))).help(expected));
    };
    match words[1..] {
        [b"1.0"] => Ok(format),
        [] => Err(lines.error("the format has no version").help(expected)),
        [version, ..] => {
            let message = format!("format version '{}' is unknown: only 1.0 exists", show(version));
            Err(lines.error(message).help(expected))
        }
    }
}

fn element(words: &[&[u8]], elements: &mut Vec<Element>, lines: &Lines) -> Result<()> {
    let &[name, count] = words else {
        return Err(lines.error("expected `element NAME COUNT`"));
    };
    let name = String::from_utf8_lossy(name).into_owned();
    let count = std::str::from_utf8(count).ok().and_then(|c| c.parse().ok()).ok_or_else(|| {
        lines.error(format!(
            "the count '{}' of element {name} is not a whole number >= 0",
            show(count)
        ))
    })?;
    if elements.iter().any(|e| e.name == name) {
        return Err(lines.error(format!("a second element '{name}'")));
    }
    elements.push(Element { name, count, properties: Vec::new() });
    Ok(())
}

fn property(words: &[&[u8]], elements: &mut [Element], lines: &Lines) -> Result<()> {
    let scalar = |word: &[u8]| {
        Scalar::parse(word).ok_or_else(|| {
            lines.error(format!("unknown type '{}'", show(word))).help(format!("known: {NAMES}"))
        })
    };
    let (name, shape) = match *words {
        [b"list", count, item, name] => {
            let shape = PropertyType::List { count: scalar(count)?, item: scalar(item)? };
            (name, shape)
        }
        [kind, name] => (name, PropertyType::Single(scalar(kind)?)),
        _ => {
            return Err(lines.error(
                "expected `property TYPE NAME` or `property list COUNT_TYPE ITEM_TYPE NAME`",
            ));
        }
    };
    let name = String::from_utf8_lossy(name).into_owned();
    if let PropertyType::List { count, .. } = shape {
        if !count.is_integer() {
            let message =
                format!("the list '{name}' is counted in {}: not an integer type", count.name());
            return Err(lines.error(message));
        }
    }
    let Some(element) = elements.last_mut() else {
        return Err(lines.error(format!("property '{name}' comes before any element")));
    };
    if element.find(&name).is_some() {
        let message = format!("element {} has a second property '{name}'", element.name);
        return Err(lines.error(message));
    }
    element.properties.push(ElementProperty { name, shape });
    Ok(())
}

/// Formats bytes of the file as printable text: at most 40 bytes, control characters escaped.
pub(super) fn show(bytes: &[u8]) -> String {
    let (shown, rest) = bytes.split_at(bytes.len().min(40));
    let dots = if rest.is_empty() { "" } else { "..." };
    match std::str::from_utf8(shown) {
        Ok(text) if !text.chars().any(char::is_control) => format!("{text}{dots}"),
        _ => format!("{}{dots}", shown.escape_ascii()),
    }
}

/// The error for a file that is not PLY. If its first bytes show what it is, the help says so.
fn not_a_ply(bytes: &[u8], name: &str) -> Error {
    let known: [(&[u8], &str); 10] = [
        (b"\x1f\x8b", "it is gzip data inside of other data: unpack it first (gunzip)"),
        (b"\x28\xb5\x2f\xfd", "it is zstd data inside of other data: unpack it first (unzstd)"),
        (b"PK\x03\x04", "it is a zip archive: unpack it first"),
        (b"version https://git-lfs", "it is a Git LFS pointer: run `git lfs pull`"),
        (b"\xef\xbb\xbfply", "it starts with a UTF-8 byte order mark: remove its first 3 bytes"),
        (b"ply\r", "its lines end in CR alone: convert them to LF"),
        (b"glTF", "it is a glTF file: convert it to PLY"),
        (b"solid", "it looks like an STL file: convert it to PLY"),
        (b"<", "it looks like HTML or XML, perhaps a failed download"),
        (b"{", "it looks like JSON"),
    ];
    let help = known.iter().find(|(start, _)| bytes.starts_with(start)).map(|(_, help)| *help);
    Error::invalid(name, "is not a PLY file: its first line is not 'ply'").maybe_help(help)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A header of `size` bytes, filled up with comments.
    fn header_of(size: usize) -> Vec<u8> {
        let (mut bytes, end) = (b"ply\nformat ascii 1.0\n".to_vec(), b"end_header\n");
        while bytes.len() < size - end.len() {
            let line = (size - end.len() - bytes.len()).min(MAX_LINE / 2);
            let first = bytes.len();
            bytes.resize(first + line, b' ');
            bytes[first..first + 7].copy_from_slice(b"comment");
            bytes[first + line - 1] = b'\n';
        }
        bytes.extend(end);
        bytes
    }

    #[test]
    fn the_largest_header_is_read_and_a_larger_one_is_refused() {
        let largest = parse(&header_of(MAX_HEADER), "a.ply").unwrap();
        assert_eq!(largest.data_start, MAX_HEADER);
        for more in [1, 100] {
            let error = parse(&header_of(MAX_HEADER + more), "a.ply").unwrap_err().to_string();
            assert!(error.contains("the header is longer than"), "{error}");
            // Of a stream, as many bytes are there.
            let start = &header_of(MAX_HEADER + more)[..MAX_HEADER];
            let error = parse(start, "a.ply").unwrap_err().to_string();
            assert!(error.contains("the header is longer than"), "{error}");
        }
    }

    #[test]
    fn as_many_lines_are_read_as_are_allowed() {
        let header = |comments: usize| {
            format!("ply\nformat ascii 1.0\n{}end_header\n", "comment\n".repeat(comments))
        };
        let largest = parse(header(MAX_LINES - 3).as_bytes(), "a.ply").unwrap();
        assert_eq!(largest.lines, MAX_LINES as u64);
        for more in [1, 100] {
            let header = header(MAX_LINES - 3 + more);
            let error = parse(header.as_bytes(), "a.ply").unwrap_err().to_string();
            assert!(error.contains("the header is longer than"), "{error}");
        }
    }

    #[test]
    fn texture_files_are_named_in_comments() {
        let header = "ply\nformat ascii 1.0\ncomment TextureFile a b.png\n comment  TextureFile \
                      c.png \ncomment TextureFiles d.png\ncomment e.png\nend_header\n";
        let header = parse(header.as_bytes(), "a.ply").unwrap();
        assert_eq!(header.texture_files, ["a b.png", "c.png"]);
    }

    #[test]
    fn a_line_that_is_too_long_is_named() {
        let header = format!("ply\nformat ascii 1.0\ncomment {}\n", "x".repeat(MAX_LINE));
        let error = parse(header.as_bytes(), "a.ply").unwrap_err().to_string();
        assert!(error.contains("a.ply:3") && error.contains("the line is longer"), "{error}");
    }

    #[test]
    fn a_header_is_complete_with_the_line_end_of_its_last_line() {
        for complete in ["ply\nend_header\n", "ply\n end_header \r\n1 2", "end_header x\n"] {
            assert!(is_complete(complete.as_bytes()), "{complete:?}");
        }
        for incomplete in ["ply\nend_header", "ply\ncomment end_header\n", "end_header2\n", ""] {
            assert!(!is_complete(incomplete.as_bytes()), "{incomplete:?}");
        }
    }

    #[test]
    fn rows_are_named_in_singular_and_plural() {
        let rows = |name: &str, count| {
            Element { name: name.into(), count: 9, properties: Vec::new() }.rows(count)
        };
        assert_eq!([rows("vertex", 1), rows("vertex", 2)], ["1 vertex", "2 vertices"]);
        assert_eq!([rows("face", 1), rows("face", 0)], ["1 face", "0 faces"]);
        assert_eq!([rows("edge", 1), rows("edge", 2)], ["1 row of 'edge'", "2 rows of 'edge'"]);
    }

    #[test]
    fn bytes_of_the_file_are_shown_as_printable_text() {
        assert_eq!(show("größe".as_bytes()), "größe");
        assert_eq!(show(b"a\x1b[31mb"), r"a\x1b[31mb");
        assert_eq!(show(b"\xff"), r"\xff");
        assert_eq!(show(&[b'x'; 41]), format!("{}...", "x".repeat(40)));
    }
}
