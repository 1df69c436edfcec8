//! Reads bytes as an image file in every way that the program does: as a texture, as a part to
//! merge, and as a picture to compare. The result must be an error with a message, or an image. A
//! texture must have the same texels if it is kept in tiles.
#![no_main]

use std::path::{Path, PathBuf};
use std::sync::LazyLock;

use lightpath::lab::compare::file::Picture;
use lightpath::merge::Parts;
use lightpath::scene::{Filter, Wrap};
use lightpath::shading::{ImageRequest, Texture};
use lightpath::{Error, Monitor};

mod folder;

/// Bytes that a texture may take while it is decoded.
const MAX_BYTES: u64 = 1 << 20;
/// An image of more texels is kept in tiles.
const WHOLE_TEXELS: u64 = 12;

struct Files {
    /// The file that is read.
    image: PathBuf,
    /// Second of the two parts of a picture. Seeds have the first.
    second: PathBuf,
}

static FILES: LazyLock<Files> = LazyLock::new(|| {
    let folder = folder::new("image");
    let second = folder.join("second.exr");
    folder::write(&second, include_bytes!("../seeds/image/second.exr"));
    Files { image: folder.join("image"), second }
});

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| {
    let Files { image, second } = &*FILES;
    folder::write(image, bytes);
    texture(image);
    for paths in [vec![image.clone()], vec![image.clone(), second.clone()]] {
        let film = Parts::open(&paths).and_then(|parts| {
            let film = parts.film(&Monitor::default())?;
            assert_eq!(film.pixels.len() as u64, film.window.pixels());
            Ok(film)
        });
        check(film.err());
    }
    match Picture::read(image) {
        Err(error) => check(Some(error)),
        Ok(picture) => assert!(!picture.layers.is_empty()),
    }
});

fn check(error: Option<Error>) {
    let Some(error) = error else { return };
    assert!(!error.problems.is_empty());
    assert!(!error.to_string().is_empty());
}

fn texture(path: &Path) {
    let load = |whole| {
        let request = ImageRequest { path, color_space: None, max_bytes: MAX_BYTES, whole };
        let texture = Texture::load(request)?;
        texture.check().map(|()| texture)
    };
    let whole = match load(u64::MAX) {
        Err(error) => return check(Some(error)),
        Ok(whole) => whole,
    };
    Texture::size(path).expect("the header of a readable image");
    // Tiles need temporary space of their own, so an image near the limit may be refused.
    let Ok(tiles) = load(WHOLE_TEXELS) else { return };
    assert_eq!((whole.width(), whole.height()), (tiles.width(), tiles.height()));
    for step in 0..16 {
        let (u, v) = (f64::from(step) / 16.0, f64::from(step * 7 % 16) / 16.0);
        let texel = |t: &Texture| t.lookup(u, v, Filter::Bilinear, Wrap::Repeat, Wrap::Clamp);
        assert_eq!(
            texel(&whole).to_array().map(f32::to_bits),
            texel(&tiles).to_array().map(f32::to_bits)
        );
    }
}
