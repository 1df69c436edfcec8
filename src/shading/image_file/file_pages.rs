//! A temporary file in the address space, whose pages can leave memory.

use std::fs::File;
use std::slice;
use std::sync::Arc;

use memmap2::MmapRaw;

use crate::error::Result;
use crate::shading::tiles::{failed, on_disk, read_at};

/// A mapped file without a name. It is written through the map. It is read as a file, so that a
/// disk that fails is an error and not a signal.
pub struct FilePages {
    file: File,
    map: Arc<MmapRaw>,
}

/// Lets the pages of a [`FilePages`] leave memory, also while its bytes are borrowed.
pub struct Release(Arc<MmapRaw>);

impl FilePages {
    /// `length` bytes that are 0. `None` if no disk has the space.
    pub fn new(length: u64) -> Option<Self> {
        let file = on_disk(length)?;
        let map = Arc::new(MmapRaw::map_raw(&file).ok()?);
        Some(Self { file, map })
    }

    /// All bytes, to be written.
    pub fn bytes(&mut self) -> &mut [u8] {
        // SAFETY: The map lives as long as `self` and has this length. The file has no name, so
        // nothing else changes it. Its space is reserved, so a write does not fail for lack of it.
        unsafe { slice::from_raw_parts_mut(self.map.as_mut_ptr(), self.map.len()) }
    }

    /// Reads the bytes from `start` on.
    ///
    /// # Errors
    /// Errors of the disk.
    pub fn read(&self, start: u64, bytes: &mut [u8]) -> Result<()> {
        read_at(&self.file, bytes, start).map_err(|e| failed("read", &e))
    }

    /// Returns what lets the pages leave memory.
    pub fn release(&self) -> Release {
        Release(Arc::clone(&self.map))
    }
}

impl Release {
    /// Lets all pages leave the process. Their content stays in the file. Without an effect on
    /// systems that have no such call.
    pub fn leave_memory(&self) {
        // SAFETY: For a shared map of a file, MADV_DONTNEED changes no content.
        #[cfg(unix)]
        let _ = unsafe { self.0.unchecked_advise(memmap2::UncheckedAdvice::DontNeed) };
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bytes_that_left_memory_are_in_the_file() {
        // `None` if this machine has no disk for temporary files.
        let Some(mut pages) = FilePages::new(10_000) else { return };
        assert!(pages.bytes().iter().all(|&byte| byte == 0));
        let release = pages.release();
        for (i, byte) in pages.bytes().iter_mut().enumerate() {
            *byte = i as u8;
            if i % 3000 == 0 {
                release.leave_memory();
            }
        }
        let expected: Vec<u8> = (0..10_000).map(|i| i as u8).collect();
        let mut read = vec![0; 9_000];
        pages.read(1_000, &mut read).unwrap();
        assert_eq!(read, expected[1_000..]);
        assert_eq!(pages.bytes(), expected);
    }
}
