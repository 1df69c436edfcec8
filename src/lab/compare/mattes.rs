//! Compares the cryptomattes of two files by name: the pixels that each matte covers.

use std::collections::BTreeMap;
use std::path::Path;

use crate::files;

use super::compared::Compared;
use super::layer::PictureLayer;

/// Names of mattes by id, for each kind of cryptomatte (`CryptoObject`).
pub type Names = BTreeMap<String, BTreeMap<u32, String>>;

/// One matte in both files.
#[derive(Debug, Clone, PartialEq)]
pub struct Matte {
    /// Name of the matte, or its id in hexadecimal if no manifest has a name.
    pub name: String,
    /// Sum of its coverage in pixels: in the picture, in the reference.
    pub pixels: [f64; 2],
    /// Sum over all pixels of the absolute difference of its coverage, in pixels.
    pub differs: f64,
}

/// All mattes of one kind.
#[derive(Debug, Clone, Default)]
pub struct ComparedMattes {
    /// All mattes. Those with the largest difference come first, then by name.
    pub all: Vec<Matte>,
    /// For each pixel, the largest difference of any matte's coverage, in [0, 1].
    pub map: Vec<f64>,
}

/// Kind of cryptomatte that a layer belongs to: `CryptoObject` for `CryptoObject00.R`.
pub fn kind<'a>(layer: &str, names: &'a Names) -> Option<&'a str> {
    let (ranked, _) = layer.rsplit_once('.')?;
    // A kind may end with a digit, too.
    let (kind, rank) = ranked.split_at_checked(ranked.len().checked_sub(2)?)?;
    let known = names.get_key_value(kind).filter(|_| rank.bytes().all(|c| c.is_ascii_digit()))?;
    Some(known.0)
}

/// Reads the cryptomatte manifests of a part into `names`, from its attributes or from the file
/// that they name.
///
/// `attributes` are the text attributes of one part of the file at `path`. If a manifest is missing
/// or damaged, its mattes have no names.
pub fn read_names<'a>(
    path: &Path,
    attributes: impl Iterator<Item = (&'a str, &'a str)>,
    names: &mut Names,
) {
    let mut keys: BTreeMap<&str, BTreeMap<&str, &str>> = BTreeMap::new();
    for (name, value) in attributes {
        let known = name.strip_prefix("cryptomatte/").and_then(|rest| rest.split_once('/'));
        if let Some((key, what)) = known {
            keys.entry(key).or_default().insert(what, value);
        }
    }
    for entries in keys.values() {
        let Some(kind) = entries.get("name") else { continue };
        let beside = entries.get("manif_file").and_then(|file| {
            let file = path.with_file_name(Path::new(file).file_name()?);
            String::from_utf8(files::read_within(&file, 64, "a manifest").ok()?).ok()
        });
        let text = entries.get("manifest").map(|text| text.to_string()).or(beside);
        let pairs: Option<BTreeMap<String, String>> =
            text.and_then(|text| serde_json::from_str(&text).ok());
        let known = names.entry(kind.to_string()).or_default();
        for (name, id) in pairs.unwrap_or_default() {
            known.extend(u32::from_str_radix(&id, 16).ok().map(|id| (id, name)));
        }
    }
}

/// Compares the mattes of one kind. `layers` must contain all its ranks.
///
/// The result is empty if ids or coverages of the first rank are missing. The pixels are those of
/// `layers[0]`. A channel is 0 where it has no pixel.
pub fn compare(kind: &str, names: &BTreeMap<u32, String>, layers: &[&Compared]) -> ComparedMattes {
    let channel = |rank: usize, suffix: &str| {
        let name = format!("{kind}{rank:02}.{suffix}");
        layers.iter().find(|layer| layer.test.name.eq_ignore_ascii_case(&name))
    };
    let pair = |i: usize| {
        let [id, coverage] = [["R", "G"], ["B", "A"]][i % 2];
        Some([channel(i / 2, id)?, channel(i / 2, coverage)?])
    };
    let pairs: Vec<[&&Compared; 2]> = (0..2 * layers.len()).map_while(pair).collect();
    let frame = match layers.first() {
        Some(first) if !pairs.is_empty() => &first.test,
        _ => return ComparedMattes::default(),
    };
    let count = frame.size[0] * frame.size[1];
    let mut sums: BTreeMap<u32, Matte> = BTreeMap::new();
    let mut map = Vec::with_capacity(count);
    let mut here: Vec<(u32, [f32; 2])> = Vec::new();
    for pixel in 0..count {
        here.clear();
        for [ids, coverages] in &pairs {
            let of = |layer: fn(&Compared) -> &PictureLayer| {
                let [id, coverage] = [ids, coverages].map(|c| value(layer(c), frame, pixel));
                (id.to_bits(), coverage)
            };
            for (side, (id, coverage)) in [of(|c| &c.test), of(|c| &c.reference)].iter().enumerate()
            {
                if *coverage > 0.0 {
                    let at = here.iter().position(|(known, _)| known == id);
                    let at = at.unwrap_or(here.len());
                    here.resize(here.len().max(at + 1), (*id, [0.0; 2]));
                    here[at].1[side] += coverage;
                }
            }
        }
        let mut most = 0.0f64;
        for (id, coverage) in &here {
            let matte = sums.entry(*id).or_insert_with(|| Matte {
                name: names.get(id).cloned().unwrap_or_else(|| format!("{id:08x}")),
                pixels: [0.0; 2],
                differs: 0.0,
            });
            let [test, reference] = coverage.map(f64::from);
            matte.pixels = [matte.pixels[0] + test, matte.pixels[1] + reference];
            matte.differs += (test - reference).abs();
            most = most.max((test - reference).abs());
        }
        map.push(most);
    }
    let mut all: Vec<Matte> = sums.into_values().collect();
    all.sort_by(|a, b| b.differs.total_cmp(&a.differs).then_with(|| a.name.cmp(&b.name)));
    ComparedMattes { all, map }
}

/// Value of a layer of one channel at a pixel of `frame`; 0 outside the layer.
fn value(layer: &PictureLayer, frame: &PictureLayer, pixel: usize) -> f32 {
    let at = [pixel % frame.size[0], pixel / frame.size[0]];
    let from = |k: usize| i64::from(frame.origin[k]) - i64::from(layer.origin[k]);
    let [x, y] = [0, 1].map(|k| usize::try_from(at[k] as i64 + from(k)).unwrap_or(usize::MAX));
    if x < layer.size[0] && y < layer.size[1] { layer.values[y * layer.size[0] + x] } else { 0.0 }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_kind_may_end_with_a_digit() {
        let names: Names =
            ["CryptoObject", "Asset1"].map(|kind| (kind.to_string(), BTreeMap::new())).into();
        assert_eq!(kind("CryptoObject02.A", &names), Some("CryptoObject"));
        assert_eq!(kind("Asset100.R", &names), Some("Asset1"));
        for other in ["CryptoObject.R", "Asset1.R", "Asset.R", "R", "P.X"] {
            assert_eq!(kind(other, &names), None, "{other}");
        }
    }
}
