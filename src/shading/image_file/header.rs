//! Headers of image files: format detection by content, memory limits, and error messages.

use std::{
    fs::File,
    io::{self, BufRead, BufReader},
    path::Path,
};

use image::{ImageDecoder, ImageError, ImageFormat, ImageReader, Limits};

use super::exr::Layout;
use super::pnm;
use crate::shading::{mip_map, tiles};
use crate::{
    error::{Error, ErrorKind, Problem, Result},
    files::Stamp,
};

const FORMATS: &str = "PPM (P3, P6), PNG, JPEG, Radiance HDR or OpenEXR";

/// Offset of the byte of a PNG that is not 0 if the image is interlaced.
const PNG_INTERLACING: usize = 28;

/// Limit of [`Texture::load`](crate::shading::Texture::load) on the memory of one texture while it
/// is decoded: 4 GiB.
pub const DEFAULT_MAX_BYTES: u64 = 4 << 30;

/// Most texels of a surface's image that is held in memory whole: 8192 x 8192.
pub const WHOLE_TEXELS: u64 = 1 << 26;

/// Memory that an image needs, in bytes.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct TextureSize {
    /// Memory of the finished texture.
    pub stored: u64,
    /// Peak memory while the image is decoded, including the texture.
    pub decoding: u64,
    /// Upper bound of the memory of the smaller copies, for a texture that has them.
    pub mip_map: u64,
}

impl TextureSize {
    /// Memory of an image that is held whole.
    pub(super) fn of(source: &Source) -> Self {
        let (stored, decoding) = match source {
            // Decoded directly into the texture.
            Source::Exr(layout, _) => {
                let stored = layout.pixels().saturating_mul(12);
                (stored, stored)
            }
            Source::Image(_, decoder, _) => Self::of_image(decoder),
        };
        // The copies have a third of the texels. Where the image has 8 bits a channel, they have
        // 16, so they take two thirds.
        Self { stored, decoding, mip_map: stored - stored / 3 }
    }

    /// Memory of an image in tiles; `whole` is the most texels of a copy that is held whole, times
    /// 4.
    pub(super) fn in_tiles(source: &Source, interlaced: bool, whole: u64) -> Self {
        let size = source.dimensions();
        let stored = tiles::max_bytes(size, 3) + size_of::<[f32; 256]>() as u64;
        let decoding = match source {
            Source::Image(ImageFormat::Png, ..) if !interlaced => {
                // Twice a row of tiles, and a row of up to 4 channels.
                stored.max(u64::from(size.0) * (2 * 3 * tiles::SIDE as u64 + 4))
            }
            _ => Self::of(source).decoding,
        };
        Self { stored, decoding, mip_map: mip_map::max_bytes(size, whole) }
    }

    fn of_image(decoder: &impl ImageDecoder) -> (u64, u64) {
        let (width, height) = decoder.dimensions();
        let color = decoder.color_type();
        let file = u64::from(color.bytes_per_pixel());
        // In `decode`: the file's pixels, then RGB of the same type, then the stored texels.
        let (stored, decoding, table) = match color.bytes_per_pixel() / color.channel_count() {
            1 => (3, file + 3, size_of::<[f32; 256]>()),
            2 => (12, (file + 6).max(6 + 12), 0),
            _ => (12, file + 12, 0),
        };
        let pixels = u64::from(width) * u64::from(height);
        let stored = pixels.saturating_mul(stored).saturating_add(table as u64);
        (stored, pixels.saturating_mul(decoding))
    }
}

/// Opens a regular file that is not empty.
pub(super) fn open(path: &Path) -> Result<(BufReader<File>, Option<Stamp>)> {
    let failed = |e| Error::io(path, "read the texture", &e);
    let file = File::open(path).map_err(failed)?;
    let data = file.metadata().map_err(failed)?;
    if !data.is_file() {
        let what = if data.is_dir() { "a folder" } else { "not a regular file" };
        return Err(Error::invalid(name(path), format!("is {what}; expected an image")));
    }
    if data.len() == 0 {
        return Err(Error::invalid(name(path), "is empty; expected an image"));
    }
    Ok((BufReader::with_capacity(1 << 16, file), Stamp::of(&data)))
}

/// An image file whose header is read.
pub(super) struct Opened {
    pub(super) source: Source,
    pub(super) stamp: Option<Stamp>,
    /// Whether the rows of a PNG are not in order.
    pub(super) interlaced: bool,
}

impl Opened {
    /// Whether an image of more than `whole` texels is kept in tiles: if it has 8 bits a channel.
    /// Narrow images would fill tiles in part. Rows of tiles of wide images need much memory.
    pub(super) fn is_for_tiles(&self, whole: u64) -> bool {
        let Source::Image(_, decoder, _) = &self.source else { return false };
        let ((width, height), color) = (decoder.dimensions(), decoder.color_type());
        color.bytes_per_pixel() == color.channel_count()
            && u64::from(width) * u64::from(height) > whole
            && width.min(height) >= tiles::SIDE as u32
            && width <= 1 << 16
    }
}

/// Decoder of the image's pixels.
pub(super) enum Source {
    Exr(Layout, BufReader<File>),
    /// The last field is the divisor of integers, if it is not the largest value of their type.
    Image(ImageFormat, Box<dyn ImageDecoder>, Option<u16>),
}

