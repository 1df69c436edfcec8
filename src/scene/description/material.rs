//! Materials as written.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::{Color, Name};

/// An inline material, or the name of one in `materials`. Untagged, because the format is: the
/// structural check, which knows places, tells the two apart before serde does.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(untagged)]
pub enum MaterialUse {
    /// The name of one of the scene's `materials`.
    Named(Name),
    /// A material of its own.
    Inline(Box<Material>),
}

/// Blinn-Phong.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default)]
pub struct Material {
    /// The only kind.
    #[serde(rename = "type")]
    pub kind: MaterialType,
    /// Diffuse coefficient.
    #[schemars(range(min = 0.0, max = 1e18))]
    pub kd: f64,
    /// Specular coefficient.
    #[schemars(range(min = 0.0, max = 1e18))]
    pub ks: f64,
    /// Ambient coefficient.
    #[schemars(range(min = 0.0, max = 1e18))]
    pub ka: f64,
    /// Mirror coefficient.
    #[schemars(range(min = 0.0, max = 1e18))]
    pub kr: f64,
    /// Sharpness of highlights; 0^0 = 1.
    #[schemars(range(min = 0.0, max = 1e18))]
    pub specularexponent: f64,
    /// Base colour without a texture.
    pub diffusecolor: Color,
    /// Texture image, relative to the scene file; its alpha is ignored.
    #[serde(rename = "tPath", skip_serializing_if = "Option::is_none")]
    pub texture_path: Option<Name>,
    /// Accepted for old files; the image's own size is used.
    #[serde(rename = "tWidth", skip_serializing_if = "Option::is_none")]
    #[schemars(range(min = 1, max = 4294967295u32))]
    pub texture_width: Option<u32>,
    /// Accepted for old files; the image's own size is used.
    #[serde(rename = "tHeight", skip_serializing_if = "Option::is_none")]
    #[schemars(range(min = 1, max = 4294967295u32))]
    pub texture_height: Option<u32>,
    /// Texture filter.
    pub filter: Filter,
    /// Outside the image; default: spheres repeat in u and clamp in v, meshes repeat, others clamp.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub wrap: Option<Wrap>,
    /// Default: `srgb` for integer images of any format, `linear` for float images.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub colorspace: Option<ColorSpace>,
    /// u, v are multiplied by it after any flip.
    #[serde(rename = "tScale")]
    #[schemars(inner(range(min = -1e9, max = 1e9)))]
    pub texture_scale: [f64; 2],
}

impl Default for Material {
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
            filter: Filter::Bilinear,
            wrap: None,
            colorspace: None,
            texture_scale: [1.0; 2],
        }
    }
}

/// Kind of material.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "lowercase")]
pub enum MaterialType {
    /// diffuse, specular, ambient and mirror
    BlinnPhong,
}

/// Texture filter.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "lowercase")]
pub enum Filter {
    /// four texels
    Bilinear,
    /// one texel
    Nearest,
}

/// What texel indices outside the image mean.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "lowercase")]
pub enum Wrap {
    /// modulo the size
    Repeat,
    /// the border texel
    Clamp,
}

/// How stored colour values become linear light.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "lowercase")]
pub enum ColorSpace {
    /// sRGB-encoded
    Srgb,
    /// linear
    Linear,
}
