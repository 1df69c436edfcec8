//! How an accelerator keeps the primitives that it reads.

use std::ops::Deref;
use std::sync::Arc;

use crate::geometry::Geometry;

/// A geometry that is borrowed, or shared with other owners. Its arrays do not move.
#[derive(Clone)]
pub enum GeometryRef<'g> {
    /// The geometry outlives the accelerator.
    Borrowed(&'g Geometry),
    /// The accelerator keeps the geometry alive.
    Shared(Arc<Geometry>),
}

impl<'g> From<&'g Geometry> for GeometryRef<'g> {
    fn from(geometry: &'g Geometry) -> Self {
        Self::Borrowed(geometry)
    }
}

impl Deref for GeometryRef<'_> {
    type Target = Geometry;

    #[inline(always)]
    fn deref(&self) -> &Geometry {
        match self {
            Self::Borrowed(geometry) => geometry,
            Self::Shared(geometry) => geometry,
        }
    }
}
