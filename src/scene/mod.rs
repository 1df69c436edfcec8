//! Scene files: text -> [`Description`] (as written) -> [`Scene`] (checked).
//!
//! The way of a file: `parse` makes a [`Document`] that knows where everything stands,
//! `overrides` applies `--set`, `structure` holds it against the [`schema()`] made from the types in
//! `description`, and `check` finds what types cannot say. All problems come back in one
//! [`Error`]. docs/guide/scene-format.md is the contract.

mod backend;
mod check;
mod checked;
mod description;
mod document;
mod expected;
mod flags;
#[cfg(test)]
mod hostile_tests;
mod layers;
mod nearest;
mod node;
mod overrides;
mod parse;
mod parse_string;
mod problems;
mod schema;
mod structure;
#[cfg(test)]
mod tests;
mod write;

pub use backend::{Backend, BackendFlags, EmbreeMode};
pub use check::{MAX_PIXELS, begins_as_ply};
pub use checked::*;
pub use description::Description;
pub use document::{Document, escaped};
pub use flags::Overrides;
pub use layers::{Layer, LightGroups};
pub use nearest::{did_you_mean, list, nearest};
pub use node::{Member, Node, NodeKind, Place};
pub use schema::{schema, schema_of};

/// The format's types as written, for scenes that are made by code.
pub mod written {
    pub use super::description::*;
}

use std::{fs::File, io::Read, path::Path};

use schemars::JsonSchema;
use serde::de::DeserializeOwned;
use sha2::{Digest, Sha256};

use crate::error::{Error, Kind, Problem, Result};

/// Longest scene file; meshes and images lie outside it.
const MAX_FILE_BYTES: u64 = 256 << 20;

/// Where a scene comes from.
#[derive(Debug, Clone, Copy)]
pub enum Source<'a> {
    /// A file; its folder is what paths in it are relative to.
    File(&'a Path),
    /// Text that is already here.
    Text {
        /// What messages call it: `<stdin>`.
        name: &'a str,
        /// JSON in UTF-8.
        text: &'a [u8],
        /// What paths in it are relative to.
        folder: &'a Path,
    },
}

/// A scene that passed every check.
#[derive(Debug, Clone)]
pub struct Loaded {
    /// What it means.
    pub scene: Scene,
    /// How it is written, overrides included.
    pub description: Description,
    /// What is valid but surely not meant, in the order of the text.
    pub warnings: Vec<Problem>,
    /// SHA-256 (hexadecimal) of the canonical JSON: two files that differ only in spacing,
    /// comments, order of keys or defaults written out have the same.
    pub hash: String,
}

/// Loads a scene and applies `--set` overrides (`/json/pointer=VALUE`) in order.
///
/// # Errors
/// Every problem of the file and the overrides, in the order of the text.
pub fn load(source: Source, overrides: &[String]) -> Result<Loaded> {
    match source {
        Source::Text { name, text, folder } => {
            check_document(Document::parse(name, text)?, folder, overrides)
        }
        Source::File(path) => {
            let document = Document::parse(&path.display().to_string(), &read(path)?)?;
            check_document(document, path.parent().unwrap_or(Path::new("")), overrides)
        }
    }
}

/// Checks a scene made by code, as if it had been read from a file in `folder`.
///
/// # Errors
/// As [`load`].
pub fn from_description(
    name: &str,
    description: &Description,
    folder: &Path,
    overrides: &[String],
) -> Result<Loaded> {
    check_document(Document::from_value(name, &description.to_json()), folder, overrides)
}

/// Reads a document as any type that has a schema, with the structural checks of scene files:
/// closed objects, places, nearest keys. For job files.
///
/// # Errors
/// Every problem of structure, in the order of the text.
pub fn read_as<T: JsonSchema + DeserializeOwned>(document: &Document) -> Result<T> {
    let mut problems = problems::Problems::new(document);
    structure::check(&schema_of::<T>(""), &mut problems);
    let (problems, _) = problems.finish();
    if !problems.is_empty() {
        let kind = Kind::Invalid;
        return Err(Error { kind, problems });
    }
    serde_json::from_value(document.root.to_value())
        .map_err(|e| Error::invalid(&document.name, e.to_string()))
}

fn check_document(mut document: Document, folder: &Path, overrides: &[String]) -> Result<Loaded> {
    let set = overrides.iter().filter_map(|o| document.apply_set(o).err());
    let bad_overrides: Vec<Problem> = set.collect();
    let mut problems = problems::Problems::new(&document);
    let broken = structure::check(schema(), &mut problems);
    let checked = check::check(&mut problems, broken, folder);
    let (mut errors, warnings) = problems.finish();
    errors.extend(bad_overrides);
    match checked {
        Some((description, scene)) if errors.is_empty() => {
            Ok(Loaded { scene, hash: hash(&description), description, warnings })
        }
        _ => Err(Error { kind: Kind::Invalid, problems: errors }),
    }
}

fn hash(description: &Description) -> String {
    let canonical = description.to_json().to_string();
    let digest = Sha256::digest(canonical.as_bytes());
    digest.iter().map(|byte| format!("{byte:02x}")).collect()
}

/// Formats of meshes that people try to render, by the names of their files.
const OTHER_MESHES: [&str; 11] =
    ["obj", "stl", "off", "glb", "gltf", "fbx", "dae", "3ds", "usd", "usdz", "abc"];

fn read(path: &Path) -> Result<Vec<u8>> {
    let failed = |error: std::io::Error| match error.kind() {
        std::io::ErrorKind::IsADirectory => {
            let name = path.display().to_string();
            Error::invalid(name, "found a folder, expected a scene file")
                .help("name the .json file in it")
        }
        _ => {
            let missing = error.kind() == std::io::ErrorKind::NotFound;
            let near = check::near_file(path).filter(|_| missing);
            let failed = Error::io(path, "read", &error);
            match near {
                Some(near) => failed.help(near),
                None => failed,
            }
        }
    };
    let mut bytes = Vec::new();
    let file = File::open(path).map_err(failed)?;
    let kind = path.extension().and_then(|end| end.to_str()).map(str::to_ascii_lowercase);
    if let Some(kind) = kind.filter(|kind| OTHER_MESHES.contains(&kind.as_str())) {
        let message = format!("found a .{kind} file, expected a PLY mesh or a JSON scene");
        return Err(Error::invalid(path.display().to_string(), message).help(check::CONVERT));
    }
    file.take(MAX_FILE_BYTES + 1).read_to_end(&mut bytes).map_err(failed)?;
    if bytes.len() as u64 > MAX_FILE_BYTES {
        let message =
            format!("found more than {} MiB, expected a scene file", MAX_FILE_BYTES >> 20);
        let name = path.display().to_string();
        return Err(Error::invalid(name, message).help("put geometry into .ply files"));
    }
    Ok(bytes)
}
