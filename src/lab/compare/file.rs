//! Reads pictures from EXR and PNG files as layers of channels that can be compared.
//!
//! EXR:
//!
//! - `R G B` of a layer are light. So is a single `Y` of the picture itself.
//! - `X Y Z` are one layer of data, and so is the `Y` of a named layer.
//! - Every other channel is a layer by itself: `A`, `Z`, `albedo.A`.
//! - A part's name is the name of its layer if its channels have none.
//! - A layer named `rgb`, `rgba` or `beauty` is the picture itself.
//! - Integers and cryptomattes are ids.
//!
//! PNG: decoded to linear light, premultiplied by alpha.
//!
//! Refused: deep data, subsampled channels, two layers of one name, EXRs and PNGs with more than
//! 4 GiB of pixels.

use std::collections::BTreeMap;
use std::fs::File;
use std::io::{BufReader, Read};
use std::path::Path;

use exr::image::read::image::ReadLayers;
use exr::image::read::layers::ReadChannels;
use exr::image::read::read;
use exr::image::{AnyChannel, AnyChannels, FlatSamples, Layer as Part};
use exr::meta::attribute::AttributeValue;

use crate::error::{Error, ErrorKind, Problem, Result};
use crate::output::exr::text::decode;
use crate::output::exr_check::{self, exr_error};

use super::layer::{Meaning, PictureLayer, fits, is_beauty};
use super::mattes::{Names, read_names};
use super::png;

/// Format of a picture file.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum FileFormat {
    /// An OpenEXR file, of one or more parts.
    Exr,
    /// A PNG file, 1 to 16 bits.
    Png,
}

/// All layers of a picture file, the picture itself first.
#[derive(Debug, Clone)]
pub struct Picture {
    /// Path of the file.
    pub path: String,
    /// Format of the file.
    pub format: FileFormat,
    /// All layers, sorted by name; at least one.
    pub layers: Vec<PictureLayer>,
    /// Names of its mattes.
    pub mattes: Names,
}

impl Picture {
    /// Reads an EXR or a PNG. The first bytes decide the format.
    ///
    /// # Errors
    /// If the file is missing, truncated, neither EXR nor PNG, or refused (see the module's head).
    pub fn read(path: &Path) -> Result<Self> {
        let opened = File::open(path).map_err(|error| Error::io(path, "read", &error))?;
        let mut start = Vec::new();
        let mut file = BufReader::new(opened);
        let read = file.by_ref().take(4).read_to_end(&mut start);
        read.map_err(|error| Error::io(path, "read", &error))?;
        let mut mattes = Names::new();
        let (format, mut layers) = match start.as_slice() {
            [0x76, 0x2f, 0x31, 0x01] => (FileFormat::Exr, exr_layers(path, &mut mattes)?),
            [0x89, b'P', b'N', b'G'] => (FileFormat::Png, png::layers(path)?),
            _ => {
                let message = "found neither an EXR nor a PNG, expected one of them";
                return Err(Error::invalid(path.display().to_string(), message));
            }
        };
        layers.sort_by(|a, b| a.name.cmp(&b.name));
        Ok(Self { path: path.display().to_string(), format, layers, mattes })
    }
}

fn exr_layers(path: &Path, mattes: &mut Names) -> Result<Vec<PictureLayer>> {
    exr_check::check(path)?;
    let failed = |error| exr_error(path, error);
    let file = File::open(path).map_err(|error| Error::io(path, "read", &error))?;
    let meta = exr_check::meta(&file, true).map_err(failed)?;
    let bytes = meta.headers.iter().map(|header| header.total_pixel_bytes() as u64);
    fits(path, bytes.fold(0, u64::saturating_add))?;
    let image = read()
        .no_deep_data()
        .largest_resolution_level()
        .all_channels()
        .all_layers()
        .all_attributes()
        .non_parallel()
        .pedantic()
        .from_file(path)
        .map_err(failed)?;
    let single = image.layer_data.len() == 1;
    let mut layers: BTreeMap<(String, bool), PictureLayer> = BTreeMap::new();
    for part in image.layer_data {
        let texts = texts(&part);
        read_names(path, texts.iter().map(|(name, text)| (&**name, &**text)), mattes);
        let ids = cryptomattes(&texts);
        if part.size.0 == 0 || part.size.1 == 0 {
            return Err(Error::invalid(path.display().to_string(), "found a layer without pixels"));
        }
        let Part { channel_data, attributes, size, .. } = part;
        let own = attributes.layer_name.map(|name| name.to_string()).unwrap_or_default();
        let own = if single || is_beauty(&own) { String::new() } else { own };
        let shape = ([size.0, size.1], [attributes.layer_position.0, attributes.layer_position.1]);
        for layer in of_part(path, channel_data, &own, shape, &ids)? {
            let key = (layer.name.clone(), layer.meaning == Meaning::Light);
            if layers.insert(key, layer).is_some() {
                let message = "found two layers of one name";
                return Err(Error::invalid(path.display().to_string(), message));
            }
        }
    }
    if layers.is_empty() {
        return Err(Error::invalid(path.display().to_string(), "found no channel"));
    }
    Ok(layers.into_values().collect())
}

