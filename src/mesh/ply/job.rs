//! What every step of reading one file is told.

use crate::error::Result;
use crate::monitor::Monitor;

/// The file's name for messages, and who may stop the work.
#[derive(Clone, Copy)]
pub(super) struct Job<'a> {
    pub(super) name: &'a str,
    pub(super) monitor: Option<&'a Monitor>,
}

impl Job<'_> {
    /// Whether a signal asked to stop. Loops that cannot fail then do nothing, and their caller
    /// finds out by [`Self::check`].
    pub(super) fn stopped(&self) -> bool {
        self.monitor.is_some_and(Monitor::stopped)
    }

    /// An error once a signal asked to stop.
    pub(super) fn check(&self) -> Result<()> {
        self.monitor.map_or(Ok(()), Monitor::check)
    }
}
