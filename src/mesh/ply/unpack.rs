//! Compressed files: gzip and zstd, known by their first bytes whatever the file is called, and
//! unpacked while they are read.

use std::io::{BufReader, Read};

use flate2::bufread::MultiGzDecoder;

use super::zstd::{self, Frames};

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
            _ if bytes.starts_with(&zstd::MAGIC) => Some(Self::Zstd),
            _ => None,
        }
    }

    pub(super) fn name(self) -> &'static str {
        match self {
            Self::Gzip => "gzip",
            Self::Zstd => "zstd",
        }
    }

    /// The unpacked bytes of `packed`, of which there are `length` if that is known.
    pub(super) fn open<'a>(
        self,
        packed: impl Read + Send + 'a,
        length: Option<u64>,
    ) -> Box<dyn Read + Send + 'a> {
        let packed = BufReader::with_capacity(1 << 16, packed);
        match self {
            // All members, as `gunzip` and parallel writers have it.
            Self::Gzip => Box::new(MultiGzDecoder::new(packed)),
            Self::Zstd => Box::new(Frames::new(packed, length)),
        }
    }
}

#[cfg(test)]
mod tests {
    use std::io::{Result, Write};

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
        let length = Some(packed.len() as u64);
        Packing::of(packed).unwrap().open(packed, length).read_to_end(&mut out)?;
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
