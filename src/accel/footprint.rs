//! How much memory an accelerator needs, as a function of the number of primitives.

use super::accelerator::BuildInfo;

/// Bytes that an accelerator needs, as a function of the number of primitives.
#[derive(Debug, Clone, Copy)]
pub struct MemoryFootprint {
    built: Line,
    peak: Line,
    library: u64,
}

/// Bytes = `fixed + per_primitive * primitives`.
#[derive(Debug, Clone, Copy)]
struct Line {
    fixed: f64,
    per_primitive: f64,
}

impl MemoryFootprint {
    /// `bvh`: the maxima over the scans of docs/notebook/bvh.md, rounded up.
    pub const BVH: Self = Self::constant(28.0, 43.0);
    /// `coursework`: measured on scans, rounded up.
    pub const COURSEWORK: Self = Self::constant(136.0, 300.0);
    /// `brute`: an index and an eighth of a box with the boxes above it, rounded up.
    pub const BRUTE: Self = Self::constant(11.0, 80.0);

    const fn constant(built: f64, peak: f64) -> Self {
        Self {
            built: Line { fixed: 0.0, per_primitive: built },
            peak: Line { fixed: 0.0, per_primitive: peak },
            library: 0,
        }
    }

    /// Returns the lines through two builds, each with its number of triangles. The files of the
    /// library that builds have `library` bytes.
    pub fn through(builds: [(f64, BuildInfo); 2], library: u64) -> Self {
        let [(n, a), (m, b)] = builds;
        Self {
            built: Line::through([(n, a.bytes), (m, b.bytes)]),
            peak: Line::through([(n, a.peak_bytes), (m, b.peak_bytes)]),
            library,
        }
    }

    /// Returns the bytes that the accelerator holds after the build.
    pub fn built_bytes(&self, primitives: u64) -> u64 {
        self.built.at(primitives)
    }

    /// Returns the largest number of bytes held during the build.
    pub fn peak_bytes(&self, primitives: u64) -> u64 {
        self.peak.at(primitives)
    }

    /// Returns the bytes of the library's files. How many of them are resident depends on how the
    /// system caches the files, up to all.
    pub fn library_bytes(&self) -> u64 {
        self.library
    }
}

impl Line {
    fn through([a, b]: [(f64, u64); 2]) -> Self {
        let per_primitive = (b.1 as f64 - a.1 as f64) / (b.0 - a.0);
        Self { fixed: a.1 as f64 - a.0 * per_primitive, per_primitive }
    }

    fn at(&self, primitives: u64) -> u64 {
        match primitives {
            0 => 0,
            // `as` saturates. A line through measured points may start a little below zero.
            n => (self.fixed.max(0.0) + n as f64 * self.per_primitive) as u64,
        }
    }
}
