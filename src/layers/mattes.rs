//! Cryptomatte 1.2.0 (Friedman and Jones, "Fully automatic ID mattes with support for motion blur
//! and transparency", 2015): the ids that cover a pixel, and their coverages. An id is the hash of
//! a name.

use std::borrow::Cow;
use std::collections::HashSet;

use crate::film::{Channel, ChannelKind, Dropped};
use crate::scene::Scene;

use super::names;

/// The mattes of one kind: shapes or materials.
#[derive(Debug, Clone)]
pub struct Mattes {
    /// Name of the kind in channels and attributes: `CryptoObject` or `CryptoMaterial`.
    pub kind: &'static str,
    /// The id of each shape, by the shape's index.
    ids: Vec<u32>,
    /// Used names with their ids. Sorted by name, so that the order of shapes does not affect the
    /// manifest.
    named: Vec<(String, u32)>,
}

impl Mattes {
    /// Makes `CryptoObject`: one matte per name of a shape.
    pub fn objects(scene: &Scene) -> Self {
        let names = names::shapes(scene);
        Self::new("CryptoObject", names.clone(), &names)
    }

    /// Makes `CryptoMaterial`: one matte per name of a material.
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

    /// Returns the channels of `ranks` ranks: id and coverage alternate, two ranks per layer, all
    /// 32-bit floats.
    pub fn channels(&self, ranks: usize) -> impl Iterator<Item = Channel> + use<> {
        let kind = self.kind;
        (0..2 * ranks).map(move |i| {
            let name = format!("{kind}{:02}.{}", i / 4, ["R", "G", "B", "A"][i % 4]);
            Channel { name, kind: ChannelKind::Float }
        })
    }

    /// Returns the id of a shape.
    pub fn id(&self, shape: u32) -> u32 {
        self.ids[shape as usize]
    }

    /// Returns the number of different ids: the most that can cover a pixel.
    pub fn ids(&self) -> usize {
        self.ids.iter().collect::<HashSet<_>>().len()
    }

    /// Returns the header attributes with which a reader finds a matte by name: conversion, hash,
    /// manifest, name.
    pub fn attributes(&self) -> Vec<(String, String)> {
        // The key is the first 7 digits of the hash of the kind itself.
        let key = format!("{:08x}", id(self.kind));
        let name = |what: &str| format!("cryptomatte/{}/{what}", &key[..7]);
        vec![
            (name("conversion"), "uint32_to_float32".to_string()),
            (name("hash"), "MurmurHash3_32".to_string()),
            (name("manifest"), self.manifest()),
            (name("name"), self.kind.to_string()),
        ]
    }

    /// Returns the manifest, a JSON object: the hexadecimal id of each name.
    pub(super) fn manifest(&self) -> String {
        let pairs = self.named.iter().map(|(name, id)| {
            let name = serde_json::Value::from(name.as_str());
            format!("{name}:\"{id:08x}\"")
        });
        format!("{{{}}}", pairs.collect::<Vec<_>>().join(","))
    }
}

/// Returns the id of a name: MurmurHash3_x86_32 of its UTF-8 with seed 0. If these bits are a zero,
/// denormal, infinite or NaN float, one bit of the exponent is flipped, as Cryptomatte requires.
pub fn id(name: &str) -> u32 {
    let mut bytes = name.as_bytes();
    // Reading from memory cannot fail.
    let hash = murmur3::murmur3_32(&mut bytes, 0).unwrap_or_default();
    if matches!(hash >> 23 & 255, 0 | 255) { hash ^ (1 << 23) } else { hash }
}

/// Fills the words of one kind of mattes. `ids` holds how many of a pixel's `samples` hit each id,
/// in the order of first hits. Ranks are sorted by coverage, the largest first. Ids of equal
/// coverage keep their order. Returns the coverage of the ids beyond the last rank.
pub fn rank(ids: &[(u32, u32)], samples: u32, words: &mut [u32]) -> Dropped {
    words.fill(0);
    let mut ids = Cow::Borrowed(ids);
    // Most pixels have one id.
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
