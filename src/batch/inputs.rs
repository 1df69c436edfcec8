//! Expands paths, folders and patterns to files.

use std::collections::{BTreeSet, HashMap};
use std::path::{Path, PathBuf};

use crate::error::{Error, Result};
use crate::{files, paths, picture, studio};

/// Returns the files that `text` stands for, sorted by name. `text` is relative to `folder`.
///
/// A file stands for itself. A folder stands for the files in it with the ending of a mesh, or of a
/// scene if it has no mesh. A pattern stands for all files that match. Hidden files (`.NAME`) are
/// left out, unless the pattern asks for them.
///
/// # Errors
/// A name that does not exist; a folder or pattern without a file; a folder that cannot be listed;
/// a pipe; a name with the ending of a mesh or scene that is no file, such as a link to nothing.
pub fn expand(place: &str, text: &str, folder: &Path) -> Result<Vec<PathBuf>> {
    let path = folder.join(text);
    let nothing = |what: &str| Error::invalid(place, format!("found {text:?}, {what}"));
    match std::fs::metadata(&path) {
        Ok(data) if data.is_dir() => {
            let files = files_in(&path)?;
            return match files.is_empty() {
                true => Err(nothing("a folder without .ply or .json files")),
                false => Ok(files),
            };
        }
        Ok(_) => return not_a_file(&path).map_or(Ok(vec![path]), Err),
        Err(_) if text.contains(['*', '?', '[']) => {}
        Err(error) if error.kind() == std::io::ErrorKind::NotFound => {
            let what =
                if path.is_symlink() { "it is a link to nothing" } else { "there is no such file" };
            return Err(Error::invalid(place, format!("found {text:?}: {what}")));
        }
        Err(error) => return Err(Error::io(&path, "read", &error)),
    }
    let pattern = match folder.as_os_str().is_empty() || Path::new(text).is_absolute() {
        true => text.to_string(),
        // The name of the folder itself is not a pattern.
        false => format!("{}/{text}", glob::Pattern::escape(&paths::named(folder)?)),
    };
    let listed = |pattern: &str| -> Result<BTreeSet<PathBuf>> {
        let paths = glob::glob(pattern)
            .map_err(|error| nothing(&format!("which is not a valid pattern: {error}")))?;
        paths.map(|path| path.map_err(|e| Error::io(e.path(), "list", e.error()))).collect()
    };
    let last = text.rsplit('/').next().unwrap_or(text);
    let wanted = |path: &PathBuf| last.starts_with('.') || !is_hidden(path);
    let mut found = Vec::new();
    for path in matches(&pattern, &listed)?.into_iter().filter(wanted) {
        let named = studio::is_named_mesh(&path) || is_named_scene(&path);
        if path.is_file() || named {
            found.push(file(path)?);
        }
    }
    let files = once(found.into_iter());
    if files.is_empty() { Err(nothing("a pattern that matches no file")) } else { Ok(files) }
}

/// Keeps the shortest of several paths that reach the same file through links to folders. A link to
/// a file counts as a file of its own.
fn once(paths: impl Iterator<Item = PathBuf>) -> Vec<PathBuf> {
    let mut found: HashMap<PathBuf, PathBuf> = HashMap::new();
    for path in paths {
        let folder = path.parent().filter(|folder| !folder.as_os_str().is_empty());
        let folder = folder.unwrap_or(Path::new(".")).canonicalize().unwrap_or_default();
        let file = folder.join(path.file_name().unwrap_or_default());
        let shown = found.entry(file).or_insert_with(|| path.clone());
        if path.components().count() < shown.components().count() {
            *shown = path;
        }
    }
    let mut files: Vec<PathBuf> = found.into_values().collect();
    files.sort();
    files
}

