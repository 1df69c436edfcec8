//! The binary tree, top down: each set of references is split where the surface area heuristic says,
//! until it fits into one leaf.

use std::sync::atomic::{AtomicU64, Ordering::Relaxed};

use rayon::prelude::*;

use super::super::bounds::Bounds3;
use super::super::node::{SPHERES, WIDTH};
use super::super::simd::MAX_DEPTH;
use super::block;
use super::reference::Reference;
use super::sah::{Bins, Grid};
use crate::geometry::Geometry;
use crate::monitor::Monitor;
use crate::simd::{self, Isa, Kernel};

/// From this many references on, the two sides are built in parallel.
const PARALLEL: usize = 4096;

/// From this many references on, bins are filled in parallel.
const PARALLEL_BINS: usize = 1 << 16;

/// Below this level sets are halved by number, which ends after at most 32 levels more.
const SAH_LEVELS: usize = MAX_DEPTH - 33;

/// A node; its left child follows it.
#[derive(Debug, Clone, Copy)]
pub struct Binary {
    /// Box of everything below.
    pub bounds: Bounds3,
    /// An inner node: how far behind this node the right child is. A leaf: 0.
    pub right: u32,
    /// A leaf: its number among the leaves of its kind.
    pub leaf: u32,
    /// A leaf: its first reference.
    first: u32,
    /// A leaf: its references.
    count: u8,
    /// A leaf: of spheres.
    pub spheres: bool,
}

/// The references of a leaf.
#[derive(Debug, Clone, Copy)]
pub struct Leaf {
    first: u32,
    count: u8,
    /// Of spheres, not of triangles.
    pub spheres: bool,
}

impl Leaf {
    /// Where its references are.
    pub fn range(&self) -> std::ops::Range<usize> {
        let first = self.first as usize;
        first..first + usize::from(self.count)
    }
}

/// Builds the tree; sorts `references` so that each leaf's stand together.
pub fn build(
    geometry: &Geometry,
    references: &mut [Reference],
    isa: Isa,
    monitor: &Monitor,
) -> Vec<Binary> {
    if references.is_empty() {
        return Vec::new();
    }
    let total = references.len() as u64;
    let done = AtomicU64::new(0);
    let builder = Builder { geometry, isa, monitor, total, done: &done };
    let mut nodes = Vec::new();
    builder.subtree(references, 0, 0, &mut nodes);
    nodes
}

/// Numbers the leaves of each kind in order; returns them all.
pub fn number_leaves(nodes: &mut [Binary]) -> Vec<Leaf> {
    let mut next = [0, 0];
    let mut leaves = Vec::new();
    for node in nodes.iter_mut().filter(|node| node.right == 0) {
        let next = &mut next[usize::from(node.spheres)];
        node.leaf = *next;
        *next += 1;
        leaves.push(Leaf { first: node.first, count: node.count, spheres: node.spheres });
    }
    leaves
}

#[derive(Clone, Copy)]
struct Builder<'a> {
    geometry: &'a Geometry,
    isa: Isa,
    monitor: &'a Monitor,
    /// References in all, and in finished subtrees.
    total: u64,
    done: &'a AtomicU64,
}

impl Builder<'_> {
    /// Appends the tree over `references`, which begin at `first` of all.
    fn subtree(
        self,
        references: &mut [Reference],
        first: u32,
        depth: usize,
        out: &mut Vec<Binary>,
    ) {
        if self.monitor.stopped() {
            // Whatever this makes is thrown away.
            let bounds = Bounds3::EMPTY;
            out.push(Binary { bounds, right: 0, leaf: 0, first, count: 0, spheres: false });
            return;
        }
        if references.len() < PARALLEL {
            let n = references.len() as u64;
            simd::dispatch(self.isa, Serial { builder: self, references, first, depth, out });
            let done = self.done.fetch_add(n, Relaxed) + n;
            self.monitor.set_done(done * 900 / self.total);
            return;
        }
        let (bounds, middle) = simd::dispatch(self.isa, Divide { references, depth });
        let (left, right) = references.split_at_mut(middle);
        let node = out.len();
        out.push(Binary { bounds, right: 0, leaf: 0, first, count: 0, spheres: false });
        let mut behind = Vec::new();
        rayon::join(
            || self.subtree(left, first, depth + 1, out),
            || self.subtree(right, first + middle as u32, depth + 1, &mut behind),
        );
        out[node].right = (out.len() - node) as u32;
        out.append(&mut behind);
    }

    #[inline(always)]
    fn serial(self, references: &mut [Reference], first: u32, depth: usize, out: &mut Vec<Binary>) {
        if let Some((bounds, spheres)) = fits(self.geometry, references) {
            let count = references.len() as u8;
            out.push(Binary { bounds, right: 0, leaf: 0, first, count, spheres });
            return;
        }
        let (bounds, middle) = divide(references, depth);
        let (left, right) = references.split_at_mut(middle);
        let node = out.len();
        out.push(Binary { bounds, right: 0, leaf: 0, first, count: 0, spheres: false });
        self.recurse(left, first, depth + 1, out);
        out[node].right = (out.len() - node) as u32;
        self.recurse(right, first + middle as u32, depth + 1, out);
    }

    fn recurse(
        self,
        references: &mut [Reference],
        first: u32,
        depth: usize,
        out: &mut Vec<Binary>,
    ) {
        simd::dispatch(self.isa, Serial { builder: self, references, first, depth, out });
    }
}

