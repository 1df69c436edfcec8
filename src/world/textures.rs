//! Loads the materials and their images. An image is opened once for each colour space in which it
//! is used.

use std::collections::{BTreeSet, HashMap};
use std::path::{Path, PathBuf};

use crate::error::{Failures, Problem, Result};
use crate::mesh::{self, Mesh};
use crate::reserve::MemoryLimit;
use crate::scene::{ColorSpace, Filter, Scene, TextureLookup, TextureUse};
use crate::shading::{
    DEFAULT_MAX_BYTES, ImageRequest, Material, Negative, Texture, TextureChoice, TexturesByFace,
    WHOLE_TEXELS,
};
use crate::units::{self, plural};

use super::sources::{LoadLog, OwnImage, own_image};

/// Memory that textures may take.
#[derive(Debug, Clone, Copy)]
pub struct TextureLimits {
    /// Memory of all textures, decoding included.
    pub budget: Option<MemoryLimit>,
    /// Most texels of an image that is held whole.
    pub whole: u64,
}

impl TextureLimits {
    /// `whole` is [`WHOLE_TEXELS`] if it is `None`.
    pub fn new(budget: Option<MemoryLimit>, whole: Option<u64>) -> Self {
        Self { budget, whole: whole.unwrap_or(WHOLE_TEXELS) }
    }

    fn less(self, bytes: u64) -> Self {
        Self { budget: self.budget.map(|budget| budget.less(bytes)), ..self }
    }
}

/// Loads the textures of the materials that shapes use, within `limits`. Also returns all materials
/// of the scene.
///
/// # Errors
/// All images that cannot be read or do not fit.
pub(super) fn load(
    scene: &Scene,
    limits: TextureLimits,
    log: &mut LoadLog,
) -> Result<(Vec<Texture>, Vec<Material>)> {
    let mut left = limits;
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
                let space = m.lookup.color_space;
                let key = (spec.path.clone(), space);
                // A file that failed is opened and reported once.
                let slot = *loaded.entry(key).or_insert_with(|| {
                    let texture = one(&spec.path, space, left);
                    let texture = failures.keep(texture)?;
                    left = left.less(texture.bytes());
                    log.read.0.push((spec.path.clone(), texture.file().stamp));
                    textures.push(texture);
                    Some(textures.len() as u32 - 1)
                });
                if let Some(slot) = slot {
                    warn(spec, &textures[slot as usize], &mut log.warnings);
                }
                slot
            }
        };
        materials.push(Material {
            kd: m.kd,
            ks: m.ks,
            ka: m.ka,
            kr: m.kr,
            exponent: m.specular_exponent,
            base: m.diffuse_color,
            texture: texture.map(TextureChoice::One),
            filter: m.lookup.filter.unwrap_or(Filter::Bilinear),
            wrap: m.lookup.wrap,
            uv_scale: m.lookup.scale,
        });
    }
    failures.check()?;
    Ok((textures, materials))
}

/// Loads one image within the memory that is left.
fn one(path: &Path, space: Option<ColorSpace>, left: TextureLimits) -> Result<Texture> {
    let max_bytes = match left.budget {
        Some(budget) if budget.set_by_user => budget.bytes.min(DEFAULT_MAX_BYTES),
        // The limit is the free memory of this machine. The image may fit on another machine, so
        // this error is retryable. An image above the fixed limit fails below.
        Some(budget) if budget.bytes < DEFAULT_MAX_BYTES => {
            let needed = Texture::size_in_tiles(path, left.whole)?.decoding;
            if needed <= DEFAULT_MAX_BYTES {
                budget.check(needed, &path.display().to_string())?;
            }
            DEFAULT_MAX_BYTES
        }
        _ => DEFAULT_MAX_BYTES,
    };
    Texture::load(ImageRequest { path, color_space: space, max_bytes, whole: left.whole })
}

/// The images that a mesh file names, for a shape whose material has no texture.
pub struct MeshImages {
    shape: usize,
    /// Paths of the images. `None` for an image that no triangle uses or that does not exist.
    images: Vec<Option<PathBuf>>,
    /// For each triangle, an index into `images` or `NO_TEXTURE`. `None` if all triangles have the
    /// one image.
    indices: Option<Vec<u16>>,
}