/// Returns all paths that match a pattern, each once. `listed` returns those of a pattern without
/// `**`.
///
/// `**` matches folders at any depth, but follows no links: a link to a parent folder would give
/// paths without end. At the end of a pattern, `**` matches no file.
///
/// # Errors
/// Those of `listed`; a folder that cannot be listed.
fn matches(
    pattern: &str,
    listed: &impl Fn(&str) -> Result<BTreeSet<PathBuf>>,
) -> Result<BTreeSet<PathBuf>> {
    if pattern == "**" || pattern.ends_with("/**") {
        return Ok(BTreeSet::new());
    }
    let (above, below) = match pattern.split_once("**/") {
        // `**` that is only part of a name also goes to `glob`, which reports an error.
        Some((above, below)) if above.is_empty() || above.ends_with('/') => (above, below),
        _ => return listed(pattern),
    };
    // Several `**` in a row match the same as one.
    let below = below.trim_start_matches("**/");
    let roots = match above {
        "" => BTreeSet::from([PathBuf::new()]),
        above => matches(above, listed)?,
    };
    let mut found = BTreeSet::new();
    let mut folders: Vec<PathBuf> = roots.into_iter().collect();
    while let Some(folder) = folders.pop() {
        let start = match folder.to_str() {
            Some("") => String::new(),
            Some(name) => format!("{}/", glob::Pattern::escape(name.trim_end_matches('/'))),
            // Not UTF-8: a job file cannot name such a folder either.
            None => continue,
        };
        found.extend(matches(&(start + below), listed)?);
        let here = if folder.as_os_str().is_empty() { Path::new(".") } else { &folder };
        let failed = |error: std::io::Error| Error::io(here, "list", &error);
        for entry in std::fs::read_dir(here).map_err(failed)? {
            let entry = entry.map_err(failed)?;
            // Hidden folders count, as in `glob`.
            if entry.file_type().map_err(failed)?.is_dir() {
                folders.push(folder.join(entry.file_name()));
            }
        }
    }
    Ok(found)
}

fn files_in(folder: &Path) -> Result<Vec<PathBuf>> {
    let failed = |error: std::io::Error| Error::io(folder, "list", &error);
    let mut all = Vec::new();
    for entry in std::fs::read_dir(folder).map_err(failed)? {
        all.push(entry.map_err(failed)?.path());
    }
    all.retain(|path| !is_hidden(path) && !is_manifest(path));
    all.sort();
    let (meshes, others): (Vec<PathBuf>, Vec<PathBuf>) =
        all.into_iter().partition(|path| studio::is_named_mesh(path));
    let scenes = || others.into_iter().filter(|path| is_named_scene(path)).collect();
    let files: Vec<PathBuf> = if meshes.is_empty() { scenes() } else { meshes };
    files.into_iter().map(file).collect()
}

/// Returns true for `.NAME`, such as the `._scan.ply` that macOS writes beside a file.
fn is_hidden(path: &Path) -> bool {
    path.file_name().is_some_and(|name| name.as_encoded_bytes().starts_with(b"."))
}

/// Returns true for a sidecar of cryptomattes, which a batch may have written into the folder.
fn is_manifest(path: &Path) -> bool {
    let name = path.file_name().map(|name| name.to_string_lossy().into_owned());
    let name = name.unwrap_or_default();
    picture::MANIFESTS.iter().any(|kind| name.ends_with(&format!(".{kind}.json")))
}

fn is_named_scene(path: &Path) -> bool {
    path.extension().is_some_and(|end| end.eq_ignore_ascii_case("json"))
}

/// Returns the error of a pipe or a device.
pub fn not_a_file(path: &Path) -> Option<Error> {
    let error = files::not_a_file(path)?;
    Some(error.help("save it as a file: a batch reads its files more than once"))
}

/// Returns the path if it is a file. Anything else would change the numbers of the frames if it
/// were left out, for example on a machine that lacks a disk.
fn file(path: PathBuf) -> Result<PathBuf> {
    let data = std::fs::metadata(&path).map_err(|error| Error::io(&path, "read", &error))?;
    if data.is_file() {
        return Ok(path);
    }
    let what = if data.is_dir() { "a folder" } else { "a pipe or a device" };
    let message = format!("found {what}, expected a file");
    Err(Error::invalid(path.display().to_string(), message).help("remove it, or name the files"))
}
