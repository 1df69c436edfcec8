//! Sums of light over the points of an area light.

use super::adaptive_shadows::LightPoint;
use super::record::Record;
use super::sampled_light::SampledLight;
use super::split::{LightPartSums, without_residue};
use crate::ray::{LANES, Mask};
use crate::shading::{Lanes3, Light, LightWeights, lane};

/// Light of one area light, by lane, before the base colour. In f64, because there may be many
/// points.
pub struct LightSums {
    /// By axis and lane.
    pub light: [[f64; LANES]; 3],
    /// The same light, separated for the layers.
    pub split: LightPartSums,
}

impl LightSums {
    /// Sums before the first point.
    pub const NONE: Self = Self { light: [[0.0; LANES]; 3], split: LightPartSums::NONE };

    /// Adds one light point to each lane of `seen`.
    #[inline(always)]
    pub fn add_lanes<R: Record>(&mut self, light: &Light, weights: &LightWeights, seen: &Mask) {
        let (d, s) = (light.diffuse, light.specular);
        // Not a loop: the compiler would make vectors of axes instead of lanes.
        let [x, y, z] = &mut self.light;
        add_seen(x, (d.x, s.x), weights, seen);
        add_seen(y, (d.y, s.y), weights, seen);
        add_seen(z, (d.z, s.z), weights, seen);
        if R::ON {
            for i in (0..LANES).filter(|&i| seen.0[i] != 0) {
                let (diffuse, specular) = (d * weights.diffuse[i], s * weights.specular[i]);
                self.split.add(i, diffuse, specular);
            }
        }
    }

    /// [`LightSums::add_lanes`] for light points of different colours.
    pub fn add_colored<R: Record>(
        &mut self,
        light: &Light,
        (weights, colors): (&LightWeights, &Lanes3),
        seen: &Mask,
    ) {
        for i in (0..LANES).filter(|&i| seen.0[i] != 0) {
            let color = lane(colors, i);
            let diffuse = light.diffuse * color * weights.diffuse[i];
            let specular = light.specular * color * weights.specular[i];
            for (sum, sent) in self.light.iter_mut().zip((diffuse + specular).to_array()) {
                sum[i] += f64::from(sent);
            }
            if R::ON {
                self.split.add(i, diffuse, specular);
            }
        }
    }

    /// Adds one visible light point to its lane.
    #[inline(always)]
    pub fn add<R: Record>(&mut self, sampled_light: &SampledLight, point: &LightPoint) {
        let LightPoint { lane, diffuse, specular, .. } = *point;
        let light = sampled_light.light;
        let sent = light.diffuse * diffuse + light.specular * specular;
        for (sum, sent) in self.light.iter_mut().zip(sent.to_array()) {
            sum[lane] += f64::from(sent);
        }
        if R::ON {
            self.split.add(lane, light.diffuse * diffuse, light.specular * specular);
        }
    }

    /// Adds `part` times `factor`. A negative factor removes light that was added before.
    #[inline(always)]
    pub fn add_part<R: Record>(&mut self, part: &Self, factor: f64) {
        if factor == 0.0 {
            return;
        }
        for (sum, part) in self.light.iter_mut().flatten().zip(part.light.iter().flatten()) {
            *sum = without_residue(*sum, factor * part);
        }
        if R::ON {
            self.split.add_part(&part.split, factor);
        }
    }
}

/// Adds the light that the lanes of `seen` receive along one colour axis.
#[inline(always)]
fn add_seen(
    sum: &mut [f64; LANES],
    (diffuse, specular): (f32, f32),
    weights: &LightWeights,
    seen: &Mask,
) {
    for i in 0..LANES {
        let light = diffuse * weights.diffuse[i] + specular * weights.specular[i];
        sum[i] += f64::from(if seen.0[i] != 0 { light } else { 0.0 });
    }
}
