//! Reads image files as linear RGB.
//!
//! Reads PPM and related formats, PNG, JPEG, Radiance HDR and OpenEXR. The content decides the
//! format, never the file name. Texels are decoded to linear light before filtering: integer images
//! of any format from sRGB, float images unchanged, unless the scene sets the colour space.
//! Integers are divided by the largest value of their type; Netpbm samples are divided by the white
//! level of their header. Gamma chunks count in [`read_by_gamma`] alone. Embedded colour profiles
//! and EXIF orientations are ignored; alpha is dropped. The texture of an OpenEXR is its display
//! window; memory is allocated only for the pixels in the file.
//!
//! Rejected are:
//!
//! - images above a given number of bytes, which the header tells before decoding
//! - truncated files
//! - Netpbm samples above the white level
//! - float images with texels that are not finite

mod exr;
mod file_pages;
mod header;
mod jpeg_rows;
mod jpeg_segments;
mod memory;
mod png_image;
mod png_rows;
mod pnm;
#[cfg(test)]
mod tests;

use std::path::Path;

use image::{DynamicImage, ImageDecoder, ImageFormat};

use super::texel_image::{Negative, TexelImage};
use super::tiles::{TileWriter, Tiles};
use crate::error::{Error, Result};
use crate::files::Stamp;
use crate::output::stored_curve::StoredCurve;
use crate::reserve;
use crate::scene::ColorSpace;
use exr::ExrLayout;
use file_pages::FilePages;
use header::{ImageSource, Opened, check_jpeg_end, explain, name, source};
use memory::{check_needed, check_size};

pub use memory::{DEFAULT_MAX_BYTES, TextureSize, WHOLE_TEXELS};

/// An image file in memory.
#[derive(Debug, Clone)]
pub struct DecodedImage {
    /// The texels.
    pub image: TexelImage,
    /// Whether the file has an alpha channel, which is ignored.
    pub had_alpha: bool,
    /// Gamma of a PNG that is not that of sRGB, if it is ignored.
    pub ignored_gamma: Option<f64>,
    /// Whether the image is in memory because no disk has space for its tiles.
    pub lacks_disk: bool,
    /// Texels with negative values, if there are any. They are kept.
    pub negative: Option<Negative>,
    /// Stamp of the file when it was opened.
    pub stamp: Option<Stamp>,
}

/// Width and height of the image at `path`, and the memory that it needs, from its header alone.
/// `whole` is that of [`read`].
///
/// # Errors
/// The errors of [`read`] that concern the header.
pub fn size(path: &Path, whole: u64) -> Result<((u32, u32), TextureSize)> {
    let opened = source(path, u64::MAX)?;
    let size = match opened.is_for_tiles(whole) {
        true => TextureSize::in_tiles(&opened, whole),
        false => TextureSize::of(&opened),
    };
    Ok((opened.source.dimensions(), size))
}

/// An image that is to be read, and its limits.
#[derive(Debug, Clone, Copy)]
pub struct ImageRequest<'a> {
    /// The image file.
    pub path: &'a Path,
    /// `None` is sRGB for integer images and linear for float images.
    pub color_space: Option<ColorSpace>,
    /// Largest number of bytes that the image may need while it is decoded.
    pub max_bytes: u64,
    /// An image of more texels of 8 bits a channel is kept in tiles, if there is space on a disk.
    pub whole: u64,
}

impl ImageRequest<'_> {
    /// The curve that the scene sets.
    fn curve(&self) -> Option<StoredCurve> {
        self.color_space.map(|space| match space {
            ColorSpace::Srgb => StoredCurve::Srgb,
            ColorSpace::Linear => StoredCurve::LINEAR,
        })
    }
}

