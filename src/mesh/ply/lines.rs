//! ASCII data: locates the rows and parses their numbers.
//!
//! A row is one line. Blank lines do not count. Lines are first counted in parallel. Then blocks of
//! rows can be read in parallel, because the first row and line of each block are known.

use super::block::{RowBlock, Span, too_short};
use super::context::ReadContext;
use super::header::{Element, Header, show};
use super::row::{Fault, Row, RowResult};
use super::scalar::Scalar;
use crate::error::Result;
use crate::parallel;
use crate::units::counted;

/// Number of bytes of text that one task counts.
const CHUNK: usize = 1 << 19;

/// A range of bytes that holds whole lines.
#[derive(Debug)]
struct Chunk {
    start: usize,
    end: usize,
    /// Number of lines that are not blank.
    rows: u64,
    lines: u64,
}

/// Locates the rows of every element. The second value is the number of bytes after the last row.
pub(super) fn locate(
    data: &[u8],
    header: &Header,
    context: &ReadContext,
) -> Result<(Vec<Span>, u64)> {
    let mut lines = Lines::new(data, header.lines, context)?;
    let mut spans = Vec::with_capacity(header.elements.len());
    for element in &header.elements {
        let left = lines.left;
        let span = lines.take(data, element, 0, element.count);
        if span.rows < element.count {
            let have = format!("{} of data in all", counted(lines.all, ["line", "lines"]));
            return Err(too_short(element, left, &have, context));
        }
        spans.push(span);
    }
    Ok((spans, lines.rest(data)))
}

fn chunks(data: &[u8], context: &ReadContext) -> Result<Vec<Chunk>> {
    let mut bounds = vec![0];
    let mut at = CHUNK;
    while at < data.len() {
        let Some(end) = data[at..].iter().position(|&b| b == b'\n') else {
            break;
        };
        bounds.push(at + end + 1);
        at += end + 1 + CHUNK;
    }
    bounds.push(data.len());
    let count = |pair: &[usize]| context.check().map(|()| count(data, pair[0], pair[1]));
    parallel::try_map(bounds.windows(2), count)
}

fn count(data: &[u8], start: usize, end: usize) -> Chunk {
    let (mut rows, mut lines, mut blank) = (0, 0, true);
    for &byte in &data[start..end] {
        if byte == b'\n' {
            lines += 1;
            rows += u64::from(!blank);
            blank = true;
        } else if byte > b' ' {
            blank = false;
        } else {
            blank &= byte.is_ascii_whitespace();
        }
    }
    rows += u64::from(!blank);
    Chunk { start, end, rows, lines }
}

/// Distributes lines of text to elements, in order. A chunk is cut where one element ends and the
/// next begins.
#[derive(Debug)]
pub(super) struct Lines {
    /// Length of the data in bytes. The data are a parameter of the methods.
    length: usize,
    chunks: Vec<Chunk>,
    /// Index of the next chunk to open.
    chunk: usize,
    /// The rest of the open chunk.
    block: Option<RowBlock>,
    /// Number of lines before the next chunk.
    line: u64,
    /// Number of all lines that are not blank.
    all: u64,
    /// Number of lines that are not blank and have not been taken.
    left: u64,
}

impl Lines {
    /// Counts the lines of `data`. The file has `line` lines before it.
    pub(super) fn new(data: &[u8], line: u64, context: &ReadContext) -> Result<Self> {
        let chunks = chunks(data, context)?;
        let all = chunks.iter().map(|c| c.rows).sum();
        Ok(Self { length: data.len(), chunks, chunk: 0, block: None, line, all, left: all })
    }

    /// Takes the next rows of `element`, from row `first` on: `wanted` rows, or fewer if the lines
    /// end first.
    pub(super) fn take(&mut self, data: &[u8], element: &Element, first: u64, wanted: u64) -> Span {
        // A row without properties has no line.
        if element.properties.is_empty() {
            return Span { first, rows: wanted, ..Span::default() };
        }
        let rows = wanted.min(self.left);
        self.left -= rows;
        Span { first, rows, uniform: None, blocks: self.blocks(data, first, rows) }
    }

    /// Returns the blocks of the next `rows` rows. The caller has checked that they exist.
    fn blocks(&mut self, data: &[u8], first: u64, rows: u64) -> Vec<RowBlock> {
        let (mut blocks, mut taken) = (Vec::new(), 0);
        while taken < rows {
            let Some(open) = self.open() else { break };
            let count = open.rows.min(rows - taken);
            let block = RowBlock { row: first + taken, rows: count, ..open };
            if count == open.rows {
                self.block = None;
            } else {
                self.block = Some(skip(data, open, count));
            }
            taken += count;
            if count > 0 {
                blocks.push(block);
            }
        }
        blocks
    }

