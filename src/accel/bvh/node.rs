//! The memory layout of the tree: 16-wide nodes of f32 boxes, and leaves of triangles over shared
//! vertices.

use crate::ray::NONE;

/// Maximum number of children of a node, of triangles of a leaf, and of vertices of a leaf.
pub const WIDTH: usize = 16;

/// Maximum number of spheres of a leaf.
pub const SPHERES: usize = 4;

/// A reference to a child of a node. The top two bits hold the kind of the child. The others hold
/// its index in the array of that kind. In [`Child::EMPTY`] all bits are set.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[repr(transparent)]
pub struct Child(pub u32);

/// A [`Child`] decoded into kind and index.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ChildKind {
    /// Index of a [`Node`].
    Node(usize),
    /// Index of a [`Block`].
    Triangles(usize),
    /// Index of a [`SphereLeaf`].
    Spheres(usize),
    /// An unused slot.
    Empty,
}

impl Child {
    /// The reference in an unused slot.
    pub const EMPTY: Self = Self(NONE);
    /// The largest index that fits into a reference.
    pub const MAX_INDEX: usize = (1 << 30) - 1;
    const LEAF: u32 = 1 << 31;
    const SPHERES: u32 = 1 << 30;

    /// Refers to an inner node.
    pub fn node(index: usize) -> Self {
        debug_assert!(index <= Self::MAX_INDEX);
        Self(index as u32)
    }

    /// Refers to a leaf of triangles.
    pub fn triangles(index: usize) -> Self {
        debug_assert!(index <= Self::MAX_INDEX);
        Self(index as u32 | Self::LEAF)
    }

    /// Refers to a leaf of spheres.
    pub fn spheres(index: usize) -> Self {
        debug_assert!(index < Self::MAX_INDEX);
        Self(index as u32 | Self::LEAF | Self::SPHERES)
    }

    /// Decodes the reference into kind and index.
    #[inline(always)]
    pub fn kind(self) -> ChildKind {
        let index = (self.0 & Self::MAX_INDEX as u32) as usize;
        if self.0 & Self::LEAF == 0 {
            ChildKind::Node(index)
        } else if self.0 & Self::SPHERES == 0 {
            ChildKind::Triangles(index)
        } else if self == Self::EMPTY {
            ChildKind::Empty
        } else {
            ChildKind::Spheres(index)
        }
    }
}

/// An inner node. It holds the boxes of its children and, for each of the 8 direction octants, the
/// order in which a ray visits them.
#[derive(Debug, Clone)]
#[repr(C, align(64))]
pub struct Node {
    /// Lower x, y, z, then upper x, y, z of each child. An empty child has `lower = +inf` and
    /// `upper = -inf`, which no ray hits.
    pub planes: [[f32; WIDTH]; 6],
    /// The children. Empty ones come last.
    pub children: [Child; WIDTH],
    /// For each octant, the children from far to near: see [`Node::set_order`]. Bit a of an octant
    /// is set if the direction is negative along axis a.
    pub order: [u64; 8],
}

impl Node {
    pub const EMPTY: Self = Self {
        planes: [
            [f32::INFINITY; WIDTH],
            [f32::INFINITY; WIDTH],
            [f32::INFINITY; WIDTH],
            [f32::NEG_INFINITY; WIDTH],
            [f32::NEG_INFINITY; WIDTH],
            [f32::NEG_INFINITY; WIDTH],
        ],
        children: [Child::EMPTY; WIDTH],
        order: [0; 8],
    };

    /// Returns the child in the lowest slot whose bit is set in `children`.
    #[inline(always)]
    pub fn first(&self, children: u32) -> Child {
        self.children[children.trailing_zeros() as usize % WIDTH]
    }

    /// Stores the order of an octant. Slot `far_to_near[j]` takes 4 bits, the lowest of which is
    /// bit `32 (j % 2) + 4 (j / 2)`. So a vector of 32-bit lanes can shift them out.
    pub fn set_order(&mut self, octant: usize, far_to_near: &[u8; WIDTH]) {
        let place = |j: usize, child: u8| u64::from(child) << (32 * (j % 2) + 4 * (j / 2));
        self.order[octant] =
            far_to_near.iter().enumerate().fold(0, |bits, (j, &child)| bits | place(j, child));
    }

    /// Returns the slot of the child at place `j` of an octant's order. Place 0 is the farthest.
    #[inline(always)]
    pub fn ordered(&self, octant: usize, j: usize) -> usize {
        (self.order[octant % 8] >> (32 * (j % 2) + 4 * (j / 2))) as usize % WIDTH
    }
}

