//! Materials and the images they name; each image is opened once.

use std::collections::HashMap;

use crate::error::{Failures, Problem, Result};
use crate::scene::{Filter, Scene, TextureUse};
use crate::shading::{DEFAULT_MAX_BYTES, Material, Texture};

/// Loads the textures of the materials that shapes use, into at most `budget` bytes.
pub fn load(
    scene: &Scene,
    budget: Option<u64>,
    warnings: &mut Vec<Problem>,
) -> Result<(Vec<Texture>, Vec<Material>)> {
    let mut left = budget;
    let mut used = vec![false; scene.materials.len()];
    for shape in &scene.shapes {
        used[shape.material] = true;
    }
    let mut failures = Failures::default();
    let mut textures = Vec::new();
    let mut loaded = HashMap::new();
    let mut materials = Vec::with_capacity(scene.materials.len());
    for (index, m) in scene.materials.iter().enumerate() {
        let texture = match m.texture.as_ref().filter(|_| used[index]) {
            None => None,
            Some(spec) => {
                let key = (spec.path.clone(), spec.color_space);
                // A file that failed is opened and reported once.
                let slot = *loaded.entry(key).or_insert_with(|| {
                    let most = left.map_or(DEFAULT_MAX_BYTES, |left| left.min(DEFAULT_MAX_BYTES));
                    let texture = Texture::load_within(&spec.path, spec.color_space, most);
                    let texture = failures.keep(texture)?;
                    left = left.map(|left| left.saturating_sub(texture.bytes()));
                    textures.push(texture);
                    Some(textures.len() as u32 - 1)
                });
                if let Some(slot) = slot {
                    warn(spec, &textures[slot as usize], warnings);
                }
                slot
            }
        };
        let spec = m.texture.as_ref();
        materials.push(Material {
            kd: m.kd,
            ks: m.ks,
            ka: m.ka,
            kr: m.kr,
            exponent: m.specular_exponent,
            base: m.diffuse_color,
            texture,
            filter: spec.map_or(Filter::Bilinear, |t| t.filter),
            wrap: spec.and_then(|t| t.wrap),
            uv_scale: spec.map_or(glam::Vec2::ONE, |t| t.scale),
        });
    }
    failures.check()?;
    Ok((textures, materials))
}

fn warn(spec: &TextureUse, texture: &Texture, warnings: &mut Vec<Problem>) {
    let sizes = [("tWidth", texture.width()), ("tHeight", texture.height())];
    for ((key, size), declared) in sizes.into_iter().zip(spec.declared_size) {
        if let Some(declared) = declared.filter(|&d| d != size) {
            let message = format!(
                "`{key}` is {declared}, but {} has {size}; {size} is used",
                spec.path.display()
            );
            warnings.push(Problem::new(&spec.place, message));
        }
    }
    if texture.had_alpha() {
        let message = format!("the alpha channel of {} is ignored", spec.path.display());
        warnings.push(Problem::new(&spec.place, message));
    }
}
