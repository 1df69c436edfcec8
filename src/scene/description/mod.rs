//! A scene exactly as the file writes it. These types are the only table of keys, types, ranges and
//! defaults.
//!
//! The JSON Schema is generated from these types, and the structural checks walk that schema.
//! Editors show the doc comments below to users. The module `check` tests what a type cannot
//! express, such as a zero direction or a missing file. The module `schema` adds the key `comment`
//! to every object; it is dropped before these types are read. The structural checks refuse unknown
//! keys and name their places.

mod camera;
mod color;
mod light;
mod material;
mod shape;
mod values;
mod visible;

pub use crate::colormap::ColorMap;
pub use camera::*;
pub use color::*;
pub use light::*;
pub use material::*;
pub use shape::*;
pub use values::*;
pub use visible::*;

use std::collections::BTreeMap;

use clap::ValueEnum;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::sampler::SamplerKind;

/// A lightpath scene. Vectors are [x, y, z] in world units, right-handed; colours are linear RGB
/// and may exceed 1; angles are degrees.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct SceneDescription {
    /// Mirror bounces after the primary ray; 0 = none.
    #[serde(default = "one_u32")]
    #[schemars(range(max = 4294967295u32))]
    pub nbounces: u32,
    /// Area lights: trace a quarter of the shadow rays (at least 4) first. Trace the others only
    /// where these disagree, or where one more ray, to a point drawn at random, disagrees with
    /// them. Same mean, fewer rays.
    #[serde(default)]
    pub adaptiveshadows: bool,
    /// Number of point lights and area lights that each shading point draws at random, by their
    /// estimated light, with one point of each. Default: every point receives light from all.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schemars(range(min = 1, max = 4294967295u32))]
    pub emittersamples: Option<u32>,
    /// Camera samples per pixel, box-filtered (their mean); 1 = one ray through the pixel centre.
    #[serde(default = "one_u32")]
    #[schemars(range(min = 1, max = 4294967295u32))]
    pub spp: u32,
    /// Seed of all random numbers.
    #[serde(default)]
    #[schemars(range(min = -9223372036854775808i64, max = 9223372036854775807i64))]
    pub seed: i64,
    /// Sampler that chooses the sample points.
    #[serde(default)]
    pub sampler: SamplerKind,
    /// The camera that takes the picture.
    pub camera: CameraDescription,
    /// Lights, shapes and materials.
    pub scene: Contents,
    /// How radiance becomes 8-bit pixels. It affects only the PNG, never the EXR.
    #[serde(default)]
    pub tonemap: TonemapDescription,
    /// Contents of the output files.
    #[serde(default)]
    pub output: Output,
}

impl SceneDescription {
    /// Returns mutable references to the paths of all textures, meshes and images of environments.
    pub fn paths_mut(&mut self) -> Vec<&mut Name> {
        let Contents { materials, shapes, lightsources, .. } = &mut self.scene;
        let mut paths: Vec<_> =
            materials.values_mut().filter_map(|material| material.texture_path.as_mut()).collect();
        for (path, material) in shapes.iter_mut().map(ShapeDescription::parts_mut) {
            paths.extend(path);
            if let MaterialUse::Inline(material) = material {
                paths.extend(&mut material.texture_path);
            }
        }
        for light in lightsources {
            if let LightDescription::Environment(light) = light {
                paths.extend(&mut light.image);
            }
        }
        paths
    }
}

/// Lights, shapes and materials of the scene.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Contents {
    /// Radiance of every ray that misses, including reflected rays.
    #[serde(default)]
    pub backgroundcolor: Color,
    /// Ambient light. A material's `ka` multiplies it.
    #[serde(default)]
    pub ambient: Color,
    /// How light falls off with distance.
    #[serde(default)]
    pub attenuation: Falloff,
    /// Backend that finds the hits; `--backend` overrides it.
    #[serde(default)]
    pub accelerator: AcceleratorName,
    /// The lights of the scene.
    #[serde(default)]
    pub lightsources: Vec<LightDescription>,
    /// The shapes of the scene.
    pub shapes: Vec<ShapeDescription>,
    /// Named materials. A shape refers to one by name: `"material": "gold"`.
    #[serde(default)]
    pub materials: BTreeMap<String, MaterialDescription>,
}