/// Names and values of the text attributes of a part.
fn texts(part: &Part<AnyChannels<FlatSamples>>) -> Vec<(String, String)> {
    let attributes = part.attributes.other.iter();
    let texts = attributes.filter_map(|(name, value)| match value {
        AttributeValue::Text(text) => Some((name.to_string(), decode(text))),
        _ => None,
    });
    texts.collect()
}

/// Names of the cryptomattes of a part, from its header.
fn cryptomattes(texts: &[(String, String)]) -> Vec<String> {
    let named = |name: &str| name.starts_with("cryptomatte/") && name.ends_with("/name");
    texts.iter().filter(|(name, _)| named(name)).map(|(_, text)| text.clone()).collect()
}

type SizeAndOrigin = ([usize; 2], [i32; 2]);

fn of_part(
    path: &Path,
    channels: AnyChannels<FlatSamples>,
    own: &str,
    (size, origin): SizeAndOrigin,
    ids: &[String],
) -> Result<Vec<PictureLayer>> {
    // The channels of each layer, by name.
    let mut groups: BTreeMap<String, BTreeMap<String, AnyChannel<FlatSamples>>> = BTreeMap::new();
    for channel in channels.list {
        let name = channel.name.to_string();
        if channel.sampling.0 != 1 || channel.sampling.1 != 1 {
            let message = format!("cannot compare the subsampled channel `{name}`");
            let problem = Problem::new(path.display().to_string(), message);
            return Err(Error::new(ErrorKind::Unsupported, problem));
        }
        let (prefix, last) = name.rsplit_once('.').unwrap_or(("", &name));
        let group = match prefix {
            // A part named `Z` with the channel `Z`: the layer needs no name.
            "" if last == own => String::new(),
            "" => own.to_string(),
            _ if names_itself(prefix, own) => prefix.to_string(),
            _ => format!("{own}.{prefix}"),
        };
        groups.entry(group).or_default().insert(last.to_string(), channel);
    }
    // `beauty.R` is the `R` of the picture itself, unless the part has an `R` without a name, too.
    let named: Vec<_> = groups.keys().filter(|group| is_beauty(group)).cloned().collect();
    for name in named {
        let channels = groups.remove(&name).unwrap_or_default();
        let itself = groups.entry(String::new()).or_default();
        match channels.keys().any(|channel| itself.contains_key(channel)) {
            true => drop(groups.insert(name, channels)),
            false => itself.extend(channels),
        }
    }
    let mut layers = Vec::new();
    for (group, mut channels) in groups {
        let is_ids = |name: &str| ids.iter().any(|id| name.starts_with(id.as_str()));
        let is_float = |c: &AnyChannel<FlatSamples>| !matches!(c.sample_data, FlatSamples::U32(_));
        let mut take = |names: &[&str], meaning: Meaning| {
            if !names.iter().all(|name| channels.get(*name).is_some_and(is_float)) {
                return;
            }
            let taken: Vec<_> = names.iter().filter_map(|n| channels.remove(*n)).collect();
            layers.push(layer(group.clone(), meaning, names, &taken, (size, origin)));
        };
        if !is_ids(&group) {
            take(&["R", "G", "B"], Meaning::Light);
            take(&["X", "Y", "Z"], Meaning::Data);
            // `Y` of a named layer is data: `samples` or `shadow_1` is no picture.
            take(&["Y"], if group.is_empty() { Meaning::Light } else { Meaning::Data });
        }
        for (name, channel) in channels {
            let meaning = match is_float(&channel) && !is_ids(&group) {
                true => Meaning::Data,
                false => Meaning::Ids,
            };
            let full = if group.is_empty() { name.clone() } else { format!("{group}.{name}") };
            layers.push(layer(full, meaning, &[name.as_str()], &[channel], (size, origin)));
        }
    }
    Ok(layers)
}

/// Returns whether a layer's name begins with its part's name.
///
/// Examples: `albedo` or `albedo.left` in the part `albedo`, and the ranks `CryptoObject00`, ... in
/// the part `CryptoObject`.
fn names_itself(layer: &str, part: &str) -> bool {
    let rest = layer.strip_prefix(part);
    rest.is_some_and(|rest| {
        part.is_empty() || rest.starts_with('.') || rest.bytes().all(|b| b.is_ascii_digit())
    })
}

fn layer(
    name: String,
    meaning: Meaning,
    names: &[&str],
    channels: &[AnyChannel<FlatSamples>],
    (size, origin): SizeAndOrigin,
) -> PictureLayer {
    let floats = channels.iter().map(|channel| match &channel.sample_data {
        FlatSamples::F16(values) => values.iter().map(|v| v.to_f32()).collect(),
        FlatSamples::F32(values) => values.clone(),
        FlatSamples::U32(values) => values.iter().map(|v| f32::from_bits(*v)).collect(),
    });
    let mut floats: Vec<Vec<f32>> = floats.collect();
    // Grey light becomes three equal channels.
    if meaning == Meaning::Light && floats.len() == 1 {
        floats = vec![floats[0].clone(), floats[0].clone(), floats.remove(0)];
    }
    let pixels = 0..size[0] * size[1];
    let values = pixels.flat_map(|i| floats.iter().map(move |channel| channel[i])).collect();
    let half = channels.iter().any(|c| matches!(c.sample_data, FlatSamples::F16(_)));
    let channels = names.iter().map(|name| name.to_string()).collect();
    PictureLayer { name, meaning, size, origin, channels, values, half }
}
