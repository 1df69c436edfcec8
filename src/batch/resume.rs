//! Decides whether an existing frame may stay.

use std::ffi::OsStr;
use std::path::PathBuf;

use crate::output::finished::{self, FileState};
use crate::picture::Manifest;

use super::file_hashes::FileHashes;
use super::fingerprint::{difference, serves};

/// Which existing frames may stay.
#[derive(Debug, Clone, Copy)]
pub enum Resume<'a> {
    /// No frame may stay.
    Nothing,
    /// Frames with the expected fingerprint may stay. If there are hashes, the bytes of their files
    /// must match these, too.
    Keep(Option<&'a FileHashes>),
}

/// Decision about one frame.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Decision {
    /// The frame stays. Its EXR and its PNG are complete and have the expected fingerprint. Its
    /// cryptomatte manifests have the expected names and ids.
    Keep,
    /// The frame is rendered: no file exists, or no existing frame may stay, or the frame has no
    /// fingerprint.
    Render,
    /// The frame is rendered again for this reason, although files exist.
    Again(String),
}

/// Decides about a frame by its files
/// ([`PictureFiles::names`](crate::picture::PictureFiles::names)), among them `manifests`. With
/// `hashes`, reads all bytes of files that may stay.
pub fn decide(
    (files, manifests): (&[PathBuf], &[Manifest]),
    fingerprint: &str,
    hashes: Option<&FileHashes>,
) -> Decision {
    let found = files.iter().map(|path| match path.extension().and_then(OsStr::to_str) {
        Some("exr") => (path, finished::exr(path)),
        Some("png") => (path, finished::png(path)),
        // A cryptomatte manifest holds no fingerprint.
        _ if path.is_file() => (path, FileState::Whole(Some(fingerprint.to_string()))),
        _ => (path, FileState::Missing),
    });
    let found: Vec<(&PathBuf, FileState)> = found.collect();
    if found.iter().all(|(_, state)| *state == FileState::Missing) {
        return Decision::Render;
    }
    for (path, state) in found {
        let name = path.display();
        return Decision::Again(match state {
            FileState::Whole(Some(there)) if serves(&there, fingerprint) => continue,
            FileState::Whole(Some(there)) => {
                format!("{name}: {}", difference(&there, fingerprint))
            }
            FileState::Whole(None) => format!("{name} has no fingerprint"),
            FileState::Broken => format!("{name} is not whole"),
            FileState::Missing => format!("{name} is missing"),
        });
    }
    // A run of another scene, killed between two renames, leaves its manifest beside an older EXR.
    if let Some(Manifest { path, .. }) = manifests.iter().find(|manifest| !manifest.is_written()) {
        return Decision::Again(format!("{}: the names or ids changed", path.display()));
    }
    let mismatch = hashes.and_then(|hashes| files.iter().find_map(|path| hashes.mismatch(path)));
    mismatch.map_or(Decision::Keep, Decision::Again)
}
