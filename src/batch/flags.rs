//! Settings of a batch from the command line.

use std::ops::Range;
use std::path::PathBuf;

use super::places::Places;
use crate::scene::Overrides;
use crate::studio::Appearance;

/// Settings from the command line that a job file does not hold, and overrides that win over those
/// of the job file.
#[derive(Debug, Default)]
pub struct Flags {
    /// Overrides that are applied after the overrides of the job file.
    pub overrides: Overrides,
    /// Looks of meshes, which win over the overrides of the job file.
    pub looks: Appearance,
    /// True if the `up` or `rotate` of the job file comes from a flag, which wins over its inputs.
    pub turned: bool,
    /// Samples on every area light, sun and environment per shading point.
    pub light_samples: Option<u32>,
    /// Drops triangles with invalid vertices.
    pub repair: bool,
    /// Reads mesh files instead of memory-mapping them.
    pub no_mmap: bool,
    /// Path of the job file.
    pub file: Option<PathBuf>,
    /// Where the job's settings were written.
    pub places: Places,
    /// The frames that will be rendered, among all frames of the job; `None` for all. Cameras of
    /// other frames are not checked.
    pub range: Option<Range<u64>>,
}
