//! Sums over the samples of a pixel. The order of additions is fixed, so every split of the samples
//! into parts gives the same bits.

use std::ops::Range;

/// A node of the binary tree over all sample indices: samples `first .. first + 2^level`, where
/// `first` is a multiple of `2^level`.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct SumNode {
    /// Index of the node's first sample.
    pub first: u32,
    /// Binary logarithm of the number of samples.
    pub level: u32,
}

impl SumNode {
    /// Splits a range of samples into as few nodes as possible, from first to last.
    pub fn cover(samples: Range<u32>) -> Vec<Self> {
        let mut nodes = Vec::new();
        let mut first = samples.start;
        while first < samples.end {
            let room = (samples.end - first).ilog2();
            let level = if first == 0 { room } else { room.min(first.trailing_zeros()) };
            nodes.push(Self { first, level });
            first += 1 << level;
        }
        nodes
    }

    /// Returns true if this node and `next` are the two halves of one node. `next` must begin where
    /// this node ends.
    fn precedes(self, next: Self) -> bool {
        self.level == next.level && self.first & (1 << self.level) == 0
    }
}

/// Sums of several quantities over the same samples. Addition rounds, so its order is fixed. The
/// value of a node of the tree is the sum of its two halves. The nodes that remain at the end are
/// added from first to last.
///
/// So renders of the samples `a..b` and `b..c`, merged node by node, give the bits of the render of
/// `a..c`, for every `b`.
#[derive(Debug, Clone)]
pub struct SampleSums {
    width: usize,
    /// The sums of all nodes, `width` values per node.
    values: Vec<f64>,
    nodes: Vec<SumNode>,
}

impl SampleSums {
    /// Makes sums of `width` quantities, without samples.
    pub fn new(width: usize) -> Self {
        Self { width, values: Vec::new(), nodes: Vec::new() }
    }

    /// Removes all samples, for a new pixel or block.
    #[inline]
    pub fn clear(&mut self) {
        self.values.clear();
        self.nodes.clear();
    }

    /// Adds a node, which must begin where the last node ends. While the last two
    /// nodes are the halves of one node, replaces them by that node.
    #[inline]
    pub fn push(&mut self, mut node: SumNode, values: &[f64]) {
        debug_assert_eq!(values.len(), self.width);
        self.values.extend_from_slice(values);
        while self.nodes.last().is_some_and(|before| before.precedes(node)) {
            let last = self.values.len() - self.width;
            let (before, values) = self.values[last - self.width..].split_at_mut(self.width);
            for (sum, value) in before.iter_mut().zip(values) {
                *sum += *value;
            }
            self.values.truncate(last);
            node = SumNode { first: node.first - (1 << node.level), level: node.level + 1 };
            self.nodes.pop();
        }
        self.nodes.push(node);
    }

    /// Returns the number of nodes that remain after merging halves.
    #[cfg(test)]
    pub fn nodes(&self) -> usize {
        self.nodes.len()
    }

    /// Returns the sum of a quantity over the samples of a node, by the node's index.
    #[inline]
    pub fn value(&self, node: usize, quantity: usize) -> f64 {
        self.values[node * self.width + quantity]
    }

    /// Writes the sums of a range of quantities over all samples to `totals`. Panics if there are
    /// quantities but no samples.
    #[inline(always)]
    pub fn totals(&self, quantities: Range<usize>, totals: &mut Vec<f64>) {
        totals.clear();
        totals.extend_from_slice(&self.values[quantities.clone()]);
        let rest = self.values.get(self.width..).unwrap_or_default();
        // `chunks_exact` needs a size of at least 1, even without quantities.
        for node in rest.chunks_exact(self.width.max(1)) {
            for (total, value) in totals.iter_mut().zip(&node[quantities.clone()]) {
                *total += value;
            }
        }
    }

    /// Returns the sum of a quantity over all samples. Panics without samples.
    #[inline]
    pub fn total(&self, quantity: usize) -> f64 {
        let rest = self.values.get(self.width..).unwrap_or_default();
        let first = self.values[quantity];
        rest.chunks_exact(self.width).fold(first, |sum, node| sum + node[quantity])
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Values whose sum depends on the order.
    fn value(sample: u32) -> f64 {
        let mixed = sample.wrapping_mul(0x9e37_79b9) ^ (sample << 7);
        f64::from(mixed) * (f64::from(sample % 13) * 5.0 - 30.0).exp2()
    }

    fn sums_of(samples: Range<u32>) -> SampleSums {
        let mut sums = SampleSums::new(2);
        for first in samples {
            sums.push(SumNode { first, level: 0 }, &[value(first), -value(first)]);
        }
        sums
    }

    fn bits(sums: &SampleSums) -> Vec<u64> {
        (0..sums.nodes()).map(|node| sums.value(node, 0).to_bits()).collect()
    }

    #[test]
    fn any_split_gives_the_bits_of_the_whole() {
        let mut naive = 0;
        for n in [1, 2, 3, 7, 16, 23, 64, 100] {
            let whole = sums_of(0..n);
            for a in 0..=n {
                for b in a..=n {
                    let mut merged = SampleSums::new(2);
                    for part in [0..a, a..b, b..n] {
                        let sums = sums_of(part.clone());
                        let nodes = SumNode::cover(part);
                        assert_eq!(sums.nodes, nodes);
                        for (i, node) in nodes.iter().enumerate() {
                            merged.push(*node, &[sums.value(i, 0), sums.value(i, 1)]);
                        }
                    }
                    assert_eq!(bits(&merged), bits(&whole));
                    assert_eq!(merged.total(0).to_bits(), whole.total(0).to_bits());
                    assert_eq!(merged.total(1), -whole.total(0));
                    let mut totals = Vec::new();
                    merged.totals(0..2, &mut totals);
                    assert_eq!(totals, [merged.total(0), merged.total(1)]);
                }
            }
            naive += i32::from((0..n).map(value).sum::<f64>() != whole.total(0));
        }
        assert!(naive > 0, "the values should make the order matter");
    }

    #[test]
    fn there_may_be_no_quantities() {
        let mut sums = SampleSums::new(0);
        sums.push(SumNode { first: 0, level: 4 }, &[]);
        let mut totals = vec![1.0];
        sums.totals(0..0, &mut totals);
        assert!(totals.is_empty());
    }

    #[test]
    fn a_run_of_samples_has_few_nodes() {
        assert_eq!(SumNode::cover(0..64), [SumNode { first: 0, level: 6 }]);
        assert_eq!(SumNode::cover(64..96), [SumNode { first: 64, level: 5 }]);
        let levels = |range| SumNode::cover(range).into_iter().map(|n| n.level).collect::<Vec<_>>();
        assert_eq!(levels(3..13), [0, 2, 2, 0]);
        assert!(levels(0..0).is_empty());
        assert!(SumNode::cover(1..u32::MAX).len() <= 62);
    }
}
