//! Skips queries after failed ones, so that scenes full of occluders hardly pay for queries.

/// Failed queries after which queries are skipped.
const PATIENCE: u32 = 8;

/// Most queries in a row that are skipped.
const MAX_SKIPPED: u32 = 15;

/// Which queries of one kind to skip.
#[derive(Debug, Default, Clone, Copy)]
pub struct Skips {
    /// Queries still to be skipped.
    left: u32,
    /// Failed queries, up to `PATIENCE + MAX_SKIPPED`; each successful query halves their number.
    failed: u32,
}

impl Skips {
    /// Whether to skip the next query.
    #[inline(always)]
    pub fn next(&mut self) -> bool {
        let skips = self.left > 0;
        self.left = self.left.saturating_sub(1);
        skips
    }

    /// Records whether a query succeeded.
    #[inline(always)]
    pub fn record(&mut self, success: bool) {
        if success {
            self.failed /= 2;
            return;
        }
        self.failed = (self.failed + 1).min(PATIENCE + MAX_SKIPPED);
        self.left = self.failed.saturating_sub(PATIENCE);
    }
}
