//! Nodes of the binary tree in 32 bytes.

use super::super::bounds::Bounds3;

/// Place of a node in memory. Nodes are written and read as [`BinaryNode`].
pub type Slot = [f32; 8];

/// A node of the binary tree. The left child is in the next slot.
///
/// Lane 3 of an inner node's box holds 2 x the distance to the slot of the right child. Lane 3 of a
/// leaf's box holds 1 + 2 x the number of its primitives, + 64 for spheres. Lane 7 of a leaf's box
/// holds the index of its first primitive, and later the leaf's index among the leaves of its kind.
/// Lane 7 of an inner node's box holds the number of wide nodes in its subtree if it becomes a wide
/// node.
#[derive(Debug, Clone, Copy)]
pub struct BinaryNode(Bounds3);

/// Bit of lane 3 of a leaf of spheres.
const OF_SPHERES: u32 = 64;

impl BinaryNode {
    /// A node above two subtrees. The root of the right one is `right` slots behind the node;
    /// `right` is below 2^31.
    pub fn inner(mut bounds: Bounds3, right: usize) -> Self {
        bounds.0[3] = f32::from_bits(2 * right as u32);
        Self(bounds)
    }

    /// A leaf of the `count` <= 16 primitives from index `first` of
    /// [`BinaryTree::primitives`](super::binary::BinaryTree) on.
    pub fn leaf(mut bounds: Bounds3, first: u32, count: usize, spheres: bool) -> Self {
        let kind = if spheres { OF_SPHERES } else { 0 };
        bounds.0[3] = f32::from_bits(1 + 2 * count as u32 + kind);
        bounds.0[7] = f32::from_bits(first);
        Self(bounds)
    }

    /// Reads the node in a slot.
    #[inline(always)]
    pub fn read(slot: &Slot) -> Self {
        Self(Bounds3(*slot))
    }

    /// Writes the node to a slot.
    #[inline(always)]
    pub fn write(self, slot: &mut Slot) {
        *slot = self.0.0;
    }

    /// Box of everything below the node. Its lanes 3 and 7 hold other data.
    #[inline(always)]
    pub fn bounds(&self) -> &Bounds3 {
        &self.0
    }

    /// Distance to the slot of the right child; 0 for a leaf.
    #[inline(always)]
    pub fn right(&self) -> usize {
        let bits = self.0.0[3].to_bits();
        if bits & 1 == 0 { (bits / 2) as usize } else { 0 }
    }

    /// Index of a leaf among the leaves of its kind, or number of wide nodes in a subtree, once it
    /// is set.
    #[inline(always)]
    pub fn number(&self) -> usize {
        self.0.0[7].to_bits() as usize
    }

    /// Sets what [`BinaryNode::number`] returns.
    pub fn set_number(&mut self, number: usize) {
        self.0.0[7] = f32::from_bits(number as u32);
    }

    /// Whether a leaf holds spheres. Meaningless for an inner node.
    #[inline(always)]
    pub fn is_of_spheres(&self) -> bool {
        self.0.0[3].to_bits() & OF_SPHERES != 0
    }

    /// The primitives of a leaf whose index among the leaves is not set yet.
    pub fn primitives(&self) -> Leaf {
        let count = (self.0.0[3].to_bits() / 2 % 32) as u8;
        Leaf { first: self.0.0[7].to_bits(), count, spheres: self.is_of_spheres() }
    }
}

/// The primitives of a leaf.
#[derive(Debug, Clone, Copy)]
pub struct Leaf {
    first: u32,
    count: u8,
    /// Whether they are spheres, not triangles.
    pub spheres: bool,
}

impl Leaf {
    /// Returns the range of its primitives.
    pub fn range(&self) -> std::ops::Range<usize> {
        let first = self.first as usize;
        first..first + usize::from(self.count)
    }
}
