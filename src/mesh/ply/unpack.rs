//! Compressed files: gzip and zstd, known by their first bytes whatever the file is called, and
//! unpacked while they are read.

use std::io::{BufReader, Error, ErrorKind, Read, Result};

use crate::reserve::Room;
use flate2::bufread::MultiGzDecoder;
use zstd::stream::read::Decoder;

/// log2 of the window that any zstd frame may ask for, as for the program `zstd`: all of its levels and
/// `--long` stay within. The memory is touched as data fills it.
const WINDOW_LOG: u32 = 27;

/// The least of the format.
const LEAST_WINDOW_LOG: u32 = 10;

/// The largest of the format.
const MOST_WINDOW_LOG: u32 = 31;

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

    /// The unpacked bytes of `packed`, of which there are `length` if that is known. Unpacking takes no more than
    /// `room`.
    ///
    /// # Errors
    /// Where memory ran out.
    pub(super) fn open<'a>(
        self,
        packed: impl Read + Send + 'a,
        length: Option<u64>,
        room: Option<Room>,
    ) -> Result<Box<dyn Read + Send + 'a>> {
        let packed = BufReader::with_capacity(1 << 16, packed);
        Ok(match self {
            // All members, as `gunzip` and parallel writers have it.
            Self::Gzip => Box::new(MultiGzDecoder::new(packed)),
            Self::Zstd => {
                let mut frames = Decoder::with_buffer(packed)?;
                // A large file may ask for a window of up to twice its size.
                let double = length.unwrap_or(0).saturating_mul(2).max(1).ilog2();
                let most = double.clamp(WINDOW_LOG, MOST_WINDOW_LOG);
                // What is unpacked stands beside the arrays.
                let room = room.map_or(most, |room| room.bytes.max(1).ilog2());
                frames.window_log_max(most.min(room).max(LEAST_WINDOW_LOG))?;
                Box::new(Frames(frames))
            }
        })
    }
}

/// All frames of a zstd file.
struct Frames<'a, R: Read>(Decoder<'a, BufReader<R>>);

impl<R: Read> Read for Frames<'_, R> {
    fn read(&mut self, out: &mut [u8]) -> Result<usize> {
        self.0.read(out).map_err(|error| match error.kind() {
            // What the library says of the data.
            ErrorKind::Other => Error::new(ErrorKind::InvalidData, error.to_string()),
            _ => error,
        })
    }
}

#[cfg(test)]
mod tests {
    use std::io::Write;

    use flate2::{Compression, write::GzEncoder};

    use super::*;

    fn gzip(bytes: &[u8]) -> Vec<u8> {
        let mut out = GzEncoder::new(Vec::new(), Compression::fast());
        out.write_all(bytes).unwrap();
        out.finish().unwrap()
    }

    fn zstd(bytes: &[u8]) -> Vec<u8> {
        let mut out = zstd::Encoder::new(Vec::new(), 1).unwrap();
        out.include_checksum(true).unwrap();
        out.write_all(bytes).unwrap();
        out.finish().unwrap()
    }

    fn unpacked(packed: &[u8]) -> Result<Vec<u8>> {
        let mut out = Vec::new();
        let length = Some(packed.len() as u64);
        Packing::of(packed).unwrap().open(packed, length, None)?.read_to_end(&mut out)?;
        Ok(out)
    }

    #[test]
    fn all_members_and_frames_are_read() {
        let data: Vec<u8> = (0..300_000u32).flat_map(|i| i.wrapping_mul(i).to_le_bytes()).collect();
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

    /// A frame with a window as RFC 8878 writes it, of one block: `count` times one byte.
    fn frame(window: u8, count: u32) -> Vec<u8> {
        let block = (count << 3 | 0b11).to_le_bytes();
        [&[0x28, 0xb5, 0x2f, 0xfd, 0, window][..], &block[..3], b"a"].concat()
    }

    #[test]
    fn a_window_is_held_against_the_file() {
        let of = |window, length| {
            let mut out = String::new();
            let packed = frame(window, 100);
            let read =
                Packing::Zstd.open(&packed[..], length, None).unwrap().read_to_string(&mut out);
            read.map(|_| out).map_err(|error| error.to_string())
        };
        let refused = Err("Frame requires too much memory for decoding".to_owned());
        // 1 KiB, 128 MiB, a little more, 512 MiB, 2 GiB, and what 8 bits can say.
        for window in [0x00, 0x88] {
            assert_eq!(of(window, None), Ok("a".repeat(100)));
        }
        for window in [0x89, 0x98, 0xa8, 0xff] {
            assert_eq!(of(window, None), refused);
            assert_eq!(of(window, Some(10)), refused);
        }
        assert_eq!(of(0x98, Some((256 << 20) - 1)), refused);
        assert_eq!(of(0x98, Some(256 << 20)), Ok("a".repeat(100)));
        assert_eq!(of(0xa9, Some(u64::MAX)), refused);
    }

    #[test]
    fn a_block_is_held_to_its_limit() {
        // 128 KiB is what the format allows.
        for (count, read) in [(1 << 17, true), ((1 << 17) + 1, false), ((1 << 21) - 1, false)] {
            assert_eq!(unpacked(&frame(0x88, count)).is_ok(), read, "{count}");
        }
    }
}
