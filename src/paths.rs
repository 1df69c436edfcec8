//! Names of output files, and paths that remain valid when a scene is saved elsewhere.

use std::ffi::OsStr;
use std::path::{Component, Path, PathBuf};

use crate::error::{Error, Result};

/// Returns the path of a render's files without ending: `-o`, or the input's stem in the working
/// folder.
///
/// `-o out/` and an existing folder mean the stem in that folder. `-o a.png` and `-o a.exr` mean
/// `a`, because nobody wants `a.png.exr`. The stem of `-` is `stdin`.
pub fn prefix(output: Option<&Path>, input: &Path) -> PathBuf {
    let stem = match stem(input) {
        Some(stem) if input != Path::new("-") => stem.to_owned(),
        _ => "stdin".into(),
    };
    let Some(output) = output else {
        return stem.into();
    };
    let text = output.as_os_str().as_encoded_bytes();
    if text.ends_with(b"/") || output.is_dir() {
        return output.join(stem);
    }
    let is_ours =
        |end: &std::ffi::OsStr| end.eq_ignore_ascii_case("exr") || end.eq_ignore_ascii_case("png");
    match output.extension() {
        Some(end) if is_ours(end) => output.with_extension(""),
        _ => output.to_owned(),
    }
}

/// Returns the path with `ending` appended. An extension that the path has already stays.
pub fn with_ending(prefix: &Path, ending: &str) -> PathBuf {
    let mut name = prefix.as_os_str().to_owned();
    name.push(ending);
    name.into()
}

/// Returns the file name without its ending. Drops both endings of a compressed mesh: `.ply.gz`.
pub fn stem(path: &Path) -> Option<&OsStr> {
    let stem = Path::new(path.file_stem()?);
    let ends = |path: &Path, ends: &[&str]| {
        path.extension().is_some_and(|e| ends.iter().any(|end| e.eq_ignore_ascii_case(end)))
    };
    match ends(path, &["gz", "zst"]) && ends(stem, &["ply"]) {
        true => stem.file_stem(),
        false => Some(stem.as_os_str()),
    }
}

/// Returns `path` as text for a scene file.
///
/// # Errors
/// A name that is not UTF-8.
pub fn named(path: &Path) -> Result<String> {
    let text = path.to_str().map(str::to_owned);
    text.ok_or_else(|| {
        let message = "found a name that is not UTF-8, expected one that a JSON scene can hold";
        Error::invalid(path.display().to_string(), message)
            .help("rename the file, or make a link to it under another name: ln -s")
    })
}

/// Refuses output names with control characters, which a terminal, a log or a farm could take for
/// more than a name.
///
/// # Errors
/// `Invalid` for control characters, which include line breaks.
pub fn refuse_control_characters(path: &Path) -> Result<()> {
    match path.to_string_lossy().contains(char::is_control) {
        false => Ok(()),
        true => {
            let message =
                "found a control character, such as a line break, in the name of an output";
            Err(Error::invalid(path.display().to_string(), message).help("choose another name"))
        }
    }
}

/// Returns `path` relative to `folder`, with `/` between its parts. `path` and `folder` are
/// absolute or relative to the working folder.
///
/// # Errors
/// A name that is not UTF-8.
pub fn seen_from(path: &Path, folder: &Path) -> Result<String> {
    // Resolves only the folder: a file that is a link keeps its name.
    let path = match (path.parent(), path.file_name()) {
        (Some(parent), Some(name)) => real(parent).join(name),
        _ => real(path),
    };
    let folder = real(folder);
    let there: Vec<Component> = path.components().collect();
    let here: Vec<Component> = folder.components().collect();
    let common = there.iter().zip(&here).take_while(|(a, b)| a == b).count();
    let ups = here[common..].iter().map(|_| Ok("..".to_string()));
    let downs = there[common..].iter().map(|c| named(c.as_ref()));
    Ok(ups.chain(downs).collect::<Result<Vec<_>>>()?.join("/"))
}

/// Makes a folder's path absolute, and resolves links if it exists.
fn real(folder: &Path) -> PathBuf {
    let folder = if folder.as_os_str().is_empty() { Path::new(".") } else { folder };
    let absolute = || std::path::absolute(folder);
    folder.canonicalize().or_else(|_| absolute()).unwrap_or_else(|_| folder.to_owned())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_prefix_comes_from_the_output_or_the_input() {
        let of = |output: Option<&str>, input: &str| {
            let prefix = prefix(output.map(Path::new), Path::new(input));
            prefix.to_str().unwrap().to_string()
        };
        assert_eq!(of(None, "a/scan.v2.ply"), "scan.v2");
        assert_eq!(of(None, "a/scan.ply.gz"), "scan");
        assert_eq!(of(None, "a/scan.PLY.zst"), "scan");
        assert_eq!(of(None, "a/scan.gz"), "scan");
        assert_eq!(of(None, "-"), "stdin");
        assert_eq!(of(Some("out/x.0001"), "a.json"), "out/x.0001");
        assert_eq!(of(Some("out/x.PNG"), "a.json"), "out/x");
        assert_eq!(of(Some("nowhere/"), "b/a.json"), "nowhere/a");
        assert_eq!(of(Some("/"), "b/a.json"), "/a");
    }

    #[test]
    fn paths_are_made_relative_to_a_folder() {
        let of = |path, folder| seen_from(Path::new(path), Path::new(folder)).unwrap();
        assert_eq!(of("/no/a/b.ply", "/no/a"), "b.ply");
        assert_eq!(of("/no/a/b.ply", "/no/c/d"), "../../a/b.ply");
        assert_eq!(of("nosuch.ply", ""), "nosuch.ply");
        assert_eq!(of("x/nosuch.ply", "."), "x/nosuch.ply");
    }
}
