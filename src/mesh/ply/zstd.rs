//! zstd: the frames of a file, one after the other, and how much memory each may ask for.

use std::io::{BufRead, BufReader, Error, ErrorKind, Read, Result, copy, sink};

use ruzstd::decoding::{BlockDecodingStrategy, FrameDecoder};

/// What every frame starts with.
pub(super) const MAGIC: [u8; 4] = [0x28, 0xb5, 0x2f, 0xfd];

/// Bytes that one call of the decoder unpacks, beside the frame's own window.
const STEP: usize = 1 << 20;

/// A window that any file may ask for, as the program `zstd` has it by default. All of its levels stay
/// within; `--long=28` and higher do not.
const WINDOW: u64 = 128 << 20;

/// Memory that is kept from frame to frame. A larger window is not reserved: it grows with the data, so
/// that a damaged header alone takes none.
const KEPT: u64 = 8 << 20;

/// All frames of a file.
pub(super) struct Frames<R: Read> {
    packed: BufReader<R>,
    /// Of the packed file, if it is known.
    length: Option<u64>,
    /// Of one frame at a time.
    decoder: FrameDecoder,
    /// Whether `decoder` is inside a frame.
    open: bool,
}

impl<R: Read> Frames<R> {
    /// The frames of a file of `length` bytes, if that is known.
    pub(super) fn new(packed: BufReader<R>, length: Option<u64>) -> Self {
        Self { packed, length, decoder: FrameDecoder::new(), open: false }
    }

    /// Moves into the next frame that holds data; `false` at the end of the file.
    fn open(&mut self) -> Result<bool> {
        while !self.packed.fill_buf()?.is_empty() {
            match Header::read(&mut self.packed)? {
                Header::Skippable(length) => {
                    let skipped = copy(&mut self.packed.by_ref().take(length), &mut sink())?;
                    if skipped < length {
                        return Err(cut("a skippable frame"));
                    }
                }
                Header::Data(header) => {
                    let window = header.window();
                    self.check_window(window)?;
                    if window > KEPT {
                        self.decoder = FrameDecoder::new();
                    }
                    self.decoder.reset(header.bytes()).map_err(bad)?;
                    self.open = true;
                    return Ok(true);
                }
            }
        }
        Ok(false)
    }

