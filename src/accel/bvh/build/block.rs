//! Triangles -> a leaf over their shared vertices.

use super::super::node::{Block, WIDTH};
use super::reference::{Group, PrimitiveId};
use crate::geometry::Geometry;
use crate::simd::{Kernel, prefetch};

/// The distinct vertices of a leaf, compared by their bits. So a mesh that repeats a vertex for
/// every face shares it in the tree.
struct LocalVertices {
    x: [u32; WIDTH],
    y: [u32; WIDTH],
    z: [u32; WIDTH],
    /// Geometry and vertex index under which each vertex was added; all bits set for a quad.
    names: [u64; WIDTH],
    /// Cache of slots by a hash of the vertex index. It finds most corners without comparing
    /// coordinates.
    slots: [u8; HASH_SLOTS],
    len: usize,
}

/// Size of the cache: large enough for few collisions.
const HASH_SLOTS: usize = 64;

/// Bits of an unused coordinate: a NaN, which no corner of a primitive has.
const NO_COORDINATE: u32 = u32::MAX;

impl LocalVertices {
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
    fn triangle(&mut self, geometry: &Geometry, place: PrimitiveId) -> Option<[u8; 3]> {
        let mut slots = [0; 3];
        let PrimitiveId { geom, prim, .. } = place;
        // Loops, because closures would be compiled for the portable instruction set.
        if let Some(mesh) = geometry.meshes.get(geom as usize) {
            let corners = mesh.triangles()[prim as usize];
            for k in 0..3 {
                let name = u64::from(geom) << 32 | u64::from(corners[k]);
                let hash = hash(corners[k]);
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
            let corners = place.corners(geometry)?;
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
pub fn prefetch_indices(geometry: &Geometry, places: impl Iterator<Item = PrimitiveId>) {
    for place in places {
        if let Some(mesh) = geometry.meshes.get(place.geom as usize) {
            prefetch(mesh.triangles(), place.prim as usize);
        }
    }
}

/// Prefetches the vertices. Their indices should be in the cache.
#[inline(always)]
pub fn prefetch_vertices(geometry: &Geometry, places: impl Iterator<Item = PrimitiveId>) {
    for place in places {
        if let Some(mesh) = geometry.meshes.get(place.geom as usize) {
            for corner in mesh.triangles()[place.prim as usize] {
                prefetch(mesh.padded_vertices(), corner as usize);
            }
        }
    }
}

/// Whether up to 16 triangles fit into one leaf: they have at most 16 vertices.
#[inline(always)]
pub fn fits(geometry: &Geometry, places: impl Iterator<Item = PrimitiveId> + Clone) -> bool {
    if name_few_vertices(geometry, places.clone()) {
        return true;
    }
    prefetch_vertices(geometry, places.clone());
    let mut vertices = LocalVertices::EMPTY;
    for place in places {
        if vertices.triangle(geometry, place).is_none() {
            return false;
        }
    }
    true
}

/// Whether triangles of one mesh have at most 16 different vertex indices. Reads no vertices.
#[inline(always)]
fn name_few_vertices(
    geometry: &Geometry,
    places: impl Iterator<Item = PrimitiveId> + Clone,
) -> bool {
    let Some(PrimitiveId { geom, .. }) = places.clone().next() else { return true };
    let Some(mesh) = geometry.meshes.get(geom as usize) else { return false };
    // A hash table with linear probing. No vertex has the index of an empty slot.
    let mut names = [u32::MAX; HASH_SLOTS];
    let mut count = 0;
    for place in places {
        if place.geom != geom {
            return false;
        }
        for corner in mesh.triangles()[place.prim as usize] {
            let mut slot = hash(corner);
            while names[slot] != corner {
                if names[slot] == u32::MAX {
                    names[slot] = corner;
                    count += 1;
                    break;
                }
                slot = (slot + 1) % HASH_SLOTS;
            }
        }
        if count > WIDTH {
            return false;
        }
    }
    true
}

/// Returns the slot of a vertex index.
#[inline(always)]
fn hash(corner: u32) -> usize {
    (corner.wrapping_mul(0x9e37_79b1) >> 26) as usize % HASH_SLOTS
}

/// Returns the lowest and the highest primitive index of a leaf.
#[inline(always)]
fn index_range(triangles: &[u32]) -> [u32; 2] {
    let (mut low, mut high) = (u32::MAX, 0);
    for &bits in triangles {
        let index = Group::from_bits(bits).first();
        (low, high) = (low.min(index), high.max(index));
    }
    [low, high]
}

/// Whether the primitive indices of a leaf are too far apart for [`Block::offsets`].
#[inline(always)]
pub fn is_wide(triangles: &[u32]) -> bool {
    let [low, high] = index_range(triangles);
    high - low > u32::from(u16::MAX)
}

/// Returns the upper 16 bits of the primitive indices of a leaf; 0 in unused slots.
pub fn high_bits(triangles: &[u32]) -> [u16; WIDTH] {
    let mut high = [0; WIDTH];
    for (high, &bits) in high.iter_mut().zip(triangles) {
        *high = (Group::from_bits(bits).first() >> 16) as u16;
    }
    high
}

/// Makes the leaf of triangles that [`fits`] accepts, except for [`Block::base`] of a wide leaf.
/// Unused vertices repeat the last one.
pub struct MakeBlock<'a> {
    pub geometry: &'a Geometry,
    /// The triangles of the leaf, as in
    /// [`BinaryTree::primitives`](super::binary::BinaryTree::primitives).
    pub triangles: &'a [u32],
    /// The triangles of the next two leaves, for prefetching.
    pub next: [&'a [u32]; 2],
}

impl Kernel for MakeBlock<'_> {
    type Output = Block;
    #[inline(always)]
    fn run(self) -> Block {
        let [near, far] = self.next.map(|triangles| places(self.geometry, triangles));
        prefetch_indices(self.geometry, far);
        prefetch_vertices(self.geometry, near);
        block(self.geometry, self.triangles)
    }
}

#[inline(always)]
fn places(geometry: &Geometry, triangles: &[u32]) -> impl Iterator<Item = PrimitiveId> {
    triangles.iter().flat_map(|&bits| Group::from_bits(bits).places(geometry))
}

#[inline(always)]
fn block(geometry: &Geometry, triangles: &[u32]) -> Block {
    let mut vertices = LocalVertices::EMPTY;
    // A wide leaf holds the lower 16 bits of the indices.
    let base = if is_wide(triangles) { 0 } else { index_range(triangles)[0] };
    let mut block = Block { base, ..Block::EMPTY };
    for (i, place) in places(geometry, triangles).take(WIDTH).enumerate() {
        let Some(corners) = vertices.triangle(geometry, place) else { continue };
        for k in 0..3 {
            block.set_corner(k, i, corners[k]);
        }
        block.second_halves |= u16::from(place.second_half) << i;
        block.offsets[i] = (place.index - block.base) as u16;
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
