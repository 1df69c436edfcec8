//! Decoder of whole PNG images, which skips the metadata.

use std::io::{BufRead, Seek};

use image::error::{DecodingError, LimitError, LimitErrorKind, ParameterError, ParameterErrorKind};
use image::{ColorType, ImageDecoder, ImageError, ImageResult};
use png::{BitDepth, DecodingError as PngError};

use crate::output::{png_read, stored_curve};

/// A PNG whose header is read.
pub struct PngImage<R: BufRead + Seek>(png::Reader<R>);

impl<R: BufRead + Seek> PngImage<R> {
    /// Reads the header of a file of `bytes` bytes.
    ///
    /// # Errors
    /// Damaged headers, and files that are too short for their pixels.
    pub fn new(file: R, bytes: u64) -> ImageResult<Self> {
        png_read::header(file, bytes).map(Self).map_err(image_error)
    }

    /// Gamma of the values, if the header has one.
    pub fn gamma(&self) -> Option<f64> {
        stored_curve::gamma(self.0.info())
    }
}

impl<R: BufRead + Seek> ImageDecoder for PngImage<R> {
    fn dimensions(&self) -> (u32, u32) {
        self.0.info().size()
    }

    fn color_type(&self) -> ColorType {
        let (color, depth) = self.0.output_color_type();
        match (color, depth == BitDepth::Sixteen) {
            // The decoder expands palettes.
            (png::ColorType::Rgb | png::ColorType::Indexed, false) => ColorType::Rgb8,
            (png::ColorType::Rgb | png::ColorType::Indexed, true) => ColorType::Rgb16,
            (png::ColorType::Rgba, false) => ColorType::Rgba8,
            (png::ColorType::Rgba, true) => ColorType::Rgba16,
            (png::ColorType::Grayscale, false) => ColorType::L8,
            (png::ColorType::Grayscale, true) => ColorType::L16,
            (png::ColorType::GrayscaleAlpha, false) => ColorType::La8,
            (png::ColorType::GrayscaleAlpha, true) => ColorType::La16,
        }
    }

    fn read_image(mut self, values: &mut [u8]) -> ImageResult<()> {
        let frame = self.0.next_frame(values).map_err(image_error)?;
        if frame.bit_depth == BitDepth::Sixteen {
            for pair in values.chunks_exact_mut(2) {
                let value = u16::from_be_bytes([pair[0], pair[1]]);
                pair.copy_from_slice(&value.to_ne_bytes());
            }
        }
        Ok(())
    }

    fn read_image_boxed(self: Box<Self>, values: &mut [u8]) -> ImageResult<()> {
        (*self).read_image(values)
    }
}

/// Converts an error as the crate `image` does.
pub fn image_error(error: PngError) -> ImageError {
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
