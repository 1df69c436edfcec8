//! What a frame is made of, in one line: two frames of one fingerprint are the same picture.
//!
//! `scene=HASH files=HASH settings=... program=VERSION`, so that a difference can be named. Paths do not
//! count, what is in the files does.

use std::{
    collections::HashMap,
    fs::File,
    io::Read,
    path::{Path, PathBuf},
    sync::{Mutex, PoisonError},
};

use sha2::{Digest, Sha256};

use crate::{
    accel::EmbreeMode,
    error::{Error, Result},
    picture::Storage,
    scene::{Description, Loaded, Scene, ShapeKind, written},
};

/// Parts and what a change of each means.
const PARTS: [(&str, &str); 4] = [
    ("scene", "the scene changed"),
    ("files", "a mesh or a texture changed"),
    ("settings", "settings changed"),
    ("program", "another version of the program wrote it"),
];

/// Hexadecimal digits of a hash: 96 bits.
const DIGITS: usize = 24;

/// Settings beside the scene that change a picture.
#[derive(Debug, Clone, Copy)]
pub struct Settings {
    /// How Embree is used.
    pub embree: EmbreeMode,
    /// Bad triangles are dropped.
    pub repair: bool,
    /// How pictures are stored.
    pub storage: Storage,
}

/// The fingerprint of a frame: its scene, the [`Contents::of`] what the scene names, settings.
pub fn fingerprint(loaded: &Loaded, contents: &str, settings: &Settings) -> String {
    let Settings { embree, repair, storage } = settings;
    let stored = match storage.float {
        true => "float",
        false => "half",
    };
    let set = format!("{embree:?},{:?},{stored}", storage.compression).to_lowercase();
    let repair = if *repair { ",repair" } else { "" };
    let scene = hash(without_paths(&loaded.description).to_json().to_string().as_bytes());
    let program = env!("CARGO_PKG_VERSION");
    format!("scene={scene} files={contents} settings={set}{repair} program={program}")
}

/// What differs between two fingerprints, in words.
pub fn difference(there: &str, now: &str) -> String {
    let part = |text: &str, key: &str| {
        let mut words = text.split(' ').filter_map(|word| word.split_once('='));
        words.find(|(k, _)| *k == key).map(|(_, value)| value.to_string())
    };
    let changed = PARTS.iter().filter(|(key, _)| part(there, key) != part(now, key));
    let reasons: Vec<&str> = changed.map(|(_, reason)| *reason).collect();
    match reasons.is_empty() {
        true => "its fingerprint is not ours".to_string(),
        false => reasons.join(", "),
    }
}

fn without_paths(description: &Description) -> Description {
    let mut all = description.clone();
    let clear = |material: &mut written::Material| {
        material.texture_path.iter_mut().for_each(|path| path.0 = "-".to_string());
    };
    all.scene.materials.values_mut().for_each(clear);
    for shape in &mut all.scene.shapes {
        let used = match shape {
            written::Shape::Sphere(s) => &mut s.material,
            written::Shape::Plane(s) => &mut s.material,
            written::Shape::Triangle(s) => &mut s.material,
            written::Shape::TriMesh(s) => {
                s.path.0 = "-".to_string();
                &mut s.material
            }
        };
        if let written::MaterialUse::Inline(material) = used {
            clear(material);
        }
    }
    all
}

/// Hashes of files, each read once.
#[derive(Debug, Default)]
pub struct Contents(Mutex<HashMap<PathBuf, String>>);

impl Contents {
    /// The hash of files in their order.
    ///
    /// # Errors
    /// A file that cannot be read.
    pub fn of(&self, files: &[PathBuf]) -> Result<String> {
        let mut text = String::new();
        for path in files {
            text += &self.file(path)?;
        }
        Ok(hash(text.as_bytes()))
    }

    fn file(&self, path: &Path) -> Result<String> {
        let known = || self.0.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(hash) = known().get(path) {
            return Ok(hash.clone());
        }
        let hash = hash_file(path).map_err(|error| Error::io(path, "read", &error))?;
        known().insert(path.to_owned(), hash.clone());
        Ok(hash)
    }
}

/// The files that a scene names: meshes, then textures.
pub fn files(scene: &Scene) -> Vec<PathBuf> {
    let meshes = scene.shapes.iter().filter_map(|shape| match &shape.kind {
        ShapeKind::Trimesh(spec) => Some(spec.path.clone()),
        _ => None,
    });
    let textures = scene.materials.iter().filter_map(|m| m.texture.as_ref());
    meshes.chain(textures.map(|texture| texture.path.clone())).collect()
}

fn hash_file(path: &Path) -> std::io::Result<String> {
    let mut file = File::open(path)?;
    let (mut sha, mut buffer) = (Sha256::new(), vec![0; 1 << 20]);
    loop {
        match file.read(&mut buffer)? {
            0 => return Ok(shown(sha)),
            n => sha.update(&buffer[..n]),
        }
    }
}

fn hash(bytes: &[u8]) -> String {
    shown(Sha256::new_with_prefix(bytes))
}

fn shown(sha: Sha256) -> String {
    let mut text: String = sha.finalize().iter().map(|byte| format!("{byte:02x}")).collect();
    text.truncate(DIGITS);
    text
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_difference_is_named() {
        let now = "scene=1 files=2 settings=robust,zip,half program=0.1.0";
        assert_eq!(difference(&now.replace("files=2", "files=3"), now), PARTS[1].1);
        let both = difference("scene=9 files=2 settings=robust,zip,half program=0.0.9", now);
        assert_eq!(both, "the scene changed, another version of the program wrote it");
        assert_eq!(difference("something else", now).matches(',').count(), 3);
    }
}