/// Reads an image.
pub fn read(request: ImageRequest) -> Result<DecodedImage> {
    let ImageRequest { path, color_space, max_bytes, whole } = request;
    let opened = source(path, max_bytes)?;
    let is_ignored =
        |gamma: &f64| color_space.is_none() && StoredCurve::of_gamma(*gamma) != StoredCurve::Srgb;
    let ignored_gamma = opened.gamma.filter(is_ignored);
    let decoded = if opened.is_for_tiles(whole) {
        read_in_tiles(request, opened)?
    } else {
        let needed = check_size(path, &opened, max_bytes)?;
        read_whole(path, request.curve(), opened, needed)?
    };
    Ok(DecodedImage { ignored_gamma, ..decoded })
}

/// Reads a whole image that needs at most `max_bytes`, by the `gAMA` chunk of a PNG.
pub fn read_by_gamma(path: &Path, max_bytes: u64) -> Result<DecodedImage> {
    let opened = source(path, max_bytes)?;
    let needed = check_size(path, &opened, max_bytes)?;
    read_whole(path, opened.gamma.map(StoredCurve::of_gamma), opened, needed)
}

/// [`read`] for an image of many texels.
fn read_in_tiles(request: ImageRequest, opened: Opened) -> Result<DecodedImage> {
    let ImageRequest { path, max_bytes, whole, .. } = request;
    // A small file can declare an image that fills a disk.
    check_size(path, &opened, max_bytes.max(DEFAULT_MAX_BYTES))?;
    let needed = TextureSize::in_tiles(&opened, whole).decoding;
    check_needed(path, &opened.source, needed, max_bytes)?;
    reserve::probe(needed, &name(path))?;
    let opened = match opened.source {
        ImageSource::Image(format, decoder, _) if opened.by_rows => {
            match read_by_rows(request, format, decoder)? {
                Some(decoded) => return Ok(decoded),
                None => source(path, max_bytes)?,
            }
        }
        source => Opened { source, ..opened },
    };
    let tiles = Tiles::new(opened.source.dimensions(), 3);
    let needed = check_size(path, &opened, max_bytes)?;
    let decoded = read_whole(path, request.curve(), opened, needed)?;
    into_tiles(decoded, tiles, path)
}

/// Moves an image in memory into tiles, if a disk has space for them.
fn into_tiles(decoded: DecodedImage, tiles: Option<Tiles>, path: &Path) -> Result<DecodedImage> {
    let Some(tiles) = tiles else { return Ok(DecodedImage { lacks_disk: true, ..decoded }) };
    let image = decoded.image.into_tiles(TileWriter::new(tiles, &name(path))?)?;
    Ok(DecodedImage { image, ..decoded })
}

/// [`read_in_tiles`] for a PNG or a JPEG that is decoded row by row. `None` if no disk has space.
/// `header` is the decoder of the header. One of a JPEG has the whole file in memory, so that it is
/// dropped first.
fn read_by_rows(
    request: ImageRequest,
    format: ImageFormat,
    header: Box<dyn ImageDecoder>,
) -> Result<Option<DecodedImage>> {
    let path = request.path;
    let (size, bytes) = (header.dimensions(), header.total_bytes());
    let had_alpha = header.color_type().has_alpha();
    drop(header);
    let Some(tiles) = Tiles::new(size, 3) else { return Ok(None) };
    let (tiles, stamp) = if format == ImageFormat::Png {
        png_rows::read(path, tiles)?
    } else {
        check_jpeg_end(path)?;
        let Some(pixels) = FilePages::new(bytes) else { return Ok(None) };
        jpeg_rows::read(path, tiles, pixels)?
    };
    let image = TexelImage::from_tiles(tiles, byte_table(request.curve(), 255));
    let (ignored_gamma, lacks_disk, negative) = (None, false, None);
    Ok(Some(DecodedImage { image, had_alpha, ignored_gamma, lacks_disk, negative, stamp }))
}

