//! One part of a picture: reads and checks its header, and compares it with that of another part.

use std::path::Path;

use serde_json::{Value, json};

use super::part::{self, PartDescription, PictureFormat};
use crate::error::{Error, Problem, Result};
use crate::film::{Channel, ChannelKind};
use crate::layers::{BEAUTY, PartialSumsLayout};
use crate::output::exr_read::ExrReader;

/// Name of the fact that all parts must have in common.
const FINGERPRINT: &str = "fingerprint";
/// Name of a fact that parts rendered with Embree must have in common.
const INSTRUCTIONS: &str = "instruction set of Embree";
/// Attribute whose value is `no` if the pixels of a render differ from run to run. Other renders do
/// not have it.
const UNREPRODUCIBLE: &str = "lightpath:reproducible";

/// A part whose header has been read and checked.
#[derive(Debug)]
pub struct OpenPart {
    /// Path of the file, for messages.
    pub name: String,
    /// The open file.
    pub reader: ExrReader,
    /// What the part holds of the picture.
    pub part: PartDescription,
    /// Layout of the sums, if the part holds some of the samples of its pixels.
    pub raw: Option<PartialSumsLayout>,
    /// Indices of R, G, B, A among the file's channels.
    pub beauty: [usize; 4],
    /// For each word (32-bit value) of a pixel besides `beauty`, the index of its channel in the
    /// file. The words are those of `raw`. If `raw` is `None`, they are the layers' channels
    /// (`part.layout`).
    pub words: Vec<usize>,
}

impl OpenPart {
    /// Opens a file and checks its header.
    ///
    /// # Errors
    /// `Invalid` for a file that is no part, is damaged, or cannot be reproduced. The errors of
    /// [`ExrReader::open`].
    pub fn new(path: &Path) -> Result<Self> {
        let name = path.display().to_string();
        let reader = ExrReader::open(path)?;
        let Some(text) = reader.attribute(part::ATTRIBUTE) else {
            let message =
                format!("found no attribute {}, expected a part of a picture", part::ATTRIBUTE);
            return Err(Error::invalid(name, message).help(
                "parts are made by `lightpath render` with --tile, --samples, --part or --crop",
            ));
        };
        let part: PartDescription = serde_json::from_str(text).map_err(|error| {
            let message =
                format!("found a {} that this version cannot read: {error}", part::ATTRIBUTE);
            Error::invalid(&name, message)
        })?;
        if let Some(problem) = part.problem(reader.frame, reader.window) {
            return Err(Error::invalid(name, format!("found a damaged part: {problem}")));
        }
        if reader.attribute(UNREPRODUCIBLE).is_some_and(|value| value != "yes") {
            let message =
                "found a part of a render that cannot be reproduced, expected one with the same";
            return Err(Error::invalid(name, format!("{message} pixels in every run"))
                .help("render it without --time"));
        }
        let raw = part.raw();
        let index =
            |name: &str| reader.channels.binary_search_by(|c| c.name.as_str().cmp(name)).ok();
        let damaged = || {
            Error::invalid(&name, "found a damaged part: its channels are not those of its layers")
        };
        let expected: Vec<Channel> = match &raw {
            // Compare the count before building the list: a damaged file may state any count.
            Some(raw) if raw.words().checked_add(BEAUTY) != Some(reader.channels.len()) => {
                return Err(damaged());
            }
            Some(raw) => raw.channels(),
            None => part.layout.channels.clone(),
        };
        let found = |channel: &Channel| {
            let index = index(&channel.name)?;
            let is_uint = reader.channels[index].kind == ChannelKind::Uint;
            (is_uint == (channel.kind == ChannelKind::Uint)).then_some(index)
        };
        let words: Option<Vec<usize>> = expected.iter().map(found).collect();
        let beauty = ["R", "G", "B", "A"].map(index);
        let [Some(r), Some(g), Some(b), Some(a)] = beauty else { return Err(damaged()) };
        let beauty = [r, g, b, a];
        let Some(words) = words.filter(|words| words.len() + BEAUTY == reader.channels.len())
        else {
            return Err(damaged());
        };
        Ok(Self { name, reader, part, raw, beauty, words })
    }

