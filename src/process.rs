//! What the system says about this process.

use std::fs::read_to_string;
use std::path::Path;

/// Returns the bytes that the limits of this process (`ulimit -v`, `-d`) leave; `None` if it has
/// none. `root` is `/`, or a folder of a test.
pub fn left_by_limits(root: &Path) -> Option<u64> {
    let text = read_to_string(root.join("proc/self/limits")).unwrap_or_default();
    let left = |name: &str, used: &str| {
        let line = text.lines().find_map(|line| line.strip_prefix(name))?;
        let limit: u64 = line.split_whitespace().next()?.parse().ok()?;
        let used = kib(&root.join("proc/self/status"), used).unwrap_or(0);
        Some(limit.saturating_sub(used))
    };
    let all = [left("Max address space", "VmSize:"), left("Max data size", "VmData:")];
    all.into_iter().flatten().min()
}

/// Returns in bytes the value after `key`, which the file holds in KiB.
pub fn kib(file: &Path, key: &str) -> Option<u64> {
    number(file, key)?.checked_mul(1024)
}

/// Returns the number after `key` in a file of `/proc`.
pub fn number(file: &Path, key: &str) -> Option<u64> {
    let text = read_to_string(file).unwrap_or_default();
    let line = text.lines().find_map(|line| line.strip_prefix(key));
    line?.split_whitespace().next()?.parse().ok()
}
