//! The triangles of faces and strips, with their arrays.

use super::attributes::{Attributes, Capacity};
use super::check::Tally;
use super::context::ReadContext;
use crate::error::Result;
use crate::reserve;

/// The triangles that have been read from faces and strips.
#[derive(Default)]
pub(super) struct PlyFaces {
    pub(super) triangles: Vec<[u32; 3]>,
    /// One entry per triangle, if any face has texture coordinates.
    pub(super) uvs: Option<Vec<[[f32; 2]; 3]>>,
    /// Arrays with one entry per triangle.
    pub(super) attributes: Attributes,
    pub(super) tally: Tally,
}

impl PlyFaces {
    /// Appends the next triangles of the file. Missing texture coordinates become zero.
    ///
    /// # Errors
    /// If there is not enough memory.
    pub(super) fn append(&mut self, next: PlyFaces, context: &ReadContext) -> Result<()> {
        context.fits(self.bytes().saturating_add(next.bytes()))?;
        if self.uvs.is_some() || next.uvs.is_some() {
            let uvs = self.uvs.get_or_insert_default();
            let all = self.triangles.len() + next.triangles.len();
            reserve::growing(uvs, all - uvs.len(), context.name)?;
            uvs.resize(self.triangles.len(), Default::default());
            uvs.extend(next.uvs.unwrap_or_default());
            uvs.resize(self.triangles.len() + next.triangles.len(), Default::default());
        }
        if self.triangles.is_empty() {
            // The first triangles decide which arrays exist.
            let reserved = Capacity::Total(self.triangles.capacity());
            let mut attributes = next.attributes;
            attributes.reserve(reserved, context)?;
            self.attributes = attributes;
        } else {
            self.attributes.reserve(Capacity::Additional(next.triangles.len()), context)?;
            self.attributes.append(next.attributes);
        }
        if self.triangles.is_empty() && self.triangles.capacity() < next.triangles.len() {
            self.triangles = next.triangles;
        } else {
            reserve::growing(&mut self.triangles, next.triangles.len(), context.name)?;
            self.triangles.extend(next.triangles);
        }
        self.tally.add(next.tally);
        Ok(())
    }

    /// Returns the size in bytes of the arrays, triangles without area included.
    pub(super) fn bytes(&self) -> u64 {
        let uvs = self.uvs.as_ref().map_or(0, |uvs| size_of_val(&uvs[..]));
        let triangles = size_of_val(&self.triangles[..]) + size_of_val(&self.tally.stitches[..]);
        (triangles + uvs) as u64 + self.attributes.bytes()
    }
}