    /// Returns why `other` is not a part of the same picture, or `None` if it is.
    pub fn difference(&self, other: &Self) -> Option<Problem> {
        let texts = |open: &Self| -> Vec<(String, String)> {
            // The hash is that of the fingerprint.
            let hashes = [part::ATTRIBUTE, "lightpath:sceneHash"];
            let own = open.reader.attributes.iter();
            let own = own.filter(|(name, _)| !hashes.contains(&name.as_str()));
            let software = ("software".to_string(), open.reader.software.clone());
            // The most informative attribute comes first.
            [software].into_iter().chain(own.cloned()).collect()
        };
        let none = || "none".to_string();
        let both =
            |what: &str, of: &dyn Fn(&Self) -> String| (what.to_string(), of(other), of(self));
        let mut facts = vec![
            both("frame", &|open| open.reader.frame.map(|side| side.to_string()).join(" x ")),
            both("--of", &|open| open.part.of.to_string()),
            both("picture", &|open| {
                let [x0, y0, x1, y1] = open.part.whole;
                format!("x {x0}..{x1}, y {y0}..{y1}")
            }),
            both(INSTRUCTIONS, &|open| open.part.isa.clone().unwrap_or_else(none)),
        ];
        let (theirs, ours) = (texts(other), texts(self));
        for (name, value) in &theirs {
            let known = ours.iter().find(|(known, _)| known == name);
            let known = known.map_or("none".to_string(), |(_, value)| value.clone());
            facts.push((name.clone(), value.clone(), known));
        }
        for (name, value) in &ours {
            if !theirs.iter().any(|(known, _)| known == name) {
                facts.push((name.clone(), "none".to_string(), value.clone()));
            }
        }
        let channels = |open: &Self| {
            let channels = open.part.layout.channels.iter();
            channels.map(|channel| channel.name.as_str()).collect::<Vec<_>>().join(" ")
        };
        facts.extend(fields(&other.part.files, &self.part.files));
        facts.extend([
            both("frame number", &|open| {
                open.reader.sequence.frame.map_or_else(none, |number| number.to_string())
            }),
            both("frame rate", &|open| {
                let rate = open.reader.sequence.per_second;
                rate.map_or_else(none, |(above, below)| format!("{above}/{below}"))
            }),
            both("list of layers", &channels),
            both("layout of layers", &|open| json!(open.part.layout).to_string()),
            // Last, because the other facts say what differs.
            both(FINGERPRINT, &|open| open.part.fingerprint.clone().unwrap_or_else(none)),
        ]);
        let (what, found, expected) = facts.into_iter().find(|(_, found, known)| found != known)?;
        let message =
            format!("found another {what}: {found}, expected {expected} as in {}", self.name);
        let help = match what.as_str() {
            INSTRUCTIONS => {
                "processors of different kinds give different last bits: render all parts on the same kind"
            }
            "software" | "lightpath:backend" => {
                "render all parts with one version of the program and one backend"
            }
            FINGERPRINT => {
                "the scene, a flag, or the contents of a mesh or texture changed between the parts"
            }
            _ => "merge parts of one picture: same scene, meshes, textures and flags",
        };
        Some(Problem::new(other.name.clone(), message).help(help))
    }
}

/// Returns the names of all settings of two formats, with their values.
fn fields(theirs: &PictureFormat, ours: &PictureFormat) -> Vec<(String, String, String)> {
    let compared = |format: &PictureFormat| json!(PictureFormat { over: false, ..format.clone() });
    let (theirs, ours) = (compared(theirs), compared(ours));
    let objects = [theirs.as_object(), ours.as_object()];
    let names = objects.iter().flatten().flat_map(|object| object.keys());
    let text = |format: &Value, name: &str| match format.get(name) {
        None => "none".to_string(),
        Some(Value::String(text)) => text.clone(),
        Some(value) => value.to_string(),
    };
    names
        .map(|name| (format!("{name} of the files"), text(&theirs, name), text(&ours, name)))
        .collect()
}
