//! Locates the rows of every element before memory is allocated for them.
//!
//! This detects a false header: each declared row must be in the file. Rows without lists all have
//! the same size. If there are lists, a pass compares their counts with those of the first row. If
//! they are equal, row n starts at n times the size of a row. Otherwise a second pass walks from
//! row to row, list by list.

use super::block::{RowBlock, Span, Uniform, too_short};
use super::context::ReadContext;
use super::header::{Element, Format, Header, PropertyType};
use super::scalar::Scalar;
use crate::error::{Error, Result};
use crate::parallel;
use crate::units::counted;

/// Maximum number of rows that one task reads.
const ROWS_PER_BLOCK: u64 = 1 << 14;

/// Locates the rows of every element. The second value is the number of bytes after the last row.
pub(super) fn locate(
    data: &[u8],
    header: &Header,
    context: &ReadContext,
) -> Result<(Vec<Span>, u64)> {
    if header.format == Format::Ascii {
        return super::lines::locate(data, header, context);
    }
    let mut at = 0;
    let mut spans = Vec::with_capacity(header.elements.len());
    for element in &header.elements {
        let binary = BinaryRows { data, element, big: header.format == Format::Big, context };
        let (mut span, mut end) = binary.rows(at, 0, element.count)?;
        if span.rows < element.count && !is_fixed(element) {
            // Later rows may be shorter than the first one.
            (span, end) = binary.walk(at, 0, element.count)?;
        }
        if span.rows < element.count {
            let left = data.len() - at;
            let stride = span.uniform.filter(|_| is_fixed(element)).map(|u| u.stride as u64);
            let have = match stride.map(|stride| (element.count.checked_mul(stride), stride)) {
                Some((Some(need), _)) => format!("they need {need} bytes, {left} are left"),
                Some((None, stride)) => {
                    format!("they need {stride} bytes each, {left} bytes are left")
                }
                None => {
                    let bytes = ["byte of data was", "bytes of data were"];
                    format!("{} left for them", counted(left as u64, bytes))
                }
            };
            return Err(too_short(element, span.rows, &have, context));
        }
        spans.push(span);
        at = end;
    }
    Ok((spans, (data.len() - at) as u64))
}

/// Returns true if the element has no lists, so that all its rows have the same size.
fn is_fixed(element: &Element) -> bool {
    element.properties.iter().all(|p| matches!(p.shape, PropertyType::Single(_)))
}

/// Rows of one element in a binary file.
pub(super) struct BinaryRows<'a> {
    pub(super) data: &'a [u8],
    pub(super) element: &'a Element,
    pub(super) big: bool,
    pub(super) context: &'a ReadContext<'a>,
}

