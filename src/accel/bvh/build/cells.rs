//! Sorts references into the cells of a grid, and splits the sets of cells: this is the top of the
//! tree.
//!
//! In the first dozen levels of a large tree, where exactly a set is split matters little. So the
//! surface area heuristic splits sets of whole cells there, and each reference is moved once in
//! place of once per level.

use std::ops::Range;
use std::sync::atomic::{AtomicU32, Ordering::Relaxed};

use rayon::prelude::*;

use super::super::bounds::Bounds3;
use super::SMALLER;
use super::groups::{self, Collect};
use super::in_order;
use super::reference::{Group, Reference};
use super::split::{MAX_SAH_LEVELS, Set, SplitSerial, bounds_of, centroids_of};
use crate::error::Result;
use crate::geometry::{Geometry, Sphere, Unseen};
use crate::parallel;
use crate::reserve;
use crate::simd::{self, Isa, Kernel};

/// Cells along each axis, as a power of two.
const BITS: u32 = 5;

/// Number of cells of the grid.
const CELLS: usize = 1 << (3 * BITS);

/// Fewer primitives are not sorted into cells, and their triangles do not share references in pairs
/// ([`groups`]): their build is short.
const MIN_PRIMITIVES: u32 = 1 << (18 - SMALLER);

/// A set of several cells is split if it has at least this many references.
const MIN_SPLIT: u64 = 1 << (12 - SMALLER);

/// Number of primitives that one task reads at least (the last task may read fewer), and largest
/// number of tasks. They must not depend on the number of threads: no pair crosses the boundary of
/// a task, so the size of a task changes the tree.
const MIN_CHUNK: u32 = 1 << (14 - SMALLER);
const MAX_CHUNKS: u32 = 64;

/// References in the order of the top of the tree.
pub struct Sorted {
    pub references: Vec<Reference>,
    pub top: Top,
}

/// The top of the tree, over cells. Empty if the references are not sorted into cells.
#[derive(Default)]
pub struct Top {
    /// The root is the first node, and a left child follows its parent.
    pub nodes: Vec<TopNode>,
    /// Index of the first reference of each cell, in the order of the leaves of `nodes`, and the
    /// number of all references.
    pub starts: Vec<usize>,
}

/// A node of the top of the tree.
pub struct TopNode {
    /// Number of its cells, which are consecutive.
    pub cells: usize,
    /// Index of the right child; 0 if the node is not split.
    pub right: usize,
}

/// Maps boxes to cells by their doubled centres (lower + upper corner).
#[derive(Clone, Copy)]
struct CellGrid {
    origin: [f32; 3],
    scale: [f32; 3],
}

impl CellGrid {
    /// Returns the grid over the bounds of all shapes; `None` if it is not finite. Bounds of a mesh
    /// include its unused vertices, which may be infinite. NaN coordinates are ignored.
    fn new(geometry: &Geometry) -> Option<Self> {
        let mut bounds = Bounds3::EMPTY;
        for mesh in &geometry.meshes {
            let [lower, upper] = mesh.bounds();
            bounds = bounds.union(Bounds3::new(lower, upper));
        }
        let sphere = |sphere: &Sphere| {
            let (lower, upper) = sphere.bounds();
            Bounds3::new(lower, upper)
        };
        bounds = bounds.union(bounds_of(&geometry.quads, |quad| Bounds3::from_points(quad)));
        bounds = bounds.union(bounds_of(&geometry.spheres, sphere));
        for instance in &geometry.instances {
            let [lower, upper] = instance.bounds;
            bounds = bounds.union(Bounds3::new(lower, upper));
        }
        let extent = bounds.extent().map(|extent| 2.0 * extent);
        let scale =
            extent.map(|extent| if extent > 0.0 { (1 << BITS) as f32 / extent } else { 0.0 });
        let finite = extent.iter().chain(&scale).all(|x| x.is_finite());
        finite.then(|| Self { origin: bounds.lower().map(|x| 2.0 * x), scale })
    }

