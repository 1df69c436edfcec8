//! Headers of image files: format detection by content, memory limits, and error messages.

use std::fs::File;
use std::io::{self, BufRead, BufReader, Seek};
use std::path::Path;

use image::{ImageDecoder, ImageError, ImageFormat, ImageReader, Limits};

use super::exr::ExrLayout;
use super::{jpeg_rows, jpeg_segments, pnm};
use crate::error::{Error, ErrorKind, Problem, Result};
use crate::files::Stamp;
use crate::shading::{mip_map, tiles};

const FORMATS: &str = "PPM (P3, P6), PNG, JPEG, Radiance HDR or OpenEXR";

/// Offset of the byte of a PNG that is not 0 if the image is interlaced.
const PNG_INTERLACING: usize = 28;

/// Limit on the memory of one texture while it is decoded, where the user sets none: 4 GiB.
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
    pub(super) fn of(opened: &Opened) -> Self {
        let (stored, decoding) = match &opened.source {
            // Decoded directly into the texture.
            ImageSource::Exr(layout, _) => {
                let stored = layout.pixels().saturating_mul(12);
                (stored, stored)
            }
            ImageSource::Image(format, decoder, _) => {
                let (stored, decoding) = Self::of_image(decoder);
                (stored, decoding.saturating_add(opened.held_bytes(*format)))
            }
        };
        // The copies have a third of the texels. Where the image has 8 bits a channel, they have
        // 16, so they take two thirds.
        Self { stored, decoding, mip_map: stored - stored / 3 }
    }

    /// Memory of an image in tiles; `whole` is the most texels of a copy that is held whole, times
    /// 4.
    pub(super) fn in_tiles(opened: &Opened, whole: u64) -> Self {
        let size = opened.source.dimensions();
        let stored = tiles::max_bytes(size, 3) + size_of::<[f32; 256]>() as u64;
        let decoding = match &opened.source {
            // Twice a row of tiles, and a row of up to 4 channels.
            ImageSource::Image(ImageFormat::Png, ..) if opened.by_rows => {
                stored.max(u64::from(size.0) * (2 * 3 * tiles::SIDE as u64 + 4))
            }
            ImageSource::Image(format, ..) if opened.by_rows => {
                stored.max(jpeg_rows::max_bytes(size.0)).max(opened.held_bytes(*format))
            }
            _ => Self::of(opened).decoding,
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
    pub(super) source: ImageSource,
    pub(super) stamp: Option<Stamp>,
    /// Whether the file is a PNG or a JPEG that is decoded row by row.
    pub(super) by_rows: bool,
    /// Size of the file.
    pub(super) bytes: u64,
}

impl Opened {
    /// Bytes of the file that its decoder holds. That of a JPEG holds all.
    fn held_bytes(&self, format: ImageFormat) -> u64 {
        if format == ImageFormat::Jpeg { self.bytes } else { 0 }
    }

    /// Whether an image of more than `whole` texels is kept in tiles: if it has 8 bits a channel.
    /// Narrow images would fill tiles in part. Rows of tiles of wide images need much memory.
    pub(super) fn is_for_tiles(&self, whole: u64) -> bool {
        let ImageSource::Image(_, decoder, _) = &self.source else { return false };
        let ((width, height), color) = (decoder.dimensions(), decoder.color_type());
        color.bytes_per_pixel() == color.channel_count()
            && u64::from(width) * u64::from(height) > whole
            && width.min(height) >= tiles::SIDE as u32
            && width <= 1 << 16
    }
}

/// Decoder of the image's pixels.
pub(super) enum ImageSource {
    Exr(ExrLayout, BufReader<File>),
    /// The last field is the divisor of integers, if it is not the largest value of their type.
    Image(ImageFormat, Box<dyn ImageDecoder>, Option<u16>),
}

impl ImageSource {
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
    let bytes = file.get_ref().metadata().map_err(failed)?.len();
    let interlacing = file.fill_buf().map_err(failed)?.get(PNG_INTERLACING).copied();
    let mut reader = ImageReader::new(file).with_guessed_format().map_err(failed)?;
    let Some(format) = reader.format() else {
        return Err(Error::invalid(name(path), "not an image of a known format")
            .help(format!("textures are {FORMATS}")));
    };
    let by_rows = match format {
        ImageFormat::Png => interlacing == Some(0),
        ImageFormat::Jpeg => {
            let mut file = reader.into_inner();
            let in_order = jpeg_segments::rows_are_in_order(&mut file).map_err(failed)?;
            file.rewind().map_err(failed)?;
            reader = ImageReader::with_format(file, format);
            in_order
        }
        _ => false,
    };
    let failed = |error| explain(path, error);
    let source = match format {
        ImageFormat::Pnm => {
            let (mut decoder, white) = pnm::decoder(reader.into_inner()).map_err(failed)?;
            decoder.set_limits(limits(max_bytes)).map_err(failed)?;
            ImageSource::Image(format, Box::new(decoder), white)
        }
        ImageFormat::OpenExr => {
            let mut file = reader.into_inner();
            ImageSource::Exr(ExrLayout::read_header(&mut file, path)?, file)
        }
        _ => {
            reader.limits(limits(max_bytes));
            ImageSource::Image(format, Box::new(reader.into_decoder().map_err(failed)?), None)
        }
    };
    Ok(Opened { source, stamp, by_rows, bytes })
}

/// Limits on what the decoders allocate themselves. [`check_size`] limits the rest.
fn limits(max_bytes: u64) -> Limits {
    let mut limits = Limits::default();
    limits.max_alloc = Some(max_bytes);
    limits
}

/// Compares the memory that the header announces with the limit. Returns the peak memory in bytes.
pub(super) fn check_size(path: &Path, opened: &Opened, max_bytes: u64) -> Result<u64> {
    check_needed(path, &opened.source, TextureSize::of(opened).decoding, max_bytes)
}

/// The same for an image that needs `needed` bytes.
pub(super) fn check_needed(
    path: &Path,
    source: &ImageSource,
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
    let (file, _) = open(path)?;
    let complete =
        jpeg_segments::has_end(file).map_err(|e| Error::io(path, "read the texture", &e))?;
    if complete { Ok(()) } else { Err(truncated(path)) }
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
