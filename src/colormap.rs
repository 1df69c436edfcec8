//! Colour maps: a number in [0, 1] becomes a colour.
//!
//! The maps come from the crate `colorous`. In the perceptual ones, equal steps look equally large.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// A colour map of the crate `colorous`.
#[derive(
    Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema, clap::ValueEnum,
)]
#[serde(rename_all = "lowercase")]
#[value(rename_all = "lowercase")]
pub enum ColorMap {
    /// dark blue to green to yellow
    #[default]
    Viridis,
    /// dark blue to yellow, nearly the same with all kinds of colour vision
    Cividis,
    /// black to red to pale yellow
    Inferno,
    /// black to purple to pale yellow
    Magma,
    /// blue to red to yellow
    Plasma,
    /// blue to green to red, with steps of uneven size
    Turbo,
    /// black to white in a spiral of hues
    Cubehelix,
    /// purple to red to green
    Warm,
    /// purple to blue to green
    Cool,
    /// white to black
    Greys,
    /// red to white to blue, for differences
    RedBlue,
    /// purple to white to orange, for differences
    PurpleOrange,
}

impl ColorMap {
    /// Returns the colour at `t` in [0, 1], as 8-bit sRGB.
    pub fn srgb(self, t: f64) -> [u8; 3] {
        let map = match self {
            Self::Viridis => colorous::VIRIDIS,
            Self::Cividis => colorous::CIVIDIS,
            Self::Inferno => colorous::INFERNO,
            Self::Magma => colorous::MAGMA,
            Self::Plasma => colorous::PLASMA,
            Self::Turbo => colorous::TURBO,
            Self::Cubehelix => colorous::CUBEHELIX,
            Self::Warm => colorous::WARM,
            Self::Cool => colorous::COOL,
            Self::Greys => colorous::GREYS,
            Self::RedBlue => colorous::RED_BLUE,
            Self::PurpleOrange => colorous::PURPLE_ORANGE,
        };
        let color = map.eval_continuous(t.clamp(0.0, 1.0));
        [color.r, color.g, color.b]
    }
}
