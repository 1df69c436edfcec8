//! [`World`] + settings -> [`Film`].

use crate::{
    accel::Accelerator,
    error::{Error, Result},
    film::{Film, Window},
    monitor::Monitor,
    world::World,
};

/// What a render needs beyond the scene.
#[derive(Debug, Clone, Copy)]
pub struct RenderSettings {
    /// Worker threads, >= 1.
    pub threads: usize,
    /// Pixels to render.
    pub window: Window,
}

/// Rays traced, by class.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct RayCounts {
    /// From the camera.
    pub primary: u64,
    /// Towards lights.
    pub shadow: u64,
    /// Mirror bounces.
    pub reflection: u64,
}

/// Renders the window.
///
/// # Errors
/// `Interrupted` after a signal.
pub fn render(
    _world: &World,
    _accelerator: &dyn Accelerator,
    _settings: &RenderSettings,
    _monitor: &Monitor,
) -> Result<(Film, RayCounts)> {
    Err(Error::invalid("", "to be written"))
}
