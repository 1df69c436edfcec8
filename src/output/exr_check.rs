//! Checks an EXR before it is decoded. The `exr` crate trusts some values that may be wrong in a
//! damaged file.

mod chunks;

use std::fs::File;
use std::io::{BufReader, Read, Seek};
use std::path::Path;

use exr::block::chunk::{Chunk, CompressedBlock};
use exr::block::read as read_blocks;
use exr::compression::Compression;
use exr::error::{Error as ExrError, Result as ExrResult};
use exr::io::Tracking;
use exr::meta::header::Header;
use exr::meta::{BlockDescription, MetaData};

use crate::error::{Error, ErrorKind, Problem, Result};

pub use self::chunks::table;

/// Number of 64-bit integers at the start of a DWAA or DWAB chunk (OpenEXR,
/// `internal_dwa_compressor.h`). They hold the version, then sizes and counts of the sections, then
/// the packing of the AC coefficients.
const COUNTERS: usize = 11;

/// Indices of the integers that are sizes or counts.
const SIZES: std::ops::Range<usize> = 1..10;

/// Upper bound of the ratio that a lossless compression of the format can reach. zlib reaches 1032;
/// PXR24 drops a byte of four before it.
const MAX_RATIO: u64 = 1400;

/// Factor of the ratio for DWAA and DWAB. Of 64 equal values of 4 bytes they keep one of 2 bytes.
const MAX_LOSSY_FACTOR: u64 = 128;

/// Reads the headers of a file from its start. `strict` refuses attributes that cannot
/// be read; otherwise they are skipped. All
/// callers have the type of reader of [`read_blocks`]: the crate is compiled once for each.
pub fn meta(mut file: &File, strict: bool) -> ExrResult<MetaData> {
    file.rewind()?;
    let file = Tracking::new(BufReader::new(file.try_clone()?));
    MetaData::read_from_buffered(file, strict)
}

/// Checks for values that make the `exr` crate divide by zero, or allocate far more memory than the
/// pixels need.
///
/// # Errors
/// `Invalid` for a file that is not readable EXR, a zero sampling factor, a file that is too short
/// for its pixels or its chunks, or a chunk that announces more than its pixels need.
/// `Unsupported` for a compression that cannot be read.
pub fn check(path: &Path) -> Result<()> {
    let failed = |error| exr_error(path, error);
    let file = File::open(path).map_err(|error| Error::io(path, "read", &error))?;
    let length = file.metadata().map_err(|error| Error::io(path, "read", &error))?.len();
    let blocks = read_blocks(BufReader::new(file), true).map_err(failed)?;
    let headers = blocks.headers().to_vec();
    if headers.iter().any(is_unreadable) {
        check_compression(path)?;
    }
    for channel in headers.iter().flat_map(|header| &header.channels.list) {
        if channel.sampling.x() == 0 || channel.sampling.y() == 0 {
            let message = format!("found a zero sampling factor in the channel `{}`", channel.name);
            return Err(Error::invalid(path.display().to_string(), message));
        }
    }
    check_length(path, length, &headers)?;
    check_chunks(path, &headers)?;
    if !headers.iter().any(is_dwa) {
        return Ok(());
    }
    for chunk in blocks.all_chunks(true).map_err(failed)? {
        let chunk = chunk.map_err(failed)?;
        let header = &headers[chunk.layer_index];
        let stored = stored_bytes(header, &chunk).map_err(failed)?;
        if is_dwa(header) && largest_stated_size(&chunk, stored) > max_stated_size(header) {
            let message = "found a chunk that announces more than its pixels need";
            return Err(Error::invalid(path.display().to_string(), message));
        }
    }
    Ok(())
}

/// Checks that an EXR holds every chunk that its headers declare. Reads the whole file, and decodes
/// nothing.
///
/// # Errors
/// `Invalid` for a file that is cut short or damaged.
pub fn check_whole(path: &Path) -> Result<()> {
    let failed = |error| exr_error(path, error);
    let file = File::open(path).map_err(|error| Error::io(path, "read", &error))?;
    let blocks = read_blocks(BufReader::new(file), true).map_err(failed)?;
    if blocks.headers().iter().any(|header| header.deep) {
        return Ok(());
    }
    check_chunks(path, blocks.headers())?;
    let mut chunks = blocks.all_chunks(true).map_err(failed)?;
    chunks.try_for_each(|chunk| chunk.map(drop)).map_err(failed)
}

/// Checks that no chunk states more bytes than the file has.
///
/// # Errors
/// `Invalid`, as for a file that is cut short.
fn check_chunks(path: &Path, headers: &[Header]) -> Result<()> {
    let exceed = || {
        let mut file = File::open(path)?;
        let length = file.metadata()?.len();
        chunks::exceed(&mut file, length, headers)
    };
    if exceed().map_err(|error| exr_error(path, error.into()))? {
        return Err(exr_error(path, ExrError::Invalid("reference to missing bytes".into())));
    }
    Ok(())
}

/// Checks that a file of `length` bytes can hold the pixels that its headers declare. All sampling
/// factors must be above zero.
///
/// # Errors
/// `Invalid` for a file that is too short.
fn check_length(path: &Path, length: u64, headers: &[Header]) -> Result<()> {
    for header in headers.iter().filter(|header| !header.deep) {
        let lossy = if is_dwa(header) { MAX_LOSSY_FACTOR } else { 1 };
        if pixel_bytes(header) > length.saturating_mul(lossy * MAX_RATIO) {
            let message = "found fewer bytes than its size needs, expected a complete file";
            return Err(Error::invalid(path.display().to_string(), message));
        }
    }
    Ok(())
}

