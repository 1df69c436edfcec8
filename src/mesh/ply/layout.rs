//! Where the rows of every element stand, found before anything is allocated for them.
//!
//! This is where a header that lies is caught: each declared row must be in the file. Rows whose
//! lists are all as long as the first row's have one stride and need no walk; other lists are
//! walked once, from count to count.

use rayon::prelude::*;

use super::block::{Block, Span, Uniform, too_short};
use super::header::{Element, Format, Header, Shape};
use super::scalar::Scalar;
use crate::error::{Error, Result};

/// Rows that one task reads.
const ROWS: u64 = 1 << 14;

/// Finds the rows of every element; the second value is the bytes after the last row.
pub(super) fn locate(data: &[u8], header: &Header, name: &str) -> Result<(Vec<Span>, u64)> {
    if header.format == Format::Ascii {
        return super::lines::locate(data, header, name);
    }
    let big = header.format == Format::Big;
    let mut at = 0;
    let mut spans = Vec::with_capacity(header.elements.len());
    for element in &header.elements {
        let (span, end) = find(data, at, element, big, name)?;
        spans.push(span);
        at = end;
    }
    Ok((spans, (data.len() - at) as u64))
}

fn find(
    data: &[u8],
    start: usize,
    element: &Element,
    big: bool,
    name: &str,
) -> Result<(Span, usize)> {
    let left = (data.len() - start) as u64;
    let fixed = element.properties.iter().all(|p| matches!(p.shape, Shape::Single(_)));
    if element.count == 0 || element.properties.is_empty() {
        return Ok((Span::default(), start));
    }
    if let Some(uniform) = first_row(data, start, element, big) {
        let stride = uniform.stride as u64;
        let total = element.count.checked_mul(stride).filter(|total| *total <= left);
        if let Some(total) = total.filter(|_| fixed || all_alike(data, &uniform, element, big)) {
            let blocks = (0..element.count.div_ceil(ROWS)).map(|block| {
                let row = block * ROWS;
                let rows = ROWS.min(element.count - row);
                let begin = start + (row * stride) as usize;
                Block { start: begin, end: begin + (rows * stride) as usize, row, rows, line: 0 }
            });
            let blocks = blocks.collect();
            return Ok((Span { uniform: Some(uniform), blocks }, start + total as usize));
        }
        if fixed {
            let have = match element.count.checked_mul(stride) {
                Some(need) => format!("they need {need} bytes, {left} are left"),
                None => format!("they need {stride} bytes each, {left} bytes are left"),
            };
            return Err(too_short(element, left / stride, &have, name));
        }
    }
    walk(data, start, element, big, name)
}

/// The layout of the first row, if it is all there.
fn first_row(data: &[u8], start: usize, element: &Element, big: bool) -> Option<Uniform> {
    let mut uniform = Uniform { start, stride: 0, offsets: Vec::new(), lengths: Vec::new() };
    let mut at = start;
    for property in &element.properties {
        let (item, length) = match property.shape {
            Shape::Single(kind) => (kind, 1),
            Shape::List { count, item } => {
                let length = count_at(data, at, count, big)?;
                at += count.size();
                (item, u64::try_from(length).ok()?)
            }
        };
        uniform.offsets.push(at - start);
        uniform.lengths.push(length);
        let bytes = usize::try_from(length.checked_mul(item.size() as u64)?).ok()?;
        at = at.checked_add(bytes)?;
    }
    // A single number's row may be cut short: the caller compares sizes.
    uniform.stride = at - start;
    Some(uniform)
}

/// The list length at byte `at`, unless the data ends before its end.
#[inline]
fn count_at(data: &[u8], at: usize, kind: Scalar, big: bool) -> Option<i64> {
    if kind == Scalar::U8 {
        return data.get(at).map(|b| *b as i64);
    }
    let end = at.checked_add(kind.size())?;
    (end <= data.len()).then(|| kind.read(data, at, big) as i64)
}

/// Whether every row's lists are as long as the first row's. By induction: if rows 0 to n - 1
/// are, row n starts where the stride says.
fn all_alike(data: &[u8], uniform: &Uniform, element: &Element, big: bool) -> bool {
    let lists: Vec<(usize, Scalar, i64)> = element
        .properties
        .iter()
        .zip(uniform.offsets.iter().zip(&uniform.lengths))
        .filter_map(|(property, (offset, length))| match property.shape {
            Shape::List { count, .. } => Some((offset - count.size(), count, *length as i64)),
            Shape::Single(_) => None,
        })
        .collect();
    let rows = &data[uniform.start..uniform.start + element.count as usize * uniform.stride];
    let alike = |row: &[u8]| match lists[..] {
        [(at, Scalar::U8, length)] => row[at] as i64 == length,
        _ => lists.iter().all(|&(at, kind, length)| count_at(row, at, kind, big) == Some(length)),
    };
    rows.par_chunks(uniform.stride * ROWS as usize)
        .all(|rows| rows.chunks_exact(uniform.stride).all(alike))
}

/// Goes through the rows of `element` list by list.
fn walk(
    data: &[u8],
    start: usize,
    element: &Element,
    big: bool,
    name: &str,
) -> Result<(Span, usize)> {
    let mut blocks: Vec<Block> = Vec::new();
    let mut at = start;
    for row in 0..element.count {
        let begin = at;
        for property in &element.properties {
            at = match skip(data, at, property.shape, big) {
                Ok(Some(end)) => end,
                Ok(None) => {
                    let have = format!("{} bytes of data were left for them", data.len() - start);
                    return Err(too_short(element, row, &have, name));
                }
                Err(length) => {
                    let place = format!("{name}: {} {row}", element.name);
                    let message = format!("the list '{}' has {length} values", property.name);
                    return Err(Error::invalid(place, message));
                }
            };
        }
        match blocks.last_mut() {
            Some(block) if block.rows < ROWS => {
                block.rows += 1;
                block.end = at;
            }
            _ => blocks.push(Block { start: begin, end: at, row, rows: 1, line: 0 }),
        }
    }
    Ok((Span { uniform: None, blocks }, at))
}

/// Where the property that starts at `at` ends; `None` behind the end of the data, an error for a
/// list of negative length.
#[inline]
fn skip(
    data: &[u8],
    at: usize,
    shape: Shape,
    big: bool,
) -> std::result::Result<Option<usize>, i64> {
    let (at, bytes) = match shape {
        Shape::Single(kind) => (at, kind.size() as u64),
        Shape::List { count, item } => match count_at(data, at, count, big) {
            None => return Ok(None),
            Some(length) if length < 0 => return Err(length),
            Some(length) => (at + count.size(), length as u64 * item.size() as u64),
        },
    };
    Ok(if bytes <= (data.len() - at) as u64 { Some(at + bytes as usize) } else { None })
}
