//! Reads a PNG row by row, so that no more than a row of tiles is in memory.

use std::path::Path;

use image::ImageError;
use image::error::{DecodingError, LimitError, LimitErrorKind, ParameterError, ParameterErrorKind};
use png::{ColorType, DecodingError as PngError};

use super::header::{decoder_limit, explain, name, open};
use crate::error::{Error, ErrorKind, Problem, Result};
use crate::files::Stamp;
use crate::shading::tiles::{TileWriter, Tiles};

/// Reads an image of 8 bits a channel, without interlacing, into `tiles`. The errors are those of
/// the crate `image`, which reads the other images. Its decoders read only whole images.
///
/// # Errors
/// Damaged files; errors of the disk.
pub fn read(path: &Path, tiles: Tiles, max_bytes: u64) -> Result<(Tiles, Option<Stamp>)> {
    let failed = |error| explain(path, image_error(error));
    let (file, stamp) = open(path)?;
    let bytes = usize::try_from(decoder_limit(max_bytes)).unwrap_or(usize::MAX);
    let mut decoder = png::Decoder::new_with_limits(file, png::Limits { bytes });
    decoder.set_transformations(png::Transformations::EXPAND);
    let mut reader = decoder.read_info().map_err(failed)?;
    let (width, height) = reader.info().size();
    let (color, depth) = reader.output_color_type();
    if (width, height) != tiles.size() || depth != png::BitDepth::Eight {
        let problem = Problem::new(name(path), "was changed while it was read");
        return Err(Error::new(ErrorKind::Retry, problem));
    }
    let mut writer = TileWriter::new(tiles, &name(path))?;
    let (mut row, mut rgb) = (vec![0; width as usize * color.samples()], Vec::new());
    // The last call checks the end of the pixels.
    while reader.read_row(&mut row).map_err(failed)?.is_some() {
        rgb.clear();
        match color {
            ColorType::Rgb => rgb.extend_from_slice(&row),
            ColorType::Rgba => rgb.extend(row.chunks_exact(4).flat_map(|rgba| &rgba[..3])),
            _ => rgb.extend(row.iter().step_by(color.samples()).flat_map(|&grey| [grey; 3])),
        }
        writer.push(&rgb)?;
    }
    Ok((writer.finish()?, stamp))
}

/// Converts an error as the crate `image` does.
fn image_error(error: PngError) -> ImageError {
    match error {
        PngError::IoError(error) => ImageError::IoError(error),
        error @ PngError::Format(_) => {
            ImageError::Decoding(DecodingError::new(image::ImageFormat::Png.into(), error))
        }
        error @ PngError::Parameter(_) => ImageError::Parameter(ParameterError::from_kind(
            ParameterErrorKind::Generic(error.to_string()),
        )),
        PngError::LimitsExceeded => {
            ImageError::Limits(LimitError::from_kind(LimitErrorKind::InsufficientMemory))
        }
    }
}