    /// Returns the cell of a box, below [`CELLS`].
    #[inline(always)]
    fn cell(&self, bounds: &Bounds3) -> u16 {
        let center2 = bounds.center2();
        let mut cell = 0;
        for axis in 0..3 {
            let x = (center2[axis] - self.origin[axis]) * self.scale[axis];
            cell = (cell << BITS) | x.clamp(0.0, ((1 << BITS) - 1) as f32) as u16;
        }
        cell
    }
}

/// The groups of one task's primitives, with their cells.
struct Chunk {
    groups: Vec<Group>,
    /// For each group, the index of its cell in `cells`.
    cell_of: Vec<u16>,
    /// The occupied cells.
    cells: Vec<Cell>,
}

/// The groups of a chunk in one cell.
struct Cell {
    index: u16,
    count: u32,
    bounds: Bounds3,
    /// Index of the next reference to a group of this cell.
    next: usize,
}

/// Finds the groups of the primitives in `range`, and their cells.
struct FillChunk<'a> {
    geometry: &'a Geometry,
    unseen: &'a Unseen,
    grid: CellGrid,
    range: Range<u32>,
}

impl Kernel for FillChunk<'_> {
    type Output = Chunk;
    #[inline(always)]
    fn run(self) -> Chunk {
        let Self { geometry, unseen, grid, range } = self;
        let most = (range.end - range.start) as usize;
        let (groups, cell_of) = (Vec::with_capacity(most), Vec::with_capacity(most));
        let chunk = Chunk { groups, cell_of, cells: Vec::new() };
        let mut filling = Filling { chunk, grid, place_of: vec![u16::MAX; CELLS] };
        groups::each((geometry, unseen), range, true, &mut filling);
        filling.chunk
    }
}

struct Filling {
    chunk: Chunk,
    grid: CellGrid,
    /// For each cell of the grid, its index in the chunk.
    place_of: Vec<u16>,
}

impl Collect for Filling {
    #[inline(always)]
    fn add(&mut self, group: Group, bounds: Bounds3) {
        let Self { chunk, grid, place_of } = self;
        let index = grid.cell(&bounds);
        // `index` is below CELLS. The remainder spares the check of the bounds.
        let place = &mut place_of[usize::from(index) % CELLS];
        if *place == u16::MAX {
            *place = chunk.cells.len() as u16;
            chunk.cells.push(Cell { index, count: 0, bounds: Bounds3::EMPTY, next: 0 });
        }
        let cell = &mut chunk.cells[usize::from(*place)];
        cell.count += 1;
        cell.bounds = cell.bounds.union(bounds);
        chunk.groups.push(group);
        chunk.cell_of.push(*place);
    }
}

/// Makes the references of all primitives that are not in `unseen`, in the order of the top of the
/// tree. The top is empty if there are few primitives or if the grid is not finite.
///
/// # Errors
/// If there is too little memory.
pub fn sort(geometry: &Geometry, unseen: &Unseen, isa: Isa) -> Result<Sorted> {
    let primitives = groups::sorted_count(geometry) as u32;
    let size = primitives.div_ceil(MAX_CHUNKS).max(MIN_CHUNK);
    let ranges = (0..primitives).step_by(size as usize);
    let ranges = ranges.map(|start| start..start.saturating_add(size).min(primitives));
    let is_large = primitives >= MIN_PRIMITIVES;
    let Some(grid) = is_large.then(|| CellGrid::new(geometry)).flatten() else {
        let references = in_order::references((geometry, unseen), ranges, is_large, isa)?;
        return Ok(Sorted { references, top: Top::default() });
    };
    // A quad has two groups.
    reserve::probe(u64::from(primitives) * 2 * size_of::<(Group, u16)>() as u64, "bvh")?;
    let fill = |range| simd::dispatch(isa, FillChunk { geometry, unseen, grid, range });
    let mut chunks = parallel::map(ranges, fill);
    let mut cells = occupied(&chunks);
    let mut nodes = Vec::new();
    let centroids = centroids_of(&cells);
    let set = Set { references: &mut cells, centroids, depth: 0 };
    split_cells(isa, set, &mut nodes);
    let starts = assign_starts(&mut chunks, &cells);
    let references = scatter(geometry, chunks, starts.last().copied().unwrap_or(0))?;
    Ok(Sorted { references, top: Top { nodes, starts } })
}

