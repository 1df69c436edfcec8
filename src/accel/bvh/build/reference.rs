//! References: the boxes of the primitives, which the builder sorts.

use rayon::prelude::*;

use super::super::bounds::Bounds3;
use crate::error::Result;
use crate::geometry::{Geometry, Unseen, quad_halves};
use crate::reserve;

const SECOND_HALF: u32 = 1 << 31;

/// A box and its primitive. Lane 3 of the box holds the index of the primitive in its geometry.
/// Lane 7 holds the geometry and whether this is the second half of a quad.
#[derive(Debug, Clone, Copy)]
#[repr(transparent)]
pub struct Reference {
    pub bounds: Bounds3,
}

impl Reference {
    #[inline(always)]
    fn new(mut bounds: Bounds3, geom: u32, prim: u32, second_half: bool) -> Self {
        bounds.0[3] = f32::from_bits(prim);
        bounds.0[7] = f32::from_bits(geom | if second_half { SECOND_HALF } else { 0 });
        Self { bounds }
    }

    /// Returns the primitive without its box.
    #[inline(always)]
    pub fn place(&self) -> Place {
        let bits = self.bounds.0[7].to_bits();
        let second_half = bits & SECOND_HALF != 0;
        Place { geom: bits & !SECOND_HALF, prim: self.bounds.0[3].to_bits(), second_half }
    }
}

/// A primitive of a geometry.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub struct Place {
    /// Id of the geometry.
    pub geom: u32,
    /// Index in it.
    pub prim: u32,
    /// Whether this is the half `v2 v3 v1` of a quad.
    pub second_half: bool,
}

impl Place {
    /// Returns the corners of the triangle; `None` for a sphere.
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
}

/// What is left of a reference when the tree is built: the scene-wide number of its primitive. The
/// top bit says whether it is the second half of a quad.
#[derive(Debug, Clone, Copy)]
pub struct PrimitiveId(u32);

impl PrimitiveId {
    /// The number of a primitive below 2^31.
    pub fn new(geometry: &Geometry, reference: &Reference) -> Self {
        let Place { geom, prim, second_half } = reference.place();
        let half = if second_half { SECOND_HALF } else { 0 };
        Self(geometry.primitive(geom, prim) | half)
    }

    /// Returns the scene-wide number.
    #[inline(always)]
    pub fn number(self) -> u32 {
        self.0 & !SECOND_HALF
    }

    /// Returns the primitive.
    #[inline(always)]
    pub fn place(self, geometry: &Geometry) -> Place {
        let (geom, prim) = geometry.place(self.number());
        Place { geom, prim, second_half: self.0 & SECOND_HALF != 0 }
    }
}

/// Returns the number of references: one per triangle and sphere, two per quad. Primitives of
/// `unseen` have none.
pub fn count(geometry: &Geometry, unseen: &Unseen) -> usize {
    let quads = geometry.quads_id() as usize;
    let seen = geometry.bases().windows(2).enumerate().map(|(geom, ends)| {
        let own = ends[0]..ends[1];
        let seen = (own.end - own.start - unseen.count(&own)) as usize;
        if geom == quads { 2 * seen } else { seen }
    });
    seen.sum()
}

/// Returns the references of all primitives that are not in `unseen`, in the order of the geometry.
///
/// # Errors
/// If there is too little memory.
pub fn references(geometry: &Geometry, unseen: &Unseen) -> Result<Vec<Reference>> {
    let mut references = Vec::new();
    reserve::exact(&mut references, count(geometry, unseen), "bvh")?;
    let is_seen = |geom: u32, prim: u32| !unseen.has(geometry.primitive(geom, prim));
    for (geom, mesh) in geometry.meshes.iter().enumerate() {
        let own = geometry.bases()[geom]..geometry.bases()[geom + 1];
        let reference = |prim| {
            Reference::new(Bounds3::from_points(&mesh.corners(prim)), geom as u32, prim, false)
        };
        match unseen.count(&own) {
            0 => references.par_extend((0..own.end - own.start).into_par_iter().map(reference)),
            count if count == own.end - own.start => {}
            _ => {
                let seen = (0..own.end - own.start).filter(|&prim| is_seen(geom as u32, prim));
                references.extend(seen.map(reference));
            }
        }
    }
    for (prim, &quad) in geometry.quads.iter().enumerate() {
        if !is_seen(geometry.quads_id(), prim as u32) {
            continue;
        }
        for (half, corners) in quad_halves(quad).iter().enumerate() {
            let (geom, prim) = (geometry.quads_id(), prim as u32);
            references.push(Reference::new(Bounds3::from_points(corners), geom, prim, half == 1));
        }
    }
    for (prim, sphere) in geometry.spheres.iter().enumerate() {
        if !is_seen(geometry.spheres_id(), prim as u32) {
            continue;
        }
        let (lower, upper) = sphere.bounds();
        let bounds = Bounds3::new(lower, upper);
        references.push(Reference::new(bounds, geometry.spheres_id(), prim as u32, false));
    }
    Ok(references)
}