/// A new material for a shape, with the images that the mesh names.
pub struct MeshMaterial {
    /// Index of the shape.
    pub shape: usize,
    /// Index of the new material.
    pub material: u32,
    /// Textures of the triangles, if they have different ones.
    pub textures: Option<TexturesByFace>,
}

/// Returns a warning if a mesh names several images and only one of them is used.
pub fn several_textures_warning(mesh: &Mesh, path: &Path) -> Option<Problem> {
    let (count, shown) = (mesh.notes.texture_files, mesh.texture_file.as_ref()?);
    let message = format!("found {count} texture files; only \"{shown}\" is used");
    let only_one = count > 1 && mesh.textures.is_none();
    only_one.then(|| Problem::new(path.display().to_string(), message))
}

/// Returns a warning that the image `name` of the mesh at `path` is not where the mesh says, and
/// that `image` is shown.
pub fn moved_texture_warning(path: &Path, name: &str, image: &Path) -> Problem {
    let message = format!("there is no texture \"{name}\"; {} is used", image.display());
    Problem::new(path.display().to_string(), message)
}

/// Returns the images that the mesh at `path` names. `None` if the mesh has no texture coordinates,
/// or names no image or only one that does not exist. Takes the indices of the triangles' textures
/// out of the mesh.
///
/// # Errors
/// As for [`own_image`].
pub fn mesh_images(
    mesh: &mut Mesh,
    shape: usize,
    path: &Path,
    warnings: &mut Vec<Problem>,
) -> Result<Option<MeshImages>> {
    let mut image = |name: &str| {
        // The header has this character for bytes that are not UTF-8.
        let is_utf8 = !name.contains(char::REPLACEMENT_CHARACTER);
        let reason = match own_image(path, name)? {
            _ if !is_utf8 => "its name is not UTF-8".to_string(),
            OwnImage::Named(image) => return Ok(Some(image)),
            OwnImage::Moved(image) => {
                warnings.push(moved_texture_warning(path, name, &image));
                return Ok(Some(image));
            }
            OwnImage::Missing(image) => format!("there is no file {}", image.display()),
        };
        let message = format!("the texture \"{name}\" is not used: {reason}");
        warnings.push(Problem::new(path.display().to_string(), message));
        Ok(None)
    };
    if mesh.uvs.is_none() {
        return Ok(None);
    }
    if let Some(mesh::FaceTextures { files, indices }) = mesh.textures.take() {
        let mut used = vec![false; files.len()];
        for &number in &indices {
            if let Some(used) = used.get_mut(usize::from(number)) {
                *used = true;
            }
        }
        let named = files.iter().zip(used);
        let images = named.map(|(name, used)| if used { image(name) } else { Ok(None) });
        let images = images.collect::<Result<_>>()?;
        return Ok(Some(MeshImages { shape, images, indices: Some(indices) }));
    }
    let Some(name) = &mesh.texture_file else { return Ok(None) };
    let Some(image) = image(name)? else { return Ok(None) };
    warnings.extend(several_textures_warning(mesh, path));
    Ok(Some(MeshImages { shape, images: vec![Some(image)], indices: None }))
}

