//! Light sources as a scene file writes them.

use glam::{DMat3, DVec3};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::values::{Color, Direction, MAX_TURN, Name, Point};

/// A light source of the scene.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(tag = "type", rename_all = "lowercase")]
#[schemars(rename = "Light")]
pub enum LightDescription {
    /// A point that emits light in every direction.
    PointLight(PointLight),
    /// A rectangle that emits light. Rays do not see it, and it casts no shadow.
    AreaLight(AreaLight),
    /// Light from all sides, from beyond the scene: of one radiance, or an image.
    Environment(EnvironmentDescription),
    /// Parallel light from beyond the scene: a sun of size 0.
    Directional(Directional),
    /// A disc in the sky, beyond the scene. Rays do not see it.
    Sun(Sun),
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

/// Light from all sides, from beyond the scene: of one radiance, or an image.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[schemars(rename = "Environment")]
pub struct EnvironmentDescription {
    /// Name of the light in the EXR.
    pub name: Option<Name>,
    /// Light group of the light in the EXR.
    pub group: Option<Name>,
    /// Radiance. A white diffuse surface has the same radiance if nothing hides the environment
    /// from it. With `image`, a factor of the image; default: 1.
    pub radiance: Option<Color>,
    /// Path of an equirectangular image of the radiance, relative to the scene file. The top of the
    /// image is +y, its middle is -z, and +x is in its right half.
    pub image: Option<Name>,
    /// Azimuth of the image's middle, in degrees from -z towards +x.
    #[serde(default)]
    #[schemars(range(min = -MAX_TURN, max = MAX_TURN))]
    pub rotation: f64,
    /// Colour of the specular light; default: `radiance`.
    #[serde(rename = "is")]
    pub specular: Option<Color>,
    /// Number of directions for each shading point of each camera sample.
    #[serde(default = "sixteen")]
    #[schemars(range(min = 1, max = 4294967295u32))]
    pub samples: u32,
    /// True if camera rays and mirrors see it, in addition to `backgroundcolor`.
    #[serde(default = "yes")]
    pub visible: bool,
}

impl EnvironmentDescription {
    /// Returns the factor of the image, or the radiance if there is no image.
    pub fn factor(&self) -> Color {
        self.radiance.unwrap_or(Color([1.0; 3]))
    }
}

/// Parallel light from beyond the scene. It has no falloff.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[schemars(extend(
    "oneOf" = [{ "required": ["direction"] }, { "required": ["azimuth", "elevation"] }]
))]
pub struct Directional {
    /// Name of the light in the EXR.
    pub name: Option<Name>,
    /// Light group of the light in the EXR.
    pub group: Option<Name>,
    /// Direction of the light.
    #[serde(flatten)]
    pub sky: Sky,
    /// Colour of its diffuse light; or `irradiance`.
    pub id: Option<Color>,
    /// Irradiance of a surface that faces the light: pi times `id`.
    pub irradiance: Option<Color>,
    /// Colour of its specular light; default: that of the diffuse light.
    #[serde(rename = "is")]
    pub specular: Option<Color>,
}

/// A disc in the sky with soft shadows. It has no falloff.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[schemars(extend(
    "oneOf" = [{ "required": ["direction"] }, { "required": ["azimuth", "elevation"] }]
))]
pub struct Sun {
    /// Name of the light in the EXR.
    pub name: Option<Name>,
    /// Light group of the light in the EXR.
    pub group: Option<Name>,
    /// Direction of the light.
    #[serde(flatten)]
    pub sky: Sky,
    /// Angular diameter in degrees. The sun's is 0.53.
    #[serde(default = "diameter")]
    #[schemars(range(min = 0, max = 179))]
    pub angle: f64,
    /// Colour of the diffuse light of the whole disc; or `irradiance`.
    pub id: Option<Color>,
    /// Irradiance of a surface that faces the sun: pi times `id`.
    pub irradiance: Option<Color>,
    /// Colour of the specular light of the whole disc; default: that of the diffuse light.
    #[serde(rename = "is")]
    pub specular: Option<Color>,
    /// Number of directions for each shading point of each camera sample.
    #[serde(default = "sixteen")]
    #[schemars(range(min = 1, max = 4294967295u32))]
    pub samples: u32,
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

/// Direction of a distant light.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Sky {
    /// Direction in which the light travels, of any length; or `azimuth` and `elevation`.
    pub direction: Option<Direction>,
    /// Degrees from -z, the north, towards +x, the east.
    #[schemars(range(min = -MAX_TURN, max = MAX_TURN))]
    pub azimuth: Option<f64>,
    /// Degrees above the horizon; y is up.
    #[schemars(range(min = -90, max = 90))]
    pub elevation: Option<f64>,
}

impl Sky {
    /// Returns the direction towards the light, of any length; zero if `direction` is zero. `None`
    /// unless either `direction`, or both `azimuth` and `elevation`, are given.
    pub fn towards(self) -> Option<DVec3> {
        match (self.direction, self.azimuth, self.elevation) {
            (Some(Direction(direction)), None, None) => Some(-DVec3::from(direction)),
            (None, Some(azimuth), Some(elevation)) => {
                let (east, north) = azimuth.to_radians().sin_cos();
                let (up, across) = elevation.to_radians().sin_cos();
                Some(DVec3::new(across * east, up, -across * north))
            }
            _ => None,
        }
    }

    /// Turns the direction. Nothing happens without a complete one.
    pub fn turn(&mut self, turn: DMat3) {
        if let Some(towards) = self.towards() {
            let direction = Some(Direction((turn * -towards).to_array()));
            *self = Self { direction, azimuth: None, elevation: None };
        }
    }
}

fn yes() -> bool {
    true
}

fn diameter() -> f64 {
    0.53
}

fn sixteen() -> u32 {
    16
}
