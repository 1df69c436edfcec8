//! Checks the materials: resolves names, checks that textures exist.

use std::collections::BTreeMap;

use crate::nearest::{did_you_mean, list};
use crate::scene::checked::{CheckedMaterial, TextureLookup, TextureUse};
use crate::scene::description::{MaterialDescription, MaterialUse};
use crate::scene::document::join;
use crate::scene::expected::quoted;
use crate::scene::node::NodeKind;

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
        let document = self.document;
        let Some(NodeKind::Object(members)) = document.get("/scene/materials").map(|n| &n.kind)
        else {
            return materials;
        };
        for member in members.iter().filter(|m| m.key != "comment") {
            let pointer = join("/scene/materials", &member.key);
            // An invalid material keeps its name. Otherwise every use of it would be an error too.
            let written = self.part(&pointer).unwrap_or_default();
            let material = self.material(&pointer, Some(&member.key), &written);
            materials.names.insert(member.key.clone(), (materials.all.len(), false));
            materials.all.push(material);
        }
        materials
    }

    /// Warns about materials that no shape uses.
    pub(super) fn unused(&mut self, materials: &Materials) {
        for (name, (_, used)) in &materials.names {
            if !used {
                let message = unused_material(name);
                self.problems.warn(&join("/scene/materials", name), message, None);
            }
        }
    }

    /// Returns the index of the material of a shape, and stores an inline one. `None` after an
    /// error.
    pub(super) fn material_of(&mut self, shape: &str, materials: &mut Materials) -> Option<usize> {
        let pointer = format!("{shape}/material");
        match self.part::<MaterialUse>(&pointer)? {
            MaterialUse::Inline(material) => {
                let material = self.material(&pointer, None, &material);
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

    fn material(
        &mut self,
        pointer: &str,
        name: Option<&String>,
        written: &MaterialDescription,
    ) -> CheckedMaterial {
        let has = |key: &str| self.document.get(&format!("{pointer}/{key}")).is_some();
        if has("specularexponent") && !has("ks") {
            let message = "found `specularexponent` without `ks`; it has no effect";
            self.problems.warn(&format!("{pointer}/specularexponent"), message, None);
        }
        CheckedMaterial {
            name: name.cloned(),
            kd: written.kd as f32,
            ks: written.ks as f32,
            ka: written.ka as f32,
            kr: written.kr as f32,
            specular_exponent: written.specularexponent as f32,
            diffuse_color: written.diffusecolor.vec(),
            texture: self.texture(pointer, written),
            lookup: self.lookup(pointer, written),
        }
    }

    fn texture(&mut self, pointer: &str, written: &MaterialDescription) -> Option<TextureUse> {
        let Some(name) = &written.texture_path else {
            self.sizes_without_path(pointer);
            return None;
        };
        let place = format!("{pointer}/tPath");
        let path = self.file(&place, &name.0, "an image");
        Some(TextureUse {
            place: self.document.place(&place),
            path,
            declared_size: [written.texture_width, written.texture_height],
        })
    }

    fn lookup(&self, pointer: &str, written: &MaterialDescription) -> TextureLookup {
        let keys = ["filter", "wrap", "colorspace", "tScale"];
        let pointers = keys.map(|key| (key, format!("{pointer}/{key}"))).into_iter();
        let has = pointers.filter(|(_, at)| self.document.get(at).is_some());
        TextureLookup {
            places: has.map(|(key, at)| (key, self.document.place(&at))).collect(),
            filter: written.filter,
            wrap: written.wrap,
            color_space: written.colorspace,
            scale: written.texture_scale.into(),
        }
    }

    fn sizes_without_path(&mut self, pointer: &str) {
        for key in ["tWidth", "tHeight"] {
            let at = format!("{pointer}/{key}");
            if self.document.get(&at).is_some() {
                let message = format!("found `{key}` without `tPath`; it has no effect");
                self.problems.warn(&at, message, None);
            }
        }
    }
}
