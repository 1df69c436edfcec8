//! Tests that count memory or processor time of their own process. They run one at a time.

use std::sync::{Mutex, MutexGuard, PoisonError};

#[cfg(target_os = "linux")]
mod idle;
mod ply_corpus;

#[cfg(target_os = "linux")]
#[path = "../support/backends.rs"]
mod backends;

/// Waits until no other test runs. The caller is alone until it drops the guard.
fn alone() -> MutexGuard<'static, ()> {
    static ALONE: Mutex<()> = Mutex::new(());
    ALONE.lock().unwrap_or_else(PoisonError::into_inner)
}