/// Returns one reference per occupied cell, in ascending order. The group of such a reference holds
/// the index of the cell in place of that of a primitive. Its weight is the number of groups in the
/// cell.
fn occupied(chunks: &[Chunk]) -> Vec<Reference> {
    let mut sums = vec![(0, Bounds3::EMPTY); CELLS];
    for cell in chunks.iter().flat_map(|chunk| &chunk.cells) {
        let (count, bounds) = &mut sums[usize::from(cell.index)];
        *count += cell.count;
        *bounds = bounds.union(cell.bounds);
    }
    let cells = sums.into_iter().zip(0..).filter(|((count, _), _)| *count > 0);
    cells.map(|((count, bounds), cell)| Reference::new(bounds, Group::one(cell), count)).collect()
}

/// Splits a set of cells until each part is one cell, has fewer than [`MIN_SPLIT`] references or
/// lies at the greatest depth of such splits. Puts the cells in the order of the parts, and appends
/// the nodes.
fn split_cells(isa: Isa, set: Set, nodes: &mut Vec<TopNode>) {
    let (node, cells) = (nodes.len(), set.references.len());
    nodes.push(TopNode { cells, right: 0 });
    let weight: u64 = set.references.iter().map(|cell| u64::from(cell.weight())).sum();
    if cells > 1 && weight >= MIN_SPLIT && set.depth < MAX_SAH_LEVELS {
        let (left, right) = simd::dispatch(isa, SplitSerial(set, 1));
        split_cells(isa, left, nodes);
        nodes[node].right = nodes.len();
        split_cells(isa, right, nodes);
    }
}

/// Sets, for each cell of each chunk, where its groups begin: in the order of `cells`, and in one
/// cell in the order of the chunks. Returns the start of each of `cells`, and the end.
fn assign_starts(chunks: &mut [Chunk], cells: &[Reference]) -> Vec<usize> {
    let mut rank = vec![0; CELLS];
    let mut starts = vec![0];
    for (i, cell) in cells.iter().enumerate() {
        rank[cell.group().first() as usize] = i;
        starts.push(starts[i] + cell.weight() as usize);
    }
    let mut next = starts.clone();
    for cell in chunks.iter_mut().flat_map(|chunk| &mut chunk.cells) {
        let next = &mut next[rank[usize::from(cell.index)]];
        cell.next = *next;
        *next += cell.count as usize;
    }
    starts
}

/// Makes the `count` references of all chunks in their places.
fn scatter(geometry: &Geometry, chunks: Vec<Chunk>, count: usize) -> Result<Vec<Reference>> {
    let mut references = Vec::new();
    reserve::exact(&mut references, count, "bvh")?;
    // Atomic, because each task writes to places all over the array.
    let groups: Vec<AtomicU32> = (0..count).into_par_iter().map(|_| AtomicU32::new(0)).collect();
    parallel::each(chunks.into_iter(), |mut chunk| {
        for (group, &cell) in chunk.groups.iter().zip(&chunk.cell_of) {
            let next = &mut chunk.cells[usize::from(cell)].next;
            groups[*next].store(group.bits(), Relaxed);
            *next += 1;
        }
    });
    let reference =
        |bits: &AtomicU32| Reference::to(Group::from_bits(bits.load(Relaxed)), geometry);
    groups.par_iter().with_min_len(1 << 12).map(reference).collect_into_vec(&mut references);
    Ok(references)
}
