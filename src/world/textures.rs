//! Loads the materials and their images; each image is opened once.

use std::collections::HashMap;
use std::path::{Path, PathBuf};

use crate::error::{Failures, Problem, Result};
use crate::mesh::Mesh;
use crate::reserve::MemoryLimit;
use crate::scene::{ColorSpace, Filter, Scene, TextureUse};
use crate::shading::{DEFAULT_MAX_BYTES, Material, Negative, Texture};

use super::sources::{ReadFiles, beside};

/// Loads the textures of the materials that shapes use, within `budget`.
pub fn load(
    scene: &Scene,
    budget: Option<MemoryLimit>,
    read: &mut ReadFiles,
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
                    let texture = one(&spec.path, spec.color_space, left);
                    let texture = failures.keep(texture)?;
                    left = left.map(|left| left.less(texture.bytes()));
                    read.0.push((spec.path.clone(), texture.stamp()));
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
            uv_scale: spec.map_or(glam::DVec2::ONE, |t| t.scale),
        });
    }
    failures.check()?;
    Ok((textures, materials))
}

/// Loads one image within the memory that is left.
fn one(path: &Path, space: Option<ColorSpace>, left: Option<MemoryLimit>) -> Result<Texture> {
    let most = match left {
        Some(left) if left.asked => left.bytes.min(DEFAULT_MAX_BYTES),
        // Too little free memory here: the file may be fine on another machine, so this error is
        // retryable. An image above the fixed limit fails below.
        Some(left) if left.bytes < DEFAULT_MAX_BYTES => {
            let needed = Texture::size(path)?.decoding;
            if needed <= DEFAULT_MAX_BYTES {
                left.check(needed, &path.display().to_string())?;
            }
            DEFAULT_MAX_BYTES
        }
        _ => DEFAULT_MAX_BYTES,
    };
    Texture::load_within(path, space, most)
}

/// Index of a shape, and the image that its mesh file names.
pub type Own = (usize, PathBuf);

/// A warning if a mesh names several images, because only one of them is used.
pub fn several_textures_warning(mesh: &Mesh, path: &Path) -> Option<Problem> {
    let (count, shown) = (mesh.notes.texture_files, mesh.texture_file.as_ref()?);
    let message = format!("found {count} texture files; only {shown:?} is used");
    (count > 1).then(|| Problem::new(path.display().to_string(), message))
}

/// The image that the mesh at `path` names, if it can be shown. For meshes whose material has no
/// texture.
pub fn own(mesh: &Mesh, shape: usize, path: &Path, warnings: &mut Vec<Problem>) -> Option<Own> {
    let name = mesh.texture_file.as_ref().filter(|_| mesh.uvs.is_some())?;
    let image = beside(path, name);
    if image.is_file() {
        warnings.extend(several_textures_warning(mesh, path));
        return Some((shape, image));
    }
    let place = path.display().to_string();
    let reason = format!("there is no file {}", image.display());
    let message = format!("the texture {name:?} is not used: {reason}");
    warnings.push(Problem::new(place, message));
    None
}

/// Loads the images that meshes name, and creates a material with its image for each of these
/// shapes. Returns pairs of shape and material. All textures together take at most `budget` bytes.
pub fn load_own(
    own: &[Own],
    scene: &Scene,
    budget: Option<MemoryLimit>,
    looks: &mut (Vec<Texture>, Vec<Material>),
    (read, warnings): (&mut ReadFiles, &mut Vec<Problem>),
) -> Result<Vec<(usize, u32)>> {
    let (textures, materials) = looks;
    let mut failures = Failures::default();
    let mut given = Vec::new();
    for (shape, path) in own {
        let taken: u64 = textures.iter().map(Texture::bytes).sum();
        let texture = one(path, None, budget.map(|budget| budget.less(taken)));
        let Some(texture) = failures.keep(texture) else { continue };
        let place = path.display().to_string();
        warn_of_negative(&place, path, &texture, warnings);
        read.0.push((path.clone(), texture.stamp()));
        let plain = &materials[scene.shapes[*shape].material];
        let material = Material { texture: Some(textures.len() as u32), ..plain.clone() };
        textures.push(texture);
        given.push((*shape, materials.len() as u32));
        materials.push(material);
    }
    failures.check()?;
    Ok(given)
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
    warn_of_negative(&spec.place, &spec.path, texture, warnings);
}

/// Warns of texels below 0: no real surface has them, and they make radiance negative.
fn warn_of_negative(place: &str, path: &Path, texture: &Texture, warnings: &mut Vec<Problem>) {
    let Some(Negative { texels, first: [x, y] }) = texture.negative() else { return };
    let message = format!(
        "{texels} texels of {} are negative, the first at ({x}, {y}); they are kept, so the surfaces \
         they cover have negative radiance",
        path.display()
    );
    let help = "a colour is at least 0: clip the image, or convert it to a wider gamut";
    warnings.push(Problem::new(place, message).help(help));
}
