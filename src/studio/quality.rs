//! The quality of pictures in the built-in studio: the number of camera samples.

use clap::ValueEnum;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::template::Template;
use crate::error::{Error, Result};
use crate::scene::Overrides;

/// Quality of a picture in the built-in studio: its number of camera samples.
/// docs/notebook/sampling.md has the error and the rays of each.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema, ValueEnum)]
#[serde(rename_all = "lowercase")]
pub enum Quality {
    /// one sample a pixel: no antialiasing
    Draft,
    /// the studio's own `spp`, the default: 4 samples a pixel
    Normal,
    /// 16 samples a pixel
    Final,
}

impl Quality {
    /// Returns the overrides of the studio for this quality.
    ///
    /// # Errors
    /// If `template` is not a built-in studio.
    pub fn overrides(self, template: &Template) -> Result<Overrides> {
        if !template.builtin {
            let message = format!("found with {}, expected with the studio", template.name);
            return Err(Error::invalid("--quality", message)
                .help("a scene has its own `spp` and `samples`: see --spp, --light-samples"));
        }
        let spp = match self {
            Self::Draft => Some(1),
            Self::Normal => None,
            Self::Final => Some(16),
        };
        let mut ours = Overrides::default();
        ours.flag("--quality", "/spp", spp);
        Ok(ours)
    }
}
