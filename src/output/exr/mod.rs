//! Writes the EXR: linear BT.709 radiance for compositing, and the layers.
//!
//! The default file has scanlines, ZIP compression, and the half channels `R G B A` without a layer
//! name, premultiplied. The display window is the whole frame, the data window is the rendered
//! part.
//!
//! The same film and options give the same bytes. Therefore the line order is set explicitly: the
//! default of the `exr` crate depends on threads. The header's attributes are sorted afterwards:
//! the crate keeps them in a hash map.
//!
//! Blocks are compressed on the caller's rayon pool, only a few ahead of the block that is being
//! written. So there is no second buffer of the size of the film.

mod header;
mod options;
mod ordered;
mod parts;
mod rows;
mod sorted;
pub mod text;
mod zip;

use std::io::{BufWriter, Read, Seek, SeekFrom, Write};
use std::path::Path;

use exr::block::chunk::{Chunk, CompressedBlock, CompressedScanLineBlock};
use exr::block::writer::ChunksWriter;
use exr::block::{BlockIndex, UncompressedBlock};
use exr::error::{Error as ExrError, Result as ExrResult};
use exr::meta::header::Header;

use crate::error::{Error, ErrorKind, Problem, Result};
use crate::film::Film;
use crate::simd::{Isa, dispatch};

pub use self::options::{CameraMatrices, Compression, DWA_MAX, Options, Sequence};
pub use self::parts::layer_of;
pub use self::sorted::{is_multi_part, read_sorted};

use self::parts::ExrPart;
use self::rows::Fill;
use self::sorted::{FLAGS, LONG_NAMES, SHORT_NAME_BYTES};
use self::zip::Zip;

/// Writes the film to an empty `file`; `path` is for messages. NaN becomes 0, and values
/// are clamped to the range of their channel: see [`super::ValueCounts`].
///
/// # Errors
/// `Retry` if the disk is full. `Limit` for a side of 2^31 pixels or more, or attributes that the
/// format cannot hold.
pub fn write<F: Read + Write + Seek + Send>(
    film: &Film,
    options: &Options,
    file: &mut F,
    path: &Path,
) -> Result<()> {
    let parts = parts::parts(film, options);
    let headers: Option<_> = parts.iter().map(|part| header::header(film, options, part)).collect();
    let headers = headers
        .ok_or_else(|| unwritable(path, "its size or attributes do not fit into an EXR file"))?;
    let mut buffered = BufWriter::with_capacity(1 << 20, &mut *file);
    let long_names = long_names(&parts);
    let written = exr::block::write(&mut buffered, headers, true, |meta, writer| {
        let blocks = Blocks { film, parts: &parts, options, headers: &meta.headers };
        blocks.stream(writer)
    });
    written.map_err(|error| exr_error(path, error))?;
    // Dropping a BufWriter would ignore the error of a full disk.
    let flushed = buffered.flush();
    drop(buffered);
    let finished = flushed.and_then(|()| finish_header(file, long_names));
    finished.map_err(|error| Error::io(path, "write", &error))
}

/// Returns true if a channel's name is longer than readers without the flag [`LONG_NAMES`] expect.
fn long_names(parts: &[ExrPart]) -> bool {
    let mut names = parts.iter().flat_map(|part| &part.sources).map(|source| source.name);
    names.any(|name| name.len() > SHORT_NAME_BYTES)
}

/// Encodes the blocks of a file.
struct Blocks<'a> {
    film: &'a Film,
    parts: &'a [ExrPart<'a>],
    options: &'a Options<'a>,
    headers: &'a [Header],
}

impl Blocks<'_> {
    /// Writes all blocks in file order.
    fn stream(&self, writer: &mut (impl ChunksWriter + Send)) -> ExrResult<()> {
        let blocks: Vec<(usize, BlockIndex)> =
            exr::block::enumerate_ordered_header_block_indices(self.headers).collect();
        let isa = Isa::detect();
        ordered::produce_in_order(
            blocks.len(),
            Zip::new,
            |zip, number| self.chunk(zip, isa, &blocks[number].1),
            |number, chunk| writer.write_chunk(blocks[number].0, chunk),
        )
    }

    /// Encodes one block for the file.
    fn chunk(&self, zip: &mut Zip, isa: Isa, index: &BlockIndex) -> ExrResult<Chunk> {
        let (header, sources) = (&self.headers[index.layer], &self.parts[index.layer].sources);
        let top = index.pixel_position.y();
        let rows = top..top + index.pixel_size.height();
        let exact = self.options.exact;
        match self.options.compression {
            Compression::Zip | Compression::Zips if cfg!(target_endian = "little") => {
                let bytes = &mut zip.raw;
                dispatch(isa, Fill { bytes, film: self.film, sources, rows, exact });
                let block = CompressedScanLineBlock {
                    y_coordinate: header.own_attributes.layer_position.y() + top as i32,
                    compressed_pixels_le: zip.compress(isa),
                };
                let compressed_block = CompressedBlock::ScanLine(block);
                Ok(Chunk { layer_index: index.layer, compressed_block })
            }
            _ => {
                let mut data = Vec::new();
                dispatch(isa, Fill { bytes: &mut data, film: self.film, sources, rows, exact });
                UncompressedBlock { index: *index, data }.compress_to_chunk(self.headers)
            }
        }
    }
}

/// Sorts the attributes of the header in place. Neither the header's length nor the offsets after
/// it change. With `long_names`, also sets [`LONG_NAMES`]: the `exr` crate sets the flag only for
/// names of attributes.
fn finish_header<F: Read + Write + Seek>(file: &mut F, long_names: bool) -> std::io::Result<()> {
    file.seek(SeekFrom::Start(0))?;
    let mut header = read_sorted(file)?;
    if long_names {
        header[FLAGS] |= LONG_NAMES;
    }
    file.seek(SeekFrom::Start(0))?;
    file.write_all(&header)?;
    file.seek(SeekFrom::End(0))?;
    file.flush()
}

fn unwritable(path: &Path, why: &str) -> Error {
    let message = format!("cannot write: {why}");
    Error::new(ErrorKind::Limit, Problem::new(path.display().to_string(), message))
}

fn exr_error(path: &Path, error: ExrError) -> Error {
    match error {
        ExrError::Io(error) => Error::io(path, "write", &error),
        other => unwritable(path, &other.to_string()),
    }
}
