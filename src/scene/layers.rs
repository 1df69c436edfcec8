//! Names of layers: what a scene may ask for in `output.layers`, and the light groups it has.

use super::nearest::nearest;

/// A layer of the EXR beside the beauty.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Layer {
    /// Depth along the camera's axis, world units, positive in front; 1e30 on a miss.
    Depth,
    /// World position.
    Position,
    /// Shading normal, world space.
    Normal,
    /// Geometric normal, world space.
    GeometricNormal,
    /// Base colour.
    Albedo,
    /// Texture coordinates.
    Uv,
    /// Diffuse light of the first hit.
    Diffuse,
    /// Specular light of the first hit.
    Specular,
    /// Ambient light of the first hit.
    Ambient,
    /// All that comes from mirrors.
    Reflection,
    /// What camera rays see that leave the scene.
    Background,
    /// All light of a group, by its index in [`LightGroups::names`].
    Light(usize),
    /// All ambient light, also in mirrors.
    LightAmbient,
    /// All background, also in mirrors.
    LightBackground,
    /// The share of a group's light points that the first hit sees.
    Shadow(usize),
    /// Variance of the samples' colours.
    Variance,
    /// Camera samples.
    Samples,
    /// Number of the primitive, from 1.
    Primitive,
    /// Number of the shape, from 1.
    Object,
    /// Cryptomatte of shapes.
    CryptoObject,
    /// Cryptomatte of materials.
    CryptoMaterial,
}

/// Layers of which there is one, in the order of the docs.
const SINGLE: [(Layer, &str); 19] = [
    (Layer::Depth, "Z"),
    (Layer::Position, "P"),
    (Layer::Normal, "N"),
    (Layer::GeometricNormal, "Ng"),
    (Layer::Albedo, "albedo"),
    (Layer::Uv, "uv"),
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

/// Words for several layers.
const FAMILIES: [&str; 5] = ["all", "components", "light", "shadow", "cryptomatte"];

/// The light groups of a scene.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct LightGroups {
    /// Their names as they stand behind `light_`, in the order of their first lights.
    pub names: Vec<String>,
    /// Index of its group, for each light.
    pub of: Vec<usize>,
}

impl LightGroups {
    /// The groups of lights with these groups and names; a light without either is called by its number
    /// from 1. Also the lights, by index, whose names collide with others', and why.
    pub fn new<'a>(
        lights: impl IntoIterator<Item = (Option<&'a str>, Option<&'a str>)>,
    ) -> (Self, Vec<(usize, String)>) {
        let mut groups = Self::default();
        let mut sources: Vec<(bool, &str)> = Vec::new();
        let mut collisions = Vec::new();
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
            let known = groups.names.iter().position(|name| *name == label);
            let same = known.is_some_and(|k| source.0 && sources[k] == source);
            if matches!(label.as_str(), "ambient" | "background") || known.is_some() && !same {
                collisions.push((i, label.clone()));
            }
            groups.of.push(known.unwrap_or(groups.names.len()));
            if known.is_none() {
                groups.names.push(label);
                sources.push(source);
            }
        }
        (groups, collisions)
    }
}

/// A name as it may stand in a layer's: letters, digits and underscores.
fn label(text: &str) -> String {
    text.chars().map(|c| if c.is_ascii_alphanumeric() { c } else { '_' }).collect()
}

impl Layer {
    /// Its name in the file.
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

    /// Every layer that a scene with these light groups can have, in the order of the docs.
    pub fn all(groups: &LightGroups) -> Vec<Self> {
        let mut all: Vec<Self> = SINGLE.iter().map(|(layer, _)| *layer).collect();
        all.extend((0..groups.names.len()).flat_map(|g| [Self::Light(g), Self::Shadow(g)]));
        all.sort();
        all
    }

    /// The layers that a word names; `None` for an unknown one.
    pub fn named(word: &str, groups: &LightGroups) -> Option<Vec<Self>> {
        let all = Self::all(groups);
        let pick = |wanted: fn(&Self) -> bool| Some(all.iter().copied().filter(wanted).collect());
        match word {
            "all" => Some(all),
            "components" => pick(|layer| (Self::Diffuse..=Self::Background).contains(layer)),
            "light" => pick(|layer| (Self::Light(0)..=Self::LightBackground).contains(layer)),
            "shadow" => pick(|layer| matches!(layer, Self::Shadow(_))),
            "cryptomatte" => pick(|layer| *layer >= Self::CryptoObject),
            word => all.into_iter().find(|layer| layer.name(groups) == word).map(|l| vec![l]),
        }
    }

    /// Whether it needs to know which light is which.
    pub fn of_lights(self) -> bool {
        matches!(self, Self::Light(_) | Self::Shadow(_))
    }

    /// What a message offers instead of an unknown `word`.
    pub fn help(word: &str, groups: &LightGroups) -> String {
        let names: Vec<String> = Self::all(groups).iter().map(|layer| layer.name(groups)).collect();
        let known = || FAMILIES.into_iter().chain(names.iter().map(String::as_str));
        let usual = match word.to_lowercase().as_str() {
            "depth" | "distance" => Some("Z"),
            "normal" | "normals" => Some("N"),
            "position" | "point" => Some("P"),
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
