//! Converts the sums of a pixel to its channels. This is the last step of a render, and of a merge
//! of parts, which has no scene.

use serde::{Deserialize, Serialize};

use crate::film::{Channel, Dropped};

use super::mattes::rank;

/// Depth and distance of a camera ray that misses.
pub const MISS_DEPTH: f32 = 1e30;

/// The nearest hit of all camera samples of a pixel. Of equally near hits, the hit of the lowest
/// sample index wins, so every split of the samples gives the same hit.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct NearestHit {
    /// Depth, as in the layer `Z`.
    pub depth: f32,
    /// Distance from the origin of the camera ray, for the layer `distance`.
    pub distance: f32,
    /// Position in world space.
    pub position: [f32; 3],
    /// Index of the primitive + 1; 0 without a hit.
    pub primitive: u32,
    /// Index of the shape + 1; 0 without a hit.
    pub object: u32,
}

impl NearestHit {
    /// The value of a pixel without a hit.
    pub const NONE: Self = Self {
        depth: MISS_DEPTH,
        distance: MISS_DEPTH,
        position: [0.0; 3],
        primitive: 0,
        object: 0,
    };
}

/// The position of each channel of a [`super::LayerPlan`] among the words of a pixel. Needs no
/// scene, so a part of a picture can hold it.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PixelLayout {
    /// All channels, in the order of a pixel's words.
    pub channels: Vec<Channel>,
    /// Number of channels that are means over samples. They are the first channels.
    pub filtered: usize,
    /// Position of the depth: 1 word.
    pub depth: Option<usize>,
    /// Position of the distance: 1 word.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub distance: Option<usize>,
    /// Position of the world position: 3 words.
    pub position: Option<usize>,
    /// Position of the primitive's id: 1 word.
    pub primitive: Option<usize>,
    /// Position of the shape's id: 1 word.
    pub object: Option<usize>,
    /// Position of the variance: 3 words.
    pub variance: Option<usize>,
    /// Position of the number of samples: 1 word.
    pub samples: Option<usize>,
    /// Positions of each kind of mattes.
    pub mattes: Vec<MatteLayout>,
}

/// Position of the ranks of one kind of mattes.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct MatteLayout {
    /// Index of the first of `2 * ranks` words.
    pub first: usize,
    /// Number of ids that a pixel can hold in the file.
    pub ranks: usize,
    /// Number of ids in the scene: the most that can cover a pixel.
    pub ids: usize,
}

impl PixelLayout {
    /// Returns the number of quantities that are summed over samples, in addition to R, G, B, A.
    /// These are the filtered channels. For the variance, R, G, B and their squares follow.
    pub fn summed(&self) -> usize {
        self.filtered + if self.variance.is_some() { 6 } else { 0 }
    }

    /// Returns true if any channel needs the nearest hit.
    pub fn has_nearest(&self) -> bool {
        [self.depth, self.distance, self.position, self.primitive, self.object]
            .iter()
            .any(Option::is_some)
    }

    /// Returns true if every position is within the channels. It may be false in a damaged file.
    pub fn is_sound(&self) -> bool {
        let count = self.channels.len();
        let fits = |first: usize, n: usize| first.checked_add(n).is_some_and(|end| end <= count);
        let singles = [self.depth, self.distance, self.primitive, self.object, self.samples];
        let triples = [self.position, self.variance];
        self.filtered <= count
            && singles.iter().flatten().all(|&first| fits(first, 1))
            && triples.iter().flatten().all(|&first| fits(first, 3))
            && self.mattes.iter().all(|m| m.ranks <= count && fits(m.first, 2 * m.ranks))
    }

    /// Fills the words of a pixel from its `n` samples. `sums` holds the sum of each quantity of
    /// [`PixelLayout::summed`]. For each kind of mattes, `mattes` holds the ids with their numbers
    /// of samples, in the order of first hits. Returns the coverage that the mattes cannot hold.
    #[inline(always)]
    pub fn fill(
        &self,
        n: u32,
        sums: &[f64],
        nearest: &NearestHit,
        mattes: &[Vec<(u32, u32)>],
        words: &mut [u32],
    ) -> Dropped {
        let count = f64::from(n);
        let means = words[..self.filtered].iter_mut().zip(sums);
        if n.is_power_of_two() {
            // Multiplication by a power of two is exact: the same bits as by division, and faster.
            let share = 1.0 / count;
            means.for_each(|(word, sum)| *word = ((sum * share) as f32).to_bits());
        } else {
            means.for_each(|(word, sum)| *word = ((sum / count) as f32).to_bits());
        }
        let mut set = |first: Option<usize>, values: &[u32]| {
            if let Some(first) = first {
                words[first..first + values.len()].copy_from_slice(values);
            }
        };
        set(self.depth, &[nearest.depth.to_bits()]);
        set(self.distance, &[nearest.distance.to_bits()]);
        set(self.position, &nearest.position.map(f32::to_bits));
        set(self.primitive, &[nearest.primitive]);
        set(self.object, &[nearest.object]);
        set(self.samples, &[(n as f32).to_bits()]);
        if self.variance.is_some() {
            let (sums, squares) = sums[self.filtered..].split_at(3);
            let mut bits = [0; 3];
            for axis in 0..3 {
                bits[axis] = variance(sums[axis], squares[axis], count).to_bits();
            }
            set(self.variance, &bits);
        }
        let mut dropped = Dropped::default();
        for (ranks, ids) in self.mattes.iter().zip(mattes) {
            let words = &mut words[ranks.first..ranks.first + 2 * ranks.ranks];
            dropped = dropped.or(rank(ids, n, words));
        }
        dropped
    }
}

/// Returns the sample variance (divisor n - 1) from the sum of `n` samples and of their squares. 0
/// for less than two samples, or if rounding makes it negative.
#[inline(always)]
fn variance(sum: f64, squares: f64, n: f64) -> f32 {
    if n < 2.0 { 0.0 } else { ((squares - sum * sum / n) / (n - 1.0)).max(0.0) as f32 }
}

/// Adds `times` to the count of an id. A new id goes to the end.
#[inline]
pub fn count(counts: &mut Vec<(u32, u32)>, id: u32, times: u32) {
    match counts.iter_mut().find(|(known, _)| *known == id) {
        Some((_, sum)) => *sum += times,
        None => counts.push((id, times)),
    }
}

#[cfg(test)]
mod tests {
    use super::variance;

    #[test]
    fn variance_is_that_of_a_sample() {
        // 1, 2 and 4: the squares of the distances from 7/3 add up to 14/3.
        assert_eq!(variance(7.0, 21.0, 3.0), (7.0f64 / 3.0) as f32);
        assert_eq!(variance(3.0, 9.0, 1.0), 0.0);
        assert_eq!(variance(0.3, 0.03 * (1.0 - 1e-9), 3.0), 0.0);
    }
}
