//! The layers of a render that become files of their own: previews, and the manifests of merged cryptomattes.

use std::path::{Path, PathBuf};

use crate::{
    error::{Error, Result},
    film::Film,
    layers::Recipe,
    output::{Outputs, atomic::Part, png, preview as pictures, tonemap::Depth},
    picture::{file_name, manifest_path},
    scene::{Layer, Scene},
};

use super::{args::RenderArgs, paths};

/// The layers that `--png-layer` shows, and where.
///
/// # Errors
/// Layers that are not written.
pub fn preview_paths(args: &RenderArgs, scene: &Scene) -> Result<Vec<(String, PathBuf)>> {
    let prefix = paths::prefix(args.output.as_deref(), &args.input);
    let written: Vec<String> =
        scene.layers.iter().map(|layer| layer.name(&scene.light_groups)).collect();
    let mut shown = Vec::new();
    for name in &args.files.png_layer {
        let named = match Layer::named(name, &scene.light_groups) {
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
                let help = format!("ask for it: --aov {name}");
                return Err(Error::invalid("--png-layer", message).help(help));
            }
            if !shown.contains(&name) {
                shown.push(name);
            }
        }
    }
    Ok(shown.into_iter().map(|name| preview(&prefix, name)).collect())
}

/// The layers that `merge --png-layer` shows, and where.
///
/// # Errors
/// Layers that are not there.
pub fn named_previews(
    names: &[String],
    recipe: &Recipe,
    prefix: &Path,
) -> Result<Vec<(String, PathBuf)>> {
    let mut written: Vec<String> = Vec::new();
    for channel in &recipe.channels {
        let layer = channel.name.rsplit_once('.').map_or(channel.name.as_str(), |(layer, _)| layer);
        // CryptoObject00, 01... are one layer.
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

/// A manifest that leaves a header for a file beside the picture.
#[derive(Debug)]
pub struct Manifest {
    /// That file.
    pub path: PathBuf,
    text: String,
}

impl Manifest {
    /// Makes sure that it can be written.
    ///
    /// # Errors
    /// Those of [`Part::create`].
    pub fn create(self) -> Result<(Part, String)> {
        Ok((Part::create(&self.path)?, self.text))
    }

    /// Writes it, for `outputs` to name it; where it will be.
    ///
    /// # Errors
    /// `Retry` for a full disk.
    pub fn write((mut file, text): (Part, String), outputs: &mut Outputs) -> Result<PathBuf> {
        file.fill(&(text + "\n"))?;
        Ok(outputs.add(file))
    }
}

/// Takes the manifests of cryptomattes out of attributes.
///
/// # Errors
/// A name that no EXR attribute can hold.
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

/// Makes sure that the pictures of layers can be written.
///
/// # Errors
/// Those of [`Part::create`].
pub fn create_previews(args: &RenderArgs, scene: &Scene) -> Result<Vec<(String, Part)>> {
    open_previews(preview_paths(args, scene)?)
}

/// Makes sure that these pictures of layers can be written.
///
/// # Errors
/// Those of [`Part::create`].
pub fn open_previews(paths: Vec<(String, PathBuf)>) -> Result<Vec<(String, Part)>> {
    paths.into_iter().map(|(name, path)| Ok((name, Part::create(&path)?))).collect()
}

/// Writes the pictures of layers and gives them to `add`, which says where they will be.
///
/// # Errors
/// `Retry` for a full disk.
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
