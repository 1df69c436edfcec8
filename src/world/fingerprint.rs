//! One hash of everything that decides the pixels of a picture. Of files only the contents count,
//! not names and folders. One exception: mattes of a mesh without a name are named after its file.

use std::collections::{HashMap, HashSet};
use std::fs::File;
use std::io::BufReader;
use std::path::{Path, PathBuf};

use sha2::{Digest, Sha256};

use crate::error::{Error, Result};
use crate::files::{Stamp, changed};
use crate::mesh;
use crate::scene::written::{
    LightDescription, MaterialDescription, MaterialUse, Name, Output, ShapeDescription,
};
use crate::scene::{CheckedMaterial, Layer, LightKind, Loaded, ShapeKind};

use super::sources::{self, is_render, own_image};

/// SHA-256 of the contents of files. Each path is read once, so frames of a batch share the result.
#[derive(Debug, Default)]
pub struct ContentHashes {
    /// Hashes by path; `None` for a pipe, whose bytes can be read only once.
    known: HashMap<PathBuf, Option<Hashed>>,
    /// Stamps of all hashed files.
    stamps: HashSet<Stamp>,
}

/// Hash and stamp of a file.
#[derive(Debug, Clone)]
struct Hashed {
    sha256: String,
    stamp: Stamp,
}

impl ContentHashes {
    /// Returns the SHA-256 of a file in hexadecimal; `None` for a pipe.
    fn sha256_of(&mut self, path: &Path) -> Result<Option<String>> {
        if !self.known.contains_key(path) {
            let found = hashed(path)?;
            self.stamps.extend(found.as_ref().map(|found| found.stamp));
            self.known.insert(path.to_owned(), found);
        }
        let found = self.known.get(path).and_then(Option::as_ref);
        Ok(found.map(|found| found.sha256.clone()))
    }

    /// Checks that the files that were read are the files that were hashed.
    ///
    /// # Errors
    /// `Retry` for a file that was replaced or written in between, or never hashed.
    pub fn check(&self, read: &sources::ReadFiles) -> Result<()> {
        let all = read.0.iter().filter_map(|(path, stamp)| Some((path, stamp.as_ref()?)));
        for (path, stamp) in all {
            if !self.has(path, stamp) {
                return Err(changed(path));
            }
        }
        Ok(())
    }

    /// Returns true if the file had this stamp when it was hashed. The scene of a frame may use
    /// another path than the loaded scene, so an unknown path is looked up by its stamp alone.
    fn has(&self, path: &Path, stamp: &Stamp) -> bool {
        match self.known.get(path) {
            Some(found) => found.as_ref().is_some_and(|found| found.stamp == *stamp),
            None => self.stamps.contains(stamp),
        }
    }

    /// Returns the SHA-256 of a mesh file, followed by the hashes of the images that it names,
    /// `-` for one that is missing. `None` for a pipe.
    fn sha256_of_mesh(&mut self, path: &Path, points: bool) -> Result<Option<String>> {
        let Some(mut all) = self.sha256_of(path)? else { return Ok(None) };
        if points {
            // Points are drawn as spheres without textures.
            return Ok(Some(all));
        }
        let summary = mesh::inspect_ply(path)?;
        for name in &summary.texture_files {
            // A mesh that shows no image may be rendered under the name of one.
            let counts = |image: &PathBuf| summary.uvs.is_some() || !is_render(image);
            match own_image(path, name)?.file().filter(counts) {
                Some(image) => all += &self.sha256_of(&image)?.unwrap_or_default(),
                // The same image under another name is that of other faces.
                None => all.push('-'),
            }
        }
        Ok(Some(all))
    }
}

