//! The PNG: what people look at. 8 or 16 bits, tone mapped, straight alpha if there is any.
//!
//! The file says how its values are meant: an `sRGB` chunk for the sRGB curve, `gAMA` 1.0 for
//! linear values, so that viewers need not guess.

use std::{
    io::{BufWriter, Write},
    path::Path,
};

use png::{
    BitDepth, ColorType, Compression, Encoder, EncodingError, ScaledFloat, SrgbRenderingIntent,
};

use crate::{
    error::{Error, Kind, Problem, Result},
    film::Film,
    scene::Tonemap,
};

use super::tonemap::{self, Depth};

/// Writes the film's data window. `path` is for messages.
///
/// # Errors
/// `Retry` where the disk is full, `Limit` for a size that a PNG cannot have.
pub fn write(
    film: &Film,
    tonemap: &Tonemap,
    transparent: bool,
    depth: Depth,
    fingerprint: Option<&str>,
    file: &mut impl Write,
    path: &Path,
) -> Result<()> {
    let bytes = tonemap::to_samples(&film.pixels, tonemap, transparent, depth);
    let color = Color { alpha: transparent, srgb: tonemap.srgb, depth };
    encode(film, &bytes, color, fingerprint, file, path)
}

/// What the bytes of a pixel mean.
#[derive(Debug, Clone, Copy)]
pub struct Color {
    /// R, G, B, A instead of R, G, B.
    pub alpha: bool,
    /// sRGB-encoded instead of linear.
    pub srgb: bool,
    /// Of each channel.
    pub depth: Depth,
}

/// Writes the pixels of the film's data window.
///
/// # Errors
/// As [`write()`].
pub fn encode(
    film: &Film,
    bytes: &[u8],
    color: Color,
    fingerprint: Option<&str>,
    file: &mut impl Write,
    path: &Path,
) -> Result<()> {
    let mut buffered = BufWriter::new(file);
    let (width, height) = (film.window.width(), film.window.height());
    let mut encoder = Encoder::new(&mut buffered, width, height);
    // To be looked at: both files together are written in less than half of the time, and the PNG has 1.2 to 2.1
    // times the bytes.
    encoder.set_compression(Compression::Fast);
    encoder.set_depth(match color.depth {
        Depth::Eight => BitDepth::Eight,
        Depth::Sixteen => BitDepth::Sixteen,
    });
    encoder.set_color(match color.alpha {
        true => ColorType::Rgba,
        false => ColorType::Rgb,
    });
    match color.srgb {
        true => encoder.set_source_srgb(SrgbRenderingIntent::RelativeColorimetric),
        false => encoder.set_source_gamma(ScaledFloat::new(1.0)),
    }
    if let Some(fingerprint) = fingerprint {
        let text = encoder.add_text_chunk(super::FINGERPRINT.into(), fingerprint.into());
        text.map_err(|error| png_error(path, error))?;
    }
    let written = encoder.write_header().and_then(|mut writer| {
        writer.write_image_data(bytes)?;
        writer.finish()
    });
    written.map_err(|error| png_error(path, error))?;
    let flushed = buffered.flush();
    flushed.map_err(|error| Error::io(path, "write", &error))
}

fn png_error(path: &Path, error: EncodingError) -> Error {
    match error {
        EncodingError::IoError(error) => Error::io(path, "write", &error),
        other => {
            let message = format!("cannot write a PNG: {other}");
            Error::new(Kind::Limit, Problem::new(path.display().to_string(), message))
        }
    }
}
