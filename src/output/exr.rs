//! The EXR: linear BT.709 radiance as compositors expect it, and the layers beside it.
//!
//! Single part, scanlines, ZIP, unnamed half `R G B A` premultiplied, display window = the whole
//! frame, data window = what was rendered. The same film and attributes give the same bytes: the
//! encoding is stated (the `exr` crate's default order depends on threads) and the header's
//! attributes are sorted afterwards (the crate keeps them in a hash map). Blocks are compressed on
//! the caller's rayon pool, some at a time, so that nothing of the size of the film stands beside it.

use std::{
    io::{BufWriter, Read, Seek, SeekFrom, Write},
    path::Path,
};

use exr::{
    block::{BlockIndex, UncompressedBlock, chunk::Chunk, writer::ChunksWriter},
    error::Error as ExrError,
    math::Vec2,
    meta::{
        BlockDescription,
        attribute::{
            AttributeValue, ChannelDescription, Chromaticities, IntegerBounds, LineOrder,
            SampleType, Text,
        },
        header::{Header, ImageAttributes, LayerAttributes},
    },
};
use half::{f16, slice::HalfFloatSliceExt};
use rayon::prelude::*;

use crate::{
    error::{Error, Kind, Problem, Result},
    film::{ChannelKind, Film},
};

use super::{HALF_MAX, exr_header, finite};

/// Rec. ITU-R BT.709 primaries and D65, as OpenEXR's own default states them.
const BT709: Chromaticities = Chromaticities {
    red: Vec2(0.64, 0.33),
    green: Vec2(0.30, 0.60),
    blue: Vec2(0.15, 0.06),
    white: Vec2(0.3127, 0.3290),
};

/// How blocks are compressed.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub enum Compression {
    /// zlib over 16 lines.
    #[default]
    Zip,
    /// zlib over single lines.
    Zips,
    /// Wavelets.
    Piz,
    /// Run lengths.
    Rle,
    /// Not at all.
    None,
    /// Lossy: DCT over 32 lines, of R, G, B, A.
    Dwaa,
}

/// Where the picture was taken from, in OpenEXR's convention: row vectors times matrices.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct View {
    /// World to camera space: x right, y up, z forward.
    pub world_to_camera: [f32; 16],
    /// World to (0, 0) top left, (1, 1) bottom right of the frame.
    pub world_to_ndc: [f32; 16],
    /// Width of the frame at distance 1.
    pub screen_window_width: f32,
}

/// What an EXR says and how it is stored.
#[derive(Debug, Clone, Copy, Default)]
pub struct Options<'a> {
    /// Custom strings by name.
    pub attributes: &'a [(String, String)],
    /// The camera.
    pub view: Option<View>,
    /// 32-bit floats in place of halves.
    pub float: bool,
    /// How blocks are compressed.
    pub compression: Compression,
}

/// Writes the film at the start of an empty `file`; `path` is for messages. NaN and infinities are
/// never written ([`super::Oddities`] counts them).
///
/// # Errors
/// `Retry` where the disk is full; `Limit` for more than 2^31 pixels a side or attributes that the
/// format cannot hold.
pub fn write<F: Read + Write + Seek>(
    film: &Film,
    options: &Options,
    file: &mut F,
    path: &Path,
) -> Result<()> {
    let sources = sources(film, options.float);
    let header = header(film, options, &sources)
        .ok_or_else(|| unwritable(path, "its size or attributes"))?;
    let mut buffered = BufWriter::with_capacity(1 << 20, &mut *file);
    let headers = [header].into_iter().collect();
    let written = exr::block::write(&mut buffered, headers, true, |meta, writer| {
        let blocks: Vec<(usize, BlockIndex)> =
            exr::block::enumerate_ordered_header_block_indices(&meta.headers).collect();
        for some in blocks.chunks(2 * rayon::current_num_threads()) {
            let compress = |(_, index): &(usize, BlockIndex)| {
                let block = UncompressedBlock { index: *index, data: bytes(film, &sources, index) };
                block.compress_to_chunk(&meta.headers)
            };
            let chunks: std::result::Result<Vec<Chunk>, ExrError> =
                some.par_iter().map(compress).collect();
            for ((position, _), chunk) in some.iter().zip(chunks?) {
                writer.write_chunk(*position, chunk)?;
            }
        }
        Ok(())
    });
    written.map_err(|error| exr_error(path, error))?;
    // Dropping a BufWriter would hide a full disk.
    let flushed = buffered.flush();
    drop(buffered);
    flushed.and_then(|()| sort_header(file)).map_err(|error| Error::io(path, "write", &error))
}

/// A channel of the file and where its values are.
struct Source<'a> {
    name: &'a str,
    kind: ChannelKind,
    /// Index into R, G, B, A, or else into a pixel's words.
    from: std::result::Result<usize, usize>,
}

/// The channels in the order of the file: by name.
fn sources(film: &Film, float: bool) -> Vec<Source<'_>> {
    let kind = |kind| match kind {
        ChannelKind::Half if float => ChannelKind::Float,
        kind => kind,
    };
    let beauty = ["R", "G", "B", "A"].into_iter().enumerate();
    let beauty =
        beauty.map(|(i, name)| Source { name, kind: kind(ChannelKind::Half), from: Ok(i) });
    let planes = film.planes.channels.iter().enumerate();
    let planes =
        planes.map(|(i, c)| Source { name: c.name.as_str(), kind: kind(c.kind), from: Err(i) });
    let mut sources: Vec<Source> = beauty.chain(planes).collect();
    sources.sort_by_key(|source| source.name);
    sources
}

