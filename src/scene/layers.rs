//! Layers of the EXR and their names in `output.layers`, and the light groups of a scene.

use std::collections::HashMap;

use crate::nearest::nearest;

/// A layer of the EXR in addition to the beauty.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Layer {
    /// Depth along the camera's axis in world units, positive in front; 1e30 on a miss.
    Depth,
    /// Distance of the hit from the origin of the camera ray, in world units; 1e30 on a miss.
    Distance,
    /// Position of the hit in world space.
    Position,
    /// Shading normal in world space.
    Normal,
    /// Geometric normal in world space.
    GeometricNormal,
    /// Shading normal in camera space: x right, y up, z to the viewer.
    CameraNormal,
    /// Cosine between the shading normal and the direction to the viewer.
    Facing,
    /// Base colour of the surface.
    Albedo,
    /// Texture coordinates of the hit.
    Uv,
    /// Ambient occlusion: the share of the hemisphere that is free of surfaces, weighted by the
    /// cosine.
    Occlusion,
    /// Diffuse light of the first hit.
    Diffuse,
    /// Specular light of the first hit.
    Specular,
    /// Ambient light of the first hit.
    Ambient,
    /// All light that the first hit reflects as a mirror.
    Reflection,
    /// Radiance of camera rays that miss.
    Background,
    /// All light of one group, given by its index in [`LightGroups::names`].
    Light(usize),
    /// All ambient light, including what mirrors reflect.
    LightAmbient,
    /// All background, including what mirrors reflect.
    LightBackground,
    /// Fraction of a group's light points that are visible from the first hit.
    Shadow(usize),
    /// Variance of the colours of the samples.
    Variance,
    /// Number of camera samples.
    Samples,
    /// Index of the primitive plus 1.
    Primitive,
    /// Index of the shape plus 1.
    Object,
    /// Cryptomatte with one id per shape.
    CryptoObject,
    /// Cryptomatte with one id per material.
    CryptoMaterial,
}

/// Layers that exist once per scene, in the order of the documentation.
const SINGLE: [(Layer, &str); 23] = [
    (Layer::Depth, "Z"),
    (Layer::Distance, "distance"),
    (Layer::Position, "P"),
    (Layer::Normal, "N"),
    (Layer::GeometricNormal, "Ng"),
    (Layer::CameraNormal, "Ncam"),
    (Layer::Facing, "facing"),
    (Layer::Albedo, "albedo"),
    (Layer::Uv, "uv"),
    (Layer::Occlusion, "ao"),
    (Layer::Diffuse, "diffuse"),
    (Layer::Specular, "specular"),
    (Layer::Ambient, "ambient"),
    (Layer::Reflection, "reflection"),
    (Layer::Background, "background"),
    (Layer::LightAmbient, "light_ambient"),
    (Layer::LightBackground, "light_background"),
    (Layer::Variance, "variance"),
    (Layer::Samples, "samples"),
    (Layer::Primitive, "primid"),
    (Layer::Object, "objectid"),
    (Layer::CryptoObject, "CryptoObject"),
    (Layer::CryptoMaterial, "CryptoMaterial"),
];

/// Words that select several layers.
const FAMILIES: [&str; 5] = ["all", "components", "light", "shadow", "cryptomatte"];

/// The light groups of a scene.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct LightGroups {
    /// Names of the groups as they follow `light_`, in the order of their first lights.
    pub names: Vec<String>,
    /// Index of the group of each light.
    pub of: Vec<usize>,
}

