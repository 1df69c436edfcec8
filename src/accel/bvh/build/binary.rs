//! Builds the binary tree from the top down. The surface area heuristic splits each set of
//! references until it fits into one leaf.

use std::sync::atomic::{AtomicU64, Ordering::Relaxed};

use super::super::bounds::Bounds3;
use super::super::node::{SPHERES, WIDTH};
use super::binary_node::{BinaryNode, Leaf, Slot};
use super::block;
use super::cells::{Sorted, Top, TopNode};
use super::reference::{PrimitiveId, Reference};
use super::room::{Nodes, Room};
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
    /// The primitives of the leaves, each as the bits of a [`Group`](super::reference::Group). A
    /// subtree of n references gets 2 n places, because a pair may need two.
    pub primitives: Vec<u32>,
    /// Number of nodes. There are more slots than nodes.
    pub len: usize,
    leaves: usize,
}

/// Builds the tree. Reorders the references.
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
        return Ok(BinaryTree { slots: Vec::new(), primitives: Vec::new(), len: 0, leaves: 0 });
    }
    let total = references.len() as u64;
    let done = AtomicU64::new(0);
    let builder = Builder { geometry, isa, monitor, total, done: &done };
    let mut slots = reserve::filled([0.0; 8], 2 * references.len() - 1, "bvh")?;
    let mut primitives = reserve::filled(0, 2 * references.len(), "bvh")?;
    let set = Set { references, centroids: Bounds3::EMPTY, depth: 0 };
    let room = Room { slots: &mut slots, primitives: &mut primitives, first: 0 };
    let len = builder.top(top, (0, 0), set, room);
    // A binary tree has one more leaf than inner nodes.
    Ok(BinaryTree { slots, primitives, len, leaves: len.div_ceil(2) })
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
            let leaf = node.primitives();
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
    /// Builds the subtree of a node of `top`. The centroids of `set` are not set. The node is given
    /// by its index and the index of its first cell. Returns the number of nodes.
    fn top(self, top: &Top, (node, cell): (usize, usize), set: Set, room: Room) -> usize {
        let Some(&TopNode { right, .. }) = top.nodes.get(node).filter(|node| node.right > 0) else {
            let centroids = centroids_of(set.references);
            return self.subtree(Set { centroids, ..set }, room);
        };
        let middle = cell + top.nodes[node + 1].cells;
        let count = top.starts[middle] - top.starts[cell];
        let (left, behind) = split_at(set, count, [Bounds3::EMPTY; 2]);
        room.fill(
            count,
            |room| self.top(top, (node + 1, cell), left, room),
            |room| self.top(top, (right, middle), behind, room),
        )
    }

    /// Builds the tree over a set of references. Returns its number of nodes.
    fn subtree(self, set: Set, room: Room) -> usize {
        let n = set.references.len();
        if self.monitor.stopped() {
            // The caller of the build discards this result.
            BinaryNode::leaf(Bounds3::EMPTY, room.first, 0, false).write(&mut room.slots[0]);
            return 1;
        }
        if n < MIN_PARALLEL {
            let out = &mut Nodes::new(room);
            self.task(set, out);
            let done = self.done.fetch_add(n as u64, Relaxed) + n as u64;
            self.monitor.set_done(done * 900 / self.total);
            return out.len();
        }
        let (left, right) = split(self.isa, set);
        let count = left.references.len();
        room.fill(count, |room| self.subtree(left, room), |room| self.subtree(right, room))
    }

    /// Builds the tree over a set on one thread, with pairs split up: leaves get fuller, because
    /// the triangles of a pair need not lie in the same leaf. Keeps the pairs if there is no room.
    fn task(self, set: Set, out: &mut Nodes) {
        let bins = &mut Bins::EMPTY.clone();
        if set.references.iter().any(|reference| reference.group().len() > 1) {
            let references = &*set.references;
            let (mut singles, centroids) =
                simd::dispatch(self.isa, SplitPairs { geometry: self.geometry, references });
            let set = Set { references: &mut singles, centroids, depth: set.depth };
            self.recurse(set, bins, out);
            if !out.is_full() {
                return;
            }
            out.clear();
        }
        self.recurse(set, bins, out);
    }

    #[inline(always)]
    fn serial(self, set: Set, bins: &mut Bins, out: &mut Nodes) {
        if let Some(spheres) = leaf_kind(self.geometry, set.references) {
            out.add_leaf(set.references, spheres);
            return;
        }
        if set.references.len() <= 2 * WIDTH {
            // The two parts may be leaves, and `block::fits` will read their indices.
            block::prefetch_indices(self.geometry, places(self.geometry, set.references));
        }
        let Some(node) = out.add_node() else { return };
        let stride = sah::stride(set.references.len());
        let (left, right) = split_serial(set, bins, stride);
        self.recurse(left, bins, out);
        let behind = out.len();
        self.recurse(right, bins, out);
        out.finish(node, behind);
    }

    fn recurse(self, set: Set, bins: &mut Bins, out: &mut Nodes) {
        simd::dispatch(self.isa, Serial { builder: self, set, bins, out });
    }
}

