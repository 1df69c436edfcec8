//! Merges the parts of a picture into the [`Film`] that one render would have made. The result is
//! the same bit for bit if all parts hold full precision ([`Parts::exact`]). Pixels of other parts
//! are rounded to 16-bit floats.
//!
//! A part is an EXR with the attribute [`part::ATTRIBUTE`]. A part with all samples of its pixels
//! holds the channels of the picture. A part with some of the samples holds sums (see
//! [`PartialSumsLayout`]).

mod cover;
pub mod part;

use std::path::{Path, PathBuf};

use rayon::prelude::*;
use serde_json::{Value, json};

use crate::error::{Error, ErrorKind, Failures, Problem, Result};
use crate::film::{Channel, ChannelKind, Dropped, Film, ReservedFilm, Window};
use crate::layers::{BEAUTY, PartialSumsLayout, PixelState};
use crate::monitor::Monitor;
use crate::output::exr::{CameraMatrices, Sequence};
use crate::output::exr_read::{ExrReader, Rows};

use self::cover::{CoverFault, CoveredRegion};
pub use self::part::{PartDescription, PictureFormat};

/// Approximate number of bytes of the parts' rows in memory at a time. A band has at least 16 rows.
const BAND_BYTES: usize = 128 << 20;
/// Name of the fact that all parts must have in common.
const FINGERPRINT: &str = "fingerprint";
/// Name of a fact that parts rendered with Embree must have in common.
const INSTRUCTIONS: &str = "instruction set of Embree";
/// Attribute whose value is `no` if the pixels of a render differ from run to run. Other renders do
/// not have it.
const UNREPRODUCIBLE: &str = "lightpath:reproducible";
/// Maximum number of faults that an error lists.
const MAX_NAMED_FAULTS: usize = 20;

/// The parts of one picture, which cover it exactly once.
#[derive(Debug)]
pub struct Parts {
    open: Vec<OpenPart>,
    /// Description of the first part. All parts share the fields about the whole picture, except
    /// that `files.over` is true if it is in any part.
    pub part: PartDescription,
}

/// A part whose header has been read and checked.
#[derive(Debug)]
struct OpenPart {
    name: String,
    reader: ExrReader,
    part: PartDescription,
    raw: Option<PartialSumsLayout>,
    /// Indices of R, G, B, A among the file's channels.
    beauty: [usize; 4],
    /// For each word (32-bit value) of a pixel besides `beauty`, the index of its channel in the
    /// file. The words are those of `raw`. If `raw` is `None`, they are the layers' channels
    /// (`part.layout`).
    words: Vec<usize>,
}

impl Parts {
    /// Opens the files and checks that they are parts of one picture and cover it exactly once.
    ///
    /// # Errors
    /// `Invalid` for files that are not parts, for parts of different pictures, and for samples
    /// that are missing or duplicated. The errors of [`ExrReader::open`].
    pub fn open(paths: &[PathBuf]) -> Result<Self> {
        let mut failures = Failures::default();
        let open: Vec<OpenPart> =
            paths.iter().filter_map(|path| failures.keep(OpenPart::new(path))).collect();
        failures.check()?;
        let Some(first) = open.first() else {
            return Err(Error::invalid("", "found no parts to merge"));
        };
        let differences = open[1..].iter().filter_map(|other| first.difference(other));
        Error::check(ErrorKind::Invalid, differences.collect())?;
        let mut part = first.part.clone();
        part.files.over = open.iter().any(|open| open.part.files.over);
        let pieces = open
            .iter()
            .map(|o| CoveredRegion { window: o.reader.window, samples: o.part.samples() });
        let faults = cover::faults(&pieces.collect::<Vec<_>>(), part.whole(), part.of);
        let named = faults.iter().take(MAX_NAMED_FAULTS).map(|fault| describe(fault, &open, &part));
        let mut problems: Vec<Problem> = named.collect();
        if faults.len() > MAX_NAMED_FAULTS {
            let message = format!("and {} more", faults.len() - MAX_NAMED_FAULTS);
            problems.push(Problem::new("parts", message));
        }
        Error::check(ErrorKind::Invalid, problems)?;
        Ok(Self { open, part })
    }

