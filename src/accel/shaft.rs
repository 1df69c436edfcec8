//! The shaft between up to 16 points and a light: the convex hull that holds their shadow rays.

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
    /// Whether shadow rays also begin between the active points, at any point of their convex hull.
    /// All lanes then have the same `leaving`.
    pub between: bool,
    /// Corners of the light. The points of the light lie in the convex hull of the corners, up to
    /// 3u of their coordinates (u = 2^-24).
    pub corners: &'a [[f32; 3]],
}
