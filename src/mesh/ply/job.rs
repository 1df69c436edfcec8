//! What every step of reading one file is told.

use crate::error::Result;
use crate::monitor::Monitor;
use crate::reserve::Room;

/// The file's name for messages, who may stop the work, and how much memory it may take.
#[derive(Clone, Copy)]
pub(super) struct Job<'a> {
    pub(super) name: &'a str,
    pub(super) monitor: Option<&'a Monitor>,
    /// The most that its arrays may take.
    pub(super) room: Option<Room>,
}

impl Job<'_> {
    /// Whether a signal asked to stop. Loops that cannot fail then do nothing, and their caller
    /// finds out by [`Self::check`].
    pub(super) fn stopped(&self) -> bool {
        self.monitor.is_some_and(Monitor::stopped)
    }

    /// An error where arrays of so many bytes are too much.
    pub(super) fn fits(&self, bytes: u64) -> Result<()> {
        self.room.map_or(Ok(()), |room| room.check(bytes, self.name))
    }

    /// An error once a signal asked to stop.
    pub(super) fn check(&self) -> Result<()> {
        self.monitor.map_or(Ok(()), Monitor::check)
    }
}
