//! Builds the binary tree from the top down. The surface area heuristic splits each set of
//! references until it fits into one leaf.

use std::sync::atomic::{AtomicU64, Ordering::Relaxed};

use rayon::prelude::*;

use super::super::bounds::Bounds3;
use super::super::node::{SPHERES, WIDTH};
use super::super::simd::MAX_DEPTH;
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

/// A node of the binary tree. The left child is the next node in the array.
#[derive(Debug, Clone, Copy)]
pub struct BinaryTree {
    /// Box of everything below the node.
    pub bounds: Bounds3,
    /// Inner node: distance to the right child in the array. Leaf: 0.
    pub right: u32,
    /// Leaf: its number among the leaves of its kind.
    pub leaf: u32,
    /// Leaf: index of its first reference.
    first: u32,
    /// Leaf: number of its references.
    count: u8,
    /// Whether this is a leaf of spheres.
    pub spheres: bool,
}

impl BinaryTree {
    /// A node whose children are still to be built.
    const UNFINISHED: Self =
        Self { bounds: Bounds3::EMPTY, right: 0, leaf: 0, first: 0, count: 0, spheres: false };
}

/// The references of a leaf.
#[derive(Debug, Clone, Copy)]
pub struct Leaf {
    first: u32,
    count: u8,
    /// Whether they are spheres, not triangles.
    pub spheres: bool,
}

impl Leaf {
    /// Returns the range of its references.
    pub fn range(&self) -> std::ops::Range<usize> {
        let first = self.first as usize;
        first..first + usize::from(self.count)
    }
}

/// Bytes per reference that [`build`] holds besides the references, approximately.
pub const SCRATCH_BYTES: u64 = 24;

/// Builds the tree. Sorts `references` so that each leaf has a contiguous range of them.
///
/// # Errors
/// If there is too little memory for the nodes.
pub fn build(
    geometry: &Geometry,
    references: &mut [Reference],
    isa: Isa,
    monitor: &Monitor,
) -> Result<Vec<BinaryTree>> {
    if references.is_empty() {
        return Ok(Vec::new());
    }
    let total = references.len() as u64;
    let done = AtomicU64::new(0);
    let builder = Builder { geometry, isa, monitor, total, done: &done };
    let centroids = centroids_of(references);
    let pieces = builder.subtree(Set { references, centroids, first: 0, depth: 0 });
    let mut nodes = Vec::new();
    reserve::exact(&mut nodes, pieces.len, "bvh")?;
    pieces.nodes.into_iter().for_each(|piece| nodes.extend(piece));
    Ok(nodes)
}

/// A subtree in pieces that are concatenated at the end. So nodes are copied once, not at every
/// level.
struct Pieces {
    nodes: Vec<Vec<BinaryTree>>,
    /// Number of nodes in all pieces.
    len: usize,
}

impl Pieces {
    fn one(nodes: Vec<BinaryTree>) -> Self {
        Self { len: nodes.len(), nodes: vec![nodes] }
    }

    fn root(&self) -> &BinaryTree {
        &self.nodes[0][0]
    }

    /// Returns the tree with two subtrees below a new root.
    fn join(left: Self, right: Self) -> Self {
        let bounds = left.root().bounds.union(right.root().bounds);
        let node = BinaryTree { bounds, right: left.len as u32 + 1, ..BinaryTree::UNFINISHED };
        let len = 1 + left.len + right.len;
        let nodes = [vec![vec![node]], left.nodes, right.nodes].into_iter().flatten().collect();
        Self { nodes, len }
    }
}

/// Numbers the leaves of each kind in order. Returns all leaves.
///
/// # Errors
/// If there is too little memory.
pub fn number_leaves(nodes: &mut [BinaryTree]) -> Result<Vec<Leaf>> {
    let mut next = [0, 0];
    let mut leaves = Vec::new();
    // A binary tree has one more leaf than inner nodes.
    reserve::exact(&mut leaves, nodes.len().div_ceil(2), "bvh")?;
    for node in nodes.iter_mut().filter(|node| node.right == 0) {
        let next = &mut next[usize::from(node.spheres)];
        node.leaf = *next;
        *next += 1;
        leaves.push(Leaf { first: node.first, count: node.count, spheres: node.spheres });
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
    /// Builds the tree over a set.
    fn subtree(self, set: Set) -> Pieces {
        if self.monitor.stopped() {
            // The build was stopped, so this result is discarded.
            return Pieces::one(vec![BinaryTree { first: set.first, ..BinaryTree::UNFINISHED }]);
        }
        let n = set.references.len();
        if n < MIN_PARALLEL {
            let bins = &mut Bins::EMPTY.clone();
            // Enough for scans: leaves of 11 references, and the nodes above them.
            let mut out = Vec::with_capacity(n / 4);
            simd::dispatch(self.isa, Serial { builder: self, set, bins, out: &mut out });
            let done = self.done.fetch_add(n as u64, Relaxed) + n as u64;
            self.monitor.set_done(done * 900 / self.total);
            return Pieces::one(out);
        }
        let (left, right) = split(self.isa, set);
        let (left, right) = rayon::join(|| self.subtree(left), || self.subtree(right));
        Pieces::join(left, right)
    }

    #[inline(always)]
    fn serial(self, set: Set, bins: &mut Bins, out: &mut Vec<BinaryTree>) {
        if let Some(spheres) = fits(self.geometry, set.references) {
            let mut bounds = Bounds3::EMPTY;
            for reference in &*set.references {
                bounds = bounds.union(reference.bounds);
            }
            let (first, count) = (set.first, set.references.len() as u8);
            out.push(BinaryTree { bounds, right: 0, leaf: 0, first, count, spheres });
            return;
        }
        if set.references.len() <= 2 * WIDTH {
            block::prefetch_indices(self.geometry, set.references);
        }
        let node = out.len();
        out.push(BinaryTree::UNFINISHED);
        let (left, right) = split_serial(set, bins);
        self.recurse(left, bins, out);
        let behind = out.len();
        self.recurse(right, bins, out);
        finish(out, node, behind);
    }

    fn recurse(self, set: Set, bins: &mut Bins, out: &mut Vec<BinaryTree>) {
        simd::dispatch(self.isa, Serial { builder: self, set, bins, out });
    }
}

struct Serial<'a, 'r> {
    builder: Builder<'a>,
    set: Set<'r>,
    bins: &'r mut Bins,
    out: &'r mut Vec<BinaryTree>,
}

impl Kernel for Serial<'_, '_> {
    type Output = ();
    #[inline(always)]
    fn run(self) {
        self.builder.serial(self.set, self.bins, self.out);
    }
}

/// Completes the node at index `node`, whose right child is at `behind`.
#[inline(always)]
fn finish(nodes: &mut [BinaryTree], node: usize, behind: usize) {
    nodes[node].right = (behind - node) as u32;
    nodes[node].bounds = nodes[node + 1].bounds.union(nodes[behind].bounds);
}

/// Whether references fit into one leaf. Returns `Some(true)` for a leaf of spheres, `Some(false)`
/// for triangles, `None` if they do not fit.
#[inline(always)]
fn fits(geometry: &Geometry, references: &[Reference]) -> Option<bool> {
    if references.len() > WIDTH {
        return None;
    }
    let is_sphere = |r: &Reference| r.geometry() == geometry.spheres_id();
    let spheres = references.iter().filter(|r| is_sphere(r)).count();
    let fit = match spheres {
        0 => block::fits(geometry, references),
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
    let key = |r: &Reference| (r.geometry(), r.primitive(), r.is_second_half());
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