impl Source {
    pub(super) fn dimensions(&self) -> (u32, u32) {
        match self {
            Self::Exr(layout, _) => layout.size.into(),
            Self::Image(_, decoder, _) => decoder.dimensions(),
        }
    }
}

/// Reads the header of an image file and selects the decoder.
pub(super) fn source(path: &Path, max_bytes: u64) -> Result<Opened> {
    let (mut file, stamp) = open(path)?;
    let failed = |e| Error::io(path, "read the texture", &e);
    let interlaced = file.fill_buf().map_err(failed)?.get(PNG_INTERLACING).is_some_and(|&b| b != 0);
    let mut reader = ImageReader::new(file)
        .with_guessed_format()
        .map_err(|e| Error::io(path, "read the texture", &e))?;
    let Some(format) = reader.format() else {
        return Err(Error::invalid(name(path), "not an image of a known format")
            .help(format!("textures are {FORMATS}")));
    };
    let failed = |error| explain(path, error);
    if format == ImageFormat::Pnm {
        let (mut decoder, white) = pnm::decoder(reader.into_inner()).map_err(failed)?;
        decoder.set_limits(limits(max_bytes)).map_err(failed)?;
        let source = Source::Image(format, Box::new(decoder), white);
        return Ok(Opened { source, stamp, interlaced });
    }
    if format == ImageFormat::OpenExr {
        let mut file = reader.into_inner();
        let source = Source::Exr(Layout::read_header(&mut file, path)?, file);
        return Ok(Opened { source, stamp, interlaced });
    }
    reader.limits(limits(max_bytes));
    let decoder = reader.into_decoder().map_err(failed)?;
    let source = Source::Image(format, Box::new(decoder), None);
    Ok(Opened { source, stamp, interlaced })
}

/// Limits on what the decoders allocate themselves. [`check_size`] limits the rest.
fn limits(max_bytes: u64) -> Limits {
    let mut limits = Limits::default();
    limits.max_alloc = Some(max_bytes);
    limits
}

/// Compares the memory that the header announces with the limit. Returns the peak memory in bytes.
pub(super) fn check_size(path: &Path, source: &Source, max_bytes: u64) -> Result<u64> {
    check_needed(path, source, TextureSize::of(source).decoding, max_bytes)
}

/// The same for an image that needs `needed` bytes.
pub(super) fn check_needed(
    path: &Path,
    source: &Source,
    needed: u64,
    max_bytes: u64,
) -> Result<u64> {
    let (width, height) = source.dimensions();
    let pixels = u64::from(width) * u64::from(height);
    if pixels == 0 {
        return Err(Error::invalid(
            name(path),
            format!("the image is {width} x {height} pixels; both must be at least 1"),
        ));
    }
    if needed > max_bytes {
        let more = if needed == u64::MAX { "at least " } else { "" };
        let message = format!(
            "{width} x {height} pixels need {more}{needed} bytes while they are decoded; the limit \
             is {max_bytes}"
        );
        return Err(Error::new(ErrorKind::Limit, Problem::new(name(path), message))
            .help("scale the image down"));
    }
    Ok(needed)
}

/// Rejects a JPEG without its end marker. The decoder would fill the missing part with grey.
pub(super) fn check_jpeg_end(path: &Path) -> Result<()> {
    let data = std::fs::read(path).map_err(|e| Error::io(path, "read the texture", &e))?;
    if jpeg_is_complete(&data) { Ok(()) } else { Err(truncated(path)) }
}

/// Follows the segments to the end-of-image marker.
fn jpeg_is_complete(data: &[u8]) -> bool {
    let mut at = 2;
    loop {
        // Search for the next marker. In entropy-coded data, FF occurs only before 00 or a restart
        // marker (D0-D7).
        while at + 1 < data.len() && (data[at] != 0xff || matches!(data[at + 1], 0 | 0xff)) {
            at += 1;
        }
        match data.get(at + 1) {
            None => return false,
            Some(0xd9) => return true,
            Some(0x01 | 0xd0..=0xd8) => at += 2,
            Some(_) => match data.get(at + 2..at + 4) {
                Some(length) => at += 2 + usize::from(u16::from_be_bytes([length[0], length[1]])),
                None => return false,
            },
        }
    }
}

pub(super) fn name(path: &Path) -> String {
    path.display().to_string()
}

fn truncated(path: &Path) -> Error {
    Error::invalid(name(path), "the image ends too early").help("the file may be cut off")
}

/// Converts an error of the decoder into our own error.
pub(super) fn explain(path: &Path, error: ImageError) -> Error {
    match error {
        ImageError::IoError(e) if e.kind() == io::ErrorKind::UnexpectedEof => truncated(path),
        ImageError::IoError(e) if e.raw_os_error().is_some() => {
            Error::io(path, "read the texture", &e)
        }
        ImageError::Limits(e) => Error::new(
            ErrorKind::Limit,
            Problem::new(name(path), format!("the image is too large to decode: {e}")),
        )
        .help("scale the image down"),
        ImageError::Unsupported(e) => {
            Error::new(ErrorKind::Unsupported, Problem::new(name(path), e.to_string()))
                .help(format!("textures are {FORMATS}"))
        }
        other => Error::invalid(name(path), other.to_string()),
    }
}
