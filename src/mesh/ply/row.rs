//! Reads a row of numbers value by value, from text or binary data. The paths that cannot read in
//! bulk use it.

use std::fmt;

use super::block::RowBlock;
use super::header::PropertyType;
use super::scalar::{Native, Scalar};
use crate::error::Error;

/// An error in a row.
#[derive(Debug)]
pub(super) enum Fault {
    /// The row ends too early. `at_end` is true if the data ends there.
    Short {
        at_end: bool,
    },
    /// The row has too many values; this is the first extra word.
    Extra(String),
    NotANumber(String),
    DoesNotFit(String, Scalar),
    NegativeCount(f64),
    /// The values do not form a valid face.
    Bad(String),
    /// The row needs more memory than there is.
    Memory(Box<Error>),
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
            Self::Memory(error) => error.fmt(f),
        }
    }
}

/// A value of a row, or an error in the row.
pub(super) type RowResult<T> = std::result::Result<T, Fault>;

/// Reads rows of numbers one after the other.
pub(super) trait Row {
    /// Moves to the first value of the next row.
    fn begin(&mut self);
    /// Reads the next value, which has type `kind`.
    fn number(&mut self, kind: Scalar) -> RowResult<f64>;
    /// Skips `count` values of type `kind`.
    fn skip(&mut self, kind: Scalar, count: u64) -> RowResult<()>;
    /// Moves past the end of the row. In text, more values on the line are an error.
    fn end(&mut self) -> RowResult<()>;
    /// Returns the line number in text; `None` in binary data.
    fn line(&self) -> Option<u64>;

    /// Reads the length of a list.
    #[inline]
    fn count(&mut self, kind: Scalar) -> RowResult<u64> {
        let count = self.number(kind)?;
        if count < 0.0 { Err(Fault::NegativeCount(count)) } else { Ok(count as u64) }
    }

    /// Skips the value or the list of one property.
    #[inline]
    fn skip_property(&mut self, shape: PropertyType) -> RowResult<()> {
        match shape {
            PropertyType::Single(kind) => self.skip(kind, 1),
            PropertyType::List { count, item } => {
                let count = self.count(count)?;
                self.skip(item, count)
            }
        }
    }
}

/// Reads the rows of a block of binary data. `layout` has checked that they end inside the block.
pub(super) struct BinaryRow<'a> {
    data: &'a [u8],
    at: usize,
    big: bool,
}

impl<'a> BinaryRow<'a> {
    pub(super) fn new(data: &'a [u8], block: &RowBlock, big: bool) -> Self {
        Self { data, at: block.start, big }
    }

    fn need(&self, bytes: u64) -> RowResult<usize> {
        let left = self.data.len() - self.at;
        usize::try_from(bytes).ok().filter(|b| *b <= left).ok_or(Fault::Short { at_end: true })
    }
}

impl Row for BinaryRow<'_> {
    fn begin(&mut self) {}

    #[inline]
    fn number(&mut self, kind: Scalar) -> RowResult<f64> {
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
    fn skip(&mut self, kind: Scalar, count: u64) -> RowResult<()> {
        self.at += self.need(count.saturating_mul(kind.size() as u64))?;
        Ok(())
    }

    fn end(&mut self) -> RowResult<()> {
        Ok(())
    }

    fn line(&self) -> Option<u64> {
        None
    }
}
