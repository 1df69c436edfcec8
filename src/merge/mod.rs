//! Merges the parts of a picture into the [`Film`] that one render would have made. The result is
//! the same bit for bit if all parts hold full precision ([`Parts::exact`]). Pixels of other parts
//! are rounded to 16-bit floats.
//!
//! A part is an EXR with the attribute [`part::ATTRIBUTE`]. A part with all samples of its pixels
//! holds the channels of the picture. A part with some of the samples holds sums (see
//! [`crate::layers::PartialSumsLayout`]).

mod cover;
mod open_part;
pub mod part;

use std::path::PathBuf;

use crate::error::{Error, ErrorKind, Failures, Problem, Result};
use crate::film::{Dropped, Film, ReservedFilm, Window};
use crate::layers::PixelState;
use crate::monitor::Monitor;
use crate::output::exr::{CameraMatrices, Sequence};
use crate::output::exr_read::Rows;
use crate::parallel;

use self::cover::{CoverFault, CoveredRegion};
use self::open_part::OpenPart;
pub use self::part::{PartDescription, PictureFormat};

/// Approximate number of bytes of the parts' rows in memory at a time. A band has at least 16 rows.
const BAND_BYTES: usize = 128 << 20;
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
            let lines = band.chunks_mut(width).zip(lines.iter_mut()).zip(y0..y1);
            let lines =
                parallel::map(lines, |((pixels, words), y)| self.line(&here, y, pixels, words));
            dropped = lines.into_iter().fold(dropped, Dropped::and);
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
