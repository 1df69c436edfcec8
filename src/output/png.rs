//! Writes the PNG, the picture for viewing: 8 or 16 bits, tone mapped. An alpha channel is
//! straight.
//!
//! The file states its encoding, so that viewers need not guess: an `sRGB` chunk for the sRGB
//! curve, `gAMA` 1.0 for linear values.

use std::io::{BufWriter, Write};
use std::path::Path;

use png::{
    BitDepth, ColorType, Compression, Encoder, EncodingError, ScaledFloat, SrgbRenderingIntent,
};

use crate::error::{Error, ErrorKind, Problem, Result};
use crate::film::Film;

use super::legend::Canvas;
use super::over;
use super::tonemap::{self, Curve, Depth, PixelFormat};
use super::write_options::WriteOptions;

/// Writes the film's data window: over the plate if there is one, tone mapped as the part in the
/// frame asks, with the legend there. `path` is for messages.
///
/// # Errors
/// `Retry` if the disk is full, `Limit` for a size that PNG cannot hold.
pub fn write(
    film: &Film,
    options: &WriteOptions,
    file: &mut impl Write,
    path: &Path,
) -> Result<()> {
    let &WriteOptions { tonemap, over, depth, fingerprint, legend, .. } = options;
    let composite = over.map(|plate| over::over(&film.pixels, plate));
    let pixels = composite.as_deref().unwrap_or(&film.pixels);
    let alpha = options.transparent && over.is_none();
    let shown = film.in_frame();
    let columns = shown.x0 as usize..shown.x1 as usize;
    let rows = pixels.chunks_exact(film.window.width() as usize);
    let rows = rows.skip(shown.y0 as usize).take(shown.height() as usize);
    let curve = Curve::new(rows.flat_map(|row| &row[columns.clone()]), tonemap, alpha);
    let mut bytes = tonemap::to_samples(pixels, &curve, alpha, depth);
    let color = PixelFormat { alpha, srgb: tonemap.srgb, depth };
    if let Some(legend) = legend {
        let width = film.window.width();
        legend.draw(&mut Canvas { bytes: &mut bytes, width, shown, color });
    }
    encode(film, &bytes, color, fingerprint, file, path)
}

/// Writes one id for each pixel of the film's data window: 16 bits grey, without a tone curve.
///
/// # Errors
/// The same as [`write()`].
pub fn write_ids(film: &Film, ids: &[u16], file: &mut impl Write, path: &Path) -> Result<()> {
    let mut buffered = BufWriter::new(file);
    let mut encoder = Encoder::new(&mut buffered, film.window.width(), film.window.height());
    encoder.set_depth(BitDepth::Sixteen);
    encoder.set_color(ColorType::Grayscale);
    let bytes: Vec<u8> = ids.iter().flat_map(|id| id.to_be_bytes()).collect();
    let written = encoder.write_header().and_then(|mut writer| {
        writer.write_image_data(&bytes)?;
        writer.finish()
    });
    written.map_err(|error| png_error(path, error))?;
    buffered.flush().map_err(|error| Error::io(path, "write", &error))
}

/// Writes `bytes`, the encoded pixels of the film's data window. `path` is for messages.
///
/// # Errors
/// The same as [`write()`].
pub fn encode(
    film: &Film,
    bytes: &[u8],
    color: PixelFormat,
    fingerprint: Option<&str>,
    file: &mut impl Write,
    path: &Path,
) -> Result<()> {
    let mut buffered = BufWriter::new(file);
    let (width, height) = (film.window.width(), film.window.height());
    let mut encoder = Encoder::new(&mut buffered, width, height);
    // The PNG is for viewing only. Fast compression more than halves the time to write EXR and PNG
    // together. The PNG has 1.2 to 2.1 times the bytes.
    encoder.set_compression(Compression::Fast);
    encoder.set_depth(match color.depth {
        Depth::Eight => BitDepth::Eight,
        Depth::Sixteen => BitDepth::Sixteen,
    });
    encoder.set_color(if color.alpha { ColorType::Rgba } else { ColorType::Rgb });
    match color.srgb {
        true => encoder.set_source_srgb(SrgbRenderingIntent::RelativeColorimetric),
        false => encoder.set_source_gamma(ScaledFloat::new(1.0)),
    }
    if let Some(fingerprint) = fingerprint {
        let text = encoder.add_text_chunk(super::finished::FINGERPRINT.into(), fingerprint.into());
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
            Error::new(ErrorKind::Limit, Problem::new(path.display().to_string(), message))
        }
    }
}
