//! Headers of image files: format detection by content, and error messages.

use std::fs::File;
use std::io::{self, BufRead, BufReader, Cursor, Read, Seek, SeekFrom};
use std::path::Path;

use image::codecs::hdr::HdrDecoder;
use image::{ImageDecoder, ImageError, ImageFormat, ImageReader, Limits};

use super::exr::ExrLayout;
use super::png_image::PngImage;
use super::{jpeg_segments, pnm};
use crate::error::{Error, ErrorKind, Problem, Result};
use crate::files::Stamp;
use crate::shading::tiles;

const FORMATS: &str = "Netpbm (P1 to P7), PNG, JPEG, Radiance HDR or OpenEXR";

/// Offset of the byte of a PNG that is not 0 if the image is interlaced.
const PNG_INTERLACING: usize = 28;

/// Most bytes in the header of a Radiance file.
const MAX_RADIANCE_HEADER: u64 = 1 << 18;

/// First bytes of a Radiance file, and those that some programs write. The decoder knows the first.
const RADIANCE: [&[u8]; 2] = [b"#?RADIANCE", b"#?RGBE"];

/// Opens a regular file that is not empty.
pub(super) fn open(path: &Path) -> Result<(BufReader<File>, Option<Stamp>)> {
    let failed = |e| Error::io(path, "read the texture", &e);
    // Opening a pipe waits for its writer.
    let data = std::fs::metadata(path).map_err(failed)?;
    if !data.is_file() {
        let what = if data.is_dir() { "a folder" } else { "not a regular file" };
        return Err(Error::invalid(name(path), format!("is {what}; expected an image")));
    }
    if data.len() == 0 {
        return Err(Error::invalid(name(path), "is empty; expected an image"));
    }
    let file = File::open(path).map_err(failed)?;
    let data = file.metadata().map_err(failed)?;
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
    /// Gamma of a PNG's values, if its header has one and is not damaged.
    pub(super) gamma: Option<f64>,
}

impl Opened {
    /// Bytes of the file that its decoder holds. That of a JPEG holds all.
    pub(super) fn held_bytes(&self, format: ImageFormat) -> u64 {
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
    Exr(ExrLayout, File),
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
    let start = file.fill_buf().map_err(failed)?;
    let interlacing = start.get(PNG_INTERLACING).copied();
    let [known, other] = RADIANCE;
    let renamed = start.starts_with(other);
    let mut reader = ImageReader::new(file).with_guessed_format().map_err(failed)?;
    if renamed {
        reader.set_format(ImageFormat::Hdr);
    }
    let Some(format) = reader.format() else {
        return Err(Error::invalid(name(path), "not an image of a known format")
            .help(format!("textures are {FORMATS}")));
    };
    let mut gamma = None;
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
        ImageFormat::Png => {
            let image = PngImage::new(reader.into_inner(), bytes).map_err(failed)?;
            gamma = image.gamma();
            ImageSource::Image(format, Box::new(image), None)
        }
        ImageFormat::Hdr => {
            let mut file = reader.into_inner();
            check_radiance_header(path, &mut file)?;
            let begin = SeekFrom::Start(if renamed { other.len() } else { known.len() } as u64);
            file.seek(begin).map_err(|error| failed(ImageError::IoError(error)))?;
            let mut decoder = HdrDecoder::new(Cursor::new(known).chain(file)).map_err(failed)?;
            decoder.set_limits(limits(max_bytes)).map_err(failed)?;
            ImageSource::Image(format, Box::new(decoder), None)
        }
        ImageFormat::Pnm => {
            let (mut decoder, white) = pnm::decoder(reader.into_inner()).map_err(failed)?;
            decoder.set_limits(limits(max_bytes)).map_err(failed)?;
            ImageSource::Image(format, Box::new(decoder), white)
        }
        ImageFormat::OpenExr => {
            let file = reader.into_inner().into_inner();
            ImageSource::Exr(ExrLayout::read_header(&file, path)?, file)
        }
        _ => {
            reader.limits(limits(max_bytes));
            ImageSource::Image(format, Box::new(reader.into_decoder().map_err(failed)?), None)
        }
    };
    Ok(Opened { source, stamp, by_rows, bytes, gamma })
}

/// Refuses a Radiance file with a long header, which the decoder would hold line by line.
fn check_radiance_header(path: &Path, file: &mut BufReader<File>) -> Result<()> {
    let failed = |e| Error::io(path, "read the texture", &e);
    let mut header = file.by_ref().take(MAX_RADIANCE_HEADER);
    let (mut line, mut is_last) = (Vec::new(), false);
    while header.read_until(b'\n', &mut line).map_err(failed)? > 0 && !is_last {
        // One more line follows the empty one: the size.
        is_last = line == b"\n";
        line.clear();
    }
    if header.limit() > 0 {
        return Ok(());
    }
    let message = format!("found no end of its header in the first {MAX_RADIANCE_HEADER} bytes");
    let help = "a header is lines as FORMAT=32-bit_rle_rgbe, then an empty line, all ending with a line feed alone";
    Err(Error::new(ErrorKind::Limit, Problem::new(name(path), message).help(help)))
}

fn limits(max_bytes: u64) -> Limits {
    let mut limits = Limits::default();
    limits.max_alloc = Some(max_bytes);
    limits
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
