//! How what is known of a pixel becomes its channels: the last step of a render, and of a merge of
//! parts, which has no scene.

use serde::{Deserialize, Serialize};

use crate::film::{Channel, Dropped};

use super::FAR;
use super::mattes::rank;

/// The nearest of the camera samples that hit something; the first of those that are equally near.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Nearest {
    /// Camera-space depth.
    pub depth: f32,
    /// World space.
    pub position: [f32; 3],
    /// From 1; 0 for none.
    pub primitive: u32,
    /// Shape, from 1; 0 for none.
    pub object: u32,
}

impl Nearest {
    /// No hit.
    pub const NONE: Self = Self { depth: FAR, position: [0.0; 3], primitive: 0, object: 0 };
}

/// Where the channels of a [`super::Plan`] stand among a pixel's words, without the scene.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Recipe {
    /// All channels, as they stand in a pixel's words.
    pub channels: Vec<Channel>,
    /// How many of them, from the first on, are means over samples.
    pub filtered: usize,
    /// 1 word.
    pub depth: Option<usize>,
    /// 3 words.
    pub position: Option<usize>,
    /// 1 word.
    pub primitive: Option<usize>,
    /// 1 word.
    pub object: Option<usize>,
    /// 3 words.
    pub variance: Option<usize>,
    /// 1 word.
    pub samples: Option<usize>,
    /// Each kind of mattes.
    pub mattes: Vec<Ranks>,
}

/// Where the ranks of one kind of mattes stand.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Ranks {
    /// First of `2 * ranks` words.
    pub first: usize,
    /// Things that a pixel can hold.
    pub ranks: usize,
    /// Ids that a pixel can meet: those of the scene.
    pub ids: usize,
}

impl Recipe {
    /// Quantities that are summed over samples beside R, G, B, A: the filtered channels; for the
    /// variance R, G, B and their squares.
    pub fn summed(&self) -> usize {
        self.filtered + if self.variance.is_some() { 6 } else { 0 }
    }

    /// Whether a nearest sample is kept.
    pub fn has_nearest(&self) -> bool {
        [self.depth, self.position, self.primitive, self.object].iter().any(Option::is_some)
    }

    /// Whether every word that it names is one of the channels: not so in a damaged file.
    pub fn is_sound(&self) -> bool {
        let count = self.channels.len();
        let fits = |first: usize, n: usize| first.checked_add(n).is_some_and(|end| end <= count);
        let singles = [self.depth, self.primitive, self.object, self.samples];
        let triples = [self.position, self.variance];
        self.filtered <= count
            && singles.iter().flatten().all(|&first| fits(first, 1))
            && triples.iter().flatten().all(|&first| fits(first, 3))
            && self.mattes.iter().all(|m| m.ranks <= count && fits(m.first, 2 * m.ranks))
    }

    /// Fills the words of a pixel from its `n` samples: the sum of each quantity of
    /// [`Recipe::summed`], the nearest hit, and by kind of mattes how many samples met each id, in the
    /// order in which they were met. Returns what the mattes could not hold.
    #[inline(always)]
    pub fn fill(
        &self,
        n: u32,
        sums: &[f64],
        nearest: &Nearest,
        mattes: &[Vec<(u32, u32)>],
        words: &mut [u32],
    ) -> Dropped {
        let count = f64::from(n);
        let means = words[..self.filtered].iter_mut().zip(sums);
        if n.is_power_of_two() {
            // The same numbers as by division, and quicker.
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

/// Of samples by their sum and the sum of their squares; divided by n - 1.
#[inline(always)]
fn variance(sum: f64, squares: f64, n: f64) -> f32 {
    if n < 2.0 { 0.0 } else { ((squares - sum * sum / n) / (n - 1.0)).max(0.0) as f32 }
}

/// Adds to how often an id was met.
#[inline]
pub fn count(counts: &mut Vec<(u32, u32)>, id: u32, times: u32) {
    match counts.iter_mut().find(|(known, _)| *known == id) {
        Some((_, sum)) => *sum += times,
        None => counts.push((id, times)),
    }
}
