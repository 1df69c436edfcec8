//! Numbers of samples of the built-in studio.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::template::Template;
use crate::error::{Error, Result};
use crate::scene::Overrides;

/// Quality of a picture in the built-in studio: a point on its front of error against time.
/// docs/notebook/sampling.md has the front.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "lowercase")]
pub enum Quality {
    /// one sample a pixel: no antialiasing
    Draft,
    /// the studio as it is
    Normal,
    /// 16 samples a pixel
    Final,
}

impl Quality {
    /// Camera samples a pixel, and samples on the studio's two lights for each of them.
    fn samples(self) -> (u32, [u32; 2]) {
        match self {
            Self::Draft => (1, [4, 2]),
            Self::Normal => (4, [4, 2]),
            Self::Final => (16, [4, 2]),
        }
    }

    /// The overrides of the studio that set these numbers; those of the lights only if `lit`.
    ///
    /// # Errors
    /// `template` is not the studio.
    pub fn overrides(self, template: &Template, lit: bool) -> Result<Overrides> {
        if !template.builtin {
            let message = format!("found with {}, expected with the studio", template.name);
            return Err(Error::invalid("--quality", message)
                .help("a scene has its own `spp` and `samples`: see --spp, --light-samples"));
        }
        let (spp, lights) = self.samples();
        let mut ours = Overrides::default();
        ours.flag("--quality", "/spp", Some(spp));
        let lights = lights.into_iter().filter(|_| lit);
        for (i, samples) in lights.enumerate() {
            ours.flag("--quality", &format!("/scene/lightsources/{i}/samples"), Some(samples));
        }
        Ok(ours)
    }
}
