//! Where to split a set of references: the surface area heuristic over bins of centroids
//! (Wald 2007, "On fast Construction of SAH-based Bounding Volume Hierarchies").

use super::super::bounds::Bounds3;
use super::reference::Reference;

/// Bins along each axis.
pub const BINS: usize = 16;

/// Counts and boxes of the references by the bin of their centroid, for three axes.
#[derive(Clone)]
pub struct Bins {
    bounds: [[Bounds3; BINS]; 3],
    counts: [[u32; BINS]; 3],
}

/// How centroids map to bins.
#[derive(Debug, Clone, Copy)]
pub struct Grid {
    /// Least centroid (doubled).
    origin: [f32; 3],
    /// Bins per unit; 0 along an axis without extent.
    scale: [f32; 3],
}

/// A plane between two bins.
#[derive(Debug, Clone, Copy)]
pub struct Split {
    axis: usize,
    /// The first bin of the right side.
    bin: u32,
}

impl Grid {
    /// The grid over a box of (doubled) centroids.
    #[inline(always)]
    pub fn new(centroids: &Bounds3) -> Self {
        let scale = centroids.extent().map(|extent| {
            let scale = (BINS as f32 - 0.01) / extent;
            if extent > 0.0 && scale.is_finite() { scale } else { 0.0 }
        });
        Self { origin: centroids.lower(), scale }
    }

    /// The bin of a centroid along an axis.
    #[inline(always)]
    fn bin(&self, center2: [f32; 3], axis: usize) -> u32 {
        // Adding 2^23 leaves the integer nearest to x - 0.5 in the low bits.
        let x = (center2[axis] - self.origin[axis]) * self.scale[axis] - 0.5;
        let x = if x > 0.0 { x } else { 0.0 };
        let bits = (x + 8_388_608.0).to_bits() & 0x7f_ffff;
        bits.min(BINS as u32 - 1)
    }

    /// Whether a reference goes left.
    #[inline(always)]
    pub fn is_left(&self, split: &Split, reference: &Reference) -> bool {
        self.bin(reference.bounds.center2(), split.axis) < split.bin
    }
}

impl Bins {
    /// No references.
    pub const EMPTY: Self = Self { bounds: [[Bounds3::EMPTY; BINS]; 3], counts: [[0; BINS]; 3] };

    /// Counts references.
    #[inline(always)]
    pub fn add(&mut self, grid: &Grid, references: &[Reference]) {
        for reference in references {
            let center2 = reference.bounds.center2();
            for axis in 0..3 {
                let bin = grid.bin(center2, axis) as usize % BINS;
                self.bounds[axis][bin] = self.bounds[axis][bin].union(reference.bounds);
                self.counts[axis][bin] += 1;
            }
        }
    }

    /// Both counts.
    #[must_use]
    pub fn merge(mut self, other: &Self) -> Self {
        for axis in 0..3 {
            for bin in 0..BINS {
                self.bounds[axis][bin] = self.bounds[axis][bin].union(other.bounds[axis][bin]);
                self.counts[axis][bin] += other.counts[axis][bin];
            }
        }
        self
    }

    /// The split with the least sum of area times number of primitives, if there is any.
    #[inline(always)]
    pub fn best(&self, grid: &Grid) -> Option<Split> {
        let mut best: Option<(f64, Split)> = None;
        for axis in 0..3 {
            if grid.scale[axis] == 0.0 {
                continue;
            }
            let (bounds, counts) = (&self.bounds[axis], &self.counts[axis]);
            let mut right_cost = [0.0; BINS];
            let (mut right, mut n) = (Bounds3::EMPTY, 0);
            for bin in (1..BINS).rev() {
                right = right.union(bounds[bin]);
                n += counts[bin];
                right_cost[bin] = right.half_area() * f64::from(n);
            }
            let (mut left, mut n) = (Bounds3::EMPTY, 0);
            for bin in 1..BINS {
                left = left.union(bounds[bin - 1]);
                n += counts[bin - 1];
                let cost = left.half_area() * f64::from(n) + right_cost[bin];
                if best.is_none_or(|(least, _)| cost < least) {
                    best = Some((cost, Split { axis, bin: bin as u32 }));
                }
            }
        }
        best.map(|(_, split)| split)
    }
}
