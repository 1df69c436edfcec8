//! Counts how often the camera sees each primitive, over all samples of all pixels.

use std::sync::atomic::Ordering::Relaxed;
use std::sync::atomic::{AtomicU32, AtomicU64};

use crate::error::Result;
use crate::reserve;

/// For each primitive, by its scene-wide index, the number of samples and of pixels that see it.
#[derive(Debug, Default)]
pub struct FaceCounts {
    samples: Vec<AtomicU64>,
    pixels: Vec<AtomicU32>,
}

impl FaceCounts {
    /// Number of bytes for each primitive.
    pub const BYTES: u64 = 12;

    /// Makes counts of 0 for `primitives` primitives.
    ///
    /// # Errors
    /// `Retry` if there is too little memory.
    pub fn new(primitives: u64) -> Result<Self> {
        let count = primitives as usize;
        let mut counts = Self::default();
        reserve::exact(&mut counts.samples, count, "--visible-faces")?;
        reserve::exact(&mut counts.pixels, count, "--visible-faces")?;
        counts.samples.resize_with(count, AtomicU64::default);
        counts.pixels.resize_with(count, AtomicU32::default);
        Ok(counts)
    }

    /// Adds all samples of one pixel: `seen` holds the primitive of each sample that hits. Sorts
    /// `seen`. Ignores primitives out of range.
    pub fn add(&self, seen: &mut [u32]) {
        seen.sort_unstable();
        for same in seen.chunk_by(|a, b| a == b) {
            let primitive = same[0] as usize;
            if let (Some(samples), Some(pixels)) =
                (self.samples.get(primitive), self.pixels.get(primitive))
            {
                samples.fetch_add(same.len() as u64, Relaxed);
                pixels.fetch_add(1, Relaxed);
            }
        }
    }

    /// Returns the primitives that are seen, with their numbers of samples and of pixels. Sorted by
    /// primitive.
    pub fn seen(&self) -> impl Iterator<Item = (u32, u64, u32)> {
        let counts = (0..).zip(self.samples.iter().zip(&self.pixels));
        let counts = counts.map(|(primitive, (samples, pixels))| {
            (primitive, samples.load(Relaxed), pixels.load(Relaxed))
        });
        counts.filter(|&(_, samples, _)| samples > 0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn samples_and_pixels_are_counted() {
        let counts = FaceCounts::new(5).unwrap();
        for pixel in [&mut [3, 1, 3][..], &mut [], &mut [3], &mut [4, 1]] {
            counts.add(pixel);
        }
        assert_eq!(counts.seen().collect::<Vec<_>>(), [(1, 2, 2), (3, 3, 2), (4, 1, 1)]);
    }
}
