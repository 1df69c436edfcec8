//! Sums over the samples of a block of pixels, packet by packet.

use std::ops::Range;

use crate::film::{Node, Sums};
use crate::ray::LANES;

use super::slot::Pattern;

/// Sums of some quantities for each pixel of a block, in the fixed order of [`Sums`].
#[derive(Debug)]
pub struct BlockSums {
    quantities: usize,
    pixels: usize,
    sums: Sums,
    /// One node's values, pixel by pixel.
    node: Vec<f64>,
}

impl BlockSums {
    /// Room for the blocks of a pattern.
    pub fn new(pattern: &Pattern, quantities: usize) -> Self {
        let pixels = pattern.pixels();
        let width = pixels * quantities;
        Self { quantities, pixels, sums: Sums::new(width), node: vec![0.0; width] }
    }

    /// A new block begins.
    #[inline(always)]
    pub fn clear(&mut self) {
        self.sums.clear();
    }

    /// Adds a packet, of which only samples within `samples` count: its values, by quantity and lane.
    #[inline(always)]
    pub fn add(
        &mut self,
        pattern: &Pattern,
        first: u32,
        samples: &Range<u32>,
        lanes: &[[f64; LANES]],
    ) {
        let stride = pattern.samples;
        if samples.start <= first && samples.end - first >= stride {
            match stride {
                16 => self.fold::<16>(lanes),
                4 => self.fold::<4>(lanes),
                _ => self.fold::<1>(lanes),
            }
            return self.sums.push(Node { first, level: stride.ilog2() }, &self.node);
        }
        for sample in samples.start.max(first)..samples.end.min(first.saturating_add(stride)) {
            for (quantity, values) in lanes.iter().enumerate() {
                for pixel in 0..self.pixels {
                    let lane = pixel * stride as usize + (sample - first) as usize;
                    self.node[pixel * self.quantities + quantity] = values[lane % LANES];
                }
            }
            self.sums.push(Node { first: sample, level: 0 }, &self.node);
        }
    }

    /// Makes the node of a packet with `RUN` samples of each pixel.
    #[inline(always)]
    fn fold<const RUN: usize>(&mut self, lanes: &[[f64; LANES]]) {
        for (quantity, values) in lanes.iter().enumerate() {
            // Most layers have nothing to say of most packets.
            let bits = values.iter().fold(0, |bits, value| bits | value.to_bits());
            let sums = if bits == 0 { [0.0; LANES] } else { sum_runs::<RUN>(values) };
            for pixel in 0..LANES / RUN {
                self.node[pixel * self.quantities + quantity] = sums[pixel];
            }
        }
    }

    /// A quantity of a pixel, over all samples.
    #[inline(always)]
    pub fn total(&self, pixel: usize, quantity: usize) -> f64 {
        self.sums.total(pixel * self.quantities + quantity)
    }

    /// A quantity of a pixel in one node of the samples' tree.
    pub fn value(&self, node: usize, pixel: usize, quantity: usize) -> f64 {
        self.sums.value(node, pixel * self.quantities + quantity)
    }
}

/// Sums over each run of `RUN` neighbouring lanes, a power of two: pairs, then pairs of pairs.
#[inline(always)]
fn sum_runs<const RUN: usize>(values: &[f64; LANES]) -> [f64; LANES] {
    let (mut sums, mut left, mut run) = (*values, LANES, RUN);
    while run > 1 {
        (left, run) = (left / 2, run / 2);
        for i in 0..left {
            sums[i] = sums[2 * i] + sums[2 * i + 1];
        }
    }
    sums
}
