//! Names of the files of a batch: frames by a pattern such as `{stem}/{stem}.{frame:04}`, and
//! contact sheets.

use std::hash::{DefaultHasher, Hash, Hasher};
use std::path::{Component, Path, PathBuf};
use std::sync::Arc;

use crate::error::{Error, Problem, Result};
use crate::output::Outputs;
use crate::paths;
use crate::scene::did_you_mean;
use crate::studio;

/// Pattern for the path of a frame's files within the output folder, without the ending.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct NamePattern {
    pieces: Vec<Piece>,
    /// Names of the pictures of a list of cameras, by frame.
    images: Arc<[String]>,
}

#[derive(Debug, Clone, PartialEq, Eq)]
enum Piece {
    Text(String),
    /// The input's file name without its ending.
    Stem,
    /// The name of the input's folder.
    Parent,
    /// Index of the input, from 0, with at least this many digits.
    Input(usize),
    /// Index of the frame, from 0, with at least this many digits.
    Frame(usize),
    /// Name of the frame's picture in the list of cameras.
    Image,
}

const FIELDS: [&str; 5] = ["stem", "parent", "input", "frame", "image"];

impl NamePattern {
    /// Default for one frame per input.
    pub const STILL: &str = "{stem}";
    /// Default for a turntable: each input has its own folder.
    pub const FRAMES: &str = "{stem}/{stem}.{frame:04}";

    /// Default for a list of cameras.
    pub const IMAGES: &str = "{stem}/{image}";

    /// Parses a pattern. An ending `.exr` or `.png` is ignored. `place` names the source in
    /// messages.
    ///
    /// # Errors
    /// Unknown fields, unbalanced braces, a path that leaves the output folder.
    pub fn parse(place: &str, text: &str) -> Result<Self> {
        let complain = |message: String| Error::invalid(place, message);
        let whole = text.strip_suffix(".exr").or(text.strip_suffix(".png")).unwrap_or(text);
        let mut pieces = Vec::new();
        let mut rest = whole;
        while let Some(at) = rest.find(['{', '}']) {
            let (before, field) = rest.split_at(at);
            let end = field.find('}').filter(|end| *end > 0 && field.starts_with('{'));
            let Some(end) = end else {
                return Err(complain(format!("found unbalanced braces in {text:?}"))
                    .help("fields stand in braces: {stem}/{stem}.{frame:04}"));
            };
            pieces.push(Piece::Text(before.to_string()));
            pieces.push(piece(&field[1..end]).map_err(|(message, help)| {
                complain(format!("{message} in {text:?}")).maybe_help(help)
            })?);
            rest = &field[end + 1..];
        }
        pieces.push(Piece::Text(rest.to_string()));
        pieces.retain(|piece| *piece != Piece::Text(String::new()));
        let pattern = Self { pieces, images: Arc::new([]) };
        let sample = pattern.of(Path::new("parent/stem"), 0, 0);
        if !is_within(&sample) {
            let message = format!("found {text:?}, expected a name within the output folder");
            return Err(complain(message).help("-o names the folder"));
        }
        Ok(pattern)
    }

    /// Sets the names that `{image}` stands for.
    ///
    /// # Errors
    /// `{image}` in the pattern without a list of cameras.
    pub fn with_images(self, place: &str, images: Vec<String>) -> Result<Self> {
        if images.is_empty() && self.has_image() {
            let message = "found {image} without a list of cameras";
            return Err(Error::invalid(place, message).help("name the list: --cameras FILE"));
        }
        Ok(Self { images: images.into(), ..self })
    }

    /// Refuses an input whose frames would lie outside the output folder, or would have names with
    /// control characters or that are not UTF-8. For example, `...ply` has the stem `..`.
    ///
    /// # Errors
    /// `Invalid`, at the input.
    pub fn check(&self, input: &Path, number: usize) -> Result<()> {
        let name = self.of(input, number, 0);
        let place = input.display().to_string();
        if !is_within(&name) {
            let message = format!(
                "found frames of the name {name:?}, expected a name within the output folder"
            );
            return Err(Error::invalid(place, message).help("rename the input, or choose --name"));
        }
        if name.to_str().is_none() {
            let message = "found frames whose names are not UTF-8, expected names that the journal \
                           can hold";
            // The scene around a mesh holds its path, whatever the frames are called.
            let help = match studio::is_mesh(input) {
                true => "rename the input",
                false => "rename the input, or choose --name {input:04}",
            };
            return Err(Error::invalid(place, message).help(help));
        }
        paths::refuse_control_characters(&name).map_err(|error| Error {
            problems: error
                .problems
                .into_iter()
                .map(|p| Problem { place: place.clone(), ..p })
                .collect(),
            ..error
        })
    }

