//! Memory that images need, and whether it is within a limit.

use std::path::Path;

use image::{ImageDecoder, ImageFormat};

use super::header::{ImageSource, Opened, name};
use super::jpeg_rows;
use crate::error::{Error, ErrorKind, Problem, Result};
use crate::shading::{mip_map, tiles};

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
                let part = (layout.columns.clone(), layout.rows.clone());
                let mip_map = mip_map::float_bytes(layout.size.into(), part);
                return Self { stored, decoding: stored, mip_map };
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
