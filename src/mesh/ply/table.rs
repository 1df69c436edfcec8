//! Reads the rows of one element block by block, in parallel.

use super::block::{RowBlock, Span, expected, too_short};
use super::context::ReadContext;
use super::header::Element;
use super::lines::Text;
use super::row::{BinaryRow, Fault, Row, RowResult};
use crate::error::{Error, Result};
use crate::parallel;

/// Minimum number of blocks per batch. The blocks of a batch are in memory twice, separate and
/// joined: some megabytes.
const MIN_BATCH: usize = 32;

/// The rows of one element, with what is needed to read them and to report errors.
pub(super) struct Table<'a> {
    pub(super) data: &'a [u8],
    /// True for big-endian data, false for little-endian, `None` for text.
    pub(super) big: Option<bool>,
    pub(super) span: &'a Span,
    pub(super) element: &'a Element,
    pub(super) context: ReadContext<'a>,
}

impl Table<'_> {
    /// Calls `read` for all blocks in parallel, one batch at a time. The results go to `take` in
    /// file order. Returns the first error in file order, independent of the threads.
    pub(super) fn blocks<T: Send>(
        &self,
        read: impl Fn(&mut Reader<'_, '_>) -> Result<T> + Sync,
        mut take: impl FnMut(T) -> Result<()>,
    ) -> Result<()> {
        let batch = MIN_BATCH.max(8 * rayon::current_num_threads());
        for blocks in self.span.blocks.chunks(batch) {
            self.context.check()?;
            let read = |block| read(&mut Reader { table: self, block });
            for result in parallel::map(blocks.iter(), read) {
                take(result?)?;
            }
        }
        Ok(())
    }

    /// Makes the error for a fault in row `row`.
    pub(super) fn fault(&self, row: u64, line: Option<u64>, fault: Fault) -> Error {
        let (name, element) = (self.context.name, &self.element.name);
        match (fault, line) {
            (Fault::Short { at_end: true }, _) => {
                let have = "its last line is incomplete";
                too_short(self.element, row, have, &self.context)
            }
            (Fault::Memory(error), _) => *error,
            (fault, Some(line)) => {
                let values = expected(self.element);
                Error::invalid(format!("{name}:{line}"), format!("{element} {row}: {fault}"))
                    .help(format!("expected: {values}"))
            }
            (fault, None) => Error::invalid(format!("{name}: {element} {row}"), fault.to_string()),
        }
    }
}

/// Reads one block of a table.
pub(super) struct Reader<'a, 'b> {
    table: &'a Table<'b>,
    block: &'a RowBlock,
}

/// A consumer of the rows of a block.
pub(super) trait RowConsumer {
    /// Reads the values of the row with index `row`.
    fn take<R: Row>(&mut self, values: &mut R, row: u64) -> RowResult<()>;
}

impl Reader<'_, '_> {
    /// Returns the number of rows in the block.
    pub(super) fn rows(&self) -> u64 {
        self.block.rows
    }

    /// Passes every row to `sink`.
    pub(super) fn feed(&self, sink: &mut impl RowConsumer) -> Result<()> {
        let Table { data, big, .. } = *self.table;
        match big {
            None => self.run(Text::new(data, self.block), sink),
            Some(big) => self.run(BinaryRow::new(data, self.block, big), sink),
        }
    }

    fn run<R: Row>(&self, mut values: R, sink: &mut impl RowConsumer) -> Result<()> {
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