    /// Returns true if the names hold those of the pictures of a list of cameras.
    pub fn has_image(&self) -> bool {
        self.pieces.contains(&Piece::Image)
    }

    /// Returns true if the frames of one input have different names.
    pub fn has_frame_number(&self) -> bool {
        self.pieces.iter().any(|piece| matches!(piece, Piece::Frame(_) | Piece::Image))
    }

    /// Returns the path of a frame within the output folder, without the ending.
    pub fn of(&self, input: &Path, number: usize, frame: u32) -> PathBuf {
        let mut name = std::ffi::OsString::new();
        for piece in &self.pieces {
            match piece {
                Piece::Text(text) => name.push(text),
                Piece::Stem => name.push(paths::stem(input).unwrap_or("input".as_ref())),
                Piece::Parent => name.push(parent(input)),
                Piece::Input(digits) => name.push(format!("{number:0digits$}")),
                Piece::Frame(digits) => name.push(format!("{frame:0digits$}")),
                Piece::Image => {
                    name.push(self.images.get(frame as usize).map_or("image", String::as_str));
                }
            }
        }
        name.into()
    }
}

/// Returns true if a path stays within the folder that it is joined to, and ends with a name.
fn is_within(name: &Path) -> bool {
    let plain = |c: Component| matches!(c, Component::Normal(_) | Component::CurDir);
    // `file_name` and `components` ignore `/` and `/.` at the end.
    let bytes = name.as_os_str().as_encoded_bytes();
    let named = !bytes.ends_with(b"/") && !bytes.ends_with(b"/.");
    named && name.file_name().is_some() && name.components().all(plain)
}

/// Returns the name of the folder that contains an input. `..` leads to the folder above in the
/// path as written, so a link gives the same name on every machine.
fn parent(input: &Path) -> std::ffi::OsString {
    let absolute = std::path::absolute(input).unwrap_or_else(|_| input.to_owned());
    let mut folder = PathBuf::new();
    for component in absolute.parent().iter().flat_map(|folder| folder.components()) {
        match component {
            Component::ParentDir => drop(folder.pop()),
            other => folder.push(other),
        }
    }
    folder.file_name().unwrap_or("root".as_ref()).to_owned()
}

fn piece(field: &str) -> std::result::Result<Piece, (String, Option<String>)> {
    let (name, width) = field.split_once(':').unwrap_or((field, ""));
    let digits = || {
        let digits = if width.is_empty() { Some(0) } else { width.parse().ok() };
        let wrong = || (format!("found the width {width:?}, expected digits such as 04"), None);
        digits.filter(|digits| *digits <= 20).ok_or_else(wrong)
    };
    match name {
        "stem" if width.is_empty() => Ok(Piece::Stem),
        "parent" if width.is_empty() => Ok(Piece::Parent),
        "input" => digits().map(Piece::Input),
        "frame" => digits().map(Piece::Frame),
        "image" if width.is_empty() => Ok(Piece::Image),
        _ => {
            let help = did_you_mean(name, FIELDS);
            let help = help.unwrap_or(
                "the fields are {stem}, {parent}, {input:03}, {frame:04}, {image}".into(),
            );
            Err((format!("found the unknown field {{{field}}}"), Some(help)))
        }
    }
}

/// File name of the contact sheet's page.
pub const PAGE: &str = "index.html";

/// Number of pictures on one PNG of the contact sheet.
pub const PICTURES_PER_SHEET: usize = 300;

/// Returns the file names of the contact sheet's PNGs for a job with this many inputs.
pub fn sheets(inputs: usize) -> Vec<String> {
    let name = |number: usize| match number {
        1 => "sheet.png".to_string(),
        n => format!("sheet.{n}.png"),
    };
    (1..=inputs.div_ceil(PICTURES_PER_SHEET).max(1)).map(name).collect()
}

/// Hash of a frame's name, index of its input, and index of the frame within the input.
type HashedName = (u64, u32, u32);

