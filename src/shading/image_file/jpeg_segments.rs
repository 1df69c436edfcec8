//! Segments of a JPEG file.

use std::io::{self, BufRead, Read};

/// Whether the pixels of a JPEG are decoded row by row: it is sequential, and its first scan has
/// all its channels. `file` is at the start.
///
/// # Errors
/// Errors of the file.
pub fn rows_are_in_order(file: impl BufRead) -> io::Result<bool> {
    let mut channels = None;
    for segment in Segments(file) {
        let Segment { marker, data } = segment?;
        match marker {
            0xc0 | 0xc1 => channels = data.get(5).copied(),
            START_OF_SCAN => return Ok(channels.is_some() && data.first().copied() == channels),
            _ => {}
        }
    }
    Ok(false)
}

/// Whether a JPEG has its end marker. `file` is at the start.
///
/// # Errors
/// Errors of the file.
pub fn has_end(file: impl BufRead) -> io::Result<bool> {
    for segment in Segments(file) {
        if segment?.marker == END_OF_IMAGE {
            return Ok(true);
        }
    }
    Ok(false)
}

const END_OF_IMAGE: u8 = 0xd9;
const START_OF_SCAN: u8 = 0xda;

/// A segment without its length. The end of the image has no data.
struct Segment {
    marker: u8,
    data: Vec<u8>,
}

/// The segments in their order, up to the end of the image or the file. A segment that is cut off
/// is the last.
struct Segments<R>(R);

impl<R: BufRead> Segments<R> {
    /// The next marker. In entropy-coded data, FF occurs only before 00 or a restart marker
    /// (D0-D7), which are passed over. FF may be repeated.
    fn marker(&mut self) -> io::Result<Option<u8>> {
        loop {
            self.0.skip_until(0xff)?;
            let mut byte = [0xff];
            while byte[0] == 0xff {
                if self.0.read(&mut byte)? == 0 {
                    return Ok(None);
                }
            }
            if !matches!(byte[0], 0x00 | 0x01 | 0xd0..=0xd8) {
                return Ok(Some(byte[0]));
            }
        }
    }

    fn segment(&mut self) -> io::Result<Option<Segment>> {
        let Some(marker) = self.marker()? else { return Ok(None) };
        if marker == END_OF_IMAGE {
            return Ok(Some(Segment { marker, data: Vec::new() }));
        }
        let [high, low] = self.bytes(2)?[..] else { return Ok(None) };
        let length = u16::from_be_bytes([high, low]);
        Ok(Some(Segment { marker, data: self.bytes(length.saturating_sub(2))? }))
    }

    /// The next `length` bytes, or those up to the end of the file.
    fn bytes(&mut self, length: u16) -> io::Result<Vec<u8>> {
        let mut bytes = Vec::new();
        self.0.by_ref().take(length.into()).read_to_end(&mut bytes)?;
        Ok(bytes)
    }
}

impl<R: BufRead> Iterator for Segments<R> {
    type Item = io::Result<Segment>;

    fn next(&mut self) -> Option<Self::Item> {
        self.segment().transpose()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The start of an image, a frame of 3 channels of this kind, and a scan of `scanned` of them.
    fn jpeg(frame: u8, scanned: u8) -> Vec<u8> {
        // A comment that looks like the end of the image.
        let comment = [0xff, 0xfe, 0, 4, 0xff, 0xd9];
        let frame = [0xff, 0xff, frame, 0, 8, 8, 0, 16, 0, 16, 3];
        let scan = [0xff, 0xda, 0, 3, scanned, 1, 0xff, 0, 0xff, 0xd0, 2];
        [&[0xff, 0xd8], &comment[..], &frame, &scan].concat()
    }

    #[test]
    fn only_a_sequential_scan_of_all_channels_has_its_rows_in_order() {
        for (frame, scanned, expected) in
            [(0xc0, 3, true), (0xc1, 3, true), (0xc0, 1, false), (0xc2, 3, false)]
        {
            let data = jpeg(frame, scanned);
            assert_eq!(rows_are_in_order(&data[..]).unwrap(), expected, "{frame:x} {scanned}");
        }
        assert!(!rows_are_in_order(&jpeg(0xc0, 3)[..15]).unwrap());
    }

    #[test]
    fn the_end_is_a_marker_outside_of_the_data() {
        let mut data = jpeg(0xc0, 3);
        assert!(!has_end(&data[..]).unwrap());
        data.extend([0xff, 0xd9]);
        assert!(has_end(&data[..]).unwrap());
        for length in 0..data.len() {
            assert!(!has_end(&data[..length]).unwrap(), "{length}");
        }
    }
}
