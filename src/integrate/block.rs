//! Sums over the samples of a block of pixels, packet by packet.

use std::ops::Range;

use crate::film::{SampleSums, SumNode};
use crate::ray::LANES;
use crate::shading::Lanes;

use super::camera_packet::Pattern;
use super::quarters::{PACKETS, packet};

/// One quantity's values, by lane of a packet.
#[derive(Debug, Clone, Copy)]
#[repr(align(64))]
pub struct Values(pub Lanes);

/// Sums of several quantities for each pixel of a block, in the fixed order of [`SampleSums`].
#[derive(Debug)]
pub struct BlockSums {
    quantities: usize,
    /// How many quantities are squares of other quantities.
    squares: usize,
    pixels: usize,
    sums: SampleSums,
    /// Values of the current node, pixel by pixel.
    node: Vec<f64>,
    /// Sums of neighbouring samples, by quantity: for the first two packets of a group of
    /// [`Quarters`], and for its last two. Only the four quantities of a picture have quarters.
    ///
    /// [`Quarters`]: super::quarters::Quarters
    pairs: [[[f64; LANES]; 2]; 4],
}

impl BlockSums {
    /// Creates sums for the blocks of a pattern: of `values` quantities, and of the squares of the
    /// last `squares` of them.
    pub fn new(pattern: &Pattern, values: usize, squares: usize) -> Self {
        let (pixels, quantities) = (pattern.pixels(), values + squares);
        let width = pixels * quantities;
        let (sums, node) = (SampleSums::new(width), vec![0.0; width]);
        Self { quantities, squares, pixels, sums, node, pairs: [[[0.0; LANES]; 2]; 4] }
    }

    /// Starts a new block: all sums become 0.
    #[inline(always)]
    pub fn clear(&mut self) {
        self.sums.clear();
    }

    /// Adds a packet. `lanes` holds its values by quantity; a quantity that is not `filled` is 0.
    /// Only samples within `samples` count.
    #[inline(always)]
    pub fn add(
        &mut self,
        pattern: &Pattern,
        first: u32,
        samples: &Range<u32>,
        lanes: &[Values],
        filled: &[bool],
    ) {
        let stride = pattern.samples;
        if samples.start <= first && samples.end - first >= stride {
            match stride {
                16 => self.fold::<1>(lanes, filled),
                4 => self.fold::<4>(lanes, filled),
                _ => self.fold::<16>(lanes, filled),
            }
            return self.sums.push(SumNode { first, level: stride.ilog2() }, &self.node);
        }
        for sample in samples.start.max(first)..samples.end.min(first.saturating_add(stride)) {
            self.take(pattern, sample - first, lanes, filled);
            self.sums.push(SumNode { first: sample, level: 0 }, &self.node);
        }
    }

    /// Adds a packet of [`Quarters`](super::quarters::Quarters), for a block of one pixel and sums
    /// without squares. Without reordering the packet would have the 16 samples from `first` on.
    /// The last packet of a group also adds the group's node.
    ///
    /// The node has the same bits as the sum of the samples in order. The shuffle of samples only
    /// swaps halves of nodes. So the tree of samples is the tree of sequence indices, with bits j0
    /// (the lowest) to j5 in a group. Indices that differ in j0 are in the same lane of two
    /// packets. The halves of the lanes differ in j1, and their halves in j2. The two pairs of
    /// packets differ in j3. The four remaining lanes differ in j4 and j5.
    #[inline(always)]
    pub fn add_quarter(&mut self, first: u32, [r, g, b, a]: &[Values; 4]) {
        let packet = packet(first);
        let [pairs_r, pairs_g, pairs_b, pairs_a] = &mut self.pairs;
        // Not a loop: the compiler would make vectors of quantities instead of lanes.
        add_pairs(pairs_r, packet, r);
        add_pairs(pairs_g, packet, g);
        add_pairs(pairs_b, packet, b);
        add_pairs(pairs_a, packet, a);
        if packet + 1 < PACKETS {
            return;
        }
        for (sum, &[low, high]) in self.node.iter_mut().zip(&self.pairs) {
            let (mut values, high) = (fold_lanes::<4>(low), fold_lanes::<4>(high));
            for i in 0..4 {
                values[i] += high[i];
            }
            *sum = (values[0] + values[2]) + (values[1] + values[3]);
        }
        let samples = (PACKETS * LANES) as u32;
        self.sums
            .push(SumNode { first: first / samples * samples, level: samples.ilog2() }, &self.node);
    }