    /// Returns the offset where the search for the next row starts, and the number of lines before
    /// it.
    pub(super) fn position(&self) -> (usize, u64) {
        match (self.block, self.chunks.get(self.chunk)) {
            (Some(block), _) => (block.start, block.line),
            (None, Some(chunk)) => (chunk.start, self.line),
            (None, None) => (self.length, self.line),
        }
    }

    fn open(&mut self) -> Option<RowBlock> {
        if self.block.is_none() {
            let chunk = self.chunks.get(self.chunk)?;
            self.chunk += 1;
            let line = self.line;
            self.line += chunk.lines;
            self.block = Some(RowBlock {
                start: chunk.start,
                end: chunk.end,
                row: 0,
                rows: chunk.rows,
                line,
            });
        }
        self.block
    }

    /// Returns the number of bytes from the first word that no element takes to the end of the
    /// data; 0 if there is no such word.
    fn rest(&mut self, data: &[u8]) -> u64 {
        while let Some(block) = self.open() {
            if block.rows > 0 {
                let mut row = Text::new(data, &block);
                row.begin();
                return (data.len() - row.at) as u64;
            }
            self.block = None;
        }
        0
    }
}

/// Returns the block without its first `rows` rows.
fn skip(data: &[u8], block: RowBlock, rows: u64) -> RowBlock {
    let mut reader = Text::new(data, &block);
    for _ in 0..rows {
        reader.begin();
        reader.skip_line();
    }
    RowBlock {
        start: reader.at,
        end: block.end,
        row: 0,
        rows: block.rows - rows,
        line: reader.line - 1,
    }
}

/// Reads the rows of a block of text.
pub(super) struct Text<'a> {
    data: &'a [u8],
    at: usize,
    /// Number of the line that is being read, from 1.
    line: u64,
}

impl<'a> Text<'a> {
    pub(super) fn new(data: &'a [u8], block: &RowBlock) -> Self {
        Self { data, at: block.start, line: block.line + 1 }
    }

    /// Moves past the end of the line.
    fn skip_line(&mut self) {
        let rest = &self.data[self.at..];
        let length = rest.iter().position(|&b| b == b'\n').map_or(rest.len(), |at| at + 1);
        self.at += length;
        self.line += 1;
    }

    #[inline]
    fn skip_blanks(&mut self) {
        while let Some(&byte) = self.data.get(self.at) {
            if byte == b'\n' || !byte.is_ascii_whitespace() {
                return;
            }
            self.at += 1;
        }
    }

    /// Reads the next word of the line.
    fn word(&mut self) -> RowResult<&'a [u8]> {
        self.skip_blanks();
        let rest = &self.data[self.at..];
        let length = rest.iter().position(u8::is_ascii_whitespace).unwrap_or(rest.len());
        if length == 0 {
            return Err(Fault::Short { at_end: self.at >= self.data.len() });
        }
        self.at += length;
        Ok(&rest[..length])
    }
}

impl Row for Text<'_> {
    fn begin(&mut self) {
        while let Some(&byte) = self.data.get(self.at) {
            if !byte.is_ascii_whitespace() {
                return;
            }
            self.line += u64::from(byte == b'\n');
            self.at += 1;
        }
    }

    #[inline]
    fn number(&mut self, kind: Scalar) -> RowResult<f64> {
        self.skip_blanks();
        let rest = &self.data[self.at..];
        if let Some((value, length)) = super::number::plain(rest) {
            if kind == Scalar::F64 || kind.is_integer() && kind.holds(value) {
                self.at += length;
                return Ok(value);
            }
            if let (Scalar::F32, Some(value)) = (kind, super::number::to_f32(value)) {
                self.at += length;
                return Ok(value);
            }
        }
        let word = self.word()?;
        let value = super::number::any(word, kind == Scalar::F32)
            .ok_or_else(|| Fault::NotANumber(show(word)))?;
        if kind.holds(value) { Ok(value) } else { Err(Fault::DoesNotFit(show(word), kind)) }
    }

    fn skip(&mut self, _: Scalar, count: u64) -> RowResult<()> {
        for _ in 0..count {
            self.word()?;
        }
        Ok(())
    }

    fn end(&mut self) -> RowResult<()> {
        self.skip_blanks();
        match self.data.get(self.at) {
            None => Ok(()),
            Some(b'\n') => {
                self.at += 1;
                self.line += 1;
                Ok(())
            }
            Some(_) => Err(Fault::Extra(show(self.word()?))),
        }
    }

    fn line(&self) -> Option<u64> {
        Some(self.line)
    }
}
