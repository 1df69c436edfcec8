//! The shaft between 16 points and a light: the convex hull that holds all of their shadow rays.

use crate::ray::{LANES, Mask};

/// Segments from each active point to every point of a convex light.
///
/// Haines and Wallace 1991, "Shaft Culling for Efficient Ray-Traced Radiosity".
#[derive(Debug)]
pub struct Shaft<'a> {
    /// Lanes that have a point.
    pub active: Mask,
    /// Origins of the shadow rays, relative to the scene's origin.
    pub origins: &'a [[f32; LANES]; 3],
    /// Primitive whose hits do not count, by lane, as in [`crate::ray::Rays::leaving`].
    pub leaving: [u32; LANES],
    /// Corners of the light. The points of the light lie in the convex hull of the corners, up to
    /// 3u of their coordinates (u = 2^-24).
    pub corners: &'a [[f32; 3]],
}
