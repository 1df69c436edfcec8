//! Sums over the samples of a pixel, in an order that does not depend on who adds which samples.

use std::ops::Range;

/// Samples `first .. first + 2^level`, where `first` is a multiple of `2^level`: a node of the binary
/// tree over all sample numbers.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Node {
    /// First sample.
    pub first: u32,
    /// Binary logarithm of how many there are.
    pub level: u32,
}

impl Node {
    /// The nodes that a run of samples leaves, from its first to its last: as few as possible.
    pub fn of(samples: Range<u32>) -> Vec<Self> {
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

    /// Whether the two are the halves of one node.
    fn precedes(self, next: Self) -> bool {
        self.level == next.level && self.first & (1 << self.level) == 0
    }
}

/// Sums of several quantities at once. Addition rounds, so its order is fixed: each node of the tree is
/// the sum of its two halves, and the nodes that are left in the end are added from first to last.
///
/// Renders of the samples `a..b` and `b..c` therefore give, node by node, what the render of `a..c`
/// gives, to the bit, wherever `b` is.
#[derive(Debug, Clone)]
pub struct Sums {
    width: usize,
    /// `width` values of each node.
    values: Vec<f64>,
    nodes: Vec<Node>,
}

impl Sums {
    /// No samples yet, of `width` quantities.
    pub fn new(width: usize) -> Self {
        Self { width, values: Vec::new(), nodes: Vec::new() }
    }

    /// Forgets all samples.
    #[inline]
    pub fn clear(&mut self) {
        self.values.clear();
        self.nodes.clear();
    }

    /// Adds a node that follows directly on the samples added before.
    #[inline]
    pub fn push(&mut self, mut node: Node, values: &[f64]) {
        debug_assert_eq!(values.len(), self.width);
        self.values.extend_from_slice(values);
        while self.nodes.last().is_some_and(|before| before.precedes(node)) {
            let last = self.values.len() - self.width;
            let (before, values) = self.values[last - self.width..].split_at_mut(self.width);
            for (sum, value) in before.iter_mut().zip(values) {
                *sum += *value;
            }
            self.values.truncate(last);
            node = Node { first: node.first - (1 << node.level), level: node.level + 1 };
            self.nodes.pop();
        }
        self.nodes.push(node);
    }

    /// How many nodes there are.
    pub fn nodes(&self) -> usize {
        self.nodes.len()
    }

    /// A quantity's value in a node.
    #[inline]
    pub fn value(&self, node: usize, quantity: usize) -> f64 {
        self.values[node * self.width + quantity]
    }

    /// Sums of neighbouring quantities over all samples.
    #[inline(always)]
    pub fn totals(&self, quantities: Range<usize>, totals: &mut Vec<f64>) {
        totals.clear();
        totals.extend_from_slice(&self.values[quantities.clone()]);
        let rest = self.values.get(self.width..).unwrap_or_default();
        // Without quantities there is nothing to cut.
        for node in rest.chunks_exact(self.width.max(1)) {
            for (total, value) in totals.iter_mut().zip(&node[quantities.clone()]) {
                *total += value;
            }
        }
    }

    /// A quantity's sum over all samples.
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

    fn of(samples: Range<u32>) -> Sums {
        let mut sums = Sums::new(2);
        for first in samples {
            sums.push(Node { first, level: 0 }, &[value(first), -value(first)]);
        }
        sums
    }

    fn bits(sums: &Sums) -> Vec<u64> {
        (0..sums.nodes()).map(|node| sums.value(node, 0).to_bits()).collect()
    }

    #[test]
    fn any_split_gives_the_bits_of_the_whole() {
        let mut naive = 0;
        for n in [1, 2, 3, 7, 16, 23, 64, 100] {
            let whole = of(0..n);
            for a in 0..=n {
                for b in a..=n {
                    let mut merged = Sums::new(2);
                    for part in [0..a, a..b, b..n] {
                        let sums = of(part.clone());
                        let nodes = Node::of(part);
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
        let mut sums = Sums::new(0);
        sums.push(Node { first: 0, level: 4 }, &[]);
        let mut totals = vec![1.0];
        sums.totals(0..0, &mut totals);
        assert!(totals.is_empty());
    }

    #[test]
    fn nodes_are_few() {
        assert_eq!(Node::of(0..64), [Node { first: 0, level: 6 }]);
        assert_eq!(Node::of(64..96), [Node { first: 64, level: 5 }]);
        let of = |range| Node::of(range).into_iter().map(|n| n.level).collect::<Vec<_>>();
        assert_eq!(of(3..13), [0, 2, 2, 0]);
        assert!(of(0..0).is_empty());
        assert!(Node::of(1..u32::MAX).len() <= 62);
    }
}