impl BinaryRows<'_> {
    /// Locates rows from byte `start` on, where row `first` begins: `wanted` rows, or fewer. Also
    /// returns the offset of their end. Fewer rows do not prove that the data ends: if all rows
    /// found have the size of the first one, shorter rows may follow.
    pub(super) fn rows(&self, start: usize, first: u64, wanted: u64) -> Result<(Span, usize)> {
        if wanted == 0 || self.element.properties.is_empty() {
            return Ok((Span { first, rows: wanted, ..Span::default() }, start));
        }
        let fixed = is_fixed(self.element);
        if let Some(uniform) = self.first_row(start) {
            let stride = uniform.stride as u64;
            let rows = wanted.min((self.data.len() - start) as u64 / stride);
            if fixed || rows > 0 && self.all_alike(&uniform, rows) {
                let blocks = (0..rows.div_ceil(ROWS_PER_BLOCK)).map(|block| {
                    let row = block * ROWS_PER_BLOCK;
                    let rows = ROWS_PER_BLOCK.min(rows - row);
                    let begin = start + (row * stride) as usize;
                    let end = begin + (rows * stride) as usize;
                    RowBlock { start: begin, end, row: first + row, rows, line: 0 }
                });
                let blocks = blocks.collect();
                let end = start + (rows * stride) as usize;
                return Ok((Span { first, rows, uniform: Some(uniform), blocks }, end));
            }
        }
        self.walk(start, first, wanted)
    }

    /// Returns the layout of the first row. `None` if the data ends before its last list count, or
    /// if a count is negative. The values of the row may be incomplete.
    fn first_row(&self, start: usize) -> Option<Uniform> {
        let mut uniform = Uniform { start, stride: 0, offsets: Vec::new(), lengths: Vec::new() };
        let mut at = start;
        for property in &self.element.properties {
            let (item, length) = match property.shape {
                PropertyType::Single(kind) => (kind, 1),
                PropertyType::List { count, item } => {
                    let length = count_at(self.data, at, count, self.big)?;
                    at += count.size();
                    (item, u64::try_from(length).ok()?)
                }
            };
            uniform.offsets.push(at - start);
            uniform.lengths.push(length);
            let bytes = usize::try_from(length.checked_mul(item.size() as u64)?).ok()?;
            at = at.checked_add(bytes)?;
        }
        // The caller compares the stride with the size of the data.
        uniform.stride = at - start;
        Some(uniform)
    }

    /// Returns true if the lists of every row are as long as those of the first row. The proof is
    /// by induction: if this holds for rows 0 to n - 1, row n starts at n times the stride.
    fn all_alike(&self, uniform: &Uniform, rows: u64) -> bool {
        let (big, stride) = (self.big, uniform.stride);
        let layout = uniform.offsets.iter().zip(&uniform.lengths);
        let lists = self.element.properties.iter().zip(layout);
        let lists = lists.filter_map(|(property, (offset, length))| match property.shape {
            PropertyType::List { count, .. } => {
                Some((offset - count.size(), count, *length as i64))
            }
            PropertyType::Single(_) => None,
        });
        let lists: Vec<(usize, Scalar, i64)> = lists.collect();
        let rows = &self.data[uniform.start..uniform.start + rows as usize * stride];
        let alike = |row: &[u8]| match lists[..] {
            [(at, Scalar::U8, length)] => row[at] as i64 == length,
            _ => {
                lists.iter().all(|&(at, kind, length)| count_at(row, at, kind, big) == Some(length))
            }
        };
        let blocks: Vec<&[u8]> = rows.chunks(stride * ROWS_PER_BLOCK as usize).collect();
        let differs =
            |i: usize| self.context.stopped() || !blocks[i].chunks_exact(stride).all(alike);
        parallel::first(blocks.len(), &differs).is_none()
    }

    /// Locates rows one after the other, list by list.
    fn walk(&self, start: usize, first: u64, wanted: u64) -> Result<(Span, usize)> {
        let mut blocks: Vec<RowBlock> = Vec::new();
        let mut at = start;
        let mut rows = 0;
        while rows < wanted {
            let Some(end) = self.walk_row(at, first + rows)? else {
                break;
            };
            match blocks.last_mut() {
                Some(block) if block.rows < ROWS_PER_BLOCK => {
                    block.rows += 1;
                    block.end = end;
                }
                _ => {
                    self.context.check()?;
                    blocks.push(RowBlock { start: at, end, row: first + rows, rows: 1, line: 0 });
                }
            }
            at = end;
            rows += 1;
        }
        Ok((Span { first, rows, uniform: None, blocks }, at))
    }

    /// Returns the end of row `row`, which starts at byte `at`, or `None` if the data ends first. A
    /// negative list count is an error.
    #[inline]
    fn walk_row(&self, mut at: usize, row: u64) -> Result<Option<usize>> {
        for property in &self.element.properties {
            let (list, bytes) = match property.shape {
                PropertyType::Single(kind) => (0, kind.size() as u64),
                PropertyType::List { count, item } => {
                    match count_at(self.data, at, count, self.big) {
                        None => return Ok(None),
                        Some(length) if length < 0 => {
                            let place =
                                format!("{}: {} {row}", self.context.name, self.element.name);
                            let message =
                                format!("the list '{}' has {length} values", property.name);
                            return Err(Error::invalid(place, message));
                        }
                        Some(length) => (count.size(), length as u64 * item.size() as u64),
                    }
                }
            };
            at += list;
            if bytes > (self.data.len() - at) as u64 {
                return Ok(None);
            }
            at += bytes as usize;
        }
        Ok(Some(at))
    }
}

/// Reads the list count at byte `at`. Returns `None` if the data ends before the count does.
#[inline]
fn count_at(data: &[u8], at: usize, kind: Scalar, big: bool) -> Option<i64> {
    if kind == Scalar::U8 {
        return data.get(at).map(|b| *b as i64);
    }
    let end = at.checked_add(kind.size())?;
    (end <= data.len()).then(|| kind.read(data, at, big) as i64)
}
