//! Holdouts and shadow catchers: alpha and light of the camera rays that hit them.
//!
//! docs/guide/scene-format.md defines both. Nothing here runs in a scene without such
//! shapes.

use super::split::LightParts;
use crate::ray::{LANES, Mask};
use crate::shading::Lanes;

/// The lanes of a packet whose camera ray hit a holdout or a shadow catcher.
#[derive(Debug)]
pub struct Plate {
    pub(super) holdouts: Mask,
    pub(super) catchers: Mask,
    /// Whether the shading points belong to camera rays, and some are on catchers.
    pub(super) catching: bool,
    /// Luminance of the light that catchers receive.
    pub(super) arrived: [f64; LANES],
    /// Luminance of the same light without shadows.
    pub(super) unshadowed: [f64; LANES],
    /// Expected luminance without shadows.
    pub(super) expected: [f64; LANES],
    /// By light: its part of `unshadowed`.
    pub(super) whole: Vec<[f64; LANES]>,
    /// By light: the luminance that shadows take, `unshadowed` minus `arrived`.
    pub(super) taken: Vec<[f64; LANES]>,
    /// Alpha of catchers: the share of the light that shadows take.
    pub(super) alpha: Lanes,
}

impl Plate {
    /// State for `lights` lights, without holdouts and catchers.
    pub fn new(lights: usize) -> Self {
        Self {
            holdouts: Mask::NONE,
            catchers: Mask::NONE,
            catching: false,
            arrived: [0.0; LANES],
            unshadowed: [0.0; LANES],
            expected: [0.0; LANES],
            whole: vec![[0.0; LANES]; lights],
            taken: vec![[0.0; LANES]; lights],
            alpha: [0.0; LANES],
        }
    }

    /// Removes the holdouts and catchers of the last packet.
    pub fn clear(&mut self) {
        (self.holdouts, self.catchers, self.catching) = (Mask::NONE, Mask::NONE, false);
    }

    /// Replaces the alpha of the lanes on holdouts and catchers.
    pub fn set_alpha(&self, alpha: &mut Lanes) {
        for i in 0..LANES {
            alpha[i] = match (self.holdouts.0[i], self.catchers.0[i]) {
                (0, 0) => alpha[i],
                (0, _) => self.alpha[i],
                _ => 0.0,
            };
        }
    }

    /// Removes the light of catchers from what layers record. Their visibility stays.
    pub fn darken(&self, split: &mut LightParts) {
        for i in (0..LANES).filter(|&i| self.catching && self.catchers.0[i] != 0) {
            for axis in 0..3 {
                (split.diffuse[axis][i], split.specular[axis][i]) = (0.0, 0.0);
            }
        }
    }
}
