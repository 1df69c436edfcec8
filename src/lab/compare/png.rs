//! Reads PNG files as linear light: grey, palettes, 1 to 16 bits, alpha.
//!
//! A `gAMA` chunk defines the curve. Values are sRGB without that chunk, with an `sRGB` chunk, or
//! if gamma is 1 / 2.2.

use std::fs::File;
use std::io::BufReader;
use std::path::Path;

use png::{BitDepth, ColorType, DecodingError};

use crate::error::{Error, ErrorKind, Problem, Result};
use crate::output::png_read;
use crate::output::stored_curve::{self, StoredCurve};
use crate::reserve;

use super::layer::{Meaning, PictureLayer, WORKING_BYTES, fits, has_room};

/// Reads the light of a PNG file, premultiplied by alpha, and its alpha if it has any.
pub fn layers(path: &Path) -> Result<Vec<PictureLayer>> {
    let failed = |error| decoding_error(path, error);
    let no_read = |error| Error::io(path, "read", &error);
    let file = File::open(path).map_err(no_read)?;
    let file_bytes = file.metadata().map_err(no_read)?.len();
    let mut reader = png_read::header(BufReader::new(file), file_bytes).map_err(failed)?;
    let gamma = stored_curve::gamma(reader.info());
    let curve = gamma.map_or(StoredCurve::Srgb, StoredCurve::of_gamma);
    let bytes = reader.output_buffer_size().unwrap_or(usize::MAX);
    fits(path, bytes as u64)?;
    let (width, height) = reader.info().size();
    let size = [width as usize, height as usize];
    let pixels = size[0] * size[1];
    let place = path.display().to_string();
    // The pixels of the file, three channels of light, alpha, and the comparison. So a picture that
    // is too large is refused before it is decoded.
    has_room(&place, bytes as u64 + (16 + WORKING_BYTES) * pixels as u64)?;
    let mut buffer = reserve::filled(0, bytes, &place)?;
    let frame = reader.next_frame(&mut buffer).map_err(failed)?;
    let (channels, with_alpha) = match frame.color_type {
        ColorType::Grayscale | ColorType::Indexed => (1, false),
        ColorType::GrayscaleAlpha => (2, true),
        ColorType::Rgb => (3, false),
        ColorType::Rgba => (4, true),
    };
    let value_bytes = if frame.bit_depth == BitDepth::Sixteen { 2 } else { 1 };
    let (mut light, mut alpha) = (Vec::new(), Vec::new());
    reserve::exact(&mut light, 3 * pixels, &place)?;
    for pixel in buffer.chunks_exact(channels * value_bytes) {
        let value = |c: usize| match value_bytes {
            2 => f64::from(u16::from_be_bytes([pixel[2 * c], pixel[2 * c + 1]])) / 65535.0,
            _ => f64::from(pixel[c]) / 255.0,
        };
        let a = if with_alpha { value(channels - 1) } else { 1.0 };
        let at = |c: usize| value(if channels < 3 { 0 } else { c });
        light.extend((0..3).map(|c| (curve.to_linear(at(c)) * a) as f32));
        if with_alpha {
            alpha.push(a as f32);
        }
    }
    let layer = |name: &str, meaning: Meaning, channels: &[&str], values: Vec<f32>| PictureLayer {
        name: name.to_string(),
        meaning,
        size,
        origin: [0, 0],
        channels: channels.iter().map(|c| c.to_string()).collect(),
        values,
        half: false,
    };
    let names: &[&str] = if channels < 3 { &["Y"] } else { &["R", "G", "B"] };
    let mut layers = vec![layer("", Meaning::Light, names, light)];
    if with_alpha {
        layers.push(layer("A", Meaning::Data, &["A"], alpha));
    }
    Ok(layers)
}

fn decoding_error(path: &Path, error: DecodingError) -> Error {
    let place = path.display().to_string();
    let (kind, message) = match error {
        DecodingError::IoError(error) if error.kind() != std::io::ErrorKind::UnexpectedEof => {
            return Error::io(path, "read", &error);
        }
        DecodingError::LimitsExceeded => {
            (ErrorKind::Limit, "found chunks that are too large to read".to_string())
        }
        other => (ErrorKind::Invalid, format!("cannot read the PNG: {other}")),
    };
    Error::new(kind, Problem::new(place, message))
}