/// Returns the SHA-256 (hexadecimal) of everything that decides a picture's pixels. That is the
/// resolved scene as JSON with its overrides, and whether meshes are repaired. Hashes of the
/// contents of meshes and textures replace their paths. Crop, sample range and machine are not part
/// of it, so all pieces of one picture share it. `None` if a mesh or an image comes through a pipe.
///
/// # Errors
/// Files that cannot be read.
pub fn fingerprint(
    loaded: &Loaded,
    repair: bool,
    contents: &mut ContentHashes,
) -> Result<Option<String>> {
    let scene = &loaded.scene;
    let mut description = loaded.description.clone();
    let layers = scene.layers.iter().map(|layer| Name(layer.name(&scene.light_groups)));
    description.output.layers = layers.collect();
    let mattes = |layer: &Layer| matches!(layer, Layer::CryptoObject | Layer::CryptoMaterial);
    let mattes = scene.layers.iter().any(mattes);
    if !mattes {
        // Without mattes, the number of ranks does not matter.
        description.output.cryptoranks = Output::default().cryptoranks;
    }
    if !scene.layers.contains(&Layer::Occlusion) {
        let Output { aodistance, aosamples, .. } = Output::default();
        (description.output.aodistance, description.output.aosamples) = (aodistance, aosamples);
    }

    let used = scene.shapes.iter().filter_map(|shape| {
        let material = &scene.materials[shape.material];
        Some((material.name.as_deref()?, material))
    });
    let used: HashMap<&str, &CheckedMaterial> = used.collect();
    description.scene.materials.retain(|key, _| used.contains_key(key.as_str()));
    for (key, material) in &mut description.scene.materials {
        if !replace_texture(material, used.get(key.as_str()).copied(), contents)? {
            return Ok(None);
        }
    }
    for (shape, checked) in description.scene.shapes.iter_mut().zip(&scene.shapes) {
        if let (ShapeDescription::TriMesh(mesh), ShapeKind::Trimesh(spec)) =
            (&mut *shape, &checked.kind)
        {
            let Some(mut hash) = contents.sha256_of_mesh(&spec.path, spec.points.is_some())? else {
                return Ok(None);
            };
            // Mattes of a mesh without a name are named after its file.
            if let (true, None, Some(stem)) = (mattes, &mesh.common.name, spec.path.file_stem()) {
                hash += &stem.to_string_lossy();
            }
            mesh.path = Name(hash);
        }
        if let MaterialUse::Inline(material) = shape.parts_mut().1 {
            let checked = scene.materials.get(checked.material);
            if !replace_texture(material, checked, contents)? {
                return Ok(None);
            }
        }
    }
    for (light, checked) in description.scene.lightsources.iter_mut().zip(&scene.lights) {
        if let (
            LightDescription::Environment(light),
            LightKind::Environment { map: Some(map), .. },
        ) = (light, &checked.kind)
        {
            let Some(hash) = contents.sha256_of(&map.path)? else { return Ok(None) };
            light.image = Some(Name(hash));
        }
    }
    let mut hash = description.digest();
    hash.update([u8::from(repair)]);
    Ok(Some(format!("{:x}", hash.finalize())))
}

/// Replaces the path of a material's image by its hash. Returns false if the image is a pipe, which
/// has no hash.
fn replace_texture(
    written: &mut MaterialDescription,
    checked: Option<&CheckedMaterial>,
    contents: &mut ContentHashes,
) -> Result<bool> {
    if let Some(texture) = checked.and_then(|material| material.texture.as_ref()) {
        written.texture_path = contents.sha256_of(&texture.path)?.map(Name);
        return Ok(written.texture_path.is_some());
    }
    Ok(true)
}

/// Returns the hash and the stamp of a file; `None` for a pipe.
///
/// # Errors
/// A file that cannot be read, or that is written while it is read.
fn hashed(path: &Path) -> Result<Option<Hashed>> {
    let failed = |error: std::io::Error| Error::io(path, "read", &error);
    if !std::fs::metadata(path).map_err(failed)?.is_file() {
        return Ok(None);
    }
    let mut file = File::open(path).map_err(failed)?;
    let stamp = |file: &File| file.metadata().map(|data| Stamp::of(&data)).map_err(failed);
    let Some(before) = stamp(&file)? else { return Ok(None) };
    let sha256 = sha256(&mut file).map_err(failed)?;
    match stamp(&file)? == Some(before) {
        true => Ok(Some(Hashed { sha256, stamp: before })),
        false => Err(changed(path)),
    }
}

fn sha256(file: &mut File) -> std::io::Result<String> {
    let mut hash = Sha256::new();
    std::io::copy(&mut BufReader::with_capacity(1 << 18, file), &mut hash)?;
    Ok(format!("{:x}", hash.finalize()))
}
