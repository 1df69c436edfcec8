//! The rows of one element, read block by block in parallel.

use rayon::prelude::*;

use super::block::{Block, Span, expected, too_short};
use super::header::Element;
use super::job::Job;
use super::lines::Text;
use super::row::{Binary, Fault, Row, Values};
use crate::error::{Error, Result};

/// Blocks that are in memory twice at the same time, in their own arrays and joined: some
/// megabytes.
const LEAST_BATCH: usize = 32;

/// Where the rows of one element are, for reading and for messages.
pub(super) struct Table<'a> {
    pub(super) data: &'a [u8],
    /// `None`: text.
    pub(super) big: Option<bool>,
    pub(super) span: &'a Span,
    pub(super) element: &'a Element,
    pub(super) job: Job<'a>,
}

impl Table<'_> {
    /// Runs `read` over all blocks in parallel and gives the results to `take` in order, some
    /// blocks at a time; stops at the first error in the order of the file, whatever the threads
    /// do.
    pub(super) fn blocks<T: Send>(
        &self,
        read: impl Fn(&mut Reader<'_, '_>) -> Result<T> + Sync,
        mut take: impl FnMut(T) -> Result<()>,
    ) -> Result<()> {
        let batch = LEAST_BATCH.max(8 * rayon::current_num_threads());
        for blocks in self.span.blocks.chunks(batch) {
            self.job.check()?;
            let read = |block| read(&mut Reader { table: self, block });
            let results: Vec<Result<T>> = blocks.par_iter().map(read).collect();
            for result in results {
                take(result?)?;
            }
        }
        Ok(())
    }

    /// An error in row `row`.
    pub(super) fn fault(&self, row: u64, line: Option<u64>, fault: Fault) -> Error {
        let (name, element) = (self.job.name, &self.element.name);
        match (fault, line) {
            (Fault::Short { at_end: true }, _) => {
                let have = "its last line is incomplete";
                too_short(self.element, row, have, &self.job)
            }
            (fault, Some(line)) => {
                let values = expected(self.element);
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
            None => self.run(Text::new(data, self.block), sink),
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
