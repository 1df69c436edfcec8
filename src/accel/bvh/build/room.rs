//! Where the nodes of a subtree go.

use super::super::bounds::Bounds3;
use super::binary_node::{BinaryNode, Slot};
use super::reference::Reference;

/// Where the tree over n references goes.
pub struct Room<'r> {
    /// 2 n - 1 slots, enough for any binary tree over n leaves.
    pub slots: &'r mut [Slot],
    /// 2 n primitives: see [`BinaryTree::primitives`](super::binary::BinaryTree::primitives).
    pub primitives: &'r mut [u32],
    /// Index of the first of `primitives` among all.
    pub first: u32,
}

impl Room<'_> {
    /// Makes a node above two subtrees. The left one has `count` references. The functions make the
    /// subtrees, in parallel, and return their numbers of nodes. Returns the number of all nodes.
    pub fn fill(
        self,
        count: usize,
        left: impl FnOnce(Room) -> usize + Send,
        right: impl FnOnce(Room) -> usize + Send,
    ) -> usize {
        let (root, below) = self.slots.split_at_mut(1);
        let (below_left, below_right) = below.split_at_mut(2 * count - 1);
        let (of_left, of_right) = self.primitives.split_at_mut(2 * count);
        let first = self.first + 2 * count as u32;
        let (a, b) = rayon::join(
            || left(Room { slots: below_left, primitives: of_left, first: self.first }),
            || right(Room { slots: below_right, primitives: of_right, first }),
        );
        finish(root, below_left, below_right, 2 * count);
        1 + a + b
    }
}

/// The nodes of a subtree that one thread builds.
pub struct Nodes<'r> {
    room: Room<'r>,
    /// Number of nodes.
    len: usize,
    /// Number of primitives in leaves.
    primitives: usize,
    /// Whether a node found no slot. Then the other nodes mean nothing.
    full: bool,
}

impl<'r> Nodes<'r> {
    pub fn new(room: Room<'r>) -> Self {
        Self { room, len: 0, primitives: 0, full: false }
    }

    /// Removes all nodes.
    pub fn clear(&mut self) {
        (self.len, self.primitives, self.full) = (0, 0, false);
    }

    #[inline(always)]
    pub fn len(&self) -> usize {
        self.len
    }

    pub fn is_full(&self) -> bool {
        self.full
    }

    /// Adds a leaf of `references`.
    #[inline(always)]
    pub fn add_leaf(&mut self, references: &[Reference], spheres: bool) {
        let Some(node) = self.add_node() else { return };
        let mut bounds = Bounds3::EMPTY;
        let first = self.primitives;
        for reference in references {
            bounds = bounds.union(reference.bounds);
            for member in reference.group().members() {
                self.room.primitives[self.primitives] = member.bits();
                self.primitives += 1;
            }
        }
        let count = self.primitives - first;
        let leaf = BinaryNode::leaf(bounds, self.room.first + first as u32, count, spheres);
        leaf.write(&mut self.room.slots[node]);
    }

    /// Takes the next slot for a node. [`Nodes::finish`] writes it if the node is an inner one.
    /// `None` if all are taken.
    #[inline(always)]
    pub fn add_node(&mut self) -> Option<usize> {
        self.full |= self.len >= self.room.slots.len();
        if self.full {
            return None;
        }
        self.len += 1;
        Some(self.len - 1)
    }

    /// Writes the inner node in slot `node`, whose right child is in slot `right`.
    #[inline(always)]
    pub fn finish(&mut self, node: usize, right: usize) {
        if self.full {
            return;
        }
        let (before, rest) = self.room.slots.split_at_mut(right);
        let (root, below_left) = before[node..].split_at_mut(1);
        finish(root, below_left, rest, right - node);
    }
}

/// Writes the node above two subtrees. The root of each is in its first slot. The right subtree is
/// `behind` slots behind the new node.
#[inline(always)]
fn finish(root: &mut [Slot], left: &[Slot], right: &[Slot], behind: usize) {
    let [left, right] = [left, right].map(|slots| BinaryNode::read(&slots[0]));
    BinaryNode::inner(left.bounds().union(*right.bounds()), behind).write(&mut root[0]);
}
