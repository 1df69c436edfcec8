//! Compressed files: gzip and zstd, known by their first bytes whatever the file is called, and
//! unpacked while they are read.

use std::io::{BufRead, BufReader, Error, ErrorKind, Read, Result, copy, sink};

use flate2::bufread::MultiGzDecoder;
use ruzstd::decoding::{
    BlockDecodingStrategy, FrameDecoder,
    errors::{FrameDecoderError, ReadFrameHeaderError},
};

/// How a file is packed.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Packing {
    Gzip,
    Zstd,
}

impl Packing {
    /// The packing of the data that starts with `bytes`.
    pub(super) fn of(bytes: &[u8]) -> Option<Self> {
        match bytes {
            [0x1f, 0x8b, ..] => Some(Self::Gzip),
            [0x28, 0xb5, 0x2f, 0xfd, ..] => Some(Self::Zstd),
            _ => None,
        }
    }

    pub(super) fn name(self) -> &'static str {
        match self {
            Self::Gzip => "gzip",
            Self::Zstd => "zstd",
        }
    }

    /// The unpacked bytes of `packed`.
    pub(super) fn open<'a>(self, packed: impl Read + Send + 'a) -> Box<dyn Read + Send + 'a> {
        let packed = BufReader::with_capacity(1 << 16, packed);
        match self {
            // All members, as `gunzip` and parallel writers have it.
            Self::Gzip => Box::new(MultiGzDecoder::new(packed)),
            Self::Zstd => Box::new(Frames { packed, decoder: FrameDecoder::new(), open: false }),
        }
    }
}

/// All frames of a zstd file, one after the other.
struct Frames<R: Read> {
    packed: BufReader<R>,
    /// Of one frame at a time.
    decoder: FrameDecoder,
    /// Whether `decoder` is inside a frame.
    open: bool,
}

/// Bytes that one call of the decoder unpacks, beside the frame's own window.
const STEP: usize = 1 << 20;

impl<R: Read> Frames<R> {
    /// Moves into the next frame that holds data; `false` at the end of the file.
    fn open(&mut self) -> Result<bool> {
        while !self.packed.fill_buf()?.is_empty() {
            match self.decoder.reset(&mut self.packed) {
                Ok(()) => {
                    self.open = true;
                    return Ok(true);
                }
                Err(FrameDecoderError::ReadFrameHeaderError(ReadFrameHeaderError::SkipFrame {
                    length,
                    ..
                })) => {
                    let mut skipped = self.packed.by_ref().take(u64::from(length));
                    copy(&mut skipped, &mut sink())?;
                }
                Err(error) => return Err(bad(error)),
            }
        }
        Ok(false)
    }

    fn check_sum(&self) -> Result<()> {
        match self.decoder.get_checksum_from_data() {
            Some(sum) if Some(sum) != self.decoder.get_calculated_checksum() => {
                Err(bad("the checksum of a frame does not match its data"))
            }
            _ => Ok(()),
        }
    }
}

impl<R: Read> Read for Frames<R> {
    fn read(&mut self, out: &mut [u8]) -> Result<usize> {
        loop {
            if !self.open && !self.open()? {
                return Ok(0);
            }
            let read = self.decoder.read(out)?;
            if read > 0 || out.is_empty() {
                return Ok(read);
            }
            if self.decoder.is_finished() {
                self.check_sum()?;
                self.open = false;
            } else {
                let step = BlockDecodingStrategy::UptoBytes(STEP);
                self.decoder.decode_blocks(&mut self.packed, step).map_err(bad)?;
            }
        }
    }
}

fn bad(error: impl ToString) -> Error {
    Error::new(ErrorKind::InvalidData, error.to_string())
}

#[cfg(test)]
mod tests {
    use std::io::Write;

    use flate2::{Compression, write::GzEncoder};
    use ruzstd::encoding::{CompressionLevel, compress_to_vec};

    use super::*;

    fn gzip(bytes: &[u8]) -> Vec<u8> {
        let mut out = GzEncoder::new(Vec::new(), Compression::fast());
        out.write_all(bytes).unwrap();
        out.finish().unwrap()
    }

    fn zstd(bytes: &[u8]) -> Vec<u8> {
        compress_to_vec(bytes, CompressionLevel::Fastest)
    }

    fn unpacked(packed: &[u8]) -> Result<Vec<u8>> {
        let mut out = Vec::new();
        Packing::of(packed).unwrap().open(packed).read_to_end(&mut out)?;
        Ok(out)
    }

    #[test]
    fn all_members_and_frames_are_read() {
        let data: Vec<u8> = (0..300_000u32).flat_map(|i| (i * i).to_le_bytes()).collect();
        let (first, second) = data.split_at(700_001);
        let skippable = [&0x184d_2a50u32.to_le_bytes()[..], &3u32.to_le_bytes(), b"abc"].concat();
        assert!(unpacked(&[gzip(first), gzip(second)].concat()).unwrap() == data);
        let frames = [zstd(first), skippable.clone(), zstd(b""), zstd(second), skippable];
        assert!(unpacked(&frames.concat()).unwrap() == data);
    }

    #[test]
    fn what_is_cut_or_changed_is_an_error() {
        let data: Vec<u8> = (0..1000u32).flat_map(|i| (i * i).to_le_bytes()).collect();
        for packed in [gzip(&data), zstd(&data)] {
            assert_eq!(unpacked(&packed).unwrap(), data);
            for length in 4..packed.len() {
                assert!(unpacked(&packed[..length]).is_err(), "cut to {length}");
            }
            for at in packed.len() / 2..packed.len() - 4 {
                let mut changed = packed.clone();
                changed[at] ^= 1;
                // A bit may be one that means nothing.
                let harmless = unpacked(&changed).is_ok_and(|found| found == data);
                assert!(harmless || unpacked(&changed).is_err(), "at {at} of {}", packed.len());
            }
        }
    }
}
