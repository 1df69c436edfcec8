//! The light of one lamp in its parts, which only layers want to know.

use crate::ray::{LANES, Mask};
use crate::shading::{Lanes, Lanes3, Light, Lit};

/// What one light brings to each lane, before the base colour: diffuse and specular apart.
#[derive(Debug, Clone)]
pub struct Split {
    /// By axis and lane.
    pub diffuse: Lanes3,
    /// The same.
    pub specular: Lanes3,
    /// The share of its points that are seen.
    pub visible: Lanes,
}

impl Split {
    const NONE: Self =
        Self { diffuse: [[0.0; LANES]; 3], specular: [[0.0; LANES]; 3], visible: [0.0; LANES] };

    /// A light point of each lane that `visible` has, with the weights of [`Lit`].
    #[inline(always)]
    pub fn of(light: &Light, lit: &Lit, visible: &Mask) -> Self {
        let mut split = Self::NONE;
        for axis in 0..3 {
            let (diffuse, specular) = (light.diffuse[axis], light.specular[axis]);
            for i in 0..LANES {
                let seen = visible.0[i] != 0;
                let (d, s) = (diffuse * lit.diffuse[i], specular * lit.specular[i]);
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

/// Sums over the points of a light, of which there may be many.
#[derive(Debug, Clone)]
pub struct SplitSums {
    diffuse: [[f64; LANES]; 3],
    specular: [[f64; LANES]; 3],
    visible: [f64; LANES],
}

impl SplitSums {
    /// No light.
    pub const NONE: Self =
        Self { diffuse: [[0.0; LANES]; 3], specular: [[0.0; LANES]; 3], visible: [0.0; LANES] };

    /// Adds a light point to lane `i`, with the weights of [`Lit`].
    #[inline(always)]
    pub fn add(&mut self, i: usize, light: &Light, diffuse: f32, specular: f32) {
        for axis in 0..3 {
            self.diffuse[axis][i] += f64::from(light.diffuse[axis] * diffuse);
            self.specular[axis][i] += f64::from(light.specular[axis] * specular);
        }
        self.visible[i] += 1.0;
    }

    /// Adds a part times a factor; what is left of light is 0 at least, but for rounding.
    #[inline(always)]
    pub fn add_part(&mut self, part: &Self, factor: f64) {
        for axis in 0..3 {
            for i in 0..LANES {
                let sum = &mut self.diffuse[axis][i];
                *sum = (*sum + factor * part.diffuse[axis][i]).max(0.0);
                let sum = &mut self.specular[axis][i];
                *sum = (*sum + factor * part.specular[axis][i]).max(0.0);
            }
        }
        for i in 0..LANES {
            self.visible[i] += factor * part.visible[i];
        }
    }

    /// Their mean, with a `share` of 1 over the number of points.
    #[inline(always)]
    pub fn mean(&self, share: f64) -> Split {
        let mut split = Split::NONE;
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