    /// Computes the node of a packet of `PIXELS` pixels, over all its samples.
    #[inline(always)]
    fn fold<const PIXELS: usize>(&mut self, lanes: &[Values], filled: &[bool]) {
        let linear = lanes.len() - self.squares;
        self.node.fill(0.0);
        for (quantity, (values, &filled)) in lanes.iter().zip(filled).enumerate() {
            if !filled {
                continue;
            }
            let values = doubles(&values.0);
            let sums = fold_lanes::<PIXELS>(values);
            for pixel in 0..PIXELS {
                self.node[pixel * self.quantities + quantity] = sums[pixel];
            }
            if quantity >= linear {
                let mut squares = values;
                for i in 0..LANES {
                    squares[i] *= values[i];
                }
                let sums = fold_lanes::<PIXELS>(squares);
                for pixel in 0..PIXELS {
                    self.node[pixel * self.quantities + quantity + self.squares] = sums[pixel];
                }
            }
        }
    }

    /// Computes the node of one sample of a packet.
    fn take(&mut self, pattern: &Pattern, sample: u32, lanes: &[Values], filled: &[bool]) {
        let linear = lanes.len() - self.squares;
        for pixel in 0..self.pixels {
            let lane = pattern.order[pixel * pattern.samples as usize + sample as usize];
            let node = &mut self.node[pixel * self.quantities..(pixel + 1) * self.quantities];
            for (quantity, (values, &filled)) in lanes.iter().zip(filled).enumerate() {
                let value = if filled { f64::from(values.0[lane]) } else { 0.0 };
                node[quantity] = value;
                if quantity >= linear {
                    node[quantity + self.squares] = value * value;
                }
            }
        }
    }

    /// Sum of one quantity of a pixel over all samples.
    #[inline(always)]
    pub fn total(&self, pixel: usize, quantity: usize) -> f64 {
        self.sums.total(pixel * self.quantities + quantity)
    }

    /// Sums of all quantities of a pixel over all samples.
    #[inline(always)]
    pub fn totals(&self, pixel: usize, totals: &mut Vec<f64>) {
        let first = pixel * self.quantities;
        self.sums.totals(first..first + self.quantities, totals);
    }

    /// Value of one quantity of a pixel in one node of the tree of samples.
    pub fn value(&self, node: usize, pixel: usize, quantity: usize) -> f64 {
        self.sums.value(node, pixel * self.quantities + quantity)
    }
}

/// Adds one quantity of a packet of a group of quarters to the group's sums of neighbours.
#[inline(always)]
fn add_pairs(pairs: &mut [[f64; LANES]; 2], packet: usize, Values(lanes): &Values) {
    let (values, sums) = (doubles(lanes), &mut pairs[packet / 2]);
    if packet % 2 == 0 {
        *sums = values;
        return;
    }
    for i in 0..LANES {
        sums[i] += values[i];
    }
}

#[inline(always)]
fn doubles(values: &Lanes) -> [f64; LANES] {
    let mut doubles = [0.0; LANES];
    for i in 0..LANES {
        doubles[i] = f64::from(values[i]);
    }
    doubles
}

/// Sums over the samples of each of `PIXELS` pixels, for lanes in the order of [`Pattern`]: first
/// neighbouring samples, then neighbouring pairs, and so on.
#[inline(always)]
fn fold_lanes<const PIXELS: usize>(mut values: [f64; LANES]) -> [f64; LANES] {
    let mut left = LANES;
    while left > PIXELS {
        left /= 2;
        for i in 0..left {
            values[i] += values[i + left];
        }
    }
    values
}
