//! Thumbnails of an input's frames, side by side in one image.

use std::path::Path;

use image::codecs::jpeg::JpegEncoder;
use image::{DynamicImage, ImageReader, ImageResult, Limits, Rgb, RgbImage, RgbaImage, imageops};

use crate::batch::job::Job;
use crate::output::Outputs;

use super::entry::SheetEntry;

/// Longer side of a thumbnail in pixels.
pub const SIDE: u32 = 192;
/// Colour behind transparent pixels and around smaller pictures.
const BACKDROP: [u8; 3] = [214, 217, 221];
/// Quality of the JPEG in percent.
const QUALITY: u8 = 82;

/// Thumbnails of one input's frames, from left to right.
#[derive(Debug, Clone)]
pub struct Strip {
    /// The thumbnails side by side, as one JPEG file.
    pub jpeg: Vec<u8>,
    /// Indices of the frames that have a thumbnail, from left to right.
    pub frames: Vec<u32>,
    /// Width and height of the cell of each thumbnail in the JPEG.
    pub cell: [u32; 2],
    /// Thumbnail of the first of these frames.
    pub first: RgbImage,
}

impl Strip {
    /// Makes at most `max_count` thumbnails, evenly spread over the frames. Frames whose picture
    /// cannot be read have none. `None` if no thumbnail is left.
    pub fn of(job: &Job, entry: &SheetEntry, max_count: usize) -> Option<Self> {
        let there: Vec<u32> = entry.frames.keys().copied().collect();
        let count = there.len().min(max_count);
        let chosen = (0..count).map(|i| there[i * there.len() / count]);
        let mut thumbnails: Vec<(u32, RgbImage)> = Vec::new();
        for frame in chosen {
            let [_, png] = Outputs::names(&job.prefix(entry.number, frame));
            if let Ok(picture) = read(&png) {
                thumbnails.push((frame, small(picture.into_rgba8())));
            }
        }
        let (jpeg, cell) = joined(thumbnails.iter().map(|(_, picture)| picture))?;
        let frames = thumbnails.iter().map(|(frame, _)| *frame).collect();
        let (_, first) = thumbnails.swap_remove(0);
        Some(Self { jpeg, frames, cell, first })
    }
}

/// Joins pictures side by side in cells of one size, and returns the JPEG with the size of a cell.
/// The pictures of several cameras may differ in size: the cell is as large as the widest and the
/// highest, and each picture is in its middle. `None` without pictures.
fn joined<'a>(
    pictures: impl ExactSizeIterator<Item = &'a RgbImage> + Clone,
) -> Option<(Vec<u8>, [u32; 2])> {
    let width = pictures.clone().map(RgbImage::width).max()?;
    let height = pictures.clone().map(RgbImage::height).max()?;
    let mut image = RgbImage::from_pixel(width * pictures.len() as u32, height, Rgb(BACKDROP));
    for (i, picture) in pictures.enumerate() {
        let x = width * i as u32 + (width - picture.width()) / 2;
        let y = (height - picture.height()) / 2;
        imageops::replace(&mut image, picture, x.into(), y.into());
    }
    let mut jpeg = Vec::new();
    JpegEncoder::new_with_quality(&mut jpeg, QUALITY).encode_image(&image).ok()?;
    Some((jpeg, [width, height]))
}

/// Reads a frame, however large it is.
fn read(png: &Path) -> ImageResult<DynamicImage> {
    let mut reader = ImageReader::open(png)?;
    // The default, 512 MiB, is less than a frame of 16384 x 16384 pixels needs. DEFLATE reaches at
    // most 1032 bytes of pixels per byte of the file.
    let mut limits = Limits::default();
    limits.max_alloc = Some(png.metadata()?.len().saturating_mul(1032).saturating_add(1 << 20));
    reader.limits(limits);
    reader.decode()
}

/// Blends a picture over the backdrop and shrinks it to thumbnail size. Never enlarges it.
fn small(mut picture: RgbaImage) -> RgbImage {
    // Before it is shrunk: the colour of a transparent pixel must not count.
    for pixel in picture.pixels_mut() {
        let [r, g, b, a] = pixel.0.map(u32::from);
        let over = |value: u32, i: usize| {
            ((value * a + u32::from(BACKDROP[i]) * (255 - a) + 127) / 255) as u8
        };
        pixel.0 = [over(r, 0), over(g, 1), over(b, 2), 255];
    }
    let longer = picture.width().max(picture.height());
    if longer > SIDE {
        let side =
            |side: u32| (u64::from(side) * u64::from(SIDE) / u64::from(longer)).max(1) as u32;
        picture = imageops::thumbnail(&picture, side(picture.width()), side(picture.height()));
    }
    DynamicImage::from(picture).into_rgb8()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_colour_of_transparent_pixels_does_not_count() {
        let stripes = |other: [u8; 3]| {
            let [r, g, b] = other;
            let picture = RgbaImage::from_fn(2 * SIDE, 2 * SIDE, |x, _| match x % 2 {
                0 => image::Rgba([255, 255, 255, 255]),
                _ => image::Rgba([r, g, b, 0]),
            });
            small(picture)
        };
        let (black, white) = (stripes([0; 3]), stripes([255; 3]));
        assert_eq!(black, white);
        let middle = black.get_pixel(SIDE / 2, SIDE / 2).0;
        for (found, backdrop) in middle.iter().zip(BACKDROP) {
            assert!(found.abs_diff(((255 + u32::from(backdrop)) / 2) as u8) <= 1, "{middle:?}");
        }
    }
}
