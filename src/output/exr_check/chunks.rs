//! Compares the sizes that the chunks of an EXR state with the length of the file. The `exr` crate
//! allocates what a chunk states, up to the size of a tile or of a block of rows, before it reads
//! the chunk.

use std::fs::File;
use std::io::{Read, Result, Seek, SeekFrom};

use exr::meta::BlockDescription;
use exr::meta::header::Header;

use crate::output::exr::{is_multi_part, read_sorted};

/// Bytes before a chunk's data, at most: its part, the coordinates of a tile, three sizes of deep
/// data.
const MAX_START: u64 = 4 + 16 + 24;

/// Where the chunks of a file begin.
pub struct Table {
    /// Offset in the file of each chunk, part after part.
    pub offsets: Vec<u64>,
    /// Whether chunks begin with the number of their part.
    pub several: bool,
    /// Offset of the byte after the table.
    end: u64,
}

/// Reads the table of a file of `length` bytes. Returns `None` if it is cut short.
///
/// # Errors
/// For a file that cannot be read.
pub fn table(file: &mut File, length: u64, headers: &[Header]) -> Result<Option<Table>> {
    file.rewind()?;
    let start = read_sorted(file)?;
    let begin = start.len() as u64;
    let counts = headers.iter().map(|header| header.chunk_count as u64);
    let count = counts.fold(0, u64::saturating_add);
    let end = begin.saturating_add(count.saturating_mul(8));
    if end > length {
        return Ok(None);
    }
    file.seek(SeekFrom::Start(begin))?;
    let mut bytes = Vec::new();
    file.take(end - begin).read_to_end(&mut bytes)?;
    let number = |eight: &[u8]| eight.iter().rev().fold(0, |sum, byte| sum << 8 | u64::from(*byte));
    let offsets = bytes.chunks_exact(8).map(number).collect();
    Ok(Some(Table { offsets, several: is_multi_part(&start), end }))
}

/// Returns true if a chunk states more bytes than the file has, and the `exr` crate would allocate
/// them. Reads the starts of all chunks, if the crate may allocate more than the file's length.
///
/// # Errors
/// For a file that cannot be read.
pub fn exceed(file: &mut File, length: u64, headers: &[Header]) -> Result<bool> {
    if headers.iter().all(|header| max_block_bytes(header) <= length) {
        return Ok(false);
    }
    // The crate refuses a table that is cut short.
    let Some(Table { offsets, several, end }) = table(file, length, headers)? else {
        return Ok(false);
    };
    let mut chunks = Chunks { file, length, headers, several };
    // Chunks are read at the offsets of the table or one after another. These differ in few files.
    let mut next = end;
    for start in offsets {
        let Some(mut end) = chunks.end(start)? else { return Ok(true) };
        if start != next {
            let Some(other) = chunks.end(next)? else { return Ok(true) };
            end = other;
        }
        next = end;
    }
    Ok(false)
}

/// Returns the most bytes that the `exr` crate allocates for a chunk.
fn max_block_bytes(header: &Header) -> u64 {
    let [width, height] = match header.blocks {
        BlockDescription::Tiles(tiles) => [tiles.tile_size.width(), tiles.tile_size.height()],
        BlockDescription::ScanLines => {
            [header.layer_size.width(), header.compression.scan_lines_per_block()]
        }
    };
    let pixels = (width as u64).saturating_mul(height as u64);
    pixels.saturating_mul(header.channels.bytes_per_pixel as u64)
}

struct Chunks<'a> {
    file: &'a mut File,
    length: u64,
    headers: &'a [Header],
    /// Whether chunks begin with the number of their part.
    several: bool,
}

impl Chunks<'_> {
    /// Returns where the chunk at an offset ends, or `None` if it states more bytes than the file
    /// has. What is no chunk ends with the file.
    fn end(&mut self, offset: u64) -> Result<Option<u64>> {
        if offset >= self.length {
            return Ok(Some(self.length));
        }
        self.file.seek(SeekFrom::Start(offset))?;
        let mut start = Vec::new();
        self.file.by_ref().take(MAX_START).read_to_end(&mut start)?;
        let number = |at: usize| {
            let four = start.get(at..at + 4)?;
            u32::try_from(i32::from_le_bytes(four.try_into().ok()?)).ok()
        };
        let long = |at: usize| Some(u64::from_le_bytes(start.get(at..at + 8)?.try_into().ok()?));
        let part = if self.several { number(0) } else { Some(0) };
        let header = part.and_then(|part| self.headers.get(part as usize));
        let Some(header) = header else { return Ok(Some(self.length)) };
        let coordinates = if header.blocks == BlockDescription::ScanLines { 4 } else { 16 };
        let sizes = if self.several { 4 } else { 0 } + coordinates;
        let (stated, data) = if header.deep {
            // The packed table of counts, the packed samples, and these unpacked.
            ([long(sizes), long(sizes + 8)], sizes + 24)
        } else {
            ([number(sizes).map(u64::from), Some(0)], sizes + 4)
        };
        let [Some(first), Some(second)] = stated else { return Ok(Some(self.length)) };
        let most = max_block_bytes(header);
        if [first, second].iter().any(|&size| size > self.length && size <= most) {
            return Ok(None);
        }
        let end = [data as u64, first, second].into_iter().fold(offset, u64::saturating_add);
        Ok(Some(end))
    }
}