/// Refuses two frames with the same name, and a frame with the name of a contact sheet's file or in
/// a folder of that name.
/// `text` is the pattern and `place` is where it was written, for messages.
///
/// # Errors
/// The first such pair in the order of the job.
pub fn distinct(
    place: &str,
    (name, text): (&NamePattern, &str),
    inputs: &[&Path],
    frames: u32,
) -> Result<()> {
    if frames > 1 && !name.has_frame_number() {
        let message = format!("found {text:?} for {frames} frames, expected {{frame}} in it");
        return Err(Error::invalid(place, message).help("{stem}/{stem}.{frame:04}"));
    }
    let of =
        |&(_, input, frame): &HashedName| name.of(inputs[input as usize], input as usize, frame);
    let mut all: Vec<HashedName> = Vec::new();
    let (mut sheets, mut first) = (sheets(inputs.len()), None);
    sheets.push(PAGE.to_string());
    for input in 0..inputs.len() as u32 {
        for frame in 0..frames {
            let path = of(&(0, input, frame));
            let mut hasher = DefaultHasher::new();
            path.hash(&mut hasher);
            let named = (hasher.finish(), input, frame);
            let [_, png] = Outputs::names(&path);
            let png = png.strip_prefix(".").unwrap_or(&png);
            // A folder of that name would be in the way, too.
            if first.is_none() && sheets.iter().any(|sheet| png.starts_with(sheet)) {
                first = Some((named, None));
            }
            all.push(named);
        }
    }
    all.sort_unstable();
    // Equal names have equal hashes. Only names with equal hashes are compared.
    for alike in all.chunk_by(|a, b| a.0 == b.0).filter(|alike| alike.len() > 1) {
        let same = |(i, a): (usize, &HashedName)| {
            let b = alike[i + 1..].iter().find(|b| of(a) == of(b))?;
            Some((*a, Some(*b)))
        };
        let pair = alike.iter().enumerate().find_map(same);
        first = [first, pair].into_iter().flatten().min_by_key(|((_, i, frame), _)| (*i, *frame));
    }
    let Some((one, other)) = first else { return Ok(()) };
    let called = |&(_, input, frame): &HashedName| {
        let path = inputs[input as usize].display();
        if frames > 1 { format!("frame {frame} of {path}") } else { path.to_string() }
    };
    let shown = other.as_ref().map_or("the contact sheet".to_string(), called);
    let path = of(&one);
    let message =
        format!("{} and {shown} would both be written to {:?}", called(&one), path.display());
    let in_folder = |input: u32| {
        let path = inputs[input as usize];
        (parent(path), paths::stem(path))
    };
    let number = if frames > 1 { ".{frame:04}" } else { "" };
    let help = match other {
        Some((_, input, _)) if input == one.1 => {
            "tell them apart: --name '{stem}/{frame:04}'".to_string()
        }
        // Folders do not tell a file from itself, or from the same scan in another format.
        Some((_, input, _)) if in_folder(input) == in_folder(one.1) => {
            format!("tell them apart: --name '{{input:03}}-{{stem}}{number}'")
        }
        _ => format!(
            "tell them apart: --name '{{parent}}/{{stem}}{number}', or '{{input:03}}-{{stem}}{number}'"
        ),
    };
    Err(Error::invalid(place, message).help(help))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn fields_are_filled_in() {
        let of = |text: &str| {
            let pattern = NamePattern::parse("--name", text).unwrap();
            pattern.of(Path::new("/scans/red/a.ply.gz"), 7, 12).to_str().unwrap().to_string()
        };
        assert_eq!(of("{stem}/{stem}.{frame:04}.exr"), "a/a.0012");
        assert_eq!(of("{parent}-{input:03}_{frame}"), "red-007_12");
        assert_eq!(of(NamePattern::STILL), "a");
        let parents = [
            ("/scans/red/../blue/a.ply", "blue"),
            ("/scans/red/../a.ply", "scans"),
            ("/scans/red/./a.ply", "red"),
            ("/../a.ply", "root"),
        ];
        let pattern = NamePattern::parse("--name", "{parent}").unwrap();
        for (input, name) in parents {
            assert_eq!(pattern.of(Path::new(input), 0, 0), Path::new(name), "{input}");
        }
        assert!(NamePattern::parse("", NamePattern::FRAMES).unwrap().has_frame_number());
        assert!(!NamePattern::parse("", NamePattern::STILL).unwrap().has_frame_number());
    }

    #[test]
    fn invalid_patterns_are_refused() {
        let bad = [
            "",
            "a/",
            "{stem}/.",
            "/a",
            "../a",
            "{stem",
            "stem}",
            "{frmae}",
            "{frame:x}",
            "{stem:3}",
            "{frame:99}",
            "{}",
        ];
        for text in bad {
            assert!(NamePattern::parse("--name", text).is_err(), "{text}");
        }
        // The stem of `..ply` is `.`.
        let pattern = NamePattern::parse("--name", "{parent}/{stem}").unwrap();
        assert!(pattern.check(Path::new("scans/..ply"), 0).is_err());
        let error = NamePattern::parse("--name", "{frmae:04}").unwrap_err();
        assert!(error.to_string().contains("frame"), "{error}");
    }
}
