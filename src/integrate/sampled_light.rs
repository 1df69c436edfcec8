//! The light that is being sampled.

use crate::shading::Light;

/// A light, and the bounce of the points that it illuminates.
#[derive(Clone, Copy)]
pub struct SampledLight<'a> {
    /// The light to sample.
    pub light: &'a Light,
    /// Index of the light in the world.
    pub index: u32,
    /// Bounce of the shading points: 0 for hits of camera rays.
    pub bounce: u32,
    /// Whether any shading point has a specular term.
    pub glossy: bool,
}
