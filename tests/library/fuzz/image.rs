//! Reads bytes as an image file in every way that the program does: as a texture, as a part to
//! merge, and as a picture to compare. The result must be an error with a message, or an image. A
//! texture must have the same texels if it is kept in tiles.

use std::path::Path;

use lightpath::lab::compare::file::Picture;
use lightpath::merge::Parts;
use lightpath::scene::{Filter, Wrap};
use lightpath::shading::{ImageRequest, Texture};
use lightpath::{ErrorKind, Monitor, Result};

use super::inputs;

/// Bytes that a texture may take while it is decoded.
const MAX_BYTES: u64 = 1 << 20;
/// An image of more texels is kept in tiles.
const WHOLE_TEXELS: u64 = 12;

/// Second of the two parts of a picture. Seeds have the first.
const SECOND: &str = "second.exr";

/// Writes the file beside which inputs are read.
pub fn prepare(folder: &Path) {
    inputs::write(&folder.join(SECOND), include_bytes!("../../data/fuzz/seeds/image/second.exr"));
}

/// Runs one input in a prepared folder. Returns whether it is a texture.
pub fn run(folder: &Path, bytes: &[u8]) -> bool {
    let (image, second) = (&folder.join("image"), &folder.join(SECOND));
    inputs::write(image, bytes);
    let is_texture = texture(image);
    for paths in [vec![image.clone()], vec![image.clone(), second.clone()]] {
        let film = Parts::open(&paths).and_then(|parts| parts.film(&Monitor::default()));
        match film {
            Err(error) => inputs::check_error(&error),
            Ok(film) => assert_eq!(film.pixels.len() as u64, film.window.pixels()),
        }
    }
    match Picture::read(image) {
        Err(error) => inputs::check_error(&error),
        Ok(picture) => assert!(!picture.layers.is_empty()),
    }
    is_texture
}

fn texture(path: &Path) -> bool {
    let load = |whole| -> Result<Texture> {
        let request = ImageRequest { path, color_space: None, max_bytes: MAX_BYTES, whole };
        let texture = Texture::load(request)?;
        texture.check().map(|()| texture)
    };
    let whole = match load(u64::MAX) {
        Err(error) => {
            inputs::check_error(&error);
            return false;
        }
        Ok(whole) => whole,
    };
    Texture::size(path).expect("the header of a readable image");
    let tiles = match load(WHOLE_TEXELS) {
        // Tiles need more memory while they are made, so an image near the limit may exceed it.
        Err(error) => {
            assert_eq!(error.kind, ErrorKind::Limit, "{error}");
            return true;
        }
        Ok(tiles) => tiles,
    };
    assert_eq!((whole.width(), whole.height()), (tiles.width(), tiles.height()));
    for step in 0..16 {
        let (u, v) = (f64::from(step) / 16.0, f64::from(step * 7 % 16) / 16.0);
        let texel = |t: &Texture| t.lookup(u, v, Filter::Bilinear, Wrap::Repeat, Wrap::Clamp);
        assert_eq!(
            texel(&whole).to_array().map(f32::to_bits),
            texel(&tiles).to_array().map(f32::to_bits)
        );
    }
    true
}
