//! The layers of a scene: the channels that they add to the beauty (R, G, B, A), and the positions
//! of these channels in the words of a pixel.

mod faces;
mod mattes;
mod names;
mod partial_sums;
mod pixel_layout;

pub use self::faces::FaceCounts;
pub use self::mattes::Mattes;
pub use self::partial_sums::{BEAUTY, PartialSumsLayout, PixelState};
pub use self::pixel_layout::{MISS_DEPTH, MatteLayout, NearestHit, PixelLayout, count};

use std::sync::Arc;

use crate::film::{Channel, ChannelKind};
use crate::scene::{Layer, Scene};

/// The position of each layer among the words of a pixel: the index of its first channel.
///
/// The first [`PixelLayout::filtered`] words are means over the camera samples (box filter, as for
/// the beauty). The other words are not filtered: they come from the nearest hit, or are counts of
/// samples, variances or mattes.
#[derive(Debug, Clone, Default)]
pub struct LayerPlan {
    /// All channels, and the positions of those that need no scene.
    pub layout: PixelLayout,
    /// Shading normal: 3 channels.
    pub normal: Option<usize>,
    /// Geometric normal: 3 channels.
    pub geometric_normal: Option<usize>,
    /// Shading normal in camera space: 3 channels.
    pub camera_normal: Option<usize>,
    /// Facing ratio: 1 channel.
    pub facing: Option<usize>,
    /// Base colour: 3 channels.
    pub albedo: Option<usize>,
    /// Texture coordinates, and the share of samples that have them: 3 channels.
    pub uv: Option<usize>,
    /// Ambient occlusion: 1 channel.
    pub occlusion: Option<usize>,
    /// Diffuse light of the first hit: 3 channels.
    pub diffuse: Option<usize>,
    /// Specular light of the first hit: 3 channels.
    pub specular: Option<usize>,
    /// Ambient light of the first hit: 3 channels.
    pub ambient: Option<usize>,
    /// Light from mirrors: 3 channels.
    pub reflection: Option<usize>,
    /// Background of camera rays: 3 channels.
    pub background: Option<usize>,
    /// For each light, the light of its group: 3 channels.
    pub lights: Vec<Option<usize>>,
    /// Ambient light, also in mirrors: 3 channels.
    pub light_ambient: Option<usize>,
    /// Background, also in mirrors: 3 channels.
    pub light_background: Option<usize>,
    /// For each light, the visibility of its group (1 channel), and the weight of the light in it:
    /// one over the number of lights in the group.
    pub shadows: Vec<Option<(usize, f32)>>,
    /// For each light, the alpha of its group's shadows on shadow catchers: 1 channel. Empty if the
    /// scene has no shadow catchers.
    pub caught: Vec<Option<usize>>,
    /// Mattes of shapes and of materials.
    pub mattes: Vec<Mattes>,
    /// Counts of the primitives that the camera sees. They are no channels.
    pub faces: Option<Arc<FaceCounts>>,
}