    /// Returns true if all parts hold full precision. Then the PNG has the same pixels as that of
    /// one render.
    pub fn exact(&self) -> bool {
        self.open.iter().all(|open| open.part.exact)
    }

    /// Returns true if values of the parts were changed by their compression.
    pub fn lossy(&self) -> bool {
        self.part.files.compression.is_lossy() && !self.exact()
    }

    /// Returns true if the parts were compared by the scene and its files.
    pub fn is_one_scene(&self) -> bool {
        self.open.len() == 1 || self.part.fingerprint.is_some()
    }

    /// Returns the text attributes of the merged picture. If it is not the whole frame, it is a
    /// part again.
    ///
    /// # Errors
    /// A failure to serialise, which cannot occur with the present types.
    pub fn attributes(&self) -> Result<Vec<(String, String)>> {
        let Some(first) = self.open.first() else { return Ok(Vec::new()) };
        let mut all = first.reader.attributes.clone();
        match self.part.merged(first.reader.frame) {
            None => all.retain(|(name, _)| name != part::ATTRIBUTE),
            Some(merged) => {
                let text = merged.text()?;
                let own = all.iter_mut().filter(|(name, _)| name == part::ATTRIBUTE);
                own.for_each(|(_, old)| old.clone_from(&text));
            }
        }
        Ok(all)
    }

    /// Returns the camera of the merged picture.
    pub fn view(&self) -> Option<CameraMatrices> {
        self.open.first()?.reader.view
    }

    /// Returns frame number and frame rate of the merged picture.
    pub fn sequence(&self) -> Sequence {
        self.open.first().map(|open| open.reader.sequence).unwrap_or_default()
    }

    /// Reads and merges the parts. Works on bands of rows, on the caller's rayon pool.
    ///
    /// # Errors
    /// `Invalid` for damaged files. `Retry` if a file has changed since [`Parts::open`], or if
    /// there is no memory for the picture. `Interrupted` after a signal.
    pub fn film(&self, monitor: &Monitor) -> Result<Film> {
        let (part, whole) = (&self.part, self.part.whole());
        let frame = self.open.first().map_or([0; 2], |open| open.reader.frame);
        let mut film = ReservedFilm::new(frame, whole, part.layout.channels.clone())?.film();
        let width = whole.width() as usize;
        let stride = part.layout.channels.len();
        let row_bytes =
            |open: &OpenPart| open.reader.channels.len() * 4 * open.reader.window.width() as usize;
        let bytes: usize = self.open.iter().map(row_bytes).sum();
        let height = (BAND_BYTES / bytes.max(1)).clamp(16, 1 << 16) / 16 * 16;
        let (mut pixels, mut words) =
            (film.pixels.as_mut_slice(), film.planes.words.as_mut_slice());
        let mut dropped = Dropped::default();
        let mut y0 = whole.y0;
        while y0 < whole.y1 {
            let y1 = whole.y1.min(y0.saturating_add(height as u32));
            let mut here = self.rows(y0, y1)?;
            here.sort_by_key(|(open, _)| open.part.samples[0]);
            let rows = (y1 - y0) as usize;
            let (band, rest) = pixels.split_at_mut(rows * width);
            pixels = rest;
            let (band_words, rest) = words.split_at_mut(rows * width * stride);
            words = rest;
            // Without layers there are no words to distribute.
            let mut none = vec![Vec::new(); if stride == 0 { rows } else { 0 }];
            let mut lines: Vec<&mut [u32]> = match stride {
                0 => none.iter_mut().map(Vec::as_mut_slice).collect(),
                _ => band_words.chunks_mut(width * stride).collect(),
            };
            let lines = band.par_chunks_mut(width).zip(lines.par_iter_mut()).enumerate();
            let lines = lines
                .map(|(row, (pixels, words))| self.line(&here, y0 + row as u32, pixels, words));
            dropped = dropped.and(lines.reduce(Dropped::default, Dropped::and));
            monitor.set_done(u64::from(y1 - whole.y0));
            monitor.check()?;
            y0 = y1;
        }
        film.dropped = dropped;
        Ok(film)
    }