/// Iterates over the places of all primitives of references.
#[inline(always)]
fn places(
    geometry: &Geometry,
    references: &[Reference],
) -> impl Iterator<Item = PrimitiveId> + Clone {
    references.iter().flat_map(|reference| reference.group().places(geometry))
}

/// Returns references to the single primitives of references, and the box of their doubled
/// centroids.
struct SplitPairs<'a> {
    geometry: &'a Geometry,
    references: &'a [Reference],
}

impl Kernel for SplitPairs<'_> {
    type Output = (Vec<Reference>, Bounds3);
    #[inline(always)]
    fn run(self) -> Self::Output {
        let Self { geometry, references } = self;
        let mut singles = Vec::with_capacity(2 * references.len());
        let mut centroids = Bounds3::EMPTY;
        for (i, reference) in references.iter().enumerate() {
            // Vertices 8 references ahead, and their indices before that.
            let [near, far] = [8, 16].map(|ahead| references.get(i + ahead..=i + ahead));
            block::prefetch_indices(geometry, places(geometry, far.unwrap_or_default()));
            block::prefetch_vertices(geometry, places(geometry, near.unwrap_or_default()));
            for member in reference.group().members() {
                let single = Reference::to(member, geometry);
                centroids = centroids.union(single.bounds.center2_point());
                singles.push(single);
            }
        }
        (singles, centroids)
    }
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

/// Returns the kind of leaf into which references fit: `Some(true)` for spheres or one instance,
/// `Some(false)` for triangles, `None` if they do not fit.
#[inline(always)]
fn leaf_kind(geometry: &Geometry, references: &[Reference]) -> Option<bool> {
    if references.iter().map(Reference::weight).sum::<u32>() as usize > WIDTH {
        return None;
    }
    let first_sphere = geometry.bases()[geometry.spheres_id() as usize];
    let spheres = references.iter().filter(|r| r.group().first() >= first_sphere).count();
    let fit = match spheres {
        0 => block::fits(geometry, places(geometry, references)),
        n => n == references.len() && n <= SPHERES,
    };
    fit.then_some(spheres > 0)
}

#[cfg(test)]
mod tests {
    use glam::DVec3;

    use super::super::reference::Group;
    use super::*;
    use crate::geometry::TriangleMesh;

    /// Builds the tree over `pairs` pairs of triangles in the given number of slots. Returns the
    /// nodes and the primitives, or `None` if the slots do not suffice.
    fn task(pairs: u32, slots: usize, split_up: bool) -> Option<(usize, Vec<u32>)> {
        // Triangle i lies at 32^i. So each split takes the farthest triangle away.
        let at = |i: u32, k: u32| [32.0_f32.powi(i as i32) * (1.0 + 0.1 * k as f32), k as f32, 0.0];
        let vertices = (0..2 * pairs).flat_map(|i| (0..3).map(move |k| at(i, k))).collect();
        let triangles = (0..2 * pairs).map(|i| [3 * i, 3 * i + 1, 3 * i + 2]).collect();
        let mesh = TriangleMesh::new(vertices, triangles, false);
        let geometry = Geometry::new(DVec3::ZERO, vec![mesh], vec![], vec![]).expect("few");
        let (monitor, done) = (Monitor::default(), AtomicU64::new(0));
        let builder = Builder {
            geometry: &geometry,
            isa: Isa::Portable,
            monitor: &monitor,
            total: u64::from(pairs),
            done: &done,
        };
        let groups: Vec<Group> = match split_up {
            true => (0..2 * pairs).map(Group::one).collect(),
            false => (0..pairs).map(|i| Group::pair(2 * i)).collect(),
        };
        let mut references: Vec<_> =
            groups.iter().map(|&group| Reference::to(group, &geometry)).collect();
        let centroids = centroids_of(&references);
        let (mut slots, mut primitives) = (vec![[0.0; 8]; slots], vec![0; 2 * pairs as usize]);
        let room = Room { slots: &mut slots, primitives: &mut primitives, first: 0 };
        let mut out = Nodes::new(room);
        builder.task(Set { references: &mut references, centroids, depth: 0 }, &mut out);
        let (full, len) = (out.is_full(), out.len());
        primitives.sort_unstable();
        (!full).then_some((len, primitives))
    }

    #[test]
    fn pairs_are_split_up_if_there_is_room() {
        let all = Vec::from_iter(0..24);
        let (split_up, primitives) = task(12, 47, true).expect("2 n - 1 slots suffice");
        assert!(split_up > 23, "{split_up}: the pairs would find room");
        assert_eq!(primitives, all);
        assert_eq!(task(12, 47, false), Some((split_up, all.clone())));
        let (as_pairs, primitives) = task(12, 23, false).expect("2 n - 1 slots suffice");
        assert!(as_pairs <= 23);
        assert_eq!(primitives, all);
        assert_eq!(task(12, 23, true), None);
    }
}