impl LayerPlan {
    /// Makes the plan for the layers that a scene selects.
    pub fn new(scene: &Scene) -> Self {
        let groups = &scene.light_groups;
        let mut plan = Self::default();
        let mut light = vec![None; groups.names.len()];
        let mut shadow = vec![None; groups.names.len()];
        // `PixelLayout::filtered` requires that means come first.
        let (means, others): (Vec<Layer>, Vec<Layer>) =
            scene.layers.iter().partition(|layer| is_mean(**layer));
        for layer in means {
            let first = Some(plan.layout.channels.len());
            let suffixes = match layer {
                Layer::Shadow(_) if scene.has_catchers() => &["Y", "A"],
                layer => suffixes(layer),
            };
            plan.add(&layer.name(groups), suffixes, kind(layer));
            match layer {
                Layer::Normal => plan.normal = first,
                Layer::GeometricNormal => plan.geometric_normal = first,
                Layer::CameraNormal => plan.camera_normal = first,
                Layer::Facing => plan.facing = first,
                Layer::Albedo => plan.albedo = first,
                Layer::Uv => plan.uv = first,
                Layer::Occlusion => plan.occlusion = first,
                Layer::Diffuse => plan.diffuse = first,
                Layer::Specular => plan.specular = first,
                Layer::Ambient => plan.ambient = first,
                Layer::Reflection => plan.reflection = first,
                Layer::Background => plan.background = first,
                Layer::LightAmbient => plan.light_ambient = first,
                Layer::LightBackground => plan.light_background = first,
                Layer::Light(group) => light[group] = first,
                Layer::Shadow(group) => shadow[group] = first,
                _ => {}
            }
        }
        plan.layout.filtered = plan.layout.channels.len();
        plan.lights = groups.of.iter().map(|&group| light[group]).collect();
        let members = |group: usize| groups.of.iter().filter(|&&g| g == group).count();
        let shares = groups.of.iter().map(|&g| Some((shadow[g]?, 1.0 / members(g) as f32)));
        plan.shadows = shares.collect();
        let caught = groups.of.iter().map(|&g| Some(shadow[g]? + 1));
        plan.caught = caught.filter(|_| scene.has_catchers()).collect();
        for layer in others {
            let first = Some(plan.layout.channels.len());
            match layer {
                Layer::CryptoObject => plan.mattes.push(Mattes::objects(scene)),
                Layer::CryptoMaterial => plan.mattes.push(Mattes::materials(scene)),
                Layer::Depth => plan.layout.depth = first,
                Layer::Distance => plan.layout.distance = first,
                Layer::Position => plan.layout.position = first,
                Layer::Primitive => plan.layout.primitive = first,
                Layer::Object => plan.layout.object = first,
                Layer::Variance => plan.layout.variance = first,
                Layer::Samples => plan.layout.samples = first,
                _ => {}
            }
            match layer {
                Layer::CryptoObject | Layer::CryptoMaterial => {}
                Layer::Depth => plan.add("", &["Z"], ChannelKind::Float),
                layer => plan.add(&layer.name(groups), suffixes(layer), kind(layer)),
            }
        }
        for mattes in &plan.mattes {
            let (first, ranks) = (plan.layout.channels.len(), scene.crypto_ranks as usize);
            plan.layout.mattes.push(MatteLayout { first, ranks, ids: mattes.ids() });
            plan.layout.channels.extend(mattes.channels(ranks));
        }
        plan
    }

    /// Returns true if there is nothing to record in addition to the beauty.
    pub fn is_empty(&self) -> bool {
        self.layout.channels.is_empty() && self.faces.is_none()
    }

    fn add(&mut self, layer: &str, suffixes: &[&str], kind: ChannelKind) {
        for suffix in suffixes {
            let name = match layer {
                "" => (*suffix).to_string(),
                layer => format!("{layer}.{suffix}"),
            };
            self.layout.channels.push(Channel { name, kind });
        }
    }
}

/// Returns true if a layer is the mean over a pixel's camera samples. The order of the variants of
/// [`Layer`] puts these between `Normal` and `Shadow`.
fn is_mean(layer: Layer) -> bool {
    (Layer::Normal..=Layer::Shadow(usize::MAX)).contains(&layer)
}

fn suffixes(layer: Layer) -> &'static [&'static str] {
    match layer {
        Layer::Position | Layer::Normal | Layer::GeometricNormal | Layer::CameraNormal => {
            &["X", "Y", "Z"]
        }
        // The order and the third channel follow the UV pass of Blender.
        Layer::Uv => &["U", "V", "A"],
        Layer::Shadow(_) | Layer::Samples | Layer::Distance | Layer::Facing | Layer::Occlusion => {
            &["Y"]
        }
        Layer::Primitive | Layer::Object => &["id"],
        _ => &["R", "G", "B"],
    }
}

fn kind(layer: Layer) -> ChannelKind {
    match layer {
        Layer::Primitive | Layer::Object => ChannelKind::Uint,
        Layer::Distance | Layer::Position | Layer::Uv => ChannelKind::Float,
        Layer::Variance | Layer::Samples => ChannelKind::Float,
        _ => ChannelKind::Half,
    }
}

#[cfg(test)]
mod tests;
