//! Light sources as a scene file writes them.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::values::{Color, Name, Point};

/// A light source of the scene.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(tag = "type", rename_all = "lowercase")]
pub enum Light {
    /// A point that emits light in every direction.
    PointLight(PointLight),
    /// A rectangle that emits light. Rays do not see it, and it casts no shadow.
    AreaLight(AreaLight),
}

/// A point that emits light in every direction.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct PointLight {
    /// Name of the light in the EXR.
    pub name: Option<Name>,
    /// Light group of the light in the EXR.
    pub group: Option<Name>,
    /// Position in world units.
    pub position: Point,
    /// Colour of its diffuse light.
    pub id: Color,
    /// Colour of its specular light; default: `id`.
    #[serde(rename = "is")]
    pub specular: Option<Color>,
}

/// A rectangle with base `v0 v1` whose opposite side passes through `v2`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct AreaLight {
    /// Name of the light in the EXR.
    pub name: Option<Name>,
    /// Light group of the light in the EXR.
    pub group: Option<Name>,
    /// First corner of the base.
    pub v0: Point,
    /// Second corner of the base.
    pub v1: Point,
    /// A point on the side opposite to the base.
    pub v2: Point,
    /// Colour of the diffuse light of the whole rectangle.
    pub id: Color,
    /// Colour of the specular light of the whole rectangle; default: `id`.
    #[serde(rename = "is")]
    pub specular: Option<Color>,
    /// Number of points on this light, for each shading point of each camera sample.
    #[serde(default = "sixteen")]
    #[schemars(range(min = 1, max = 4294967295u32))]
    pub samples: u32,
    /// Directions in which it emits light.
    #[serde(default)]
    pub emission: Emission,
}

/// Directions in which an area light emits light.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "lowercase")]
pub enum Emission {
    /// both sides, the same in every direction
    #[default]
    Uniform,
    /// a diffuse emitter: one-sided, with the cosine
    Lambertian,
}

fn sixteen() -> u32 {
    16
}
