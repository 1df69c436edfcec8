//! Checks the layers: their names must be known, and the names of light groups must differ if a
//! layer uses them.

use crate::scene::checked::{CheckedLight, Scene};
use crate::scene::description::Name;
use crate::scene::layers::{Layer, LightGroups};

use super::context::Check;

impl Check<'_, '_> {
    /// Checks that there is a colour map for `/output/legend`.
    pub(super) fn legend(&mut self, scene: &Scene) {
        if scene.legend && !scene.shows_property() {
            let message = "found true, but no mesh shows a property by its `color`";
            let help = "name one: --color PROPERTY; `info` lists those of a file";
            self.problems.error("/output/legend", message, Some(help.into()));
        }
    }

    /// Checks `/output/layers`. Returns the layers and the light groups.
    pub(super) fn layers(&mut self, lights: &[CheckedLight]) -> (Vec<Layer>, LightGroups) {
        let called = lights.iter().map(|light| (light.group.as_deref(), light.name.as_deref()));
        let (groups, collisions) = LightGroups::new(called);
        let words: Vec<Name> = self.part("/output/layers").unwrap_or_default();
        let mut layers = Vec::new();
        for (i, Name(word)) in words.iter().enumerate() {
            let pointer = format!("/output/layers/{i}");
            // An empty word is already reported.
            if word.is_empty() {
                continue;
            }
            if words[..i].iter().any(|Name(before)| before == word) {
                let message = format!("found the layer {word:?} a second time; it is written once");
                self.problems.warn(&pointer, message, None);
            }
            match Layer::from_word(word, &groups) {
                Some(named) => layers.extend(named),
                None => {
                    let message = format!("found the unknown layer {word:?}");
                    self.problems.error(&pointer, message, Some(Layer::help(word, &groups)));
                }
            }
        }
        layers.sort();
        layers.dedup();
        if !layers.contains(&Layer::Occlusion) {
            for key in ["aodistance", "aosamples"] {
                let pointer = format!("/output/{key}");
                if self.document.get(&pointer).is_some() {
                    let message = format!("found `{key}` without the layer `ao`; it has no effect");
                    self.problems.warn(&pointer, message, None);
                }
            }
        }
        let is_matte = |layer: &Layer| matches!(layer, Layer::CryptoObject | Layer::CryptoMaterial);
        if self.document.get("/output/cryptoranks").is_some() && !layers.iter().any(is_matte) {
            let message = "found `cryptoranks` without cryptomattes; it has no effect";
            self.problems.warn("/output/cryptoranks", message, None);
        }
        if layers.iter().any(|layer| layer.is_per_light()) {
            for (light, label) in collisions {
                let pointer = format!("/scene/lightsources/{light}");
                let message = format!("found a second layer `light_{label}`");
                let help = "choose another `name`, or give lights that belong together one `group`";
                self.problems.error(&pointer, message, Some(help.to_string()));
            }
        }
        (layers, groups)
    }
}
