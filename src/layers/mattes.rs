//! Cryptomatte 1.2.0 (Friedman and Jones, "Fully automatic ID mattes with support for motion blur and
//! transparency", 2015): per pixel, what covers it and how much of it, by hashes of names.

use std::borrow::Cow;
use std::collections::HashSet;

use crate::film::{Channel, ChannelKind, Dropped};
use crate::scene::Scene;

use super::names;

/// Mattes of one kind of thing.
#[derive(Debug, Clone)]
pub struct Mattes {
    /// What the kind is called in channels and attributes.
    pub kind: &'static str,
    /// Id of each shape.
    ids: Vec<u32>,
    /// Names and their ids by name: scenes that differ in the order of their parts have one manifest.
    named: Vec<(String, u32)>,
}

impl Mattes {
    /// `CryptoObject`: one matte per shape.
    pub fn objects(scene: &Scene) -> Self {
        let names = names::shapes(scene);
        Self::new("CryptoObject", names.clone(), &names)
    }

    /// `CryptoMaterial`: one matte per material.
    pub fn materials(scene: &Scene) -> Self {
        let names = names::materials(scene);
        let of_shapes = scene.shapes.iter().map(|shape| names[shape.material].clone()).collect();
        Self::new("CryptoMaterial", of_shapes, &names)
    }

    fn new(kind: &'static str, of_shapes: Vec<String>, names: &[String]) -> Self {
        let ids = of_shapes.iter().map(|name| id(name)).collect();
        let mut used: HashSet<&String> = of_shapes.iter().collect();
        let named = names.iter().filter(|name| used.remove(name));
        let mut named: Vec<_> = named.map(|name| (name.clone(), id(name))).collect();
        named.sort();
        Self { kind, ids, named }
    }

    /// Its channels: ids and coverages in turn, two of `ranks` a layer, all 32-bit float.
    pub fn channels(&self, ranks: usize) -> impl Iterator<Item = Channel> + use<> {
        let kind = self.kind;
        (0..2 * ranks).map(move |i| {
            let name = format!("{kind}{:02}.{}", i / 4, ["R", "G", "B", "A"][i % 4]);
            Channel { name, kind: ChannelKind::Float }
        })
    }

    /// The id of a shape.
    pub fn id(&self, shape: u32) -> u32 {
        self.ids[shape as usize]
    }

    /// How many different ids a pixel can meet.
    pub fn ids(&self) -> usize {
        self.ids.iter().collect::<HashSet<_>>().len()
    }

    /// Header attributes: what a reader needs to find mattes by name. The manifest stands in
    /// `sidecar`, a file beside the picture, if there is one.
    pub fn attributes(&self, sidecar: Option<&str>) -> Vec<(String, String)> {
        // The key is the first 7 digits of the kind's own hash.
        let key = format!("{:08x}", id(self.kind));
        let name = |what: &str| format!("cryptomatte/{}/{what}", &key[..7]);
        let manifest = match sidecar {
            Some(file) => (name("manif_file"), file.to_string()),
            None => (name("manifest"), self.manifest()),
        };
        vec![
            (name("conversion"), "uint32_to_float32".to_string()),
            (name("hash"), "MurmurHash3_32".to_string()),
            manifest,
            (name("name"), self.kind.to_string()),
        ]
    }

    /// Names and ids as a JSON object.
    pub fn manifest(&self) -> String {
        let pairs = self.named.iter().map(|(name, id)| {
            let name = serde_json::Value::from(name.as_str());
            format!("{name}:\"{id:08x}\"")
        });
        format!("{{{}}}", pairs.collect::<Vec<_>>().join(","))
    }
}

/// The bits of a name's id: MurmurHash3_x86_32 of its UTF-8, seed 0, with one bit of the exponent
/// turned where they would be a denormal, an infinity or a NaN as a float.
pub fn id(name: &str) -> u32 {
    let mut bytes = name.as_bytes();
    // Reading from memory does not fail.
    let hash = murmur3::murmur3_32(&mut bytes, 0).unwrap_or_default();
    match (hash >> 23) & 255 {
        0 | 255 => hash ^ (1 << 23),
        _ => hash,
    }
}

/// Fills the words of one kind of mattes from how many of a pixel's `samples` met each id: the most covered
/// first, of equals the one that was met first. Returns the coverage of those that have no rank left.
pub fn rank(ids: &[(u32, u32)], samples: u32, words: &mut [u32]) -> Dropped {
    words.fill(0);
    let mut ids = Cow::Borrowed(ids);
    // Most pixels have one.
    if ids.len() > 1 {
        ids.to_mut().sort_by_key(|(_, count)| std::cmp::Reverse(*count));
    }
    let share = |count: u32| (f64::from(count) / f64::from(samples)) as f32;
    for (pair, (id, count)) in words.chunks_exact_mut(2).zip(&*ids) {
        pair.copy_from_slice(&[*id, share(*count).to_bits()]);
    }
    let Some(rest @ [_, ..]) = ids.get(words.len() / 2..) else { return Dropped::default() };
    let rest = rest.iter().map(|(_, count)| count).sum();
    Dropped { pixels: 1, share: share(rest), things: ids.len() as u32 }
}
