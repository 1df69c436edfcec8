//! The answer of a backend to the query of one ray.

use serde::{Deserialize, Deserializer, Serialize};

use crate::accel::brute::Brute;
use crate::accel::lane::{LaneHit, LaneRay};
use crate::ray::{NONE, RayPacket, Rays};

/// A backend's answer to the query of one ray.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(tag = "says", rename_all = "snake_case")]
pub enum Answer {
    /// The ray hits nothing, or is not occluded.
    Miss,
    /// The closest hit of the ray.
    Hit {
        /// Geometry id of the hit.
        geom: u32,
        /// Index of the primitive within its geometry.
        prim: u32,
        /// Ray parameter of the hit. JSON writes infinity as null.
        #[serde(deserialize_with = "infinite")]
        t: f64,
    },
    /// The ray is occluded.
    Occluded,
}

/// Reads a number. Null is infinity: a t beyond the range of f32.
fn infinite<'de, D: Deserializer<'de>>(value: D) -> Result<f64, D::Error> {
    Ok(Option::deserialize(value)?.unwrap_or(f64::INFINITY))
}

impl Answer {
    /// The answer in lane `i` of a packet traced by `closest`.
    pub fn closest(packet: &RayPacket, i: usize) -> Self {
        let (geom, prim) = (packet.hits.geom[i], packet.hits.prim[i]);
        match geom {
            NONE => Self::Miss,
            _ => Self::Hit { geom, prim, t: packet.rays.tfar[i].into() },
        }
    }

    /// The answer in lane `i` of rays traced by `occluded`.
    pub fn occluded(rays: &Rays, i: usize) -> Self {
        if rays.tfar[i] == f32::NEG_INFINITY { Self::Occluded } else { Self::Miss }
    }

    /// The answer in lane `i` of a packet traced by `occluded` if `shadow`, else by `closest`.
    pub fn in_lane(packet: &RayPacket, i: usize, shadow: bool) -> Self {
        if shadow { Self::occluded(&packet.rays, i) } else { Self::closest(packet, i) }
    }

    /// The answer for a ray whose closest hit is `hit`: to an occlusion query if `shadow`, else to
    /// a closest-hit query.
    pub fn of_hit(hit: Option<LaneHit>, shadow: bool) -> Self {
        match hit {
            None => Self::Miss,
            Some(_) if shadow => Self::Occluded,
            Some(LaneHit { geom, prim, t, .. }) => Self::Hit { geom, prim, t },
        }
    }

    /// The oracle's answer: occlusion if `shadow`, else the closest hit.
    pub fn truth(oracle: &Brute, ray: &LaneRay, shadow: bool) -> Self {
        Self::of_hit(oracle.closest_hit(ray), shadow)
    }

    /// Returns whether the ray hits anything or is occluded.
    pub fn is_hit(&self) -> bool {
        *self != Self::Miss
    }

    /// Ray parameter of the closest hit; infinite for all other answers.
    pub fn t(&self) -> f64 {
        match self {
            Self::Hit { t, .. } => *t,
            Self::Miss | Self::Occluded => f64::INFINITY,
        }
    }

    /// Geometry id and primitive index of the closest hit; `None` for all other answers.
    pub fn primitive(&self) -> Option<[u32; 2]> {
        match self {
            Self::Hit { geom, prim, .. } => Some([*geom, *prim]),
            Self::Miss | Self::Occluded => None,
        }
    }
}
