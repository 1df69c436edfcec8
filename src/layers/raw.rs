//! A pixel of a part of the samples, as words: everything that an exact merge needs.

use std::ops::Range;

use crate::film::{Channel, ChannelKind, Dropped, Node, Sums};

use super::recipe::{Nearest, Recipe, count};

/// R, G, B, A.
pub const BEAUTY: usize = 4;

/// How the sums of some samples stand in a pixel's words: node by node R, G, B, A and the quantities of
/// [`Recipe::summed`], each an f64 in two words; the nearest hit; ids and counts.
#[derive(Debug, Clone)]
pub struct Raw {
    samples: Range<u32>,
    nodes: Vec<Node>,
    summed: usize,
    has_nearest: bool,
    /// Ids of each kind of mattes.
    mattes: Vec<usize>,
}

/// What is known of a pixel after a run of samples that begins with the first.
#[derive(Debug, Clone)]
pub struct Pixel {
    /// R, G, B, A, then the quantities of [`Recipe::summed`].
    pub sums: Sums,
    /// The nearest hit so far.
    pub nearest: Nearest,
    /// By kind of mattes: ids and how often they were met.
    pub mattes: Vec<Vec<(u32, u32)>>,
}

impl Pixel {
    /// Before the first sample.
    pub fn new(recipe: &Recipe) -> Self {
        Self {
            sums: Sums::new(BEAUTY + recipe.summed()),
            nearest: Nearest::NONE,
            mattes: vec![Vec::new(); recipe.mattes.len()],
        }
    }

    /// The same again, for another pixel.
    pub fn clear(&mut self) {
        self.sums.clear();
        self.nearest = Nearest::NONE;
        self.mattes.iter_mut().for_each(Vec::clear);
    }

    /// R, G, B, A of `n` samples, and their other channels into `words`; what the mattes could not hold.
    pub fn finish(&self, recipe: &Recipe, n: u32, words: &mut [u32]) -> ([f32; 4], Dropped) {
        let mut totals = Vec::new();
        self.sums.totals(0..BEAUTY + recipe.summed(), &mut totals);
        let dropped = recipe.fill(n, &totals[BEAUTY..], &self.nearest, &self.mattes, words);
        let count = f64::from(n);
        (std::array::from_fn(|axis| (totals[axis] / count) as f32), dropped)
    }
}

impl Raw {
    /// The words of the samples `samples` for a recipe.
    pub fn new(recipe: &Recipe, samples: Range<u32>) -> Self {
        let most = samples.len();
        Self {
            nodes: Node::of(samples.clone()),
            samples,
            summed: recipe.summed(),
            has_nearest: recipe.has_nearest(),
            mattes: recipe.mattes.iter().map(|ranks| ranks.ids.min(most)).collect(),
        }
    }

    /// Which samples.
    pub fn samples(&self) -> Range<u32> {
        self.samples.clone()
    }

    /// Words of a pixel.
    pub fn words(&self) -> usize {
        let nearest = if self.has_nearest { 6 } else { 0 };
        let sums = self.nodes.len() * (BEAUTY + self.summed);
        let mattes = self.mattes.iter().fold(0, |sum: usize, ids| sum.saturating_add(*ids));
        mattes.saturating_add(sums).saturating_mul(2).saturating_add(nearest)
    }

    /// Their channels in a file.
    pub fn channels(&self) -> Vec<Channel> {
        let name = |i| Channel { name: format!("part.{i:06}"), kind: ChannelKind::Uint };
        (0..self.words()).map(name).collect()
    }

    /// Fills a pixel's words from the sums of R, G, B, A and of the other quantities, node by node and
    /// by their index, and from the rest.
    pub fn encode(
        &self,
        sum: impl Fn(usize, usize) -> f64,
        nearest: &Nearest,
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
        let (six, mut rest) = rest.split_at_mut(if self.has_nearest { 6 } else { 0 });
        if let [depth, x, y, z, primitive, object] = six {
            *depth = nearest.depth.to_bits();
            [*x, *y, *z] = nearest.position.map(f32::to_bits);
            (*primitive, *object) = (nearest.primitive, nearest.object);
        }
        for (most, ids) in self.mattes.iter().zip(mattes) {
            let (own, after) = rest.split_at_mut(2 * most);
            for (two, (id, times)) in own.chunks_exact_mut(2).zip(ids) {
                two.copy_from_slice(&[*id, *times]);
            }
            rest = after;
        }
    }

    /// Adds a pixel's words to what is known of the samples before these.
    pub fn add(&self, words: &[u32], pixel: &mut Pixel) {
        let quantities = BEAUTY + self.summed;
        let (sums, rest) = words.split_at(2 * self.nodes.len() * quantities);
        let mut values = Vec::with_capacity(quantities);
        for (node, words) in self.nodes.iter().zip(sums.chunks_exact(2 * quantities)) {
            let value = |two: &[u32]| f64::from_bits(u64::from(two[1]) << 32 | u64::from(two[0]));
            values.clear();
            values.extend(words.chunks_exact(2).map(value));
            pixel.sums.push(*node, &values);
        }
        let (six, mut rest) = rest.split_at(if self.has_nearest { 6 } else { 0 });
        if let &[depth, x, y, z, primitive, object] = six {
            let depth = f32::from_bits(depth);
            if depth < pixel.nearest.depth {
                let position = [x, y, z].map(f32::from_bits);
                pixel.nearest = Nearest { depth, position, primitive, object };
            }
        }
        for (most, known) in self.mattes.iter().zip(&mut pixel.mattes) {
            let (own, after) = rest.split_at(2 * most);
            for two in own.chunks_exact(2).take_while(|two| two[1] > 0) {
                count(known, two[0], two[1]);
            }
            rest = after;
        }
    }
}
