//! Builds the binary tree from the top down. The surface area heuristic splits each set of
//! references until it fits into one leaf.

use std::sync::atomic::{AtomicU64, Ordering::Relaxed};

use rayon::prelude::*;

use super::super::bounds::Bounds3;
use super::super::node::{SPHERES, WIDTH};
use super::super::simd::MAX_DEPTH;
use super::binary_node::{BinaryNode, Leaf, Slot};
use super::block;
use super::reference::Reference;
use super::sah::{Bins, Grid, Split};
use crate::error::Result;
use crate::geometry::Geometry;
use crate::monitor::Monitor;
use crate::reserve;
use crate::simd::{self, Isa, Kernel};

/// From this many references on, the two subtrees are built in parallel.
const MIN_PARALLEL: usize = 4096;

/// From this many references on, bins are filled in parallel.
const MIN_PARALLEL_BINS: usize = 1 << 16;

/// Below this level sets are halved by number. That ends after at most 32 more levels.
const MAX_SAH_LEVELS: usize = MAX_DEPTH - 33;

/// The binary tree. Its root is in the first slot.
///
/// A subtree of n references has 2 n - 1 slots, whose number is known before it is built. So
/// subtrees are built in parallel in their final place. The system allocates no memory for the
/// slots that none of them uses.
pub struct BinaryTree {
    pub slots: Vec<Slot>,
    /// Number of nodes.
    pub len: usize,
    leaves: usize,
}

/// Builds the tree. Sorts `references` so that each leaf has a contiguous range of them.
///
/// # Errors
/// If there is too little memory for the nodes.
pub fn build(
    geometry: &Geometry,
    references: &mut [Reference],
    isa: Isa,
    monitor: &Monitor,
) -> Result<BinaryTree> {
    if references.is_empty() {
        return Ok(BinaryTree { slots: Vec::new(), len: 0, leaves: 0 });
    }
    let total = references.len() as u64;
    let done = AtomicU64::new(0);
    let builder = Builder { geometry, isa, monitor, total, done: &done };
    let mut slots = reserve::filled([0.0; 8], 2 * references.len() - 1, "bvh")?;
    let centroids = centroids_of(references);
    let len = builder.subtree(Set { references, centroids, first: 0, depth: 0 }, &mut slots);
    // A binary tree has one more leaf than inner nodes.
    Ok(BinaryTree { slots, len, leaves: len.div_ceil(2) })
}

/// Numbers the leaves of each kind in order. Returns all leaves.
///
/// # Errors
/// If there is too little memory.
pub fn number_leaves(tree: &mut BinaryTree) -> Result<Vec<Leaf>> {
    let mut next = [0, 0];
    let mut leaves = Vec::new();
    reserve::exact(&mut leaves, tree.leaves, "bvh")?;
    let mut right = Vec::from_iter((tree.len > 0).then_some(0));
    while let Some(mut place) = right.pop() {
        loop {
            let node = BinaryNode::read(&tree.slots[place]);
            if node.right() > 0 {
                right.push(place + node.right());
                place += 1;
                continue;
            }
            let leaf = node.references();
            let next = &mut next[usize::from(leaf.spheres)];
            tree.slots[place][7] = f32::from_bits(*next);
            *next += 1;
            leaves.push(leaf);
            break;
        }
    }
    Ok(leaves)
}

#[derive(Clone, Copy)]
struct Builder<'a> {
    geometry: &'a Geometry,
    isa: Isa,
    monitor: &'a Monitor,
    /// Number of all references.
    total: u64,
    /// Number of references in finished subtrees.
    done: &'a AtomicU64,
}

/// The references below one node.
struct Set<'r> {
    references: &'r mut [Reference],
    /// Box of the doubled centroids.
    centroids: Bounds3,
    /// Index of the first reference among all references.
    first: u32,
    /// Level of the node.
    depth: usize,
}

impl Builder<'_> {
    /// Builds the tree over a set of n references in the first 2 n - 1 slots. Returns its number of
    /// nodes.
    fn subtree(self, set: Set, slots: &mut [Slot]) -> usize {
        let n = set.references.len();
        if self.monitor.stopped() {
            // The build was stopped, so this result is discarded.
            BinaryNode::leaf(Bounds3::EMPTY, set.first, 0, false).write(&mut slots[0]);
            return 1;
        }
        if n < MIN_PARALLEL {
            let bins = &mut Bins::EMPTY.clone();
            let out = &mut Nodes { slots, len: 0 };
            simd::dispatch(self.isa, Serial { builder: self, set, bins, out });
            let done = self.done.fetch_add(n as u64, Relaxed) + n as u64;
            self.monitor.set_done(done * 900 / self.total);
            return out.len;
        }
        let (left, right) = split(self.isa, set);
        let behind = 2 * left.references.len();
        let (root, below) = slots.split_at_mut(1);
        let (below_left, below_right) = below.split_at_mut(behind - 1);
        let (a, b) =
            rayon::join(|| self.subtree(left, below_left), || self.subtree(right, below_right));
        finish(root, below_left, below_right, behind);
        1 + a + b
    }

    #[inline(always)]
    fn serial(self, set: Set, bins: &mut Bins, out: &mut Nodes) {
        if let Some(spheres) = fits(self.geometry, set.references) {
            let mut bounds = Bounds3::EMPTY;
            for reference in &*set.references {
                bounds = bounds.union(reference.bounds);
            }
            let node = BinaryNode::leaf(bounds, set.first, set.references.len(), spheres);
            node.write(&mut out.slots[out.len]);
            out.len += 1;
            return;
        }
        if set.references.len() <= 2 * WIDTH {
            block::prefetch_indices(self.geometry, set.references.iter().map(Reference::place));
        }
        let node = out.len;
        out.len += 1;
        let (left, right) = split_serial(set, bins);
        self.recurse(left, bins, out);
        let behind = out.len;
        self.recurse(right, bins, out);
        let (before, rest) = out.slots.split_at_mut(behind);
        let (root, below_left) = before[node..].split_at_mut(1);
        finish(root, below_left, rest, behind - node);
    }

    fn recurse(self, set: Set, bins: &mut Bins, out: &mut Nodes) {
        simd::dispatch(self.isa, Serial { builder: self, set, bins, out });
    }
}