/// Returns the size in bytes of a header's pixels at full resolution, or less where a sampling
/// factor does not divide the size.
fn pixel_bytes(header: &Header) -> u64 {
    let bytes = header.channels.list.iter().map(|channel| {
        let (size, sampling) = (header.layer_size, channel.sampling);
        let samples = [size.x() / sampling.x(), size.y() / sampling.y()];
        (samples[0] as u64)
            .saturating_mul(samples[1] as u64)
            .saturating_mul(channel.sample_type.bytes_per_sample() as u64)
    });
    bytes.fold(0, u64::saturating_add)
}

/// Returns true if the `exr` crate knows the compression by name but cannot decode it.
fn is_unreadable(header: &Header) -> bool {
    matches!(header.compression, Compression::HTJ2K32 | Compression::HTJ2K256)
}

fn is_dwa(header: &Header) -> bool {
    matches!(header.compression, Compression::DWAA(_) | Compression::DWAB(_))
}

/// Returns the size in bytes of a chunk's pixels. A chunk of this size is stored uncompressed,
/// because compression did not make it smaller.
fn stored_bytes(header: &Header, chunk: &Chunk) -> ExrResult<usize> {
    let indices = header.get_block_data_indices(&chunk.compressed_block)?;
    let bounds = header.get_absolute_block_pixel_coordinates(indices)?;
    Ok(bounds.size.area().saturating_mul(header.channels.bytes_per_pixel))
}

/// Returns the largest size or count that a DWAA or DWAB chunk states. Returns 0 if the chunk is
/// too short for the integers, or if it has `stored` bytes and so is uncompressed.
fn largest_stated_size(chunk: &Chunk, stored: usize) -> u64 {
    let bytes = match &chunk.compressed_block {
        CompressedBlock::ScanLine(block) => &block.compressed_pixels_le,
        CompressedBlock::Tile(block) => &block.compressed_pixels_le,
        CompressedBlock::DeepScanLine(_) | CompressedBlock::DeepTile(_) => return 0,
    };
    if bytes.len() == stored {
        return 0;
    }
    let Some(counters) = bytes.get(..8 * COUNTERS) else { return 0 };
    let values = counters
        .chunks_exact(8)
        .map(|eight| eight.iter().rev().fold(0, |n, b| n << 8 | u64::from(*b)));
    values.enumerate().filter(|(i, _)| SIZES.contains(i)).map(|(_, value)| value).max().unwrap_or(0)
}

/// Returns an upper bound for every size and count in a valid chunk: four times the bytes of its
/// pixels, with 8 more pixels on each axis for incomplete blocks of 8 x 8, plus 4 KiB.
fn max_stated_size(header: &Header) -> u64 {
    let (width, height) = match header.blocks {
        BlockDescription::ScanLines => {
            (header.layer_size.width(), header.compression.scan_lines_per_block())
        }
        BlockDescription::Tiles(tiles) => (tiles.tile_size.width(), tiles.tile_size.height()),
    };
    let pixels = (width as u64 + 8).saturating_mul(height as u64 + 8);
    pixels.saturating_mul(4 * header.channels.bytes_per_pixel as u64).saturating_add(1 << 12)
}

/// The bytes of the compression attribute in a header. The number of the compression follows them.
const COMPRESSION: &[u8] = b"compression\0compression\0\x01\0\0\0";

/// The highest number of a compression that can be read: DWAB.
const LAST_COMPRESSION: u8 = 9;

/// Checks whether an EXR has a compression that the `exr` crate does not support. Searches the
/// first 64 KiB. Returns `Ok` for a file that is not EXR or cannot be read.
///
/// # Errors
/// `Unsupported`, with the name of the compression.
pub fn check_compression(path: &Path) -> Result<()> {
    let mut start = Vec::new();
    let Ok(file) = File::open(path) else { return Ok(()) };
    if file.take(1 << 16).read_to_end(&mut start).is_err() || !start.starts_with(b"v/1\x01") {
        return Ok(());
    }
    let length = COMPRESSION.len();
    let numbers = start.windows(length + 1).filter(|window| window.starts_with(COMPRESSION));
    let Some(number) = numbers.map(|window| window[length]).find(|&n| n > LAST_COMPRESSION) else {
        return Ok(());
    };
    let name = match number {
        10 => "HTJ2K256".to_string(),
        11 => "HTJ2K32".to_string(),
        13 => "ZSTD".to_string(),
        other => format!("number {other}"),
    };
    let message = format!(
        "found the compression {name}, expected none, RLE, ZIPS, ZIP, PIZ, PXR24, B44, B44A, DWAA or DWAB"
    );
    Err(Error::new(ErrorKind::Unsupported, Problem::new(path.display().to_string(), message))
        .help("save the file with ZIP: nothing is lost"))
}

/// Converts an error of the `exr` crate to an error about the file. An unsupported compression
/// takes precedence.
pub fn exr_error(path: &Path, error: ExrError) -> Error {
    if let Err(unknown) = check_compression(path) {
        return unknown;
    }
    let (kind, message) = match error {
        ExrError::Io(error) if error.kind() != std::io::ErrorKind::UnexpectedEof => {
            return Error::io(path, "read", &error);
        }
        ExrError::NotSupported(what) => {
            (ErrorKind::Unsupported, format!("cannot read this EXR: {what}"))
        }
        other => (ErrorKind::Invalid, format!("cannot read this EXR: {other}")),
    };
    Error::new(kind, Problem::new(path.display().to_string(), message))
}
