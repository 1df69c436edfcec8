//! PNG files in memory.

use std::io::Cursor;

use image::{ImageFormat, RgbImage};

/// Encodes a picture as a PNG file; empty if the encoder fails.
pub fn encode(image: &RgbImage) -> Vec<u8> {
    let mut file = Cursor::new(Vec::new());
    // Writing to memory cannot fail; only the encoder itself can.
    match image.write_to(&mut file, ImageFormat::Png) {
        Ok(()) => file.into_inner(),
        Err(_) => Vec::new(),
    }
}
