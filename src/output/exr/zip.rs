//! OpenEXR's ZIP: zlib over differences of bytes, the even ones first.

use libdeflater::{CompressionLvl, Compressor};

/// OpenEXR's own level.
const LEVEL: i32 = 4;

/// A compressor and its memory, for one block after the other.
pub struct Zip {
    compressor: Compressor,
    /// The block as it is without compression, little-endian.
    pub raw: Vec<u8>,
    differences: Vec<u8>,
    packed: Vec<u8>,
}

impl Zip {
    /// Ready for any block.
    pub fn new() -> Self {
        let level = CompressionLvl::new(LEVEL).unwrap_or_default();
        let compressor = Compressor::new(level);
        Self { compressor, raw: Vec::new(), differences: Vec::new(), packed: Vec::new() }
    }

    /// The block as it stands in the file: `raw` itself if that is not longer.
    pub fn compress(&mut self) -> Vec<u8> {
        let Self { compressor, raw, differences, packed } = self;
        differences.resize(raw.len(), 0);
        separate(raw, differences);
        packed.resize(raw.len().saturating_sub(1), 0);
        match compressor.zlib_compress(differences, packed) {
            Ok(length) => packed[..length].to_vec(),
            Err(_) => raw.clone(),
        }
    }
}

/// Bytes 0, 2, 4..., then 1, 3, 5..., each less the one before it, plus 128.
fn separate(raw: &[u8], differences: &mut [u8]) {
    let (even, odd) = differences.split_at_mut(raw.len().div_ceil(2));
    let pairs = raw.chunks_exact(2);
    if let ([last], Some(to)) = (pairs.remainder(), even.last_mut()) {
        *to = *last;
    }
    for ((pair, even), odd) in pairs.zip(even).zip(odd) {
        (*even, *odd) = (pair[0], pair[1]);
    }
    // From the end, so that every byte is still there when the next one needs it.
    const SOME: usize = 64;
    let mut end = differences.len();
    while end > SOME {
        let before: [u8; SOME] = std::array::from_fn(|i| differences[end - SOME - 1 + i]);
        for (byte, before) in differences[end - SOME..end].iter_mut().zip(before) {
            *byte = byte.wrapping_sub(before).wrapping_add(128);
        }
        end -= SOME;
    }
    for i in (1..end).rev() {
        differences[i] = differences[i].wrapping_sub(differences[i - 1]).wrapping_add(128);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bytes_are_separated_as_openexr_says() {
        for length in [0, 1, 2, 5, 64, 65, 66, 200, 1001] {
            let raw: Vec<u8> = (0..length).map(|i: usize| (i * i / 3 + 7 * i) as u8).collect();
            let mut found = vec![0; length];
            separate(&raw, &mut found);
            // As in OpenEXR's internal_zip: one byte at a time.
            let even = raw.iter().step_by(2);
            let mut expected: Vec<u8> =
                even.chain(raw.iter().skip(1).step_by(2)).copied().collect();
            let mut before = expected.first().copied().unwrap_or(0);
            for byte in expected.iter_mut().skip(1) {
                let difference = i32::from(*byte) - i32::from(before) + 128 + 256;
                before = *byte;
                *byte = difference as u8;
            }
            assert_eq!(found, expected, "{length}");
        }
    }

    #[test]
    fn what_cannot_be_compressed_stays_as_it_is() {
        let mut state = 1_u32;
        let noise = (0..4096).map(|_| {
            state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            (state >> 24) as u8
        });
        let noise: Vec<u8> = noise.collect();
        let mut zip = Zip::new();
        let mut compress = |raw: &[u8]| {
            zip.raw = raw.to_vec();
            zip.compress()
        };
        assert_eq!(compress(&noise), noise);
        assert!(compress(&[7; 4096]).len() < 100);
        assert!(compress(&[]).is_empty());
    }
}
