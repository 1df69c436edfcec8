//! The built-in studios: the scenes in which a mesh without a scene is shown.

use clap::ValueEnum;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// A built-in studio. They differ in their lights.
#[derive(
    Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema, ValueEnum,
)]
#[serde(rename_all = "lowercase")]
pub enum Studio {
    /// a key lamp and a fill lamp
    #[default]
    Lamps,
    /// light from all sides, and a large sun
    Soft,
    /// light from all sides on grey clay, without the colours of the file
    Clay,
}

impl Studio {
    /// Returns the scene as JSON.
    pub fn text(self) -> &'static str {
        match self {
            Self::Lamps => include_str!("../../assets/studio.json"),
            Self::Soft => include_str!("../../assets/studio-soft.json"),
            Self::Clay => include_str!("../../assets/studio-clay.json"),
        }
    }
}