/// Loads the images that meshes name, and appends a material with them for each of these shapes.
/// All textures together stay within `limits`. Warns of texture settings that concern no image.
///
/// # Errors
/// All images that cannot be read or do not fit.
pub(super) fn load_mesh_images(
    mesh_images: Vec<MeshImages>,
    scene: &Scene,
    limits: TextureLimits,
    looks: &mut (Vec<Texture>, Vec<Material>),
    log: &mut LoadLog,
) -> Result<Vec<MeshMaterial>> {
    let (textures, materials) = looks;
    let mut failures = Failures::default();
    let mut mesh_materials = Vec::new();
    let mut applies = vec![false; scene.materials.len()];
    for MeshImages { shape, images, indices } in mesh_images {
        let material = scene.shapes[shape].material;
        applies[material] |= images.iter().any(Option::is_some);
        let lookup = &scene.materials[material].lookup;
        // A file may name an image twice.
        let mut loaded: HashMap<PathBuf, Option<u32>> = HashMap::new();
        let mut slots = Vec::with_capacity(images.len());
        for path in images {
            let Some(path) = path else {
                slots.push(None);
                continue;
            };
            let slot = match loaded.get(&path) {
                Some(slot) => *slot,
                None => {
                    let taken: u64 = textures.iter().map(Texture::bytes).sum();
                    let texture = one(&path, lookup.color_space, limits.less(taken));
                    failures.keep(texture).map(|texture| {
                        let place = path.display().to_string();
                        warn_of_texels(&place, &path, &texture, &mut log.warnings);
                        log.read.0.push((path.clone(), texture.file().stamp));
                        textures.push(texture);
                        textures.len() as u32 - 1
                    })
                }
            };
            loaded.insert(path, slot);
            slots.push(slot);
        }
        let texture = match (&indices, slots.first()) {
            (Some(_), _) => Some(TextureChoice::ByFace),
            (None, Some(Some(slot))) => Some(TextureChoice::One(*slot)),
            (None, _) => continue,
        };
        // A scan's texture has far more texels than a picture has pixels.
        let filter = lookup.filter.unwrap_or(Filter::Trilinear);
        let material = Material { texture, filter, ..materials[material].clone() };
        let textures = indices.map(|indices| TexturesByFace { indices, textures: slots });
        mesh_materials.push(MeshMaterial { shape, material: materials.len() as u32, textures });
        materials.push(material);
    }
    failures.check()?;
    log.warnings.extend(settings_without_images(scene, &applies));
    Ok(mesh_materials)
}

/// Returns a warning for each texture setting of a material that shapes use, and that has no
/// `tPath` and, by `applies`, no image of a mesh.
fn settings_without_images(scene: &Scene, applies: &[bool]) -> Vec<Problem> {
    let without = |index: &usize| !applies[*index] && scene.materials[*index].texture.is_none();
    let used: BTreeSet<usize> = scene.shapes.iter().map(|shape| shape.material).collect();
    let lookups = used.into_iter().filter(without).map(|index| &scene.materials[index].lookup);
    let warning = |(key, place): &(&str, String)| {
        let message = format!(
            "found `{key}` without `tPath`, and no mesh that names an image; it has no effect"
        );
        Problem::new(place, message)
    };
    lookups.flat_map(|TextureLookup { places, .. }| places).map(warning).collect()
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
    warn_of_texels(&spec.place, &spec.path, texture, warnings);
}

/// Warns of alpha, of a gamma chunk, of a large image in memory, and of texels below 0: no real
/// surface has them, and they make radiance negative.
fn warn_of_texels(place: &str, path: &Path, texture: &Texture, warnings: &mut Vec<Problem>) {
    if texture.file().had_alpha {
        let message = format!("the alpha channel of {} is ignored", path.display());
        warnings.push(Problem::new(place, message));
    }
    if let Some(gamma) = texture.file().ignored_gamma {
        let message = format!(
            "the gAMA chunk of {} ({gamma}) is ignored: it is read as sRGB",
            path.display()
        );
        let help = "set `colorspace` of the material to linear or srgb";
        warnings.push(Problem::new(place, message).help(help));
    }
    if texture.file().lacks_disk {
        let message = format!(
            "{} takes {} of memory: no disk has space for its temporary file",
            path.display(),
            units::bytes(texture.bytes())
        );
        warnings.push(Problem::new(place, message).help("set TMPDIR to a folder on a disk"));
    }
    let Some(Negative { texels, first: [x, y] }) = texture.file().negative else { return };
    let message = format!(
        "found {} in {}, the first at ({x}, {y}); such values are kept: surfaces have negative \
         radiance there",
        plural(texels as usize, "negative texel"),
        path.display()
    );
    let help = "a colour is at least 0: clip the image, or convert it to a wider gamut";
    warnings.push(Problem::new(place, message).help(help));
}
