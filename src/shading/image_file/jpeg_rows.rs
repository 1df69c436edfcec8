//! Decodes a JPEG into a temporary file, so that few of its pixels are in memory at once.

use std::cell::Cell;
use std::io::{self, BufRead, BufReader, Read, Seek, SeekFrom};
use std::path::Path;

use image::error::{
    DecodingError, LimitError, LimitErrorKind, UnsupportedError, UnsupportedErrorKind,
};
use image::{ImageError, ImageFormat};
use zune_core::colorspace::ColorSpace;
use zune_core::options::DecoderOptions;
use zune_jpeg::JpegDecoder;
use zune_jpeg::errors::DecodeErrors;

use super::file_pages::{FilePages, Release};
use super::header::{explain, name, open};
use crate::error::{Error, ErrorKind, Problem, Result};
use crate::files::Stamp;
use crate::shading::tiles::{SIDE, TileWriter, Tiles};

/// Bytes of the file that are decoded before the finished pixels leave memory. Each time takes some
/// 0.1 ms, for 0.8 GB of pixels.
const READ_BYTES: usize = 1 << 15;

/// Upper bound of the bytes of pixels that come from one byte of the file. A block of 64 pixels of
/// 3 channels takes at least 2 bits: its mean, and the end of its coefficients.
const PIXEL_BYTES_OF_BYTE: usize = 3 * 64 * 8 / 2;

/// Upper bound of the memory that [`read`] needs, in bytes, without the texture. If the data of a
/// damaged file end early, the rest becomes grey at once, in pages that the system can write back.
pub fn max_bytes(width: u32) -> u64 {
    // The decoder has up to 32 rows of 3 channels in 16 bits, and as much space to enlarge them.
    // After it, there are two rows of tiles.
    let row = (2 * 32 * 3 * 2).max(2 * 3 * SIDE as u64);
    (READ_BYTES * PIXEL_BYTES_OF_BYTE) as u64 + u64::from(width) * row
}

/// Reads an image whose rows are in order into `tiles`. It has 1 or 3 channels. `pixels` is as
/// large as the image. If the data end early, the rest is grey. The errors are those of the crate
/// `image`, which reads the smaller images with the same decoder.
///
/// # Errors
/// Other damage; errors of the disk.
pub fn read(path: &Path, tiles: Tiles, mut pixels: FilePages) -> Result<(Tiles, Option<Stamp>)> {
    let (width, height) = tiles.size();
    let row_bytes = pixels.bytes().len() / height as usize;
    let is_grey = row_bytes == width as usize;
    let (file, stamp) = open(path)?;
    decode(path, file.into_inner(), [width, height], &mut pixels)?;
    pixels.release().leave_memory();

    let mut writer = TileWriter::new(tiles, &name(path))?;
    let (mut row, mut rgb) = (vec![0; row_bytes], Vec::new());
    for y in 0..u64::from(height) {
        pixels.read(y * row_bytes as u64, &mut row)?;
        if is_grey {
            rgb.clear();
            rgb.extend(row.iter().flat_map(|&grey| [grey; 3]));
            writer.push(&rgb)?;
        } else {
            writer.push(&row)?;
        }
    }
    Ok((writer.finish()?, stamp))
}

/// Decodes an image of this size. The decoder takes a failed read for the end of the data, so such
/// an error is kept aside.
fn decode(
    path: &Path,
    file: impl Read + Seek,
    size: [u32; 2],
    pixels: &mut FilePages,
) -> Result<()> {
    let failure = Cell::new(None);
    let file = Releasing { file, pixels: pixels.release(), failure: &failure };
    let result = decode_file(path, file, size, pixels.bytes());
    match failure.into_inner() {
        Some(error) => Err(Error::io(path, "read the texture", &error)),
        None => result,
    }
}

fn decode_file(
    path: &Path,
    file: Releasing<impl Read + Seek>,
    [width, height]: [u32; 2],
    pixels: &mut [u8],
) -> Result<()> {
    let failed = |error| explain(path, image_error(error));
    let is_grey = pixels.len() == width as usize * height as usize;
    let options = DecoderOptions::default()
        .jpeg_set_out_colorspace(if is_grey { ColorSpace::Luma } else { ColorSpace::RGB })
        .set_strict_mode(false)
        .set_max_width(usize::MAX)
        .set_max_height(usize::MAX);
    let file = Buffered { file: BufReader::with_capacity(READ_BYTES, file), position: 0 };
    let mut decoder = JpegDecoder::new_with_options(file, options);
    decoder.decode_headers().map_err(failed)?;
    if decoder.dimensions() != Some((width as usize, height as usize)) {
        let problem = Problem::new(name(path), "was changed while it was read");
        return Err(Error::new(ErrorKind::Retry, problem));
    }
    decoder.decode_into(pixels).map_err(failed)
}

