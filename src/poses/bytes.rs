//! The contents of a file of cameras.

use std::io::Read;
use std::path::Path;

use crate::error::{Error, Result};

/// Maximum size of a file of cameras in bytes.
const MAX_FILE_BYTES: u64 = 1 << 30;

/// Returns the contents of a file.
///
/// # Errors
/// A file that cannot be read or exceeds [`MAX_FILE_BYTES`].
pub fn bytes(path: &Path) -> Result<Vec<u8>> {
    let failed = |error| Error::io(path, "read", &error);
    let mut all = Vec::new();
    let file = std::fs::File::open(path).map_err(failed)?;
    file.take(MAX_FILE_BYTES + 1).read_to_end(&mut all).map_err(failed)?;
    if all.len() as u64 > MAX_FILE_BYTES {
        let message = format!("found more than {} MiB", MAX_FILE_BYTES >> 20);
        return Err(Error::invalid(path.display().to_string(), message));
    }
    Ok(all)
}
