//! Paths, folders and patterns -> files.

use std::{
    collections::BTreeSet,
    path::{Path, PathBuf},
};

use crate::{
    error::{Error, Result},
    studio,
};

/// The files that `text`, seen from `folder`, stands for: itself, the meshes in a folder (or else its
/// scenes), what a pattern matches; in the order of their names.
///
/// # Errors
/// A name that is not there; a folder or pattern without a file.
pub fn expand(place: &str, text: &str, folder: &Path) -> Result<Vec<PathBuf>> {
    let path = folder.join(text);
    let nothing = |what: &str| Error::invalid(place, format!("found {text:?}, {what}"));
    if path.is_dir() {
        let files = files_in(&path)?;
        return match files.is_empty() {
            true => Err(nothing("a folder without .ply or .json files")),
            false => Ok(files),
        };
    }
    if path.exists() {
        return Ok(vec![path]);
    }
    if !text.contains(['*', '?', '[']) {
        return Err(Error::invalid(place, format!("found {text:?}: there is no such file")));
    }
    let pattern = match folder.to_str() {
        // The folder's own name is no pattern.
        Some(folder) if !folder.is_empty() && !Path::new(text).is_absolute() => {
            format!("{}/{text}", glob::Pattern::escape(folder))
        }
        _ => text.to_string(),
    };
    let matches =
        matches(&pattern).map_err(|error| nothing(&format!("which is no pattern: {error}")))?;
    let files: Vec<PathBuf> = matches.into_iter().filter(|path| path.is_file()).collect();
    match files.is_empty() {
        true => Err(nothing("a pattern that matches no file")),
        false => Ok(files),
    }
}

/// What a pattern matches, each path once. `**` stands for the folders of any depth that are no links:
/// links may lead upwards, and then the paths through them have no end.
fn matches(pattern: &str) -> std::result::Result<BTreeSet<PathBuf>, glob::PatternError> {
    let (above, below) = match pattern.split_once("**/") {
        // Also where it is no name of its own, which `glob` complains about.
        Some((above, below)) if above.is_empty() || above.ends_with('/') => (above, below),
        _ => return Ok(glob::glob(pattern)?.filter_map(|path| path.ok()).collect()),
    };
    // All of them once, however many `**` follow each other.
    let below = below.trim_start_matches("**/");
    let roots = match above {
        "" => BTreeSet::from([PathBuf::new()]),
        above => matches(above)?,
    };
    let mut found = BTreeSet::new();
    let mut folders: Vec<PathBuf> = roots.into_iter().collect();
    while let Some(folder) = folders.pop() {
        let start = match folder.to_str() {
            Some("") => String::new(),
            Some(name) => format!("{}/", glob::Pattern::escape(name.trim_end_matches('/'))),
            // No job file can say the names in it either.
            None => continue,
        };
        found.extend(matches(&(start + below))?);
        let listed = match folder.as_os_str().is_empty() {
            true => std::fs::read_dir("."),
            false => std::fs::read_dir(&folder),
        };
        let entries = listed.into_iter().flatten().flatten();
        let real = entries.filter(|entry| entry.file_type().is_ok_and(|kind| kind.is_dir()));
        // As `glob` does, hidden folders count.
        folders.extend(real.map(|entry| folder.join(entry.file_name())));
    }
    Ok(found)
}

fn files_in(folder: &Path) -> Result<Vec<PathBuf>> {
    let failed = |error: std::io::Error| Error::io(folder, "list", &error);
    let mut all = Vec::new();
    for entry in std::fs::read_dir(folder).map_err(failed)? {
        all.push(entry.map_err(failed)?.path());
    }
    all.retain(|path| path.is_file());
    all.sort();
    let (meshes, others): (Vec<PathBuf>, Vec<PathBuf>) =
        all.into_iter().partition(|path| studio::is_mesh(path));
    if !meshes.is_empty() {
        return Ok(meshes);
    }
    let scene = |path: &PathBuf| path.extension().is_some_and(|end| end == "json");
    Ok(others.into_iter().filter(scene).collect())
}