/// Divisor of a light's contribution at distance d.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "lowercase")]
#[schemars(rename = "Attenuation")]
pub enum Falloff {
    /// divide by 1: no falloff
    None,
    /// divide by d, as the coursework does
    #[default]
    Linear,
    /// divide by the square of d
    Quadratic,
}

/// Backend that finds the hits.
#[derive(
    Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema, ValueEnum,
)]
#[serde(rename_all = "lowercase")]
#[schemars(rename = "Accelerator")]
pub enum AcceleratorName {
    /// lightpath's own watertight BVH
    #[default]
    Bvh,
    /// the library Intel Embree 4
    Embree,
    /// the BVH of the coursework
    Coursework,
    /// tests every primitive: slow, the oracle
    Brute,
}

/// Conversion of radiance to 8-bit pixels.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default)]
#[schemars(rename = "Tonemap")]
pub struct TonemapDescription {
    /// Tone curve that is applied.
    pub operator: ToneOperator,
    /// Exposure in stops: x * 2^exposure. Applied after the division of `max`, and before the other
    /// operators.
    #[schemars(range(min = -100.0, max = 100.0))]
    pub exposure: f64,
    /// Encoding of the pixel values.
    pub transfer: Transfer,
}

/// Tone curve of the PNG.
#[derive(
    Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema, ValueEnum,
)]
#[serde(rename_all = "lowercase")]
#[schemars(rename = "Operator")]
pub enum ToneOperator {
    /// divide by the largest channel value of the whole frame
    #[default]
    Max,
    /// clip values at 1
    Clamp,
    /// x / (1 + x) per channel
    Reinhard,
}

/// Encoding of PNG values.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "lowercase")]
pub enum Transfer {
    /// the sRGB transfer curve
    #[default]
    Srgb,
    /// linear values (gAMA 1.0)
    Linear,
}

/// Maximum value of `cryptoranks`.
pub const MAX_CRYPTO_RANKS: u32 = 16;

/// Contents of the output files.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default)]
pub struct Output {
    /// Names of EXR layers, as for `--aov`.
    pub layers: Vec<Name>,
    /// Number of entries in a pixel of a cryptomatte: the ids with the most coverage. Each of the
    /// layers `CryptoObject00`, `CryptoObject01`... holds two.
    #[schemars(range(min = 2, max = MAX_CRYPTO_RANKS), extend("multipleOf" = 2))]
    pub cryptoranks: u32,
    /// Length of the rays of the layer `ao`, in world units. Default: unlimited.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schemars(range(min = 1e-18, max = 1e18))]
    pub aodistance: Option<f64>,
    /// Number of rays of the layer `ao` for each camera sample.
    #[serde(skip_serializing_if = "is_sixteen")]
    #[schemars(range(min = 1, max = 65536))]
    pub aosamples: u32,
    /// Alpha is the fraction of camera samples that hit, instead of 1.
    pub transparent: bool,
    /// Draws the colour map of a mesh's `color` into the PNG, with ticks and the property's name.
    #[serde(skip_serializing_if = "is_false")]
    pub legend: bool,
}

impl Default for Output {
    fn default() -> Self {
        Self {
            layers: Vec::new(),
            cryptoranks: 6,
            aodistance: None,
            aosamples: 16,
            transparent: false,
            legend: false,
        }
    }
}

/// The default `false` is not written.
fn is_false(value: &bool) -> bool {
    !value
}

fn is_sixteen(value: &u32) -> bool {
    *value == 16
}

fn one_u32() -> u32 {
    1
}
