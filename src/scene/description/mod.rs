//! A scene exactly as the file writes it: the one table of keys, types, ranges and defaults.
//!
//! The JSON Schema is generated from these types, the structural checks walk that schema, and
//! the doc comments below are what an editor shows. What a type cannot say (a direction of length
//! zero, a file that is missing) is checked in `check`. `comment`, allowed in every object, is
//! added by `schema` and never gets here; unknown keys are refused there too, with places.

mod light;
mod material;
mod shape;
mod values;

pub use light::*;
pub use material::*;
pub use shape::*;
pub use values::*;

use std::collections::BTreeMap;

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// A lightpath scene. Vectors are [x, y, z] in world units, right-handed; colours are linear RGB
/// and may exceed 1; angles are degrees.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Description {
    /// Mirror bounces after the primary ray; 0 = none.
    #[serde(default = "one_u32")]
    #[schemars(range(max = 4294967295u32))]
    pub nbounces: u32,
    /// Area lights: trace a quarter of the shadow rays (4 at least) first and the others only where these
    /// disagree, or a point drawn by chance does. The same mean; fewer rays.
    #[serde(default)]
    pub adaptiveshadows: bool,
    /// Camera samples per pixel, box-filtered (their mean); 1 = one ray through the pixel centre.
    #[serde(default = "one_u32")]
    #[schemars(range(min = 1, max = 4294967295u32))]
    pub spp: u32,
    /// Seed of every random choice.
    #[serde(default)]
    #[schemars(range(min = -9223372036854775808i64, max = 9223372036854775807i64))]
    pub seed: i64,
    /// How sample points are chosen.
    #[serde(default)]
    pub sampler: Sampler,
    /// Where the picture is taken from.
    pub camera: Camera,
    /// Lights, shapes, materials.
    pub scene: Contents,
    /// How radiance becomes 8-bit pixels; touches the PNG only, never the EXR.
    #[serde(default)]
    pub tonemap: Tonemap,
    /// What is written.
    #[serde(default)]
    pub output: Output,
}

/// How the points are chosen that pixels, the lens and area lights are sampled at.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "lowercase")]
pub enum Sampler {
    /// Owen-scrambled Sobol: stratified
    #[default]
    Sobol,
    /// uniform and independent, as in the coursework: the baseline
    Random,
}

/// The camera; exactly one of `lookat` and `target`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[schemars(extend(
    "oneOf" = [{ "required": ["lookat"] }, { "required": ["target"] }],
    "if" = { "properties": { "type": { "const": "thinlens" } } },
    "then" = { "required": ["aperture", "focaldistance"] },
    "else" = { "properties": { "aperture": false, "focaldistance": false } }
))]
pub struct Camera {
    /// Pinhole or thin lens.
    #[serde(rename = "type")]
    pub kind: CameraType,
    /// Picture width in pixels.
    #[schemars(range(min = 1, max = 2147483647))]
    pub width: u32,
    /// Picture height in pixels.
    #[schemars(range(min = 1, max = 2147483647))]
    pub height: u32,
    /// The full vertical angle in degrees.
    #[schemars(extend("exclusiveMinimum" = 0, "exclusiveMaximum" = 180))]
    pub fov: f64,
    /// Position in world units.
    pub position: Point,
    /// The view DIRECTION, not a point; any length.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub lookat: Option<Direction>,
    /// A point to look at, other than `position`.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub target: Option<Point>,
    /// Up; any length, not parallel to the view.
    pub up: Direction,
    /// `thinlens` only: lens diameter in world units; 0 equals `pinhole`.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schemars(range(min = 0.0, max = 1e18))]
    pub aperture: Option<f64>,
    /// `thinlens` only: distance in focus along the view direction, world units.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schemars(range(max = 1e18), extend("exclusiveMinimum" = 0))]
    pub focaldistance: Option<f64>,
}

/// Kind of camera.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "lowercase")]
pub enum CameraType {
    /// Everything is in focus.
    Pinhole,
    /// `aperture` and `focaldistance` set the depth of field.
    Thinlens,
}

/// What the camera sees.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Contents {
    /// Radiance of every ray that leaves the scene, reflected ones too.
    #[serde(default = "black")]
    pub backgroundcolor: Color,
    /// Ambient light, used with a material's `ka`.
    #[serde(default = "black")]
    pub ambient: Color,
    /// How light falls off with distance.
    #[serde(default)]
    pub attenuation: Attenuation,
    /// What finds the hits; `--backend` overrides it.
    #[serde(default)]
    pub accelerator: Accelerator,
    /// The lights.
    #[serde(default)]
    pub lightsources: Vec<Light>,
    /// The shapes.
    pub shapes: Vec<Shape>,
    /// Named materials, so that a shape may say `"material": "gold"`.
    #[serde(default)]
    pub materials: BTreeMap<String, Material>,
}

/// Divisor of a light's contribution at distance d.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "lowercase")]
pub enum Attenuation {
    /// 1
    None,
    /// d, the coursework's choice
    #[default]
    Linear,
    /// d^2
    Quadratic,
}

/// What finds the hits.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "lowercase")]
pub enum Accelerator {
    /// lightpath's own watertight BVH
    #[default]
    Bvh,
    /// Intel Embree 4
    Embree,
    /// the coursework's BVH
    Coursework,
    /// every primitive: slow, the oracle
    Brute,
}

/// Radiance to 8-bit pixels.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default)]
pub struct Tonemap {
    /// The tone curve.
    pub operator: Operator,
    /// Stops: x * 2^exposure, after `max`'s division, before the others.
    #[schemars(range(min = -100.0, max = 100.0))]
    pub exposure: f64,
    /// How pixel values are encoded.
    pub transfer: Transfer,
}

/// Tone curve.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "lowercase")]
pub enum Operator {
    /// divide by the largest channel value of the whole frame
    #[default]
    Max,
    /// clip at 1
    Clamp,
    /// x / (1 + x) per channel
    Reinhard,
}

/// Encoding of PNG values.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "lowercase")]
pub enum Transfer {
    /// the sRGB curve
    #[default]
    Srgb,
    /// linear values (gAMA 1.0)
    Linear,
}

/// The largest `cryptoranks`.
pub const MAX_CRYPTO_RANKS: u32 = 16;

/// What is written.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default)]
pub struct Output {
    /// EXR layers by name, as `--aov` takes them.
    pub layers: Vec<Name>,
    /// How many things a pixel of a cryptomatte can hold, those that cover most: two in each of its layers
    /// `CryptoObject00`, `CryptoObject01`...
    #[schemars(range(min = 2, max = MAX_CRYPTO_RANKS), extend("multipleOf" = 2))]
    pub cryptoranks: u32,
    /// Alpha is the fraction of camera samples that hit, instead of 1.
    pub transparent: bool,
}

impl Default for Output {
    fn default() -> Self {
        Self { layers: Vec::new(), cryptoranks: 6, transparent: false }
    }
}

fn one_u32() -> u32 {
    1
}

fn black() -> Color {
    Color([0.0; 3])
}
