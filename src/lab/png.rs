//! PNG files in memory.

use image::RgbImage;
use image::codecs::png::PngEncoder;

/// Encodes a picture as a PNG file; empty if the encoder fails.
pub fn encode(image: &RgbImage) -> Vec<u8> {
    let mut file = Vec::new();
    // Only the encoder itself can fail. `write_to` would compile the encoders of all formats.
    match image.write_with_encoder(PngEncoder::new(&mut file)) {
        Ok(()) => file,
        Err(_) => Vec::new(),
    }
}
