//! Compressed files: gzip and zstd. They are recognised by their first bytes, not by their name,
//! and unpacked while they are read.

use std::io::{BufRead, BufReader, Error, ErrorKind, Read, Result};

use crate::reserve::MemoryLimit;
use flate2::bufread::GzDecoder;
use zstd::stream::read::Decoder;

/// log2 of the window that a zstd frame may use in a file of any size. The program `zstd` has this
/// limit by default: all its levels, and `--long` without a number, stay within it. A window takes
/// memory only as data fills it.
const WINDOW_LOG: u32 = 27;

/// log2 of the smallest window of the format.
const MIN_WINDOW_LOG: u32 = 10;

/// log2 of the largest window that the zstd library accepts. The format allows larger ones.
const MAX_WINDOW_LOG: u32 = 31;

/// The compression of a file.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Packing {
    Gzip,
    Zstd,
}

impl Packing {
    /// Detects the compression of data from its first bytes. `None` if it is not compressed.
    pub(super) fn detect(bytes: &[u8]) -> Option<Self> {
        match bytes {
            [0x1f, 0x8b, ..] => Some(Self::Gzip),
            [0x28, 0xb5, 0x2f, 0xfd, ..] => Some(Self::Zstd),
            // A skippable frame. Parallel compressors begin with one.
            [0x50..=0x5f, 0x2a, 0x4d, 0x18, ..] => Some(Self::Zstd),
            _ => None,
        }
    }

    pub(super) fn name(self) -> &'static str {
        match self {
            Self::Gzip => "gzip",
            Self::Zstd => "zstd",
        }
    }

    /// Returns a reader of the unpacked bytes of `packed`. `length` is the number of packed bytes,
    /// if known. The window of a zstd decoder takes at most `memory_limit`, or 1 KiB.
    ///
    /// # Errors
    /// If there is no memory for the decoder.
    pub(super) fn open<'a>(
        self,
        packed: impl Read + Send + 'a,
        length: Option<u64>,
        memory_limit: Option<MemoryLimit>,
    ) -> Result<Box<dyn Read + Send + 'a>> {
        let packed = BufReader::with_capacity(1 << 16, packed);
        Ok(match self {
            Self::Gzip => Box::new(Members(Some(GzDecoder::new(packed)))),
            Self::Zstd => {
                let mut frames = Decoder::with_buffer(packed)?;
                // A window above `WINDOW_LOG` may be up to twice the size of the packed file.
                let double = length.unwrap_or(0).saturating_mul(2).max(1).ilog2();
                let max_log = double.clamp(WINDOW_LOG, MAX_WINDOW_LOG);
                // The limit holds for the window alone. The arrays are checked separately.
                let log_limit = memory_limit.map_or(max_log, |limit| limit.bytes.max(1).ilog2());
                frames.window_log_max(max_log.min(log_limit).max(MIN_WINDOW_LOG))?;
                Box::new(Frames(frames))
            }
        })
    }
}

/// Reads all members of a gzip file, as `gunzip` does; parallel compressors write several. Zeros
/// after a member are skipped: some programs pad their files.
struct Members<R>(Option<GzDecoder<R>>);

impl<R: BufRead> Read for Members<R> {
    fn read(&mut self, out: &mut [u8]) -> Result<usize> {
        while let Some(member) = &mut self.0 {
            let count = member.read(out)?;
            if count > 0 || out.is_empty() {
                return Ok(count);
            }
            let rest = self.0.take().map(GzDecoder::into_inner);
            self.0 = rest.map_or(Ok(None), next_member)?;
        }
        Ok(0)
    }
}

/// Returns the member after some zeros, or `None` at the end of the file.
fn next_member<R: BufRead>(mut packed: R) -> Result<Option<GzDecoder<R>>> {
    loop {
        let bytes = match packed.fill_buf() {
            Err(error) if error.kind() == ErrorKind::Interrupted => continue,
            bytes => bytes?,
        };
        let (all, zeros) = (bytes.len(), bytes.iter().take_while(|&&byte| byte == 0).count());
        packed.consume(zeros);
        if zeros < all {
            return Ok(Some(GzDecoder::new(packed)));
        }
        if all == 0 {
            return Ok(None);
        }
    }
}

/// Returns the kind of an error of the zstd library: too large a window, no memory, damaged data.
fn kind_of(error: &str) -> ErrorKind {
    match error {
        "Frame requires too much memory for decoding" => ErrorKind::FileTooLarge,
        "Allocation error : not enough memory" => ErrorKind::OutOfMemory,
        _ => ErrorKind::InvalidData,
    }
}

