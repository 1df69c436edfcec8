//! References: the boxes that the builder sorts.

use super::super::bounds::Bounds3;
use super::super::node::WIDTH;
use crate::geometry::{Geometry, quad_halves};

const SECOND_HALF: u32 = 1 << 31;
const PAIR: u32 = 1 << 30;

/// One primitive, half of a quad, an instance, or two triangles of a mesh with consecutive indices.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[repr(transparent)]
pub struct Group(u32);

impl Group {
    /// A primitive by its scene-wide index, below 2^30. Instances have the indices after those of
    /// all primitives: see [`super::groups::sorted_count`].
    #[inline(always)]
    pub fn one(index: u32) -> Self {
        Self(index)
    }

    /// The half `v2 v3 v1` of a quad. [`Self::one`] is its half `v0 v1 v3`.
    pub fn second_half(index: u32) -> Self {
        Self(index | SECOND_HALF)
    }

    /// The triangles with this index and the next.
    #[inline(always)]
    pub fn pair(index: u32) -> Self {
        Self(index | PAIR)
    }

    #[inline(always)]
    pub fn from_bits(bits: u32) -> Self {
        Self(bits)
    }

    #[inline(always)]
    pub fn bits(self) -> u32 {
        self.0
    }

    /// Scene-wide index of the first primitive.
    #[inline(always)]
    pub fn first(self) -> u32 {
        self.0 & !(SECOND_HALF | PAIR)
    }

    /// Returns the number of primitives: 1, or 2 for a pair.
    #[inline(always)]
    pub fn len(self) -> u32 {
        1 + u32::from(self.0 & PAIR != 0)
    }

    /// Iterates over the primitives, each a group of its own.
    #[inline(always)]
    pub fn members(self) -> impl Iterator<Item = Self> {
        (0..self.len()).map(move |k| Self((self.0 & !PAIR) + k))
    }

    /// Iterates over the primitives and their places in the geometry.
    #[inline(always)]
    pub fn places(self, geometry: &Geometry) -> impl Iterator<Item = PrimitiveId> + Clone + use<> {
        let (geom, prim) = geometry.place(self.first());
        let second_half = self.0 & SECOND_HALF != 0;
        let index = self.first();
        (0..self.len()).map(move |k| PrimitiveId {
            index: index + k,
            geom,
            prim: prim + k,
            second_half,
        })
    }

    /// Returns the box of the primitives.
    #[inline(always)]
    pub fn bounds(self, geometry: &Geometry) -> Bounds3 {
        let mut bounds = Bounds3::EMPTY;
        for place in self.places(geometry) {
            bounds = bounds.union(place.bounds(geometry));
        }
        bounds
    }
}

/// Where the geometry holds a primitive. An instance is found by its index alone.
#[derive(Debug, Clone, Copy)]
pub struct PrimitiveId {
    /// Scene-wide index of the primitive.
    pub index: u32,
    /// Id of the mesh that it belongs to, of the quads or of the spheres.
    pub geom: u32,
    /// Index among these.
    pub prim: u32,
    /// Whether this is the half `v2 v3 v1` of a quad.
    pub second_half: bool,
}

impl PrimitiveId {
    /// Returns the corners of the triangle; `None` for a sphere or an instance.
    #[inline(always)]
    pub fn corners(&self, geometry: &Geometry) -> Option<[[f32; 3]; 3]> {
        if let Some(mesh) = geometry.meshes.get(self.geom as usize) {
            return Some(mesh.corners(self.prim));
        }
        (self.geom == geometry.quads_id()).then(|| {
            let [first, second] = quad_halves(geometry.quads[self.prim as usize]);
            if self.second_half { second } else { first }
        })
    }

    /// Returns the box of a sphere or of an instance.
    fn sphere_or_instance_bounds(&self, geometry: &Geometry) -> Bounds3 {
        match self.index.checked_sub(geometry.own_count()) {
            None => {
                let (lower, upper) = geometry.spheres[self.prim as usize].bounds();
                Bounds3::new(lower, upper)
            }
            Some(instance) => {
                let [lower, upper] = geometry.instances[instance as usize].bounds;
                Bounds3::new(lower, upper)
            }
        }
    }

    #[inline(always)]
    fn bounds(&self, geometry: &Geometry) -> Bounds3 {
        match self.corners(geometry) {
            Some(corners) => Bounds3::from_points(&corners),
            None => self.sphere_or_instance_bounds(geometry),
        }
    }
}

/// A box and what it bounds. A box has 8 lanes: its lower corner, one free, its upper corner, one
/// free. The free lanes hold a [`Group`] and the weight.
#[derive(Debug, Clone, Copy)]
#[repr(transparent)]
pub struct Reference {
    pub bounds: Bounds3,
}

impl Reference {
    /// A reference of the given weight in the surface area heuristic.
    #[inline(always)]
    pub fn new(mut bounds: Bounds3, group: Group, weight: u32) -> Self {
        bounds.0[3] = f32::from_bits(group.bits());
        bounds.0[7] = f32::from_bits(weight);
        Self { bounds }
    }

    /// A reference to a group of primitives. Its weight is their number. An instance is a leaf of
    /// its own, so it weighs as much as a full leaf.
    #[inline(always)]
    pub fn to(group: Group, geometry: &Geometry) -> Self {
        Self::in_box(group.bounds(geometry), group, geometry)
    }

    /// [`Reference::to`] with the box of the group.
    #[inline(always)]
    pub fn in_box(bounds: Bounds3, group: Group, geometry: &Geometry) -> Self {
        let is_instance = group.first() >= geometry.own_count();
        let weight = if is_instance { WIDTH as u32 } else { group.len() };
        Self::new(bounds, group, weight)
    }

    #[inline(always)]
    pub fn group(&self) -> Group {
        Group::from_bits(self.bounds.0[3].to_bits())
    }

    /// See [`Reference::to`]. Where a reference stands for a cell ([`cells`](super::cells)), the
    /// number of its groups.
    #[inline(always)]
    pub fn weight(&self) -> u32 {
        self.bounds.0[7].to_bits()
    }
}