/// The header in the crate's terms; `None` where the format cannot hold it.
fn header(film: &Film, options: &Options, sources: &[Source]) -> Option<Header> {
    let window = film.window;
    let size = Vec2(window.width() as usize, window.height() as usize);
    let frame = film.frame.map(|side| i32::try_from(side).ok());
    let frame = Vec2(frame[0]? as usize, frame[1]? as usize);
    let mut own = LayerAttributes {
        software_name: Text::new_or_none(format!("lightpath {}", env!("CARGO_PKG_VERSION"))),
        layer_position: Vec2(i32::try_from(window.x0).ok()?, i32::try_from(window.y0).ok()?),
        ..LayerAttributes::default()
    };
    if let Some(view) = options.view {
        own.world_to_camera = Some(view.world_to_camera);
        own.world_to_normalized_device = Some(view.world_to_ndc);
        own.screen_window_width = view.screen_window_width;
    }
    for (name, value) in options.attributes {
        let name = Text::new_or_none(name)?;
        own.other.insert(name, AttributeValue::Text(Text::new_or_none(value)?));
    }
    let channels = sources.iter().map(|source| {
        let kind = match source.kind {
            ChannelKind::Half => SampleType::F16,
            ChannelKind::Float => SampleType::F32,
            ChannelKind::Uint => SampleType::U32,
        };
        Some(ChannelDescription::new(Text::new_or_none(source.name)?, kind, false))
    });
    let channels: Option<_> = channels.collect();
    let shared = ImageAttributes {
        chromaticities: Some(BT709),
        ..ImageAttributes::new(IntegerBounds::from_dimensions(frame))
    };
    let compression = match options.compression {
        Compression::Zip => exr::compression::Compression::ZIP16,
        Compression::Zips => exr::compression::Compression::ZIP1,
        Compression::Piz => exr::compression::Compression::PIZ,
        Compression::Rle => exr::compression::Compression::RLE,
        Compression::None => exr::compression::Compression::Uncompressed,
        Compression::Dwaa => exr::compression::Compression::DWAA(None),
    };
    let header = Header::new(Text::from(""), size, channels?)
        .with_encoding(compression, BlockDescription::ScanLines, LineOrder::Increasing)
        .with_attributes(own)
        .with_shared_attributes(shared);
    Some(header)
}

/// The values of a block: line by line, channel by channel.
fn bytes(film: &Film, sources: &[Source], block: &BlockIndex) -> Vec<u8> {
    let width = film.window.width() as usize;
    let stride = film.planes.channels.len();
    let mut bytes = Vec::new();
    for y in block.pixel_position.1..block.pixel_position.1 + block.pixel_size.1 {
        let row = y * width..(y + 1) * width;
        let pixels = &film.pixels[row.clone()];
        let words = &film.planes.words[row.start * stride..row.end * stride];
        for source in sources {
            match source.from {
                Ok(axis) => {
                    append(&mut bytes, source.kind, pixels.iter().map(|p| p[axis].to_bits()));
                }
                Err(channel) => {
                    let column = words.chunks_exact(stride.max(1)).map(|words| words[channel]);
                    append(&mut bytes, source.kind, column);
                }
            }
        }
    }
    bytes
}

/// Appends a row of one channel.
fn append(bytes: &mut Vec<u8>, kind: ChannelKind, words: impl ExactSizeIterator<Item = u32>) {
    let start = bytes.len();
    let size = if kind == ChannelKind::Half { 2 } else { 4 };
    bytes.resize(start + size * words.len(), 0);
    let to = &mut bytes[start..];
    match kind {
        ChannelKind::Half => {
            let floats: Vec<f32> = words.map(|word| within_half(f32::from_bits(word))).collect();
            let mut halves = vec![f16::ZERO; floats.len()];
            halves.convert_from_f32_slice(&floats);
            for (to, half) in to.chunks_exact_mut(2).zip(halves) {
                to.copy_from_slice(&half.to_ne_bytes());
            }
        }
        ChannelKind::Float => {
            for (to, word) in to.chunks_exact_mut(4).zip(words) {
                to.copy_from_slice(&finite(f32::from_bits(word)).to_ne_bytes());
            }
        }
        ChannelKind::Uint => {
            for (to, word) in to.chunks_exact_mut(4).zip(words) {
                to.copy_from_slice(&word.to_ne_bytes());
            }
        }
    }
}

/// What a half can hold; finite for every input.
fn within_half(value: f32) -> f32 {
    finite(value).clamp(-HALF_MAX, HALF_MAX)
}

/// Sorts the attributes of the header in place; its length and the offsets behind it stay.
fn sort_header<F: Read + Write + Seek>(file: &mut F) -> std::io::Result<()> {
    file.seek(SeekFrom::Start(0))?;
    let header = exr_header::read_sorted(file)?;
    file.seek(SeekFrom::Start(0))?;
    file.write_all(&header)?;
    file.seek(SeekFrom::End(0))?;
    file.flush()
}

fn unwritable(path: &Path, what: &str) -> Error {
    let message = format!("cannot write: {what} do not fit into an EXR file");
    Error::new(Kind::Limit, Problem::new(path.display().to_string(), message))
}

fn exr_error(path: &Path, error: ExrError) -> Error {
    match error {
        ExrError::Io(error) => Error::io(path, "write", &error),
        other => unwritable(path, &other.to_string()),
    }
}
