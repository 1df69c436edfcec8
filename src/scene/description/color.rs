//! Colours of a mesh as a scene file writes them.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::values::{Color, Name};
use crate::colormap::ColorMap;

/// Source of the colours of a mesh.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(untagged)]
#[schemars(rename = "MeshColor")]
pub enum MeshColorDescription {
    /// Colours that the file stores.
    Stored(StoredColor),
    /// A property of the file, shown through a colour map.
    Property(PropertyColorDescription),
}

/// Colours that a mesh file stores.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "lowercase")]
pub enum StoredColor {
    /// colours of the vertices
    Vertex,
    /// colours of the faces
    Face,
    /// neither colours nor textures of the file
    None,
}

/// A scalar property of the file, shown through a colour map.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[schemars(rename = "PropertyColor")]
pub struct PropertyColorDescription {
    /// Name of the property of the vertices, or else of the faces. `vertex.NAME` and `face.NAME`
    /// select one.
    pub property: Name,
    /// Colour map from the low to the high end of the range.
    #[serde(default)]
    pub map: ColorMap,
    /// Values at the two ends of the map. Values beyond have the colours of the ends. Default: the
    /// smallest and the largest value of the file.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schemars(inner(range(min = -1e300, max = 1e300)))]
    pub range: Option<[f64; 2]>,
    /// Colour of values that are not finite.
    #[serde(default = "magenta")]
    pub nan: Color,
}

impl MeshColorDescription {
    /// Returns the value of the flag `--color`: `vertex`, `face`, `none` or the name of a
    /// property.
    pub fn from_name(name: &str) -> Self {
        match name {
            "vertex" => Self::Stored(StoredColor::Vertex),
            "face" => Self::Stored(StoredColor::Face),
            "none" => Self::Stored(StoredColor::None),
            name => Self::Property(PropertyColorDescription {
                property: Name(name.to_string()),
                map: ColorMap::default(),
                range: None,
                nan: magenta(),
            }),
        }
    }
}

/// Returns the default colour of values that are not finite. No perceptual map has it.
fn magenta() -> Color {
    Color([1.0, 0.0, 1.0])
}
