//! Which kinds of rays can hit a shape.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// Kinds of rays that can hit a shape.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(default)]
pub struct Visible {
    /// Rays from the camera.
    pub camera: bool,
    /// Shadow rays: false if the shape casts no shadow.
    pub shadow: bool,
    /// Rays that a mirror reflects.
    pub reflection: bool,
}

impl Default for Visible {
    fn default() -> Self {
        Self { camera: true, shadow: true, reflection: true }
    }
}

impl Visible {
    /// Returns the three values, in the order camera, shadow, reflection.
    pub fn kinds(self) -> [bool; 3] {
        [self.camera, self.shadow, self.reflection]
    }
}
