//! Finds the best split of a set of primitive references: the surface area heuristic over bins of
//! centroids (Wald 2007, "On fast Construction of SAH-based Bounding Volume Hierarchies").
//!
//! A [`Reference`] is a bounding box with a weight, such as the number of its primitives. Centroids
//! are doubled, lower + upper corner, because no comparison needs the division by 2. [`Bounds3`]
//! stores the upper corner negated, so `b[i] - b[i + 4]` is the doubled centroid along axis i.

use super::super::bounds::Bounds3;
use super::super::node::WIDTH;
use super::reference::Reference;

/// Number of bins along each axis.
pub const BINS: usize = 16;

/// Sets of at least this many references to primitives are subsampled: see [`SUBSAMPLE_STRIDE`].
/// The trees have about the same SAH cost as without subsampling.
const MIN_SUBSAMPLED: usize = 1024;

/// Stride of the subsampling: every third reference is binned. It is odd because many 3D scans list
/// the two triangles of a grid cell one after the other. An even stride would bin only the first of
/// each pair.
const SUBSAMPLE_STRIDE: usize = 3;

/// Weight and bounding box of the references in each bin, along each axis. A reference is in the
/// bin of its centroid. Arrays are indexed by bin, then by axis.
#[derive(Clone)]
pub struct Bins {
    bounds: [[Bounds3; 3]; BINS],
    weights: [[u32; 3]; BINS],
}

/// The mapping from doubled centroids to bins.
#[derive(Debug, Clone, Copy)]
pub struct Grid {
    /// Smallest doubled centroid along each axis.
    origin: [f32; 4],
    /// Bins per unit of the doubled centroid; 0 along an axis whose extent is 0 or whose scale is
    /// not finite.
    scale: [f32; 4],
}

/// A split plane between two bins.
#[derive(Debug, Clone, Copy)]
pub struct Split {
    axis: usize,
    /// First bin of the right side.
    bin: u32,
}

impl Grid {
    /// Returns the grid over the bounding box of doubled centroids.
    #[inline(always)]
    pub fn new(centroids: &Bounds3) -> Self {
        let [x, y, z] = centroids.extent().map(|extent| {
            // Slightly below BINS: the largest centroid stays inside the last bin.
            let scale = (BINS as f32 - 0.01) / extent;
            if extent > 0.0 && scale.is_finite() { scale } else { 0.0 }
        });
        let [a, b, c] = centroids.lower();
        Self { origin: [a, b, c, 0.0], scale: [x, y, z, 0.0] }
    }

    /// Returns the bin of a centroid along each axis, below [`BINS`].
    #[inline(always)]
    fn bin(&self, reference: &Reference) -> [u32; 4] {
        let Bounds3(b) = reference.bounds;
        let mut bins = [0; 4];
        for i in 0..4 {
            bins[i] = bin(b[i] - b[i + 4], self.origin[i], self.scale[i]);
        }
        bins
    }

    /// Whether a reference belongs to the left side.
    #[inline(always)]
    pub fn is_left(&self, split: &Split, reference: &Reference) -> bool {
        // `% 3` changes nothing: it removes the bounds checks.
        let axis = split.axis % 3;
        let Bounds3(b) = reference.bounds;
        bin(b[axis] - b[axis + 4], self.origin[axis], self.scale[axis]) < split.bin
    }
}

/// Returns the bin of one coordinate: `(center2 - origin) * scale`, rounded down and clamped to the
/// bins. An odd integer gives the bin below. That is harmless: every bin is computed here.
#[inline(always)]
fn bin(center2: f32, origin: f32, scale: f32) -> u32 {
    // A floor without a conversion. After `- 0.5`, the nearest integer is the floor, except for the
    // tie of an odd integer. Adding 2^23 leaves the nearest integer in the low bits.
    let x = (center2 - origin) * scale - 0.5;
    let x = if x > 0.0 { x } else { 0.0 };
    let bits = (x + 8_388_608.0).to_bits() & 0x7f_ffff;
    bits.min(BINS as u32 - 1)
}

/// Returns a weight rounded up to whole leaves if it exceeds one leaf. All triangles of a leaf are
/// tested at once, so a full leaf costs no more than any other.
#[inline(always)]
fn whole_leaves(weight: u32) -> f64 {
    let leaf = WIDTH as u32;
    f64::from(if weight <= leaf { weight } else { weight.next_multiple_of(leaf) })
}

/// Returns the stride for [`Bins::add`] in a set of `len` references to primitives.
#[inline(always)]
pub fn stride(len: usize) -> usize {
    if len >= MIN_SUBSAMPLED { SUBSAMPLE_STRIDE } else { 1 }
}

impl Bins {
    pub const EMPTY: Self = Self { bounds: [[Bounds3::EMPTY; 3]; BINS], weights: [[0; 3]; BINS] };

    /// Adds references to their bins: the first of every `stride`.
    #[inline(always)]
    pub fn add(&mut self, grid: &Grid, references: &[Reference], stride: usize) {
        for reference in references.iter().step_by(stride) {
            let bins = grid.bin(reference);
            for axis in 0..3 {
                // `% BINS` changes nothing: it removes the bounds checks.
                let bin = bins[axis] as usize % BINS;
                let bounds = &mut self.bounds[bin][axis];
                *bounds = bounds.union(reference.bounds);
                self.weights[bin][axis] += reference.weight();
            }
        }
    }

    /// Returns the sum of two sets of bins.
    #[must_use]
    pub fn merge(mut self, other: &Self) -> Self {
        for bin in 0..BINS {
            for axis in 0..3 {
                self.bounds[bin][axis] = self.bounds[bin][axis].union(other.bounds[bin][axis]);
                self.weights[bin][axis] += other.weights[bin][axis];
            }
        }
        self
    }

    /// Returns the split with the smallest SAH cost: half the surface area times the weight in
    /// whole leaves, summed over both sides. Of equal costs, the lowest axis and bin win. `None` if
    /// no axis has a usable extent: all centroids coincide, or f32 cannot hold the scale. One side
    /// of the split may be empty.
    #[inline(always)]
    pub fn best(&self, grid: &Grid) -> Option<Split> {
        let mut right_cost = [[0.0; 3]; BINS];
        let (mut right, mut n) = ([Bounds3::EMPTY; 3], [0; 3]);
        for bin in (1..BINS).rev() {
            for axis in 0..3 {
                right[axis] = right[axis].union(self.bounds[bin][axis]);
                n[axis] += self.weights[bin][axis];
                right_cost[bin][axis] = right[axis].half_area() * whole_leaves(n[axis]);
            }
        }
        let mut min_cost = [f64::INFINITY; 3];
        let mut at = [0; 3];
        let (mut left, mut n) = ([Bounds3::EMPTY; 3], [0; 3]);
        for bin in 1..BINS {
            for axis in 0..3 {
                left[axis] = left[axis].union(self.bounds[bin - 1][axis]);
                n[axis] += self.weights[bin - 1][axis];
                let cost = left[axis].half_area() * whole_leaves(n[axis]) + right_cost[bin][axis];
                let better = cost < min_cost[axis];
                min_cost[axis] = if better { cost } else { min_cost[axis] };
                at[axis] = if better { bin as u32 } else { at[axis] };
            }
        }
        let mut best: Option<(f64, Split)> = None;
        for axis in 0..3 {
            if grid.scale[axis] != 0.0 && best.is_none_or(|(cost, _)| min_cost[axis] < cost) {
                best = Some((min_cost[axis], Split { axis, bin: at[axis] }));
            }
        }
        best.map(|(_, split)| split)
    }
}
