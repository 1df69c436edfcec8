//! Opens PNG files for reading. A small file cannot make the decoder reserve much memory.

use std::io::{BufRead, Error, ErrorKind, Seek};

use png::{Decoder, DecodingError, Limits, Reader, Transformations};

/// Bytes that the decoder may take beside a row of pixels and the chunk `eXIf`.
const CHUNK_BYTES: usize = 64 << 20;
/// Most bytes that one byte of deflate data unpacks to.
const MAX_INFLATION: u64 = 1032;

/// Reads the header of a PNG file of `bytes` bytes, for pixels of 8 or 16 bits without a palette.
///
/// Colour profiles and texts are skipped: 1 MB of them can unpack to 1 GB.
///
/// # Errors
/// The decoder's, for damaged files. `UnexpectedEof` if the file is too short for its pixels.
pub fn header<R: BufRead + Seek>(file: R, bytes: u64) -> Result<Reader<R>, DecodingError> {
    // The decoder holds the chunk `eXIf`, which is not compressed: it is shorter than the file.
    let chunks = usize::try_from(bytes).unwrap_or(usize::MAX).saturating_add(CHUNK_BYTES);
    let mut decoder = Decoder::new_with_limits(file, Limits { bytes: chunks });
    decoder.set_ignore_text_chunk(true);
    decoder.set_ignore_iccp_chunk(true);
    decoder.set_transformations(Transformations::EXPAND);
    let info = decoder.read_header_info()?;
    // Interlaced pixels take at least as many bytes.
    let row = u64::from(info.width) * info.bits_per_pixel() as u64 / 8;
    if row.saturating_mul(info.height.into()) / MAX_INFLATION > bytes {
        let message = "the file is too short for its pixels";
        return Err(DecodingError::IoError(Error::new(ErrorKind::UnexpectedEof, message)));
    }
    // The decoder counts one unpacked row, of up to 4 channels of 16 bits.
    let row = usize::try_from(8 * u64::from(info.width)).unwrap_or(usize::MAX);
    decoder.set_limits(Limits { bytes: row.saturating_add(chunks) });
    decoder.read_info()
}

#[cfg(test)]
mod tests {
    use std::borrow::Cow;
    use std::io::Cursor;

    use super::*;

    /// A PNG without pixels.
    fn without_pixels(size: [u32; 2]) -> Vec<u8> {
        let mut file = Vec::new();
        png::Encoder::new(&mut file, size[0], size[1]).write_header().unwrap();
        file
    }

    #[test]
    fn files_that_are_too_short_for_their_pixels_are_refused() {
        for (size, fits) in [([i32::MAX as u32, 1], false), ([60000; 2], false), ([90; 2], true)] {
            let file = without_pixels(size);
            let read = header(Cursor::new(&file), file.len() as u64);
            let message = match read {
                Err(DecodingError::IoError(error)) => error.to_string(),
                _ => String::new(),
            };
            assert_eq!(message.contains("too short for its pixels"), !fits, "{size:?}");
        }
    }

    /// Scanners and panorama programs write previews and notes into this chunk.
    #[test]
    fn a_long_exif_chunk_is_no_reason_to_refuse_a_file() {
        let mut file = Vec::new();
        let mut info = png::Info::with_size(4, 4);
        info.exif_metadata = Some(Cow::Owned(vec![0; CHUNK_BYTES + (1 << 20)]));
        let mut writer = png::Encoder::with_info(&mut file, info).unwrap().write_header().unwrap();
        writer.write_image_data(&[7; 16]).unwrap();
        drop(writer);
        let mut reader = header(Cursor::new(&file), file.len() as u64).unwrap();
        let mut pixels = [0; 16];
        assert!(reader.next_frame(&mut pixels).is_ok() && pixels == [7; 16]);
    }

    #[test]
    fn a_profile_is_not_unpacked() {
        let mut file = Vec::new();
        let mut info = png::Info::with_size(4, 4);
        info.icc_profile = Some(Cow::Owned(vec![0; 1 << 16]));
        let mut writer = png::Encoder::with_info(&mut file, info).unwrap().write_header().unwrap();
        writer.write_image_data(&[7; 16]).unwrap();
        drop(writer);
        let mut reader = header(Cursor::new(&file), file.len() as u64).unwrap();
        assert!(reader.info().icc_profile.is_none());
        assert!(reader.next_frame(&mut [0; 16]).is_ok());
        let usual = png::Decoder::new(Cursor::new(&file)).read_info().unwrap();
        assert!(usual.info().icc_profile.is_some());
    }
}
