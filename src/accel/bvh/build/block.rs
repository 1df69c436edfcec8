//! References of triangles -> a leaf over their shared vertices.

use super::super::node::{Block, SECOND_HALF, WIDTH};
use super::reference::Reference;
use crate::geometry::Geometry;
use crate::simd::Kernel;

/// The distinct vertices of a leaf, compared by their bits: meshes that repeat a vertex for every
/// face share them here all the same.
struct Vertices {
    x: [u32; WIDTH],
    y: [u32; WIDTH],
    z: [u32; WIDTH],
    len: usize,
}

impl Vertices {
    const EMPTY: Self = Self { x: [0; WIDTH], y: [0; WIDTH], z: [0; WIDTH], len: 0 };

    /// The place of a vertex, which is added if it is new; none if there is no room.
    #[inline(always)]
    fn place(&mut self, vertex: [f32; 3]) -> Option<usize> {
        let [x, y, z] = vertex.map(f32::to_bits);
        let mut same = 0u32;
        for i in 0..WIDTH {
            let equal = (self.x[i] == x) & (self.y[i] == y) & (self.z[i] == z);
            same |= u32::from(equal) << i;
        }
        same &= (1 << self.len) - 1;
        if same != 0 {
            return Some(same.trailing_zeros() as usize);
        }
        if self.len == WIDTH {
            return None;
        }
        (self.x[self.len], self.y[self.len], self.z[self.len]) = (x, y, z);
        self.len += 1;
        Some(self.len - 1)
    }
}

/// Whether triangles fit into one leaf: at most 16, over at most 16 vertices.
#[inline(always)]
pub fn fits(geometry: &Geometry, references: &[Reference]) -> bool {
    if references.len() > WIDTH {
        return false;
    }
    let mut vertices = Vertices::EMPTY;
    // Loops, not closures: those would be compiled for the portable tier.
    for reference in references {
        let Some(corners) = reference.corners(geometry) else { return false };
        for corner in corners {
            if vertices.place(corner).is_none() {
                return false;
            }
        }
    }
    true
}

/// The leaf of references that [`fits`] let through. Unused vertices repeat the last one.
pub struct MakeBlock<'a> {
    /// What the references name.
    pub geometry: &'a Geometry,
    /// Of triangles.
    pub references: &'a [Reference],
}

impl Kernel for MakeBlock<'_> {
    type Output = Block;
    #[inline(always)]
    fn run(self) -> Block {
        block(self.geometry, self.references)
    }
}

#[inline(always)]
fn block(geometry: &Geometry, references: &[Reference]) -> Block {
    let mut vertices = Vertices::EMPTY;
    let mut block = Block::EMPTY;
    for (i, reference) in references.iter().take(WIDTH).enumerate() {
        let Some(corners) = reference.corners(geometry) else { continue };
        for (k, &corner) in corners.iter().enumerate() {
            block.corners[k][i] = vertices.place(corner).unwrap_or(0) as u8;
        }
        if reference.is_second_half() {
            block.corners[0][i] |= SECOND_HALF;
        }
        block.primitives[i] = geometry.primitive(reference.geometry(), reference.primitive());
        block.present |= 1 << i;
    }
    for i in 0..WIDTH {
        let last = i.min(vertices.len.saturating_sub(1));
        block.vertices[0][i] = f32::from_bits(vertices.x[last]);
        block.vertices[1][i] = f32::from_bits(vertices.y[last]);
        block.vertices[2][i] = f32::from_bits(vertices.z[last]);
    }
    block
}