struct Serial<'a, 'r> {
    builder: Builder<'a>,
    references: &'r mut [Reference],
    first: u32,
    depth: usize,
    out: &'r mut Vec<Binary>,
}

impl Kernel for Serial<'_, '_> {
    type Output = ();
    #[inline(always)]
    fn run(self) {
        self.builder.serial(self.references, self.first, self.depth, self.out);
    }
}

struct Divide<'r> {
    references: &'r mut [Reference],
    depth: usize,
}

impl Kernel for Divide<'_> {
    type Output = (Bounds3, usize);
    #[inline(always)]
    fn run(self) -> Self::Output {
        divide(self.references, self.depth)
    }
}

/// The box of references that fit into one leaf, and whether they are spheres.
#[inline(always)]
fn fits(geometry: &Geometry, references: &[Reference]) -> Option<(Bounds3, bool)> {
    if references.len() > WIDTH {
        return None;
    }
    let is_sphere = |r: &Reference| r.geometry() == geometry.spheres_id();
    let spheres = references.iter().filter(|r| is_sphere(r)).count();
    let fit = match spheres {
        0 => block::fits(geometry, references),
        n => n == references.len() && n <= SPHERES,
    };
    fit.then(|| (bounds_of(references), spheres > 0))
}

#[inline(always)]
fn bounds_of(references: &[Reference]) -> Bounds3 {
    references.iter().fold(Bounds3::EMPTY, |b, r| b.union(r.bounds))
}

/// Sorts references into a left and a right part, neither empty; the box of all, and where the right
/// part begins.
#[inline(always)]
fn divide(references: &mut [Reference], depth: usize) -> (Bounds3, usize) {
    let parallel = references.len() >= PARALLEL_BINS;
    let (bounds, centroids) =
        if parallel { extents_in_parallel(references) } else { extents(references) };
    if depth >= SAH_LEVELS {
        return (bounds, halve(references, &centroids));
    }
    let grid = Grid::new(&centroids);
    let bins = if parallel {
        let one = |part: &[Reference]| {
            let mut bins = Bins::EMPTY;
            bins.add(&grid, part);
            bins
        };
        references.par_chunks(PARALLEL_BINS / 4).map(one).reduce(|| Bins::EMPTY, |a, b| a.merge(&b))
    } else {
        let mut bins = Bins::EMPTY;
        bins.add(&grid, references);
        bins
    };
    let middle = match bins.best(&grid) {
        Some(split) => partition(references, |r| grid.is_left(&split, r)),
        None => 0,
    };
    if middle == 0 || middle == references.len() {
        return (bounds, halve(references, &centroids));
    }
    (bounds, middle)
}

/// Boxes of the references and of their (doubled) centroids.
#[inline(always)]
fn extents(references: &[Reference]) -> (Bounds3, Bounds3) {
    let (mut bounds, mut centroids) = (Bounds3::EMPTY, Bounds3::EMPTY);
    for reference in references {
        let center = reference.bounds.center2();
        bounds = bounds.union(reference.bounds);
        centroids = centroids.union(Bounds3::new(center, center));
    }
    (bounds, centroids)
}

fn extents_in_parallel(references: &[Reference]) -> (Bounds3, Bounds3) {
    references
        .par_chunks(PARALLEL_BINS / 4)
        .map(extents)
        .reduce(|| (Bounds3::EMPTY, Bounds3::EMPTY), |a, b| (a.0.union(b.0), a.1.union(b.1)))
}

/// Moves what goes left to the front; how much that is.
#[inline(always)]
fn partition(references: &mut [Reference], is_left: impl Fn(&Reference) -> bool) -> usize {
    let (mut i, mut j) = (0, references.len());
    loop {
        while i < j && is_left(&references[i]) {
            i += 1;
        }
        while i < j && !is_left(&references[j - 1]) {
            j -= 1;
        }
        if i >= j {
            return i;
        }
        references.swap(i, j - 1);
        i += 1;
        j -= 1;
    }
}

/// Halves by number along the axis in which the centroids spread most; spheres behind triangles
/// where they do not spread at all, so that leaves of one kind come about.
fn halve(references: &mut [Reference], centroids: &Bounds3) -> usize {
    let middle = references.len() / 2;
    let extent = centroids.extent();
    let axis = (0..3).fold(0, |a, b| if extent[b] > extent[a] { b } else { a });
    let key = |r: &Reference| (r.geometry(), r.primitive(), r.is_second_half());
    if !(extent[axis] > 0.0) {
        references.select_nth_unstable_by_key(middle, key);
        return middle;
    }
    references.select_nth_unstable_by(middle, |a, b| {
        let (ca, cb) = (a.bounds.center2()[axis], b.bounds.center2()[axis]);
        ca.total_cmp(&cb).then_with(|| key(a).cmp(&key(b)))
    });
    middle
}