impl LightGroups {
    /// Makes the groups from the `group` and `name` of each light. A light with neither is named by
    /// its index plus 1. Lights share a group only if they have the same `group`. Also returns the
    /// lights whose names collide with another group or with `ambient` or `background`: index and
    /// label.
    pub fn new<'a>(
        lights: impl IntoIterator<Item = (Option<&'a str>, Option<&'a str>)>,
    ) -> (Self, Vec<(usize, String)>) {
        let mut groups = Self::default();
        let mut sources: Vec<(bool, &str)> = Vec::new();
        let mut collisions = Vec::new();
        let mut indices: HashMap<String, usize> = HashMap::new();
        for (i, called) in lights.into_iter().enumerate() {
            let source = match called {
                (Some(group), _) => (true, group),
                (None, Some(name)) => (false, name),
                (None, None) => (false, ""),
            };
            let label = match source.1 {
                "" => (i + 1).to_string(),
                text => label(text),
            };
            let known = indices.get(&label).copied();
            let same = known.is_some_and(|k| source.0 && sources[k] == source);
            if matches!(label.as_str(), "ambient" | "background") || known.is_some() && !same {
                collisions.push((i, label.clone()));
            }
            groups.of.push(known.unwrap_or(groups.names.len()));
            if known.is_none() {
                indices.insert(label.clone(), groups.names.len());
                groups.names.push(label);
                sources.push(source);
            }
        }
        (groups, collisions)
    }
}

/// Converts a name to a valid part of a layer name: all but ASCII letters and digits become
/// underscores.
fn label(text: &str) -> String {
    text.chars().map(|c| if c.is_ascii_alphanumeric() { c } else { '_' }).collect()
}

impl Layer {
    /// Returns the name of the layer in the file.
    pub fn name(self, groups: &LightGroups) -> String {
        match self {
            Self::Light(group) => format!("light_{}", groups.names[group]),
            Self::Shadow(group) => format!("shadow_{}", groups.names[group]),
            other => {
                let known = SINGLE.iter().find(|(layer, _)| *layer == other);
                known.map_or("", |(_, name)| name).to_string()
            }
        }
    }

    /// Returns every layer that a scene with these light groups can have, in the order of the
    /// documentation.
    pub fn all(groups: &LightGroups) -> Vec<Self> {
        let mut all: Vec<Self> = SINGLE.iter().map(|(layer, _)| *layer).collect();
        all.extend((0..groups.names.len()).flat_map(|g| [Self::Light(g), Self::Shadow(g)]));
        all.sort();
        all
    }

    /// Returns the layers that a word selects: a name, or a family such as `light`. `None` for an
    /// unknown word.
    pub fn from_word(word: &str, groups: &LightGroups) -> Option<Vec<Self>> {
        let all = Self::all(groups);
        let pick = |wanted: fn(&Self) -> bool| Some(all.iter().copied().filter(wanted).collect());
        match word {
            // Occlusion traces additional rays, so it is selected only by its own name.
            "all" => pick(|layer| *layer != Self::Occlusion),
            "components" => pick(|layer| (Self::Diffuse..=Self::Background).contains(layer)),
            "light" => pick(|layer| (Self::Light(0)..=Self::LightBackground).contains(layer)),
            "shadow" => pick(|layer| matches!(layer, Self::Shadow(_))),
            "cryptomatte" => pick(|layer| *layer >= Self::CryptoObject),
            word => all.into_iter().find(|layer| layer.name(groups) == word).map(|l| vec![l]),
        }
    }

    /// Returns true if the layer needs the light of each group separately.
    pub fn is_per_light(self) -> bool {
        matches!(self, Self::Light(_) | Self::Shadow(_))
    }

    /// Returns the help for an unknown `word`: the nearest name, or the list of names.
    pub fn help(word: &str, groups: &LightGroups) -> String {
        let names: Vec<String> = Self::all(groups).iter().map(|layer| layer.name(groups)).collect();
        let known = || FAMILIES.into_iter().chain(names.iter().map(String::as_str));
        let usual = match word.to_lowercase().as_str() {
            "depth" => Some("Z"),
            "normal" | "normals" => Some("N"),
            "position" | "point" => Some("P"),
            "occlusion" | "ambientocclusion" => Some("ao"),
            "basecolor" | "base" | "color" => Some("albedo"),
            "crypto" | "mattes" => Some("cryptomatte"),
            _ => None,
        };
        match usual.or_else(|| nearest(word, known())) {
            Some(near) => format!("did you mean `{near}`?"),
            None => format!("layers: {}", known().collect::<Vec<_>>().join(" ")),
        }
    }
}
