//! The context that every step of reading a file needs.

use crate::error::Result;
use crate::monitor::Monitor;
use crate::reserve::MemoryLimit;

/// The name of the file for messages, a monitor that can stop the work, and a memory limit.
#[derive(Clone, Copy)]
pub(super) struct ReadContext<'a> {
    pub(super) name: &'a str,
    pub(super) monitor: Option<&'a Monitor>,
    /// Memory limit of the arrays.
    pub(super) memory_limit: Option<MemoryLimit>,
}

impl ReadContext<'_> {
    /// Returns true once a signal has requested a stop. Loops that cannot return an error then skip
    /// their work. Their caller detects the stop with [`Self::check`].
    pub(super) fn stopped(&self) -> bool {
        self.monitor.is_some_and(Monitor::stopped)
    }

    /// Returns an error if arrays of `bytes` bytes exceed the memory limit.
    pub(super) fn fits(&self, bytes: u64) -> Result<()> {
        self.memory_limit.map_or(Ok(()), |limit| limit.check(bytes, self.name))
    }

    /// Returns an error once a signal has requested a stop.
    pub(super) fn check(&self) -> Result<()> {
        self.monitor.map_or(Ok(()), Monitor::check)
    }
}
