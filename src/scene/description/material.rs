//! Materials as a scene file writes them.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::values::{Color, Name};

/// An inline material, or the name of one in `materials`.
// The format has no tag here, so the type is untagged. The structural check reports errors with
// places before serde reads the value.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(untagged)]
pub enum MaterialUse {
    /// The name of a material in `materials`.
    Named(Name),
    /// A material that belongs to this shape alone.
    Inline(Box<MaterialDescription>),
}

/// A Blinn-Phong material with an optional mirror.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default)]
#[schemars(rename = "Material")]
pub struct MaterialDescription {
    /// Kind of material; there is only one.
    #[serde(rename = "type")]
    pub kind: MaterialType,
    /// Coefficient of diffuse reflection.
    #[schemars(range(min = 0.0, max = 1e18))]
    pub kd: f64,
    /// Coefficient of specular reflection.
    #[schemars(range(min = 0.0, max = 1e18))]
    pub ks: f64,
    /// Coefficient of ambient light.
    #[schemars(range(min = 0.0, max = 1e18))]
    pub ka: f64,
    /// Coefficient of mirror reflection.
    #[schemars(range(min = 0.0, max = 1e18))]
    pub kr: f64,
    /// Exponent of the specular highlight; 0^0 = 1.
    #[schemars(range(min = 0.0, max = 1e18))]
    pub specularexponent: f64,
    /// Base colour without a texture.
    pub diffusecolor: Color,
    /// Texture image, relative to the scene file. Its alpha is ignored.
    #[serde(rename = "tPath")]
    pub texture_path: Option<Name>,
    /// Accepted for old files and ignored: the image's own size is used.
    #[serde(rename = "tWidth")]
    #[schemars(range(min = 1, max = 4294967295u32))]
    pub texture_width: Option<u32>,
    /// Accepted for old files and ignored: the image's own size is used.
    #[serde(rename = "tHeight")]
    #[schemars(range(min = 1, max = 4294967295u32))]
    pub texture_height: Option<u32>,
    /// How texels are filtered. Default: `trilinear` for images that a mesh file names, `bilinear`
    /// for `tPath`.
    pub filter: Option<Filter>,
    /// Texture lookup outside the image. Default: spheres repeat in u and clamp in v, meshes
    /// repeat, others clamp.
    pub wrap: Option<Wrap>,
    /// Encoding of the image. Default: `srgb` for integer images of any format, `linear` for float
    /// images.
    pub colorspace: Option<ColorSpace>,
    /// Factors of u and v, applied after v is flipped where the shape flips it.
    #[serde(rename = "tScale")]
    #[schemars(inner(range(min = -1e9, max = 1e9)))]
    pub texture_scale: [f64; 2],
}

impl Default for MaterialDescription {
    fn default() -> Self {
        Self {
            kind: MaterialType::BlinnPhong,
            kd: 1.0,
            ks: 0.0,
            ka: 0.0,
            kr: 0.0,
            specularexponent: 1.0,
            diffusecolor: Color([1.0; 3]),
            texture_path: None,
            texture_width: None,
            texture_height: None,
            filter: None,
            wrap: None,
            colorspace: None,
            texture_scale: [1.0; 2],
        }
    }
}

/// Kind of a material.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "lowercase")]
pub enum MaterialType {
    /// diffuse, specular, ambient and mirror
    BlinnPhong,
}

/// Filter of a texture lookup.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "lowercase")]
pub enum Filter {
    /// interpolates between four texels
    Bilinear,
    /// takes the nearest texel
    Nearest,
    /// takes the mean over the footprint of a sample
    Trilinear,
}

/// Lookup of texels outside the image.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "lowercase")]
pub enum Wrap {
    /// indices modulo the size
    Repeat,
    /// the nearest border texel
    Clamp,
}

/// Encoding of stored colour values.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "lowercase")]
pub enum ColorSpace {
    /// values are encoded as sRGB
    Srgb,
    /// values are linear light
    Linear,
}