/// A leaf of up to 16 triangles over up to 16 shared vertices.
///
/// Each shared vertex is sheared once per ray. A leaf of a scanned mesh takes 19 bytes per
/// triangle. It would take 40 if every triangle held its own corners.
#[derive(Debug, Clone)]
#[repr(C, align(64))]
pub struct Block {
    /// x, y, z of the vertices.
    pub vertices: [[f32; WIDTH]; 3],
    /// For each triangle, its primitive index minus `base`, or its lower 16 bits. See
    /// [`Indices::of`].
    pub offsets: [u16; WIDTH],
    /// Vertex indices of the first, second and third corner of each triangle, of 4 bits: slots 0 to
    /// 7 in the low bits of the bytes, slots 8 to 15 in the high bits.
    pub corners: [[u8; WIDTH / 2]; 3],
    /// A primitive index; or, with the bit [`WIDE`], an index into [`super::build::Tree::wide`].
    pub base: u32,
    /// Bit i is set if slot i holds a triangle.
    pub present: u16,
    /// Bit i is set if slot i holds the second half `v2 v3 v1` of a quad.
    pub second_halves: u16,
}

/// Bit of [`Block::base`] in a leaf whose primitive indices are too far apart for
/// [`Block::offsets`].
pub const WIDE: u32 = 1 << 31;

impl Block {
    pub const EMPTY: Self = Self {
        vertices: [[0.0; WIDTH]; 3],
        offsets: [0; WIDTH],
        corners: [[0; WIDTH / 2]; 3],
        base: 0,
        present: 0,
        second_halves: 0,
    };

    /// Returns the vertex index of corner `k` of triangle `i`.
    #[inline(always)]
    pub fn corner(&self, k: usize, i: usize) -> usize {
        let pair = self.corners[k][i % (WIDTH / 2)];
        usize::from(pair >> (4 * (i / (WIDTH / 2) % 2))) % WIDTH
    }

    /// Sets the vertex index of corner `k` of triangle `i`, which was 0.
    #[inline(always)]
    pub fn set_corner(&mut self, k: usize, i: usize, vertex: u8) {
        self.corners[k][i % (WIDTH / 2)] |= vertex << (4 * (i / (WIDTH / 2) % 2));
    }

    /// Returns the corners of triangle `i`.
    #[inline(always)]
    pub fn triangle(&self, i: usize) -> [[f32; 3]; 3] {
        [0, 1, 2].map(|k| {
            let v = self.corner(k, i);
            [self.vertices[0][v], self.vertices[1][v], self.vertices[2][v]]
        })
    }

    /// Whether triangle `i` is the second half of a quad.
    #[inline(always)]
    pub fn is_second_half(&self, i: usize) -> bool {
        (self.second_halves >> (i % WIDTH)) & 1 != 0
    }
}

/// Finds the scene-wide primitive indices of the triangles in leaves.
#[derive(Debug, Clone, Copy)]
pub struct Indices<'a> {
    /// The upper 16 bits of the primitive indices of leaves with the bit [`WIDE`].
    pub wide: &'a [[u16; WIDTH]],
    /// Added to all indices: that of the first triangle of an instance, else 0.
    pub first: u32,
}

impl Indices<'_> {
    /// Returns the scene-wide primitive index of triangle `i`, which must be present.
    #[inline(always)]
    pub fn of(self, block: &Block, i: usize) -> u32 {
        let i = i % WIDTH;
        let base = match block.base & WIDE {
            0 => block.base,
            _ => u32::from(self.wide[(block.base & !WIDE) as usize][i]) << 16,
        };
        self.first + base + u32::from(block.offsets[i])
    }
}

/// A leaf of spheres, or of one instance. Holds indices of the scene's spheres; unused slots at the
/// end hold [`NONE`]. An instance has its own index plus the number of spheres.
#[derive(Debug, Clone, Copy)]
pub struct SphereLeaf(pub [u32; SPHERES]);

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn children_keep_their_kind_and_index() {
        for index in [0, 1, 77, Child::MAX_INDEX - 1] {
            assert_eq!(Child::node(index).kind(), ChildKind::Node(index));
            assert_eq!(Child::triangles(index).kind(), ChildKind::Triangles(index));
            assert_eq!(Child::spheres(index).kind(), ChildKind::Spheres(index));
        }
        assert_eq!(Child::EMPTY.kind(), ChildKind::Empty);
    }

    #[test]
    fn corners_keep_their_vertex() {
        let mut block = Block::EMPTY;
        let vertex = |k: usize, i: usize| (7 * i + 5 * k + 3) % WIDTH;
        for k in 0..3 {
            (0..WIDTH).for_each(|i| block.set_corner(k, i, vertex(k, i) as u8));
        }
        for k in 0..3 {
            (0..WIDTH).for_each(|i| assert_eq!(block.corner(k, i), vertex(k, i)));
        }
    }

    #[test]
    fn sizes_are_whole_cache_lines() {
        assert_eq!((size_of::<Node>(), size_of::<Block>()), (512, 256));
    }
}
