//! Small pictures of an input's frames, side by side in one image.

use image::{DynamicImage, Rgb, RgbImage, codecs::jpeg::JpegEncoder, imageops};

use crate::{batch::job::Job, output::Outputs};

use super::entry::Entry;

/// Longer side of a thumbnail in pixels.
pub const SIDE: u32 = 192;
/// What shows through transparent pixels.
const BEHIND: [u8; 3] = [214, 217, 221];
/// Of the JPEG.
const QUALITY: u8 = 82;

/// Frames of one input from left to right.
#[derive(Debug, Clone)]
pub struct Strip {
    /// All of them.
    pub image: RgbImage,
    /// The numbers of the frames.
    pub frames: Vec<u32>,
    /// Width of one.
    pub width: u32,
}

impl Strip {
    /// At most so many frames of an input, evenly spread; `None` where no picture can be read.
    pub fn of(job: &Job, entry: &Entry, most: usize) -> Option<Self> {
        let there: Vec<u32> = entry.frames.keys().copied().collect();
        let count = there.len().min(most);
        let chosen = (0..count).map(|i| there[i * there.len() / count]);
        let mut thumbnails: Vec<(u32, RgbImage)> = Vec::new();
        for frame in chosen {
            let [_, png] = Outputs::names(&job.prefix(entry.number, frame));
            if let Ok(picture) = image::open(&png) {
                thumbnails.push((frame, small(&picture)));
            }
        }
        let (width, height) = thumbnails.first()?.1.dimensions();
        // A frame of another size is another job's.
        thumbnails.retain(|(_, picture)| picture.dimensions() == (width, height));
        let mut image = RgbImage::new(width * thumbnails.len() as u32, height);
        for (i, (_, picture)) in thumbnails.iter().enumerate() {
            imageops::replace(&mut image, picture, i64::from(width) * i as i64, 0);
        }
        Some(Self { image, frames: thumbnails.iter().map(|(frame, _)| *frame).collect(), width })
    }

    /// The first frame alone.
    pub fn first(&self) -> RgbImage {
        imageops::crop_imm(&self.image, 0, 0, self.width, self.image.height()).to_image()
    }

    /// As a JPEG file.
    pub fn jpeg(&self) -> Vec<u8> {
        let mut bytes = Vec::new();
        let encoded = JpegEncoder::new_with_quality(&mut bytes, QUALITY).encode_image(&self.image);
        encoded.map(|()| bytes).unwrap_or_default()
    }
}

fn small(picture: &DynamicImage) -> RgbImage {
    let picture = picture.thumbnail(SIDE, SIDE).to_rgba8();
    RgbImage::from_fn(picture.width(), picture.height(), |x, y| {
        let [r, g, b, a] = picture.get_pixel(x, y).0.map(u32::from);
        let over = |value: u32, i: usize| {
            ((value * a + u32::from(BEHIND[i]) * (255 - a) + 127) / 255) as u8
        };
        Rgb([over(r, 0), over(g, 1), over(b, 2)])
    })
}
