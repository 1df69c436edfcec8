//! Reads a PNG row by row, so that no more than a row of tiles is in memory.

use std::path::Path;

use png::ColorType;

use super::header::{explain, name, open};
use super::png_image::image_error;
use crate::error::{Error, ErrorKind, Problem, Result};
use crate::files::Stamp;
use crate::output::png_read;
use crate::shading::tiles::{TileWriter, Tiles};

/// Reads an image of 8 bits a channel, without interlacing, into `tiles`. The errors are those of
/// the crate `image`, which reads the other images. Its decoders read only whole images.
///
/// # Errors
/// Damaged files; errors of the disk.
pub fn read(path: &Path, tiles: Tiles) -> Result<(Tiles, Option<Stamp>)> {
    let failed = |error| explain(path, image_error(error));
    let (file, stamp) = open(path)?;
    let bytes = file.get_ref().metadata().map_err(|e| Error::io(path, "read the texture", &e))?;
    let mut reader = png_read::header(file, bytes.len()).map_err(failed)?;
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