/// Reads an image into memory. Decoding takes `needed` bytes. Without a `curve`, the format
/// decides.
fn read_whole(
    path: &Path,
    curve: Option<StoredCurve>,
    opened: Opened,
    needed: u64,
) -> Result<DecodedImage> {
    let (had_alpha, image) = match opened.source {
        ImageSource::Exr(layout, file) => {
            let floats = layout.read(file, path)?;
            (layout.has_alpha, decode_exr(layout, floats, curve))
        }
        ImageSource::Image(format, decoder, white) => {
            let had_alpha = decoder.color_type().has_alpha();
            if format == ImageFormat::Jpeg {
                check_jpeg_end(path)?;
            }
            // The library's single allocations cannot fail, so the sum is tested first.
            reserve::probe(needed, &name(path))?;
            let image = DynamicImage::from_decoder(decoder).map_err(|e| explain(path, e))?;
            let width = u64::from(image.width());
            let image = decode(image, curve, white).map_err(|texel| {
                let (x, y) = (texel % width, texel / width);
                let white = white.unwrap_or_default();
                let message = format!(
                    "texel ({x}, {y}) is more than {white}, the largest that the header allows"
                );
                Error::invalid(name(path), message)
            })?;
            (had_alpha, image)
        }
    };
    if let Some([x, y]) = image.first_non_finite() {
        return Err(Error::invalid(
            name(path),
            format!("texel ({x}, {y}) is NaN or infinite; every value must be finite"),
        ));
    }
    let (ignored_gamma, lacks_disk, negative) = (None, false, image.negative());
    let stamp = opened.stamp;
    Ok(DecodedImage { image, had_alpha, ignored_gamma, lacks_disk, negative, stamp })
}

/// Drops alpha, expands grey to RGB and makes values linear. `white` is the divisor of integers, if
/// it is not the largest value of their type.
///
/// # Errors
/// The first texel (row by row) with a value above `white`.
fn decode(
    image: DynamicImage,
    curve: Option<StoredCurve>,
    white: Option<u16>,
) -> std::result::Result<TexelImage, u64> {
    let size = (image.width(), image.height());
    let color = image.color();
    let bytes_per_value = color.bytes_per_pixel() / color.channel_count();
    let is_float = matches!(image, DynamicImage::ImageRgb32F(_) | DynamicImage::ImageRgba32F(_));
    let default = if is_float { StoredCurve::LINEAR } else { StoredCurve::Srgb };
    let linear = |stored: f64| curve.unwrap_or(default).to_linear(stored) as f32;
    let beyond = |at: Option<usize>| at.map_or(Ok(()), |at| Err(at as u64 / 3));
    if is_float {
        let mut floats = image.into_rgb32f().into_raw();
        for value in &mut floats {
            *value = linear(f64::from(*value));
        }
        Ok(TexelImage::from_floats(size, floats))
    } else if bytes_per_value == 1 {
        let bytes = image.into_rgb8().into_raw();
        let white = white.unwrap_or(255);
        if white < 255 {
            beyond(bytes.iter().position(|&byte| u16::from(byte) > white))?;
        }
        Ok(TexelImage::from_bytes(size, bytes, byte_table(curve, white)))
    } else {
        let words = image.into_rgb16().into_raw();
        let white = white.unwrap_or(65535);
        if white < 65535 {
            beyond(words.iter().position(|&word| word > white))?;
        }
        let floats = words.iter().map(|&word| linear(f64::from(word) / f64::from(white)));
        Ok(TexelImage::from_floats(size, floats.collect()))
    }
}

/// The linear value of each byte. `white` is 1.
fn byte_table(curve: Option<StoredCurve>, white: u16) -> Box<[f32; 256]> {
    let curve = curve.unwrap_or(StoredCurve::Srgb);
    Box::new(std::array::from_fn(|byte| curve.to_linear(byte as f64 / f64::from(white)) as f32))
}

/// The image of an EXR: linear unless the scene sets another colour space.
fn decode_exr(layout: ExrLayout, mut floats: Vec<f32>, curve: Option<StoredCurve>) -> TexelImage {
    if let Some(curve) = curve {
        floats.iter_mut().for_each(|v| *v = curve.to_linear(f64::from(*v)) as f32);
    }
    let ExrLayout { size, columns, rows, .. } = layout;
    TexelImage::from_part(size.into(), columns, rows, floats)
}
