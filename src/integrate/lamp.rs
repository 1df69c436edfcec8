//! A light on its way into the film.

use crate::shading::Light;

/// A light, and when its light is gathered.
#[derive(Clone, Copy)]
pub struct Lamp<'a> {
    /// The light.
    pub light: &'a Light,
    /// Number of the light.
    pub index: u32,
    /// 0 at the camera rays' hits.
    pub bounce: u32,
    /// Whether any point has a specular term.
    pub glossy: bool,
}
