//! Checks the materials: resolves names, checks that textures exist.

use std::collections::BTreeMap;

use crate::nearest::{did_you_mean, list};
use crate::scene::checked::{CheckedMaterial, TextureLookup, TextureUse};
use crate::scene::description::{MaterialDescription, MaterialUse};
use crate::scene::document::{Document, join};
use crate::scene::expected::quoted;
use crate::scene::node::{JsonNode, Member, NodeKind};

use super::context::Check;

/// All materials of a scene, with their names.
pub(super) struct Materials {
    /// Named materials in file order, then inline ones.
    pub all: Vec<CheckedMaterial>,
    /// Index of each named material, and whether a shape uses it.
    names: BTreeMap<String, (usize, bool)>,
}

/// Returns the warning about a material of the scene file that no shape uses.
pub fn unused_material(name: &str) -> String {
    format!("found the material {name:?}, which no shape uses")
}

impl Check<'_, '_> {
    /// Checks `/scene/materials` and makes the named materials.
    pub(super) fn named_materials(&mut self) -> Materials {
        let mut materials = Materials { all: Vec::new(), names: BTreeMap::new() };
        for member in named(self.document) {
            let pointer = join("/scene/materials", &member.key);
            // An invalid material keeps its name. Otherwise every use of it would be an error too.
            let written = self.part_at(&pointer, &member.value).unwrap_or_default();
            let material = self.material((&pointer, &member.value), Some(&member.key), &written);
            materials.names.insert(member.key.clone(), (materials.all.len(), false));
            materials.all.push(material);
        }
        materials
    }

    /// Warns about materials that no shape uses.
    pub(super) fn unused(&mut self, materials: &Materials) {
        for Member { key, value, .. } in named(self.document) {
            if materials.names.get(key).is_some_and(|(_, used)| !used) {
                let pointer = join("/scene/materials", key);
                self.problems.warn_at(&value.place, &pointer, unused_material(key), None);
            }
        }
    }

    /// Returns the index of the material of a shape, and stores an inline one. `None` after an
    /// error.
    pub(super) fn material_of(&mut self, shape: &str, materials: &mut Materials) -> Option<usize> {
        let pointer = format!("{shape}/material");
        let node = self.document.get(&pointer)?;
        match self.part_at::<MaterialUse>(&pointer, node)? {
            MaterialUse::Inline(material) => {
                let material = self.material((&pointer, node), None, &material);
                materials.all.push(material);
                Some(materials.all.len() - 1)
            }
            MaterialUse::Named(name) => {
                if let Some((index, used)) = materials.names.get_mut(&name.0) {
                    *used = true;
                    return Some(*index);
                }
                let known: Vec<&str> = materials.names.keys().map(String::as_str).collect();
                let help = did_you_mean(&name.0, known.iter().copied());
                let wanted = match known.len() {
                    0 => "a material under /scene/materials or an inline one".to_string(),
                    1..=20 => list(known),
                    n => format!("one of the {n} names under /scene/materials"),
                };
                let message =
                    format!("found the unknown material {}, expected {wanted}", quoted(&name.0));
                self.problems.error(&pointer, message, help);
                None
            }
        }
    }

    /// Makes the material at `pointer`, which `node` holds. A search for the pointer would compare
    /// the names of all materials.
    fn material(
        &mut self,
        (pointer, node): (&str, &JsonNode),
        name: Option<&String>,
        written: &MaterialDescription,
    ) -> CheckedMaterial {
        if let (Some(exponent), None) = (node.member("specularexponent"), node.member("ks")) {
            let message = "found `specularexponent` without `ks`; it has no effect";
            let at = format!("{pointer}/specularexponent");
            self.problems.warn_at(&exponent.place, &at, message, None);
        }
        CheckedMaterial {
            name: name.cloned(),
            kd: written.kd as f32,
            ks: written.ks as f32,
            ka: written.ka as f32,
            kr: written.kr as f32,
            specular_exponent: written.specularexponent as f32,
            diffuse_color: written.diffusecolor.vec(),
            texture: self.texture((pointer, node), written),
            lookup: self.lookup((pointer, node), written),
        }
    }

    fn texture(
        &mut self,
        (pointer, node): (&str, &JsonNode),
        written: &MaterialDescription,
    ) -> Option<TextureUse> {
        let Some(name) = &written.texture_path else {
            self.sizes_without_path((pointer, node));
            return None;
        };
        let at = format!("{pointer}/tPath");
        let path = self.file(&at, &name.0, "an image");
        let place = &node.member("tPath").unwrap_or(node).place;
        Some(TextureUse {
            place: self.document.describe(place, &at),
            path,
            declared_size: [written.texture_width, written.texture_height],
        })
    }

    fn lookup(
        &self,
        (pointer, node): (&str, &JsonNode),
        written: &MaterialDescription,
    ) -> TextureLookup {
        let place = |key: &'static str| {
            let place = &node.member(key)?.place;
            Some((key, self.document.describe(place, &format!("{pointer}/{key}"))))
        };
        let keys = ["filter", "wrap", "colorspace", "tScale"];
        TextureLookup {
            places: keys.into_iter().filter_map(place).collect(),
            filter: written.filter,
            wrap: written.wrap,
            color_space: written.colorspace,
            scale: written.texture_scale.into(),
        }
    }

    fn sizes_without_path(&mut self, (pointer, node): (&str, &JsonNode)) {
        for key in ["tWidth", "tHeight"] {
            if let Some(size) = node.member(key) {
                let message = format!("found `{key}` without `tPath`; it has no effect");
                self.problems.warn_at(&size.place, &format!("{pointer}/{key}"), message, None);
            }
        }
    }
}

/// Returns the materials of the scene that have a name.
fn named(document: &Document) -> impl Iterator<Item = &Member> {
    let members = match document.get("/scene/materials").map(|node| &node.kind) {
        Some(NodeKind::Object(members)) => &members[..],
        _ => &[],
    };
    members.iter().filter(|member| member.key != "comment")
}
