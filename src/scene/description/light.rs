//! Lights as written.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::{Color, Name, Point};

/// A light.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(tag = "type", rename_all = "lowercase")]
pub enum Light {
    /// A point that shines in every direction.
    PointLight(PointLight),
    /// A rectangle that shines; not seen by rays, casts no shadow.
    AreaLight(AreaLight),
}

/// A point that shines in every direction.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct PointLight {
    /// Its own name, in the EXR.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub name: Option<Name>,
    /// Its EXR light group.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub group: Option<Name>,
    /// Where it is.
    pub position: Point,
    /// Diffuse colour.
    pub id: Color,
    /// Specular colour; default: `id`.
    #[serde(rename = "is", skip_serializing_if = "Option::is_none")]
    pub specular: Option<Color>,
}

/// A rectangle with base `v0 v1` whose opposite side passes through `v2`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct AreaLight {
    /// Its own name, in the EXR.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub name: Option<Name>,
    /// Its EXR light group.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub group: Option<Name>,
    /// First corner of the base.
    pub v0: Point,
    /// Second corner of the base.
    pub v1: Point,
    /// A point on the side opposite to the base.
    pub v2: Point,
    /// Diffuse colour of the whole light.
    pub id: Color,
    /// Specular colour of the whole light; default: `id`.
    #[serde(rename = "is", skip_serializing_if = "Option::is_none")]
    pub specular: Option<Color>,
    /// Points on this light, for each shading point of each camera sample.
    #[serde(default = "sixteen")]
    #[schemars(range(min = 1, max = 4294967295u32))]
    pub samples: u32,
    /// Which way it shines.
    #[serde(default)]
    pub emission: Emission,
}

/// Which way an area light shines.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "lowercase")]
pub enum Emission {
    /// both sides, every direction alike
    #[default]
    Uniform,
    /// a diffuse emitter: one-sided, with the cosine
    Lambertian,
}

fn sixteen() -> u32 {
    16
}
