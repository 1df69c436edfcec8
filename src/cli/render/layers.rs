//! Writes layers as pictures of their own: `--png-layer`.

use std::path::{Path, PathBuf};

use crate::error::{Error, Problem, Result};
use crate::film::Film;
use crate::layers::PixelLayout;
use crate::output::atomic::PartFile;
use crate::output::tonemap::{Depth, PixelFormat};
use crate::output::{exr, png, preview as pictures};
use crate::paths;
use crate::scene::{Layer, LightGroups, Scene};

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
    layout: &PixelLayout,
    prefix: &Path,
) -> Result<Vec<(String, PathBuf)>> {
    let mut written: Vec<String> = Vec::new();
    for channel in &layout.channels {
        let layer = exr::layer_of(&channel.name);
        if !written.iter().any(|known| known == layer) {
            written.push(layer.to_string());
        }
    }
    // The parts name their light groups only in the names of layers.
    let prefixes = ["light_", "shadow_"];
    let of_layer = |layer: &String| {
        prefixes.iter().find_map(|prefix| layer.strip_prefix(prefix).map(str::to_string))
    };
    let groups =
        LightGroups { names: written.iter().filter_map(of_layer).collect(), of: Vec::new() };
    let mut shown: Vec<String> = Vec::new();
    for name in names {
        let named = Layer::from_word(name, &groups).unwrap_or_default();
        let named: Vec<String> = named.into_iter().map(|layer| layer.name(&groups)).collect();
        let wanted = |layer: &&String| name == "all" || name == *layer || named.contains(layer);
        let these: Vec<&String> = written.iter().filter(wanted).collect();
        if these.is_empty() && name != "all" {
            let message = format!("found the layer {name:?}, which the parts do not have");
            let help = match written[..] {
                [] => "they have no layers: render them with --aov".to_string(),
                _ => format!("they have: {}", written.join(", ")),
            };
            return Err(Error::invalid("--png-layer", message).help(help));
        }
        for layer in these {
            if !shown.contains(layer) {
                shown.push(layer.clone());
            }
        }
    }
    Ok(shown.into_iter().map(|name| preview(prefix, name)).collect())
}

/// Returns the warning about `--crypto-sidecar` for a picture without cryptomattes.
pub fn no_mattes() -> Problem {
    Problem::new("--crypto-sidecar", "found without cryptomattes; it has no effect")
}

/// Returns the warning about `--png-layer all` for a picture without layers.
pub fn no_layers() -> Problem {
    Problem::new("--png-layer", "found without layers; it has no effect")
}

fn preview(prefix: &Path, name: String) -> (String, PathBuf) {
    let path = paths::with_ending(prefix, &format!(".{name}.png"));
    (name, path)
}

/// Creates the part files for pictures of layers.
///
/// # Errors
/// As for [`PartFile::create`].
pub fn open_previews(paths: Vec<(String, PathBuf)>) -> Result<Vec<(String, PartFile)>> {
    paths.into_iter().map(|(name, path)| Ok((name, PartFile::create(&path)?))).collect()
}

/// Writes the pictures of layers. `add` takes each part file for the final rename and returns its
/// path.
///
/// # Errors
/// `Retry` if the disk is full.
pub fn write_previews(
    film: &Film,
    previews: Vec<(String, PartFile)>,
    mut add: impl FnMut(PartFile) -> PathBuf,
) -> Result<Vec<PathBuf>> {
    let write = |(name, mut part): (String, PartFile)| {
        let bytes = pictures::bytes(film, &name).unwrap_or_default();
        let color = PixelFormat { alpha: false, srgb: true, depth: Depth::Eight };
        part.fill_by(|file, path| png::encode(film, &bytes, color, None, file, path))?;
        Ok(add(part))
    };
    previews.into_iter().map(write).collect()
}
