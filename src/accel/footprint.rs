//! How much memory an accelerator needs, as a function of the numbers of primitives and vertices.

use super::accelerator::BuildInfo;
use crate::geometry::PrimitiveCounts;

/// Bytes that an accelerator needs, as a function of its primitives.
#[derive(Debug, Clone, Copy)]
pub struct MemoryFootprint {
    built: Line,
    peak: Line,
    library: u64,
}

/// Bytes = `fixed + per_primitive * primitives + per_loose_vertex * loose_vertices`.
#[derive(Debug, Clone, Copy)]
struct Line {
    fixed: f64,
    per_primitive: f64,
    per_loose_vertex: f64,
}

impl MemoryFootprint {
    /// `bvh`: the maxima over the scans of docs/notebook/bvh.md, rounded up. A leaf holds 16
    /// vertices, so triangles that share none need more.
    pub const BVH: Self = Self {
        built: Line { fixed: 0.0, per_primitive: 28.0, per_loose_vertex: 25.5 },
        peak: Line { fixed: 0.0, per_primitive: 43.0, per_loose_vertex: 24.0 },
        library: 0,
    };
    /// `coursework`: measured on scans, rounded up.
    pub const COURSEWORK: Self = Self::constant(136.0, 300.0);
    /// `brute`: an index and an eighth of a box with the boxes above it, rounded up.
    pub const BRUTE: Self = Self::constant(11.0, 80.0);

    const fn constant(built: f64, peak: f64) -> Self {
        Self {
            built: Line { fixed: 0.0, per_primitive: built, per_loose_vertex: 0.0 },
            peak: Line { fixed: 0.0, per_primitive: peak, per_loose_vertex: 0.0 },
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
    pub fn built_bytes(&self, counts: PrimitiveCounts) -> u64 {
        self.built.at(counts)
    }

    /// Returns the largest number of bytes held during the build.
    pub fn peak_bytes(&self, counts: PrimitiveCounts) -> u64 {
        self.peak.at(counts)
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
        let fixed = a.1 as f64 - a.0 * per_primitive;
        Self { fixed, per_primitive, per_loose_vertex: 0.0 }
    }

    fn at(&self, PrimitiveCounts { primitives, loose_vertices }: PrimitiveCounts) -> u64 {
        if primitives == 0 {
            return 0;
        }
        let vertices = loose_vertices as f64 * self.per_loose_vertex;
        // `as` saturates. A line through measured points may start a little below zero.
        (self.fixed.max(0.0) + primitives as f64 * self.per_primitive + vertices) as u64
    }
}
