//! The sums of some of a pixel's samples as words of an EXR: all that an exact merge needs.

use std::ops::Range;

use crate::film::{Channel, ChannelKind, Dropped, SampleSums, SumNode};

use super::pixel_layout::{MISS_DEPTH, NearestHit, PixelLayout, count};

/// Number of beauty channels: R, G, B, A.
pub const BEAUTY: usize = 4;

/// The layout of the sums of a range of samples in the words of a pixel.
///
/// First come, node by node, R, G, B, A and the quantities of [`PixelLayout::summed`]. Each is an
/// f64 in two words, the low word first. Then come the nearest hit, and the mattes' ids and counts.
#[derive(Debug, Clone)]
pub struct PartialSumsLayout {
    samples: Range<u32>,
    nodes: Vec<SumNode>,
    summed: usize,
    /// Number of words of the nearest hit: 0 if no layer needs the hit, 6, or 7 with its distance.
    nearest: usize,
    /// For each kind of mattes, the maximum number of ids in a pixel.
    mattes: Vec<usize>,
}

/// The state of a pixel after the first n samples.
#[derive(Debug, Clone)]
pub struct PixelState {
    /// R, G, B, A, then the quantities of [`PixelLayout::summed`].
    pub sums: SampleSums,
    /// The nearest hit so far.
    pub nearest: NearestHit,
    /// For each kind of mattes, the ids with their numbers of samples, in the order of first hits.
    pub mattes: Vec<Vec<(u32, u32)>>,
}

impl PixelState {
    /// Makes the state before the first sample.
    pub fn new(pixel_layout: &PixelLayout) -> Self {
        Self {
            sums: SampleSums::new(BEAUTY + pixel_layout.summed()),
            nearest: NearestHit::NONE,
            mattes: vec![Vec::new(); pixel_layout.mattes.len()],
        }
    }

    /// Resets the state, for another pixel.
    pub fn clear(&mut self) {
        self.sums.clear();
        self.nearest = NearestHit::NONE;
        self.mattes.iter_mut().for_each(Vec::clear);
    }

    /// Writes the layers' channels to `words`. Returns R, G, B, A, and the coverage that the mattes
    /// cannot hold. `n` is the number of samples in the state.
    pub fn finish(
        &self,
        pixel_layout: &PixelLayout,
        n: u32,
        words: &mut [u32],
    ) -> ([f32; 4], Dropped) {
        let mut totals = Vec::new();
        self.sums.totals(0..BEAUTY + pixel_layout.summed(), &mut totals);
        let dropped = pixel_layout.fill(n, &totals[BEAUTY..], &self.nearest, &self.mattes, words);
        let count = f64::from(n);
        (std::array::from_fn(|axis| (totals[axis] / count) as f32), dropped)
    }
}

impl PartialSumsLayout {
    /// Makes the layout of a range of samples for the channels of `pixel_layout`.
    pub fn new(pixel_layout: &PixelLayout, samples: Range<u32>) -> Self {
        let capacity = samples.len();
        Self {
            nodes: SumNode::cover(samples.clone()),
            samples,
            summed: pixel_layout.summed(),
            nearest: match (pixel_layout.has_nearest(), pixel_layout.distance) {
                (false, _) => 0,
                (true, None) => 6,
                (true, Some(_)) => 7,
            },
            mattes: pixel_layout.mattes.iter().map(|ranks| ranks.ids.min(capacity)).collect(),
        }
    }

    /// Returns the range of samples.
    pub fn samples(&self) -> Range<u32> {
        self.samples.clone()
    }

    /// Returns the number of words in a pixel. Saturates, because a damaged file may state any
    /// number of ids.
    pub fn words(&self) -> usize {
        let nearest = self.nearest;
        let sums = self.nodes.len() * (BEAUTY + self.summed);
        let mattes = self.mattes.iter().fold(0, |sum: usize, ids| sum.saturating_add(*ids));
        mattes.saturating_add(sums).saturating_mul(2).saturating_add(nearest)
    }

    /// Returns the channels of the words in a file.
    pub fn channels(&self) -> Vec<Channel> {
        let name = |i| Channel { name: format!("part.{i:06}"), kind: ChannelKind::Uint };
        (0..self.words()).map(name).collect()
    }

    /// Fills the words of a pixel. `sum` returns a sum, given the index of the node and of the
    /// quantity: R, G, B, A, then those of [`PixelLayout::summed`].
    pub fn encode(
        &self,
        sum: impl Fn(usize, usize) -> f64,
        nearest: &NearestHit,
        mattes: &[Vec<(u32, u32)>],
        words: &mut [u32],
    ) {
        words.fill(0);
        let (sums, rest) = words.split_at_mut(2 * self.nodes.len() * (BEAUTY + self.summed));
        let quantities = BEAUTY + self.summed;
        for (i, two) in sums.chunks_exact_mut(2).enumerate() {
            let bits = sum(i / quantities, i % quantities).to_bits();
            two.copy_from_slice(&[bits as u32, (bits >> 32) as u32]);
        }
        let (words, mut rest) = rest.split_at_mut(self.nearest);
        if let [depth, x, y, z, primitive, object, far @ ..] = words {
            *depth = nearest.depth.to_bits();
            [*x, *y, *z] = nearest.position.map(f32::to_bits);
            (*primitive, *object) = (nearest.primitive, nearest.object);
            far.fill(nearest.distance.to_bits());
        }
        for (capacity, ids) in self.mattes.iter().zip(mattes) {
            let (own, after) = rest.split_at_mut(2 * capacity);
            for (two, (id, times)) in own.chunks_exact_mut(2).zip(ids) {
                two.copy_from_slice(&[*id, *times]);
            }
            rest = after;
        }
    }

    /// Adds the words of a pixel to `pixel`, which must hold all samples before these. Of equally
    /// near hits, the hit of the lowest sample index wins, as in a render.
    pub fn add(&self, words: &[u32], pixel: &mut PixelState) {
        let quantities = BEAUTY + self.summed;
        let (sums, rest) = words.split_at(2 * self.nodes.len() * quantities);
        let mut values = Vec::with_capacity(quantities);
        for (node, words) in self.nodes.iter().zip(sums.chunks_exact(2 * quantities)) {
            let value = |two: &[u32]| f64::from_bits(u64::from(two[1]) << 32 | u64::from(two[0]));
            values.clear();
            values.extend(words.chunks_exact(2).map(value));
            pixel.sums.push(*node, &values);
        }
        let (words, mut rest) = rest.split_at(self.nearest);
        if let &[depth, x, y, z, primitive, object, ref far @ ..] = words {
            let depth = f32::from_bits(depth);
            if depth < pixel.nearest.depth {
                let position = [x, y, z].map(f32::from_bits);
                let distance = far.first().map_or(MISS_DEPTH, |&far| f32::from_bits(far));
                pixel.nearest = NearestHit { depth, distance, position, primitive, object };
            }
        }
        for (capacity, known) in self.mattes.iter().zip(&mut pixel.mattes) {
            let (own, after) = rest.split_at(2 * capacity);
            for two in own.chunks_exact(2).take_while(|two| two[1] > 0) {
                count(known, two[0], two[1]);
            }
            rest = after;
        }
    }
}