/// A file. Each time that it is read, the pixels decoded so far leave memory.
struct Releasing<'a, F> {
    file: F,
    pixels: Release,
    /// The last error of the file, but for interruptions.
    failure: &'a Cell<Option<io::Error>>,
}

impl<F: Read> Read for Releasing<'_, F> {
    fn read(&mut self, bytes: &mut [u8]) -> io::Result<usize> {
        self.pixels.leave_memory();
        self.file.read(bytes).inspect_err(|error| {
            let code = error.raw_os_error();
            if let Some(code) = code.filter(|_| error.kind() != io::ErrorKind::Interrupted) {
                self.failure.set(Some(io::Error::from_raw_os_error(code)));
            }
        })
    }
}

impl<F: Seek> Seek for Releasing<'_, F> {
    fn seek(&mut self, to: SeekFrom) -> io::Result<u64> {
        self.file.seek(to)
    }
}

/// A buffered file. The decoder often goes back some bytes, which keeps this buffer. `BufReader`
/// alone would read its buffer again.
struct Buffered<F> {
    file: BufReader<F>,
    position: u64,
}

impl<F: Read> Read for Buffered<F> {
    fn read(&mut self, bytes: &mut [u8]) -> io::Result<usize> {
        let length = self.file.read(bytes)?;
        self.position += length as u64;
        Ok(length)
    }
}

impl<F: Read> BufRead for Buffered<F> {
    fn fill_buf(&mut self) -> io::Result<&[u8]> {
        self.file.fill_buf()
    }

    fn consume(&mut self, length: usize) {
        self.file.consume(length);
        self.position += length as u64;
    }
}

impl<F: Read + Seek> Seek for Buffered<F> {
    fn seek(&mut self, to: SeekFrom) -> io::Result<u64> {
        self.position = match to {
            SeekFrom::Current(by) => {
                self.file.seek_relative(by)?;
                self.position.saturating_add_signed(by)
            }
            to => self.file.seek(to)?,
        };
        Ok(self.position)
    }
}

/// Converts an error as the crate `image` does.
fn image_error(error: DecodeErrors) -> ImageError {
    let format = || ImageFormat::Jpeg.into();
    match error {
        DecodeErrors::Unsupported(what) => {
            let kind = UnsupportedErrorKind::GenericFeature(format!("{what:?}"));
            ImageError::Unsupported(UnsupportedError::from_format_and_kind(format(), kind))
        }
        DecodeErrors::LargeDimensions(_) => {
            ImageError::Limits(LimitError::from_kind(LimitErrorKind::DimensionError))
        }
        error => ImageError::Decoding(DecodingError::new(format(), error)),
    }
}

#[cfg(test)]
mod tests {
    use std::io::Cursor;

    use super::*;

    /// A file whose disk fails from a byte on.
    struct Failing {
        file: Cursor<Vec<u8>>,
        good: u64,
    }

    impl Read for Failing {
        fn read(&mut self, bytes: &mut [u8]) -> io::Result<usize> {
            const EIO: i32 = 5;
            match self.good.saturating_sub(self.file.position()) {
                0 => Err(io::Error::from_raw_os_error(EIO)),
                left => self.file.by_ref().take(left).read(bytes),
            }
        }
    }

    impl Seek for Failing {
        fn seek(&mut self, to: SeekFrom) -> io::Result<u64> {
            self.file.seek(to)
        }
    }

    #[test]
    fn a_disk_that_fails_is_no_end_of_the_data() {
        let noise = |x: u32, y: u32| x.wrapping_mul(0x9e37_79b9) ^ y.wrapping_mul(0x85eb_ca6b);
        let image = image::GrayImage::from_fn(512, 512, |x, y| [(noise(x, y) >> 24) as u8].into());
        let mut file = Cursor::new(Vec::new());
        image.write_to(&mut file, ImageFormat::Jpeg).unwrap();
        let data = file.into_inner();
        let length = data.len() as u64;
        assert!(length > 2 * READ_BYTES as u64, "{length}");
        // `None` if this machine has no disk for temporary files.
        let Some(mut pixels) = FilePages::new(512 * 512) else { return };
        for (good, fails) in [(u64::MAX, false), (length - 9, true), (length / 2, true), (0, true)]
        {
            let file = Failing { file: Cursor::new(data.clone()), good };
            let result = decode(Path::new("a.jpg"), file, [512, 512], &mut pixels);
            let message = result.err().map(|error| error.to_string());
            assert_eq!(message.is_some(), fails, "{good} of {length}: {message:?}");
            let disk = |text: String| text.contains("cannot read the texture");
            assert!(message.is_none_or(disk), "{good} of {length}");
        }
    }
}
