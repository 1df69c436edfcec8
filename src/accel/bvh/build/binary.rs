//! Builds the binary tree from the top down. The surface area heuristic splits each set of
//! references until it fits into one leaf.

use std::sync::atomic::{AtomicU64, Ordering::Relaxed};

use super::super::bounds::Bounds3;
use super::super::node::{SPHERES, WIDTH};
use super::binary_node::{BinaryNode, Leaf, Slot};
use super::block;
use super::cells::{Sorted, Top, TopNode};
use super::groups::instance_of;
use super::reference::Reference;
use super::sah::{self, Bins};
use super::split::{Set, centroids_of, split, split_at, split_serial};
use crate::error::Result;
use crate::geometry::Geometry;
use crate::monitor::Monitor;
use crate::reserve;
use crate::simd::{self, Isa, Kernel};

/// From this many references on, the two subtrees are built in parallel.
const MIN_PARALLEL: usize = 4096;

/// The binary tree. Its root is in the first slot.
///
/// A subtree of n references gets 2 n - 1 slots: enough for any binary tree over them. So subtrees
/// are built in parallel in their final place. The system allocates no memory for pages of slots
/// that no subtree uses.
pub struct BinaryTree {
    pub slots: Vec<Slot>,
    /// Number of nodes. There are more slots than nodes.
    pub len: usize,
    leaves: usize,
}

/// Builds the tree. Reorders the references so that each leaf has a contiguous range of them.
///
/// # Errors
/// If there is too little memory for the nodes.
pub fn build(
    geometry: &Geometry,
    Sorted { references, top }: &mut Sorted,
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
    let set = Set { references, centroids: Bounds3::EMPTY, first: 0, depth: 0 };
    let len = builder.top(top, (0, 0), set, &mut slots);
    // A binary tree has one more leaf than inner nodes.
    Ok(BinaryTree { slots, len, leaves: len.div_ceil(2) })
}

/// Sets the index of each leaf among the leaves of its kind, in depth-first order. Returns all
/// leaves in this order.
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

impl Builder<'_> {
    /// Builds the subtree of a node of `top` over its n references, in the first 2 n - 1 slots. The
    /// centroids of `set` are not set. The node is given by its index and the index of its first
    /// cell. Returns the number of nodes.
    fn top(self, top: &Top, (node, cell): (usize, usize), set: Set, slots: &mut [Slot]) -> usize {
        let Some(&TopNode { right, .. }) = top.nodes.get(node).filter(|node| node.right > 0) else {
            let centroids = centroids_of(set.references);
            return self.subtree(Set { centroids, ..set }, slots);
        };
        let middle = cell + top.nodes[node + 1].cells;
        let count = top.starts[middle] - top.starts[cell];
        let (left, behind) = split_at(set, count, [Bounds3::EMPTY; 2]);
        let (root, below) = slots.split_at_mut(1);
        let (below_left, below_right) = below.split_at_mut(2 * count - 1);
        let (a, b) = rayon::join(
            || self.top(top, (node + 1, cell), left, below_left),
            || self.top(top, (right, middle), behind, below_right),
        );
        finish(root, below_left, below_right, 2 * count);
        1 + a + b
    }

    /// Builds the tree over a set of n references in the first 2 n - 1 slots. Returns its number of
    /// nodes.
    fn subtree(self, set: Set, slots: &mut [Slot]) -> usize {
        let n = set.references.len();
        if self.monitor.stopped() {
            // The caller of the build discards this result.
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
        if let Some(spheres) = leaf_kind(self.geometry, set.references) {
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
            // The two parts may be leaves, and `block::fits` will read their indices.
            let places = set.references.iter().flat_map(|r| r.group().places(self.geometry));
            block::prefetch_indices(self.geometry, places);
        }
        let node = out.len;
        out.len += 1;
        let stride = sah::stride(set.references.len());
        let (left, right) = split_serial(set, bins, stride);
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

/// Slots. The first `len` hold nodes.
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

/// Writes the node above two subtrees. The root of each is in its first slot. The right subtree is
/// `behind` slots behind the new node.
#[inline(always)]
fn finish(root: &mut [Slot], left: &[Slot], right: &[Slot], behind: usize) {
    let [left, right] = [left, right].map(|slots| BinaryNode::read(&slots[0]));
    BinaryNode::inner(left.bounds().union(*right.bounds()), behind).write(&mut root[0]);
}

/// Returns the kind of leaf into which references fit: `Some(true)` for spheres or an instance,
/// `Some(false)` for triangles, `None` if they do not fit.
#[inline(always)]
fn leaf_kind(geometry: &Geometry, references: &[Reference]) -> Option<bool> {
    if references.iter().map(Reference::weight).sum::<u32>() as usize > WIDTH {
        return None;
    }
    let first_sphere = geometry.bases()[geometry.spheres_id() as usize];
    let spheres = references.iter().filter(|r| r.group().first() >= first_sphere).count();
    let fit = match spheres {
        0 => block::fits(geometry, references.iter().flat_map(|r| r.group().places(geometry))),
        // An instance is a leaf of its own: the box of the leaf decides which rays enter it.
        n => {
            let instances = references.iter().filter_map(|r| instance_of(geometry, r.group()));
            n == references.len() && n <= SPHERES && (n == 1 || instances.count() == 0)
        }
    };
    fit.then_some(spheres > 0)
}