/// Slots of which the first `len` have nodes.
struct Nodes<'r> {
    slots: &'r mut [Slot],
    len: usize,
}

struct Serial<'a, 'r, 's> {
    builder: Builder<'a>,
    set: Set<'r>,
    bins: &'r mut Bins,
    out: &'r mut Nodes<'s>,
}

impl Kernel for Serial<'_, '_, '_> {
    type Output = ();
    #[inline(always)]
    fn run(self) {
        self.builder.serial(self.set, self.bins, self.out);
    }
}

/// Writes the root of two subtrees, whose roots are the first of their slots.
#[inline(always)]
fn finish(root: &mut [Slot], left: &[Slot], right: &[Slot], behind: usize) {
    let [left, right] = [left, right].map(|slots| BinaryNode::read(&slots[0]));
    BinaryNode::inner(left.bounds().union(*right.bounds()), behind).write(&mut root[0]);
}

/// Whether references fit into one leaf. Returns `Some(true)` for a leaf of spheres, `Some(false)`
/// for triangles, `None` if they do not fit.
#[inline(always)]
fn fits(geometry: &Geometry, references: &[Reference]) -> Option<bool> {
    if references.len() > WIDTH {
        return None;
    }
    let is_sphere = |r: &Reference| r.place().geom == geometry.spheres_id();
    let spheres = references.iter().filter(|r| is_sphere(r)).count();
    let fit = match spheres {
        0 => block::fits(geometry, references.iter().map(Reference::place)),
        n => n == references.len() && n <= SPHERES,
    };
    fit.then_some(spheres > 0)
}

/// Splits a set into a left and a right part. Neither is empty.
#[inline(always)]
fn split_serial<'r>(set: Set<'r>, bins: &mut Bins) -> (Set<'r>, Set<'r>) {
    if set.depth >= MAX_SAH_LEVELS {
        return halve(set);
    }
    let grid = Grid::new(&set.centroids);
    *bins = Bins::EMPTY;
    bins.add(&grid, set.references);
    split_by_bins(set, &grid, bins)
}

/// Splits a set like [`split_serial`], but fills the bins of a large set in parallel.
fn split(isa: Isa, set: Set) -> (Set, Set) {
    if set.references.len() < MIN_PARALLEL_BINS || set.depth >= MAX_SAH_LEVELS {
        return simd::dispatch(isa, SplitSerial(set));
    }
    let grid = Grid::new(&set.centroids);
    let bins = set
        .references
        .par_chunks(MIN_PARALLEL_BINS / 4)
        .map(|part| simd::dispatch(isa, Fill { grid: &grid, part }))
        .reduce(|| Bins::EMPTY, |a, b| a.merge(&b));
    simd::dispatch(isa, SplitByBins { set, grid: &grid, bins: &bins })
}

struct SplitSerial<'r>(Set<'r>);

impl<'r> Kernel for SplitSerial<'r> {
    type Output = (Set<'r>, Set<'r>);
    #[inline(always)]
    fn run(self) -> Self::Output {
        split_serial(self.0, &mut Bins::EMPTY.clone())
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
        bins.add(self.grid, self.part);
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

/// Splits a set at the best plane of its bins, or by number if there is none.
#[inline(always)]
fn split_by_bins<'r>(set: Set<'r>, grid: &Grid, bins: &Bins) -> (Set<'r>, Set<'r>) {
    let Some(split) = bins.best(grid) else { return halve(set) };
    let (middle, sides) = partition(set.references, grid, &split);
    if middle == 0 || middle == set.references.len() {
        return halve(set);
    }
    split_at(set, middle, sides)
}

#[inline(always)]
fn split_at(set: Set, middle: usize, [left, right]: [Bounds3; 2]) -> (Set, Set) {
    let Set { references, first, depth, .. } = set;
    let (a, b) = references.split_at_mut(middle);
    (
        Set { references: a, centroids: left, first, depth: depth + 1 },
        Set { references: b, centroids: right, first: first + middle as u32, depth: depth + 1 },
    )
}

/// Returns the box of the doubled centroids. Runs in parallel.
fn centroids_of(references: &[Reference]) -> Bounds3 {
    references
        .par_iter()
        .with_min_len(MIN_PARALLEL)
        .map(|reference| reference.bounds.center2_point())
        .reduce(|| Bounds3::EMPTY, Bounds3::union)
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

/// Halves a set by number along the axis in which the centroids spread most. If they do not spread
/// at all, sorts spheres behind triangles, so that leaves of one kind result.
fn halve(set: Set) -> (Set, Set) {
    let references = &mut *set.references;
    let middle = references.len() / 2;
    let extent = set.centroids.extent();
    let axis = (0..3).fold(0, |a, b| if extent[b] > extent[a] { b } else { a });
    let key = Reference::place;
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
