//! Layers that become files of their own: preview pictures, and the manifests of merged
//! cryptomattes.

use std::path::{Path, PathBuf};

use crate::{
    error::{Error, Result},
    film::Film,
    layers::PixelLayout,
    output::{Outputs, atomic::Part, png, preview as pictures, tonemap::Depth},
    picture::{file_name, manifest_path},
    scene::{Layer, Scene},
};

/// Returns the layers of `render --png-layer` and the paths of their pictures.
///
/// # Errors
/// Layers that the EXR does not have.
pub fn preview_paths(
    names: &[String],
    scene: &Scene,
    prefix: &Path,
) -> Result<Vec<(String, PathBuf)>> {
    let written: Vec<String> =
        scene.layers.iter().map(|layer| layer.name(&scene.light_groups)).collect();
    let mut shown = Vec::new();
    for name in names {
        let named = match Layer::from_word(name, &scene.light_groups) {
            Some(_) if name == "all" => written.clone(),
            Some(layers) => layers.iter().map(|layer| layer.name(&scene.light_groups)).collect(),
            None => {
                let message = format!("found the unknown layer {name:?}");
                let help = Layer::help(name, &scene.light_groups);
                return Err(Error::invalid("--png-layer", message).help(help));
            }
        };
        for name in named {
            if !written.contains(&name) {
                let message = format!("found the layer `{name}`, which the EXR does not have");
                let help = format!("add it: --aov {name}");
                return Err(Error::invalid("--png-layer", message).help(help));
            }
            if !shown.contains(&name) {
                shown.push(name);
            }
        }
    }
    Ok(shown.into_iter().map(|name| preview(prefix, name)).collect())
}

/// Returns the layers of `merge --png-layer` and the paths of their pictures.
///
/// # Errors
/// Layers that the parts do not have.
pub fn named_previews(
    names: &[String],
    recipe: &PixelLayout,
    prefix: &Path,
) -> Result<Vec<(String, PathBuf)>> {
    let mut written: Vec<String> = Vec::new();
    for channel in &recipe.channels {
        let layer = channel.name.rsplit_once('.').map_or(channel.name.as_str(), |(layer, _)| layer);
        // CryptoObject00, CryptoObject01... form one layer.
        let layer = match layer.starts_with("Crypto") {
            true => layer.trim_end_matches(|c: char| c.is_ascii_digit()),
            false => layer,
        };
        if !written.iter().any(|known| known == layer) {
            written.push(layer.to_string());
        }
    }
    let mut shown: Vec<String> = Vec::new();
    for name in names {
        let these = match name.as_str() {
            "all" => written.clone(),
            name if written.iter().any(|known| known == name) => vec![name.to_string()],
            name => {
                let message = format!("found the layer {name:?}, which the parts do not have");
                let help = format!("they have: {}", written.join(", "));
                return Err(Error::invalid("--png-layer", message).help(help));
            }
        };
        shown.extend(these);
    }
    shown.dedup();
    Ok(shown.into_iter().map(|name| preview(prefix, name)).collect())
}

fn preview(prefix: &Path, name: String) -> (String, PathBuf) {
    let mut path = prefix.as_os_str().to_owned();
    path.push(format!(".{name}.png"));
    (name, PathBuf::from(path))
}

/// A cryptomatte manifest that moves from the EXR header to a file of its own.
#[derive(Debug)]
pub struct Manifest {
    /// Path of that file.
    pub path: PathBuf,
    text: String,
}

impl Manifest {
    /// Creates the part file of the manifest.
    ///
    /// # Errors
    /// As for [`Part::create`].
    pub fn create(self) -> Result<(Part, String)> {
        Ok((Part::create(&self.path)?, self.text))
    }

    /// Writes the manifest, hands its part file to `outputs` for the final rename, and returns its
    /// path.
    ///
    /// # Errors
    /// `Retry` if the disk is full.
    pub fn write((mut file, text): (Part, String), outputs: &mut Outputs) -> Result<PathBuf> {
        file.fill(&(text + "\n"))?;
        Ok(outputs.add(file))
    }
}

/// Replaces cryptomatte manifests in `attributes` by the names of files, and returns the manifests.
///
/// # Errors
/// A file name that an EXR attribute cannot hold.
pub fn manifests(attributes: &mut [(String, String)], prefix: &Path) -> Result<Vec<Manifest>> {
    let mut found = Vec::new();
    for index in 0..attributes.len() {
        let Some(key) = attributes[index].0.strip_suffix("/manifest").map(str::to_string) else {
            continue;
        };
        let kind = attributes.iter().find(|(name, _)| *name == format!("{key}/name"));
        let kind = kind.map(|(_, kind)| kind.clone()).unwrap_or_default();
        let path = manifest_path(prefix, &kind);
        let file = file_name(&path)?;
        let (name, text) = &mut attributes[index];
        *name = format!("{key}/manif_file");
        found.push(Manifest { path, text: std::mem::replace(text, file) });
    }
    Ok(found)
}

/// Creates the part files for pictures of layers.
///
/// # Errors
/// As for [`Part::create`].
pub fn open_previews(paths: Vec<(String, PathBuf)>) -> Result<Vec<(String, Part)>> {
    paths.into_iter().map(|(name, path)| Ok((name, Part::create(&path)?))).collect()
}

/// Writes the pictures of layers. `add` takes each part file for the final rename and returns its
/// path.
///
/// # Errors
/// `Retry` if the disk is full.
pub fn write_previews(
    film: &Film,
    previews: Vec<(String, Part)>,
    mut add: impl FnMut(Part) -> PathBuf,
) -> Result<Vec<PathBuf>> {
    let write = |(name, mut part): (String, Part)| {
        let path = part.target().to_owned();
        let bytes = pictures::bytes(film, &name).unwrap_or_default();
        let color = png::Color { alpha: false, srgb: true, depth: Depth::Eight };
        png::encode(film, &bytes, color, None, part.file(), &path)?;
        part.sync()?;
        Ok(add(part))
    };
    previews.into_iter().map(write).collect()
}
