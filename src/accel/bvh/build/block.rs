//! References of triangles -> a leaf over their shared vertices.

use super::super::node::{Block, SECOND_HALF, WIDTH};
use super::reference::Reference;
use crate::geometry::Geometry;
use crate::simd::{Kernel, prefetch};

/// The distinct vertices of a leaf, compared by their bits. So a mesh that repeats a vertex for
/// every face shares it in the tree.
struct Vertices {
    x: [u32; WIDTH],
    y: [u32; WIDTH],
    z: [u32; WIDTH],
    /// Geometry and index of each vertex, as first added.
    names: [u64; WIDTH],
    /// Cache of slots by a hash of the name. It finds most corners without comparing coordinates.
    slots: [u8; HASH_SLOTS],
    len: usize,
}

/// Size of the cache: large enough for few collisions.
const HASH_SLOTS: usize = 64;

/// Bits of an unused coordinate: a NaN, which no vertex has.
const NO_COORDINATE: u32 = u32::MAX;

impl Vertices {
    const EMPTY: Self = Self {
        x: [NO_COORDINATE; WIDTH],
        y: [NO_COORDINATE; WIDTH],
        z: [NO_COORDINATE; WIDTH],
        names: [u64::MAX; WIDTH],
        slots: [0; HASH_SLOTS],
        len: 0,
    };

    /// Returns the slots of a triangle's corners. Adds new vertices. Returns `None` if there is no
    /// room.
    #[inline(always)]
    fn triangle(&mut self, geometry: &Geometry, reference: &Reference) -> Option<[u8; 3]> {
        let mut slots = [0; 3];
        let (geom, prim) = (reference.geometry(), reference.primitive());
        // Loops, because closures would be compiled for the portable instruction set.
        if let Some(mesh) = geometry.meshes.get(geom as usize) {
            let corners = mesh.triangles()[prim as usize];
            for k in 0..3 {
                let name = u64::from(geom) << 32 | u64::from(corners[k]);
                let hash = (corners[k].wrapping_mul(0x9e37_79b1) >> 26) as usize % HASH_SLOTS;
                let slot = self.slots[hash];
                slots[k] = if self.names[usize::from(slot) % WIDTH] == name {
                    slot
                } else {
                    let slot = self.slot(mesh.padded_vertices()[corners[k] as usize], name)?;
                    self.slots[hash] = slot;
                    slot
                };
            }
        } else {
            let corners = reference.corners(geometry)?;
            for k in 0..3 {
                slots[k] = self.slot(corners[k], u64::MAX)?;
            }
        }
        Some(slots)
    }

    /// Returns the slot of a vertex with these coordinates. Adds it if it is new.
    #[inline(always)]
    fn slot(&mut self, vertex: [f32; 3], name: u64) -> Option<u8> {
        let [x, y, z] = vertex.map(f32::to_bits);
        let mut may_exist = false;
        for i in 0..WIDTH {
            may_exist |= self.x[i] == x;
        }
        if may_exist {
            for i in 0..self.len {
                if (self.x[i], self.y[i], self.z[i]) == (x, y, z) {
                    return Some(i as u8);
                }
            }
        }
        let i = self.len;
        if i >= WIDTH {
            return None;
        }
        (self.x[i], self.y[i], self.z[i], self.names[i]) = (x, y, z, name);
        self.len += 1;
        Some(i as u8)
    }
}

/// Prefetches the vertex indices that [`fits`] or [`MakeBlock`] will read.
#[inline(always)]
pub fn prefetch_indices(geometry: &Geometry, references: &[Reference]) {
    for reference in references {
        if let Some(mesh) = geometry.meshes.get(reference.geometry() as usize) {
            prefetch(mesh.triangles(), reference.primitive() as usize);
        }
    }
}

/// Prefetches the vertices. Their indices should be in the cache.
#[inline(always)]
fn prefetch_vertices(geometry: &Geometry, references: &[Reference]) {
    for reference in references {
        if let Some(mesh) = geometry.meshes.get(reference.geometry() as usize) {
            for corner in mesh.triangles()[reference.primitive() as usize] {
                prefetch(mesh.padded_vertices(), corner as usize);
            }
        }
    }
}

/// Whether triangles fit into one leaf: at most 16, with at most 16 vertices.
#[inline(always)]
pub fn fits(geometry: &Geometry, references: &[Reference]) -> bool {
    if references.len() > WIDTH {
        return false;
    }
    prefetch_vertices(geometry, references);
    let mut vertices = Vertices::EMPTY;
    for reference in references {
        if vertices.triangle(geometry, reference).is_none() {
            return false;
        }
    }
    true
}

/// Makes the leaf of references that [`fits`] accepts. Unused vertices repeat the last one.
pub struct MakeBlock<'a> {
    pub geometry: &'a Geometry,
    /// References of the triangles of the leaf.
    pub references: &'a [Reference],
    /// References of the next two leaves, for prefetching.
    pub next: [&'a [Reference]; 2],
}

impl Kernel for MakeBlock<'_> {
    type Output = Block;
    #[inline(always)]
    fn run(self) -> Block {
        prefetch_indices(self.geometry, self.next[1]);
        prefetch_vertices(self.geometry, self.next[0]);
        block(self.geometry, self.references)
    }
}

#[inline(always)]
fn block(geometry: &Geometry, references: &[Reference]) -> Block {
    let mut vertices = Vertices::EMPTY;
    let mut block = Block::EMPTY;
    for (i, reference) in references.iter().take(WIDTH).enumerate() {
        let Some(corners) = vertices.triangle(geometry, reference) else { continue };
        for k in 0..3 {
            block.corners[k][i] = corners[k];
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
