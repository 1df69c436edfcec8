//! The diffuse and specular light of one light source, separated for layers.

use glam::Vec3;

use crate::ray::{LANES, Mask};
use crate::shading::{Lanes, Lanes3, Light, LightWeights};

/// Light of one source in each lane, before the base colour, as diffuse and specular parts.
#[derive(Debug, Clone)]
pub struct LightParts {
    /// Diffuse light, by axis and lane.
    pub diffuse: Lanes3,
    /// Specular light, by axis and lane.
    pub specular: Lanes3,
    /// Fraction of the light's points that are visible, by lane.
    pub visible: Lanes,
}

impl LightParts {
    const NONE: Self =
        Self { diffuse: [[0.0; LANES]; 3], specular: [[0.0; LANES]; 3], visible: [0.0; LANES] };

    /// Light of one point per lane, with the weights of [`LightWeights`]. Lanes outside of
    /// `visible` receive none.
    #[inline(always)]
    pub fn from_weights(light: &Light, weights: &LightWeights, visible: &Mask) -> Self {
        let mut split = Self::NONE;
        for axis in 0..3 {
            let (diffuse, specular) = (light.diffuse[axis], light.specular[axis]);
            for i in 0..LANES {
                let seen = visible.0[i] != 0;
                let (d, s) = (diffuse * weights.diffuse[i], specular * weights.specular[i]);
                split.diffuse[axis][i] = if seen { d } else { 0.0 };
                split.specular[axis][i] = if seen { s } else { 0.0 };
            }
        }
        for i in 0..LANES {
            split.visible[i] = if visible.0[i] != 0 { 1.0 } else { 0.0 };
        }
        split
    }
}

impl LightParts {
    /// Multiplies the light of each lane by a colour.
    #[inline(always)]
    pub fn color(&mut self, colors: &Lanes3) {
        for axis in 0..3 {
            for i in 0..LANES {
                self.diffuse[axis][i] *= colors[axis][i];
                self.specular[axis][i] *= colors[axis][i];
            }
        }
    }
}

/// Sums over the points of a light, in f64, because there may be many.
#[derive(Debug, Clone)]
pub struct LightPartSums {
    diffuse: [[f64; LANES]; 3],
    specular: [[f64; LANES]; 3],
    visible: [f64; LANES],
}

impl LightPartSums {
    /// Sums before the first point.
    pub const NONE: Self =
        Self { diffuse: [[0.0; LANES]; 3], specular: [[0.0; LANES]; 3], visible: [0.0; LANES] };

    /// Adds the light of a visible light point to lane `i`.
    #[inline(always)]
    pub fn add(&mut self, i: usize, diffuse: Vec3, specular: Vec3) {
        for axis in 0..3 {
            self.diffuse[axis][i] += f64::from(diffuse[axis]);
            self.specular[axis][i] += f64::from(specular[axis]);
        }
        self.visible[i] += 1.0;
    }

    /// Adds `part` times `factor`. Sums of light keep their sign, which rounding may change.
    #[inline(always)]
    pub fn add_part(&mut self, part: &Self, factor: f64) {
        for axis in 0..3 {
            for i in 0..LANES {
                let sum = &mut self.diffuse[axis][i];
                *sum = without_residue(*sum, factor * part.diffuse[axis][i]);
                let sum = &mut self.specular[axis][i];
                *sum = without_residue(*sum, factor * part.specular[axis][i]);
            }
        }
        // Not clamped: one result may be outside [0, n], because the draws follow the light.
        for i in 0..LANES {
            self.visible[i] += factor * part.visible[i];
        }
    }

    /// Mean over the points; `share` is 1 over their number.
    #[inline(always)]
    pub fn mean(&self, share: f64) -> LightParts {
        let mut split = LightParts::NONE;
        for i in 0..LANES {
            for axis in 0..3 {
                split.diffuse[axis][i] = (self.diffuse[axis][i] * share) as f32;
                split.specular[axis][i] = (self.specular[axis][i] * share) as f32;
            }
            split.visible[i] = (self.visible[i] * share) as f32;
        }
        split
    }
}

/// Largest light that rounding to single precision leaves where all is taken away, as a fraction of
/// the light before. The terms are rounded by 2^-24 of them; 1e-8 of the sum was seen.
const RESIDUE: f64 = 1e-6;

/// Returns `sum + change`. Light that is taken away again, in single precision, leaves no light of
/// the other sign: the result is 0 if only rounding tells it from 0.
#[inline(always)]
pub fn without_residue(sum: f64, change: f64) -> f64 {
    let whole = sum + change;
    if whole * sum < 0.0 && whole.abs() <= RESIDUE * sum.abs() { 0.0 } else { whole }
}