/// Reads all frames of a zstd file.
struct Frames<'a, R: Read>(Decoder<'a, BufReader<R>>);

impl<R: Read> Read for Frames<'_, R> {
    fn read(&mut self, out: &mut [u8]) -> Result<usize> {
        self.0.read(out).map_err(|error| match error.kind() {
            // The library reports everything with this kind, and only names tell what it is.
            ErrorKind::Other => Error::new(kind_of(&error.to_string()), error.to_string()),
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
        Packing::detect(packed).unwrap().open(packed, length, None)?.read_to_end(&mut out)?;
        Ok(out)
    }

    #[test]
    fn all_members_and_frames_are_read() {
        let data: Vec<u8> = (0..300_000u32).flat_map(|i| i.wrapping_mul(i).to_le_bytes()).collect();
        let (first, second) = data.split_at(700_001);
        let skippable = [&0x184d_2a50u32.to_le_bytes()[..], &3u32.to_le_bytes(), b"abc"].concat();
        let padding = vec![0; 100_000];
        let members = [gzip(first), padding.clone(), gzip(second), padding];
        assert!(unpacked(&members.concat()).unwrap() == data);
        assert!(unpacked(&[gzip(first), gzip(second)].concat()).unwrap() == data);
        assert!(unpacked(&[gzip(first), vec![0, 1]].concat()).is_err());
        let frames = [zstd(first), skippable.clone(), zstd(b""), zstd(second), skippable];
        assert!(unpacked(&frames.concat()).unwrap() == data);
        let first = [0x184d_2a50u32, 0x184d_2a5f]
            .map(|magic| [&magic.to_le_bytes()[..], &4u32.to_le_bytes(), b"size"].concat());
        for skippable in first {
            assert!(unpacked(&[skippable, zstd(&data)].concat()).unwrap() == data);
        }
    }

    #[test]
    fn truncated_or_changed_data_is_an_error() {
        let data: Vec<u8> = (0..1000u32).flat_map(|i| (i * i).to_le_bytes()).collect();
        for packed in [gzip(&data), zstd(&data)] {
            assert_eq!(unpacked(&packed).unwrap(), data);
            for length in 4..packed.len() {
                assert!(unpacked(&packed[..length]).is_err(), "cut to {length}");
            }
            for at in packed.len() / 2..packed.len() - 4 {
                let mut changed = packed.clone();
                changed[at] ^= 1;
                // Some bits have no effect.
                let harmless = unpacked(&changed).is_ok_and(|found| found == data);
                assert!(harmless || unpacked(&changed).is_err(), "at {at} of {}", packed.len());
            }
        }
    }

    /// A zstd frame with the window descriptor `window` of RFC 8878. Its one block is `count` times
    /// the same byte.
    fn frame(window: u8, count: u32) -> Vec<u8> {
        let block = (count << 3 | 0b11).to_le_bytes();
        [&[0x28, 0xb5, 0x2f, 0xfd, 0, window][..], &block[..3], b"a"].concat()
    }

    #[test]
    fn the_window_is_limited_by_the_size_of_the_file() {
        let read = |window, length| {
            let mut out = String::new();
            let packed = frame(window, 100);
            let read =
                Packing::Zstd.open(&packed[..], length, None).unwrap().read_to_string(&mut out);
            read.map(|_| out).map_err(|error| error.kind())
        };
        let refused = Err(ErrorKind::FileTooLarge);
        // Windows of 1 KiB and 128 MiB, then a little more, 512 MiB, 2 GiB and the largest that 8
        // bits can express.
        for window in [0x00, 0x88] {
            assert_eq!(read(window, None), Ok("a".repeat(100)));
        }
        for window in [0x89, 0x98, 0xa8, 0xff] {
            assert_eq!(read(window, None), refused);
            assert_eq!(read(window, Some(10)), refused);
        }
        assert_eq!(read(0x98, Some((256 << 20) - 1)), refused);
        assert_eq!(read(0x98, Some(256 << 20)), Ok("a".repeat(100)));
        assert_eq!(read(0xa9, Some(u64::MAX)), refused);
    }

    #[test]
    fn a_block_larger_than_the_format_allows_is_an_error() {
        // The format allows 128 KiB.
        for (count, read) in [(1 << 17, true), ((1 << 17) + 1, false), ((1 << 21) - 1, false)] {
            assert_eq!(unpacked(&frame(0x88, count)).is_ok(), read, "{count}");
        }
    }
}
