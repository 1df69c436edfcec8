//! Splits a set of references into two.

use super::super::bounds::Bounds3;
use super::super::simd::MAX_DEPTH;
use super::SMALLER;
use super::reference::Reference;
use super::sah::{self, Bins, Grid, Split};
use crate::parallel;
use crate::simd::{self, Isa, Kernel};

/// Sets of at least this many references are binned in parallel.
const MIN_PARALLEL_BINS: usize = 1 << (16 - SMALLER);

/// From this level on, sets are halved by count. Fewer than 2^32 references need at most 32 more
/// levels.
pub const MAX_SAH_LEVELS: usize = MAX_DEPTH - 33;

/// The references below one node.
pub struct Set<'r> {
    pub references: &'r mut [Reference],
    /// Box of the doubled centroids; empty until it is needed in the top of the tree.
    pub centroids: Bounds3,
    /// Level of the node; 0 for the root.
    pub depth: usize,
}

/// Splits a set into a left and a right part. Neither is empty. `bins` is working memory; `stride`
/// is that of [`Bins::add`].
#[inline(always)]
pub fn split_serial<'r>(set: Set<'r>, bins: &mut Bins, stride: usize) -> (Set<'r>, Set<'r>) {
    if set.depth >= MAX_SAH_LEVELS {
        return halve(set);
    }
    let grid = Grid::new(&set.centroids);
    *bins = Bins::EMPTY;
    bins.add(&grid, set.references, stride);
    split_by_bins(set, &grid, bins)
}

/// Splits a set like [`split_serial`], but fills the bins of a large set in parallel. The result is
/// the same for any number of threads.
pub fn split(isa: Isa, set: Set) -> (Set, Set) {
    if set.references.len() < MIN_PARALLEL_BINS || set.depth >= MAX_SAH_LEVELS {
        let stride = sah::stride(set.references.len());
        return simd::dispatch(isa, SplitSerial(set, stride));
    }
    let grid = Grid::new(&set.centroids);
    let fill = |part| simd::dispatch(isa, Fill { grid: &grid, part });
    let bins = parallel::map(set.references.chunks(MIN_PARALLEL_BINS / 4), fill);
    let bins = bins.iter().fold(Bins::EMPTY, |all, part| all.merge(part));
    simd::dispatch(isa, SplitByBins { set, grid: &grid, bins: &bins })
}

/// Runs [`split_serial`] with this set and this stride.
pub struct SplitSerial<'r>(pub Set<'r>, pub usize);

impl<'r> Kernel for SplitSerial<'r> {
    type Output = (Set<'r>, Set<'r>);
    #[inline(always)]
    fn run(self) -> Self::Output {
        split_serial(self.0, &mut Bins::EMPTY.clone(), self.1)
    }
}

struct Fill<'r> {
    grid: &'r Grid,
    part: &'r [Reference],
}

impl Kernel for Fill<'_> {
    type Output = Bins;
    #[inline(always)]
    fn run(self) -> Bins {
        let mut bins = Bins::EMPTY;
        bins.add(self.grid, self.part, sah::stride(self.part.len()));
        bins
    }
}

struct SplitByBins<'r, 'b> {
    set: Set<'r>,
    grid: &'b Grid,
    bins: &'b Bins,
}

impl<'r> Kernel for SplitByBins<'r, '_> {
    type Output = (Set<'r>, Set<'r>);
    #[inline(always)]
    fn run(self) -> Self::Output {
        split_by_bins(self.set, self.grid, self.bins)
    }
}

/// Splits a set at the best plane of its bins. Halves it by count if there is no such plane or one
/// side would be empty.
#[inline(always)]
fn split_by_bins<'r>(set: Set<'r>, grid: &Grid, bins: &Bins) -> (Set<'r>, Set<'r>) {
    let Some(split) = bins.best(grid) else { return halve(set) };
    let (middle, sides) = partition(set.references, grid, &split);
    if middle == 0 || middle == set.references.len() {
        return halve(set);
    }
    split_at(set, middle, sides)
}

/// Splits a set behind its first `middle` references. `centroids` are the boxes of both parts.
#[inline(always)]
pub fn split_at(set: Set, middle: usize, [left, right]: [Bounds3; 2]) -> (Set, Set) {
    let Set { references, depth, .. } = set;
    let (a, b) = references.split_at_mut(middle);
    (
        Set { references: a, centroids: left, depth: depth + 1 },
        Set { references: b, centroids: right, depth: depth + 1 },
    )
}

/// Returns the box around the boxes of all items. Runs in parallel.
pub fn bounds_of<T: Sync>(all: &[T], bounds: impl Fn(&T) -> Bounds3 + Sync) -> Bounds3 {
    let around = |part: &[T]| part.iter().map(&bounds).fold(Bounds3::EMPTY, Bounds3::union);
    let parts = parallel::map(all.chunks(1 << 14), around);
    parts.into_iter().fold(Bounds3::EMPTY, Bounds3::union)
}

/// Returns the box of the doubled centroids. Runs in parallel.
pub fn centroids_of(references: &[Reference]) -> Bounds3 {
    bounds_of(references, |reference| reference.bounds.center2_point())
}

/// Moves the references of the left side to the front. Returns their number and the boxes of the
/// centroids of both sides.
///
/// Has no branches: they would be mispredicted for every second reference.
#[inline(always)]
fn partition(references: &mut [Reference], grid: &Grid, split: &Split) -> (usize, [Bounds3; 2]) {
    let mut middle = 0;
    let (mut left, mut right) = (Bounds3::EMPTY, Bounds3::EMPTY);
    for i in 0..references.len() {
        let reference = references[i];
        let is_left = grid.is_left(split, &reference);
        references[i] = references[middle];
        references[middle] = reference;
        middle += usize::from(is_left);
        let centroid = reference.bounds.center2_point();
        left = left.union(centroid.or_empty(is_left));
        right = right.union(centroid.or_empty(!is_left));
    }
    (middle, [left, right])
}

/// Halves a set by count along the axis of the largest extent of the centroids. If they coincide,
/// it halves by primitive index: spheres have the last indices, so leaves of one kind result.
fn halve(set: Set) -> (Set, Set) {
    let references = &mut *set.references;
    let middle = references.len() / 2;
    let extent = set.centroids.extent();
    let axis = (0..3).fold(0, |a, b| if extent[b] > extent[a] { b } else { a });
    let key = |r: &Reference| (r.group().first(), r.group().bits());
    if extent[axis] > 0.0 {
        references.select_nth_unstable_by(middle, |a, b| {
            let (ca, cb) = (a.bounds.center2()[axis], b.bounds.center2()[axis]);
            ca.total_cmp(&cb).then_with(|| key(a).cmp(&key(b)))
        });
    } else {
        references.select_nth_unstable_by_key(middle, key);
    }
    let sides = [centroids_of(&references[..middle]), centroids_of(&references[middle..])];
    split_at(set, middle, sides)
}