    /// Reads the rows `y0..y1` from every part that overlaps them.
    fn rows(&self, y0: u32, y1: u32) -> Result<Vec<(&OpenPart, Rows)>> {
        let reaches = |w: Window| w.y0 < y1 && w.y1 > y0;
        let here = self.open.iter().filter(|open| reaches(open.reader.window));
        here.map(|open| Ok((open, open.reader.rows(y0..y1)?))).collect()
    }

    /// Makes row `y` of the picture. `parts` must be sorted by their samples. Returns the coverage
    /// that the mattes of pixels merged from sums cannot hold. (For other pixels, the render of the
    /// part has dropped such coverage.)
    fn line(
        &self,
        parts: &[(&OpenPart, Rows)],
        y: u32,
        pixels: &mut [[f32; 4]],
        words: &mut [u32],
    ) -> Dropped {
        let (layout, of, x0) = (&self.part.layout, self.part.of, self.part.whole().x0);
        let stride = layout.channels.len();
        let mut sums = PixelState::new(layout);
        let mut gathered = Vec::new();
        let mut dropped = Dropped::default();
        let of_row = |(open, _): &&(&OpenPart, Rows)| {
            let window = open.reader.window;
            window.y0 <= y && window.y1 > y
        };
        let parts: Vec<&(&OpenPart, Rows)> = parts.iter().filter(of_row).collect();
        for (column, pixel) in pixels.iter_mut().enumerate() {
            let x = x0 + column as u32;
            let words = &mut words[column * stride..(column + 1) * stride];
            sums.clear();
            let mut is_sum = false;
            for (open, rows) in &parts {
                let window = open.reader.window;
                if x < window.x0 || x >= window.x1 {
                    continue;
                }
                let found = rows.pixel((x - window.x0) as usize, y);
                match &open.raw {
                    Some(raw) => {
                        gathered.clear();
                        gathered.extend(open.words.iter().map(|&from| found[from]));
                        raw.add(&gathered, &mut sums);
                        is_sum = true;
                    }
                    None => {
                        *pixel = open.beauty.map(|from| f32::from_bits(found[from]));
                        for (word, &from) in words.iter_mut().zip(&open.words) {
                            *word = found[from];
                        }
                    }
                }
            }
            if is_sum {
                let (mean, lost) = sums.finish(layout, of, words);
                *pixel = mean;
                dropped = dropped.and(lost);
            }
        }
        dropped
    }
}

impl OpenPart {
    fn new(path: &Path) -> Result<Self> {
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
    fn difference(&self, other: &Self) -> Option<Problem> {
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
            both("camera", &|open| format!("{:?}", open.reader.view)),
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

fn describe(fault: &CoverFault, open: &[OpenPart], part: &PartDescription) -> Problem {
    let Window { x0, y0, x1, y1 } = fault.window;
    let samples = match fault.samples.clone() {
        all if all == (0..part.of) => String::new(),
        some => format!("samples {}..{} of {} of ", some.start, some.end, part.of),
    };
    let what = format!("{samples}the pixels x {x0}..{x1}, y {y0}..{y1}");
    match fault.twice {
        Some([a, b]) => {
            let message = format!("{what} are also in {}", open[a].name);
            Problem::new(open[b].name.clone(), message).help("leave out one of the two")
        }
        None => {
            let tiles = open.iter().find_map(|open| open.part.tile).map(|[_, n]| n);
            let is_tile =
                |n: &u32| (1..=*n).find(|&i| part::band(part.whole(), i, *n) == fault.window);
            let tile = tiles.and_then(|n| Some(format!(" (--tile {}/{n})", is_tile(&n)?)));
            let message = format!("missing: {what}{}", tile.unwrap_or_default());
            Problem::new("parts", message).help("render them, then merge all files")
        }
    }
}
