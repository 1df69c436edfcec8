//! One row of numbers, in text or binary: what the general paths read.

use std::fmt;

use super::header::Element;
use super::layout::{Block, Span};
use super::scalar::{Native, Scalar};
use crate::error::{Error, Result};
use rayon::prelude::*;

/// What is wrong with a row.
#[derive(Debug)]
pub(super) enum Fault {
    /// The row ends too early; `at_end`: because the file does.
    Short {
        at_end: bool,
    },
    /// A word too many.
    Extra(String),
    NotANumber(String),
    DoesNotFit(String, Scalar),
    NegativeCount(f64),
    /// The values make no face.
    Bad(String),
}

impl fmt::Display for Fault {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Short { .. } => f.write_str("the line has too few values"),
            Self::Extra(word) => write!(f, "the line has too many values, from '{word}' on"),
            Self::NotANumber(word) => write!(f, "'{word}' is not a number"),
            Self::DoesNotFit(word, kind) => write!(f, "'{word}' does not fit type {}", kind.name()),
            Self::NegativeCount(count) => write!(f, "a list of {count} values"),
            Self::Bad(message) => f.write_str(message),
        }
    }
}

/// A value of a row, or what is wrong with it.
pub(super) type Values<T> = std::result::Result<T, Fault>;

/// A reader of rows of numbers, one after the other.
pub(super) trait Row {
    /// Moves to the first value of the next row.
    fn begin(&mut self);
    /// The next value, which is of type `kind`.
    fn number(&mut self, kind: Scalar) -> Values<f64>;
    /// Reads over `count` values.
    fn skip(&mut self, kind: Scalar, count: u64) -> Values<()>;
    /// Ends the row.
    fn end(&mut self) -> Values<()>;
    /// The line number, in text.
    fn line(&self) -> Option<u64>;

    /// The length of a list.
    #[inline]
    fn count(&mut self, kind: Scalar) -> Values<u64> {
        let count = self.number(kind)?;
        if count < 0.0 { Err(Fault::NegativeCount(count)) } else { Ok(count as u64) }
    }
}

/// The rows of a block of binary data. [`super::layout`] has checked that they end inside it.
pub(super) struct Binary<'a> {
    data: &'a [u8],
    at: usize,
    big: bool,
}

impl<'a> Binary<'a> {
    pub(super) fn new(data: &'a [u8], block: &Block, big: bool) -> Self {
        Self { data, at: block.start, big }
    }

    fn need(&self, bytes: u64) -> Values<usize> {
        let left = self.data.len() - self.at;
        usize::try_from(bytes).ok().filter(|b| *b <= left).ok_or(Fault::Short { at_end: true })
    }
}

impl Row for Binary<'_> {
    fn begin(&mut self) {}

    #[inline]
    fn number(&mut self, kind: Scalar) -> Values<f64> {
        if kind == Scalar::I32 && self.data.len() - self.at >= 4 {
            let value = i32::take(self.data, self.at, self.big);
            self.at += 4;
            return Ok(value as f64);
        }
        let size = self.need(kind.size() as u64)?;
        let value = kind.read(self.data, self.at, self.big);
        self.at += size;
        Ok(value)
    }

    #[inline]
    fn skip(&mut self, kind: Scalar, count: u64) -> Values<()> {
        self.at += self.need(count.saturating_mul(kind.size() as u64))?;
        Ok(())
    }

    fn end(&mut self) -> Values<()> {
        Ok(())
    }

    fn line(&self) -> Option<u64> {
        None
    }
}

/// Where the rows of one element are, for reading and for messages.
pub(super) struct Table<'a> {
    pub(super) data: &'a [u8],
    /// `None`: text.
    pub(super) big: Option<bool>,
    pub(super) span: &'a Span,
    pub(super) element: &'a Element,
    pub(super) name: &'a str,
}

impl Table<'_> {
    /// Runs `read` over all blocks in parallel; the results in order, or the first error in the
    /// order of the file, whatever the threads do.
    pub(super) fn blocks<T: Send>(
        &self,
        read: impl Fn(&mut Reader<'_, '_>) -> Result<T> + Sync,
    ) -> Result<Vec<T>> {
        let results: Vec<Result<T>> = self
            .span
            .blocks
            .par_iter()
            .map(|block| read(&mut Reader { table: self, block }))
            .collect();
        results.into_iter().collect()
    }

    /// An error in row `row`.
    pub(super) fn fault(&self, row: u64, line: Option<u64>, fault: Fault) -> Error {
        let (name, element) = (self.name, &self.element.name);
        match (fault, line) {
            (Fault::Short { at_end: true }, _) => {
                let have = "its last line is incomplete";
                super::layout::too_short(self.element, row, have, name)
            }
            (fault, Some(line)) => {
                let values = super::layout::expected(self.element);
                Error::invalid(format!("{name}:{line}"), format!("{element} {row}: {fault}"))
                    .help(format!("expected: {values}"))
            }
            (fault, None) => Error::invalid(format!("{name}: {element} {row}"), fault.to_string()),
        }
    }
}

/// One block of a table.
pub(super) struct Reader<'a, 'b> {
    table: &'a Table<'b>,
    block: &'a Block,
}

/// Something that takes the rows of a block one by one.
pub(super) trait Sink {
    /// Reads the values of row number `row`.
    fn take<R: Row>(&mut self, values: &mut R, row: u64) -> Values<()>;
}

impl Reader<'_, '_> {
    /// Rows of the block.
    pub(super) fn rows(&self) -> u64 {
        self.block.rows
    }

    /// Feeds every row to `sink`.
    pub(super) fn feed(&self, sink: &mut impl Sink) -> Result<()> {
        let Table { data, big, .. } = *self.table;
        match big {
            None => self.run(super::lines::Text::new(data, self.block), sink),
            Some(big) => self.run(Binary::new(data, self.block, big), sink),
        }
    }

    fn run<R: Row>(&self, mut values: R, sink: &mut impl Sink) -> Result<()> {
        for row in self.block.row..self.block.row + self.block.rows {
            values.begin();
            let line = values.line();
            sink.take(&mut values, row)
                .and_then(|()| values.end())
                .map_err(|fault| self.table.fault(row, line, fault))?;
        }
        Ok(())
    }
}