    /// An error if a frame's window is too large for this file.
    fn check_window(&self, window: u64) -> Result<()> {
        let most = WINDOW.saturating_add(self.length.unwrap_or(0).saturating_mul(2));
        if window <= most {
            return Ok(());
        }
        let file =
            self.length.map_or(String::new(), |n| format!(" and twice the file's {n} bytes"));
        Err(bad(format!("a frame asks for a window of {window} bytes; the most is 128 MiB{file}")))
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

/// How a frame begins (RFC 8878, section 3.1).
#[derive(Debug, PartialEq)]
enum Header {
    Data(DataHeader),
    /// No data: so many bytes follow that mean nothing to us.
    Skippable(u64),
}

impl Header {
    fn read(packed: &mut impl Read) -> Result<Self> {
        let mut header = DataHeader { bytes: [0; DataHeader::MOST], length: 0 };
        header.more(packed, 4)?;
        let magic = &header.bytes[..4];
        if let [0x50..=0x5f, 0x2a, 0x4d, 0x18] = magic {
            header.more(packed, 4)?;
            return Ok(Self::Skippable(header.number(4..8)));
        }
        if magic != MAGIC {
            return Err(bad(format!(
                "a frame begins with the bytes {magic:02x?}, not {MAGIC:02x?}"
            )));
        }
        header.more(packed, 1)?;
        header.more(packed, header.content_at() - 5 + header.content_size())?;
        Ok(Self::Data(header))
    }
}

/// The header of a frame with data: the magic bytes, a byte that tells which fields there are, then window,
/// dictionary and size of the content, each of which may be missing.
#[derive(Debug, PartialEq)]
struct DataHeader {
    bytes: [u8; Self::MOST],
    length: usize,
}

impl DataHeader {
    const MOST: usize = 18;

    /// Reads the next bytes.
    fn more(&mut self, packed: &mut impl Read, count: usize) -> Result<()> {
        let next = &mut self.bytes[self.length..self.length + count];
        packed.read_exact(next).map_err(|error| match error.kind() {
            ErrorKind::UnexpectedEof => cut("the header of a frame"),
            _ => error,
        })?;
        self.length += count;
        Ok(())
    }

    fn bytes(&self) -> &[u8] {
        &self.bytes[..self.length]
    }

    /// The little-endian number at some bytes.
    fn number(&self, at: std::ops::Range<usize>) -> u64 {
        self.bytes[at].iter().rev().fold(0, |sum, byte| sum << 8 | u64::from(*byte))
    }

    /// Whether the window is the whole content, and has no field of its own.
    fn is_single_segment(&self) -> bool {
        self.bytes[4] & 0x20 != 0
    }

    /// Where the size of the content stands: after window and dictionary.
    fn content_at(&self) -> usize {
        5 + usize::from(!self.is_single_segment()) + [0, 1, 2, 4][usize::from(self.bytes[4] & 3)]
    }

    /// Bytes of the size of the content.
    fn content_size(&self) -> usize {
        match self.bytes[4] >> 6 {
            0 => usize::from(self.is_single_segment()),
            flag => 1 << flag,
        }
    }

    /// Bytes of unpacked data that the decoder must keep.
    fn window(&self) -> u64 {
        if !self.is_single_segment() {
            let base = 1u64 << (10 + (self.bytes[5] >> 3));
            return base + base / 8 * u64::from(self.bytes[5] & 7);
        }
        let (at, size) = (self.content_at(), self.content_size());
        // Sizes up to 255 fit one byte.
        self.number(at..at + size) + if size == 2 { 256 } else { 0 }
    }
}

fn bad(error: impl ToString) -> Error {
    Error::new(ErrorKind::InvalidData, error.to_string())
}

fn cut(inside: &str) -> Error {
    Error::new(ErrorKind::UnexpectedEof, format!("the data ends inside {inside}"))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn open(packed: &[u8], length: Option<u64>) -> Frames<&[u8]> {
        Frames::new(BufReader::new(packed), length)
    }

    fn unpacked(packed: &[u8], length: Option<u64>) -> Result<String> {
        let mut out = String::new();
        open(packed, length).read_to_string(&mut out)?;
        Ok(out)
    }

    fn window(packed: &[u8]) -> (u64, usize) {
        match Header::read(&mut &packed[..]).unwrap() {
            Header::Data(header) => (header.window(), header.length),
            Header::Skippable(_) => panic!("skippable"),
        }
    }

    const HELLO: &str = "hello hello hello hello\n";
    /// What `zstd` 1.5.4 makes of [`HELLO`]: these bytes, a header's fields, then `BODY`.
    const BODY: [u8; 17] =
        [0x6d, 0, 0, 0x38, b'h', b'e', b'l', b'l', b'o', b' ', 0x0a, 1, 0, 0x99, 0x4b, 0x11, 0xa8];
    const END: [u8; 3] = [0x7c, 0x2e, 0xa8];

    fn hello(fields: &[u8]) -> Vec<u8> {
        [&MAGIC, fields, &BODY, &END].concat()
    }

    #[test]
    fn headers_of_the_program_zstd() {
        // zstd h; the same from stdin; --no-content-size; --ultra -22 --long=27 from stdin.
        for (fields, expected) in [
            (&[0x24, 0x18][..], (24, 6)),
            (&[0x04, 0x58], (2 << 20, 6)),
            (&[0x04, 0x00], (1 << 10, 6)),
            (&[0x04, 0x88], (128 << 20, 6)),
        ] {
            let packed = hello(fields);
            assert_eq!(window(&packed), expected, "{fields:x?}");
            for length in [None, Some(packed.len() as u64)] {
                assert_eq!(unpacked(&packed, length).unwrap(), HELLO, "{fields:x?}");
            }
        }
        // 300 and 70000 times the letter a: sizes in two and in four bytes.
        let a = |start: &[u8], end: &[u8]| [&MAGIC, start, end].concat();
        let short = a(
            &[0x64, 0x2c, 0x00],
            &[0x4d, 0, 0, 0x10, 0x61, 0x61, 1, 0, 0x27, 0x2a, 0xc0, 0x02, 0xc7, 0xcf, 0xcf, 0xb9],
        );
        assert_eq!(window(&short), (300, 7));
        assert_eq!(unpacked(&short, None).unwrap(), "a".repeat(300));
        let long = a(
            &[0xa4, 0x70, 0x11, 0x01, 0x00],
            &[
                0x55, 0, 0, 0x10, 0x61, 0x61, 1, 0, 0x6b, 0x11, 0x39, 0xc0, 0x02, 0xa1, 0xa9, 0xf8,
                0x1f,
            ],
        );
        assert_eq!(window(&long), (70_000, 9));
        assert_eq!(unpacked(&long, None).unwrap(), "a".repeat(70_000));
        // Packed with dictionaries, of numbers of one byte and of four, which we do not have.
        for (fields, length) in
            [(&[0x25, 0x4d, 0x18][..], 7), (&[0x27, 0x74, 0x5a, 0xb5, 0x09, 0x18], 10)]
        {
            assert_eq!(window(&hello(fields)), (24, length));
            let error = unpacked(&hello(fields), None).unwrap_err().to_string();
            assert!(error.contains("dictionary"), "{error}");
        }
    }

    #[test]
    fn a_window_is_held_against_the_file() {
        // --long=31 from stdin: 2 GiB, which `zstd -d` refuses, too.
        let packed = hello(&[0x04, 0xa8]);
        let of = |length| unpacked(&packed, length).map_err(|error| error.to_string());
        let most = "a frame asks for a window of 2147483648 bytes; the most is 128 MiB";
        assert_eq!(of(None).unwrap_err(), most);
        assert_eq!(of(Some(26)).unwrap_err(), format!("{most} and twice the file's 26 bytes"));
        let enough = (2048 - 128) << 19;
        assert!(of(Some(enough - 1)).is_err());
        assert_eq!(of(Some(enough)).unwrap(), HELLO);
        // The next frame after a small one likewise.
        let both = [hello(&[0x24, 0x18]), packed.clone()].concat();
        assert_eq!(unpacked(&both, None).unwrap_err().to_string(), most);
        assert_eq!(unpacked(&both, Some(enough)).unwrap(), HELLO.repeat(2));
        // One segment of more than memory: eight bytes of size.
        let whole = [&MAGIC[..], &[0xe0], &[0xff; 8]].concat();
        assert_eq!(window(&whole), (u64::MAX, 13));
        assert!(unpacked(&whole, Some(13)).unwrap_err().to_string().contains("window"));
        let largest = [&MAGIC[..], &[0x00, 0xff]].concat();
        assert_eq!(window(&largest), ((1 << 41) + 7 * (1 << 38), 6));
    }

    #[test]
    fn every_header_has_the_decoder_s_length() {
        for descriptor in 0..=255u8 {
            // A window that the decoder takes, whatever the field that the byte belongs to.
            let packed = [&MAGIC[..], &[descriptor], &[0x01; 20]].concat();
            let mut rest = &packed[..];
            let taken = FrameDecoder::new().reset(&mut rest);
            let (_, length) = window(&packed);
            assert_eq!(length, packed.len() - rest.len(), "{descriptor:x}: {taken:?}");
            for short in 0..length {
                let error = Header::read(&mut &packed[..short]).unwrap_err();
                assert_eq!(error.to_string(), "the data ends inside the header of a frame");
            }
        }
    }

    #[test]
    fn what_is_between_frames_is_skipped_if_it_is_whole() {
        let skippable = [&0x184d_2a5fu32.to_le_bytes()[..], &3u32.to_le_bytes(), b"abc"].concat();
        let packed = [&skippable[..], &hello(&[0x24, 0x18]), &skippable].concat();
        assert_eq!(unpacked(&packed, None).unwrap(), HELLO);
        let error = |bytes: &[u8]| unpacked(bytes, None).unwrap_err().to_string();
        assert_eq!(error(&packed[..packed.len() - 1]), "the data ends inside a skippable frame");
        assert_eq!(
            error(&packed[..packed.len() - 4]),
            "the data ends inside the header of a frame"
        );
        assert_eq!(
            error(&[&packed[..], b"ply\n"].concat()),
            "a frame begins with the bytes [70, 6c, 79, 0a], not [28, b5, 2f, fd]"
        );
    }
}
