//! The primitives that a kind of ray passes through.

use std::ops::Range;

/// Primitives that one kind of ray cannot hit, by scene-wide index.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Unseen {
    /// Ranges of indices, ascending and disjoint.
    ranges: Vec<Range<u32>>,
}

impl Unseen {
    /// The set of no primitive: every primitive can be hit.
    pub const NONE: Self = Self { ranges: Vec::new() };

    /// Adds primitives. Their indices must be above all indices that were added before.
    pub fn push(&mut self, primitives: Range<u32>) {
        match self.ranges.last_mut() {
            _ if primitives.is_empty() => {}
            Some(last) if last.end == primitives.start => last.end = primitives.end,
            _ => self.ranges.push(primitives),
        }
    }

    /// Whether every primitive can be hit.
    pub fn is_empty(&self) -> bool {
        self.ranges.is_empty()
    }

    /// Whether the set contains a primitive.
    pub fn has(&self, primitive: u32) -> bool {
        let index = self.ranges.partition_point(|range| range.end <= primitive);
        self.ranges.get(index).is_some_and(|range| range.contains(&primitive))
    }

    /// Number of primitives of `primitives` that the set contains.
    pub fn count(&self, primitives: &Range<u32>) -> u32 {
        let common = |range: &Range<u32>| {
            range.end.min(primitives.end).saturating_sub(range.start.max(primitives.start))
        };
        self.ranges.iter().map(common).sum()
    }

    /// Whether the set contains all of `primitives`.
    pub fn has_all(&self, primitives: &Range<u32>) -> bool {
        self.count(primitives) == primitives.end - primitives.start
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ranges_are_joined_counted_and_searched() {
        let mut unseen = Unseen::NONE;
        assert!(unseen.is_empty() && !unseen.has(0) && unseen.has_all(&(4..4)));
        for range in [2..3, 3..5, 7..7, 9..12] {
            unseen.push(range);
        }
        assert_eq!(unseen, Unseen { ranges: vec![2..5, 9..12] });
        assert!(!unseen.is_empty());
        let members: Vec<u32> = (0..20).filter(|&primitive| unseen.has(primitive)).collect();
        assert_eq!(members, [2, 3, 4, 9, 10, 11]);
        assert_eq!([0..20, 4..10, 5..9, 2..5].map(|range| unseen.count(&range)), [6, 2, 0, 3]);
        assert!(unseen.has_all(&(3..5)) && !unseen.has_all(&(3..6)));
    }
}
