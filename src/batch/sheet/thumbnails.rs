//! Thumbnails of an input's frames, side by side in one image.

use std::fs::File;
use std::io::BufReader;
use std::path::Path;

use image::codecs::jpeg::JpegEncoder;
use image::{Rgb, RgbImage, imageops};
use png::{Decoder, Transformations};

use crate::batch::job::Job;
use crate::error::Result;
use crate::monitor::Monitor;
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
    ///
    /// # Errors
    /// A stop request in the monitor.
    pub fn of(
        job: &Job,
        entry: &SheetEntry,
        max_count: usize,
        monitor: &Monitor,
    ) -> Result<Option<Self>> {
        let there: Vec<u32> = entry.frames.keys().copied().collect();
        let count = there.len().min(max_count);
        let chosen = (0..count).map(|i| there[i * there.len() / count]);
        let mut thumbnails: Vec<(u32, RgbImage)> = Vec::new();
        for frame in chosen {
            monitor.check()?;
            let [_, png] = Outputs::names(&job.prefix(entry.number, frame));
            thumbnails.extend(read(&png).map(|picture| (frame, picture)));
        }
        let Some((jpeg, cell)) = joined(thumbnails.iter().map(|(_, picture)| picture)) else {
            return Ok(None);
        };
        let frames = thumbnails.iter().map(|(frame, _)| *frame).collect();
        let (_, first) = thumbnails.swap_remove(0);
        Ok(Some(Self { jpeg, frames, cell, first }))
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

/// Reads the thumbnail of a frame. Holds only one row of the frame at a time, so that large frames
/// take no memory. `None` if the file cannot be read, or if its rows are interlaced.
fn read(png: &Path) -> Option<RgbImage> {
    let mut decoder = Decoder::new(BufReader::new(File::open(png).ok()?));
    decoder.set_transformations(Transformations::normalize_to_color8() | Transformations::ALPHA);
    let mut reader = decoder.read_info().ok()?;
    if reader.info().interlaced {
        return None;
    }
    let (width, height) = reader.info().size();
    let channels = reader.output_color_type().0.samples();
    let mut shrinking = Shrinking::of([width, height]);
    while let Some(row) = reader.next_row().ok()? {
        // Either grey and alpha, or red, green, blue and alpha.
        shrinking.add(row.data().chunks_exact(channels).map(|pixel| match *pixel {
            [r, g, b, a] => [r, g, b, a],
            [grey, .., a] => [grey, grey, grey, a],
            _ => [0; 4],
        }));
    }
    shrinking.finish()
}

/// A picture that is blended over the backdrop and shrunk to thumbnail size, row by row. It is
/// never enlarged.
struct Shrinking {
    /// Width and height of the picture.
    from: [u64; 2],
    /// Number of rows that were added.
    rows: u64,
    /// For each column of the thumbnail, the sums of red, green and blue in its current row, and
    /// the number of pixels.
    sums: Vec<[u64; 4]>,
    to: RgbImage,
    /// Number of complete rows of the thumbnail.
    done: u32,
}

impl Shrinking {
    fn of([width, height]: [u32; 2]) -> Self {
        let longer = width.max(height).max(SIDE);
        let side =
            |side: u32| (u64::from(side) * u64::from(SIDE) / u64::from(longer)).max(1) as u32;
        let to = RgbImage::new(side(width), side(height));
        let sums = vec![[0; 4]; to.width() as usize];
        Self { from: [width.into(), height.into()], rows: 0, sums, to, done: 0 }
    }

    /// Adds the next row of red, green, blue and alpha.
    fn add(&mut self, row: impl Iterator<Item = [u8; 4]>) {
        let [width, height] = self.from;
        let columns = self.sums.len() as u64;
        for (x, [r, g, b, a]) in (0..width).zip(row) {
            let sum = &mut self.sums[(x * columns / width) as usize];
            let alpha = u32::from(a);
            // Before it is shrunk: the colour of a transparent pixel must not count.
            for (i, value) in [r, g, b].into_iter().enumerate() {
                let over = u32::from(value) * alpha + u32::from(BACKDROP[i]) * (255 - alpha);
                sum[i] += u64::from((over + 127) / 255);
            }
            sum[3] += 1;
        }
        self.rows += 1;
        if self.rows * u64::from(self.to.height()) / height > self.done.into() {
            for (x, sum) in self.sums.iter_mut().enumerate() {
                let [r, g, b, count] = std::mem::take(sum);
                let mean = [r, g, b].map(|sum| ((sum + count / 2) / count.max(1)) as u8);
                self.to.put_pixel(x as u32, self.done, Rgb(mean));
            }
            self.done += 1;
        }
    }

    /// Returns the thumbnail; `None` if rows are missing.
    fn finish(self) -> Option<RgbImage> {
        (self.done == self.to.height()).then_some(self.to)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_colour_of_transparent_pixels_does_not_count() {
        let stripes = |other: [u8; 3]| {
            let [r, g, b] = other;
            let mut shrinking = Shrinking::of([2 * SIDE, 2 * SIDE]);
            for _ in 0..2 * SIDE {
                shrinking.add((0..2 * SIDE).map(|x| match x % 2 {
                    0 => [255, 255, 255, 255],
                    _ => [r, g, b, 0],
                }));
            }
            shrinking.finish().unwrap()
        };
        let (black, white) = (stripes([0; 3]), stripes([255; 3]));
        assert_eq!(black, white);
        let middle = black.get_pixel(SIDE / 2, SIDE / 2).0;
        for (found, backdrop) in middle.iter().zip(BACKDROP) {
            assert!(found.abs_diff(((255 + u32::from(backdrop)) / 2) as u8) <= 1, "{middle:?}");
        }
    }

    #[test]
    fn every_size_gives_a_whole_thumbnail() {
        for size in [[1, 1], [5, 3], [SIDE, SIDE], [SIDE + 1, 7], [7, 3 * SIDE + 1], [1000, 1]] {
            let [width, height] = size;
            let mut shrinking = Shrinking::of(size);
            for _ in 0..height {
                assert!(shrinking.done < shrinking.to.height(), "{size:?}");
                shrinking.add((0..width).map(|_| [10, 20, 30, 255]));
            }
            let thumbnail = shrinking.finish().unwrap();
            assert!(thumbnail.pixels().all(|pixel| pixel.0 == [10, 20, 30]), "{size:?}");
            assert_eq!(thumbnail.width().max(thumbnail.height()), width.max(height).min(SIDE));
        }
    }

    /// Grey, palette, 16 bits, with and without alpha.
    #[test]
    fn every_kind_of_png_has_a_thumbnail() {
        use image::{DynamicImage, GrayAlphaImage, GrayImage, ImageBuffer, Rgba, RgbaImage};
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.png");
        let deep = ImageBuffer::from_pixel(300, 200, Rgba([0x4040u16, 0x4040, 0x4040, 0xffff]));
        let kinds: [DynamicImage; 5] = [
            GrayImage::from_pixel(300, 200, image::Luma([0x40])).into(),
            GrayAlphaImage::from_pixel(300, 200, image::LumaA([0x40, 255])).into(),
            RgbImage::from_pixel(300, 200, Rgb([0x40; 3])).into(),
            RgbaImage::from_pixel(300, 200, Rgba([0x40, 0x40, 0x40, 255])).into(),
            deep.into(),
        ];
        for kind in kinds {
            kind.save(&path).unwrap();
            let thumbnail = read(&path).unwrap();
            assert_eq!(thumbnail.dimensions(), (192, 128));
            assert!(thumbnail.pixels().all(|pixel| pixel.0 == [0x40; 3]), "{:?}", kind.color());
        }
        let whole = std::fs::read(&path).unwrap();
        std::fs::write(&path, &whole[..whole.len() / 2]).unwrap();
        assert_eq!(read(&path), None);
    }
}
