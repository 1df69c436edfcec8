//! What finds the hits.

use crate::{
    error::{Error, Result},
    geometry::Geometry,
    monitor::Monitor,
    scene::Backend,
};

/// How an accelerator is built.
#[derive(Debug, Clone, Copy)]
pub struct BuildOptions {
    /// Worker threads, >= 1.
    pub threads: usize,
    /// Embree without its ROBUST flag.
    pub fast: bool,
    /// Stop the build cleanly once the accelerator holds more bytes.
    pub max_bytes: Option<u64>,
}

/// What an accelerator is and what it cost.
#[derive(Debug, Clone, Default)]
pub struct BuildInfo {
    /// Name and version of what does the work, e.g. `Embree 4.4.0`.
    pub version: String,
    /// Instruction set in use, e.g. `AVX2`.
    pub isa: String,
    /// Bytes held after the build.
    pub bytes: u64,
    /// Largest number of bytes held during the build.
    pub peak_bytes: u64,
}

/// Finds closest hits and occlusion for packets of 16 rays.
pub trait Accelerator: Sync {
    /// What it is and what it cost.
    fn info(&self) -> BuildInfo;
}

/// Builds `backend` over `geometry`.
///
/// # Errors
/// `Unsupported` where the backend cannot run here or has no such mode, `Limit` above
/// `max_bytes`, `Interrupted` after a signal, `Retry` when memory ran out.
pub fn build<'g>(
    _geometry: &'g Geometry,
    _backend: Backend,
    _options: &BuildOptions,
    _monitor: &Monitor,
) -> Result<Box<dyn Accelerator + 'g>> {
    Err(Error::invalid("", "to be written"))
}
