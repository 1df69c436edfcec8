//! Reads PNG files as linear light: grey, palettes, 1 to 16 bits, alpha.
//!
//! A `gAMA` chunk defines the curve. Values are sRGB without that chunk, with an `sRGB` chunk, or
//! if gamma is 1 / 2.2.

use std::fs::File;
use std::io::BufReader;
use std::path::Path;

use png::{BitDepth, ColorType, Decoder, DecodingError, Limits, Transformations};

use crate::error::{Error, ErrorKind, Problem, Result};
use crate::output::stored_curve::{self, StoredCurve};

use super::layer::{MAX_BYTES, Meaning, PictureLayer, fits};

/// Reads the light of a PNG file, premultiplied by alpha, and its alpha if it has any.
pub fn layers(path: &Path) -> Result<Vec<PictureLayer>> {
    let failed = |error| decoding_error(path, error);
    let file = File::open(path).map_err(|error| Error::io(path, "read", &error))?;
    let limits = Limits { bytes: MAX_BYTES as usize };
    let mut decoder = Decoder::new_with_limits(BufReader::new(file), limits);
    decoder.set_transformations(Transformations::EXPAND);
    let mut reader = decoder.read_info().map_err(failed)?;
    let gamma = stored_curve::gamma(reader.info());
    let curve = gamma.map_or(StoredCurve::Srgb, StoredCurve::of_gamma);
    let bytes = reader.output_buffer_size().unwrap_or(usize::MAX);
    fits(path, bytes as u64)?;
    let mut buffer = Vec::new();
    buffer.try_reserve_exact(bytes).map_err(|_| {
        let message = format!("no memory for {bytes} bytes of pixels");
        Error::no_memory(&path.display().to_string(), message)
    })?;
    buffer.resize(bytes, 0);
    let frame = reader.next_frame(&mut buffer).map_err(failed)?;
    let values: Vec<f64> = match frame.bit_depth {
        BitDepth::Sixteen => {
            let pairs = buffer.chunks_exact(2);
            pairs.map(|p| f64::from(u16::from_be_bytes([p[0], p[1]])) / 65535.0).collect()
        }
        _ => buffer.iter().map(|byte| f64::from(*byte) / 255.0).collect(),
    };
    let size = [frame.width as usize, frame.height as usize];
    let (channels, with_alpha) = match frame.color_type {
        ColorType::Grayscale | ColorType::Indexed => (1, false),
        ColorType::GrayscaleAlpha => (2, true),
        ColorType::Rgb => (3, false),
        ColorType::Rgba => (4, true),
    };
    let mut light = Vec::with_capacity(3 * size[0] * size[1]);
    let mut alpha = Vec::new();
    for pixel in values.chunks_exact(channels) {
        let a = if with_alpha { pixel[channels - 1] } else { 1.0 };
        let at = |c: usize| pixel[if channels < 3 { 0 } else { c }];
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
            (ErrorKind::Limit, format!("its pixels need more than {MAX_BYTES} bytes"))
        }
        other => (ErrorKind::Invalid, format!("cannot read the PNG: {other}")),
    };
    Error::new(kind, Problem::new(place, message))
}
