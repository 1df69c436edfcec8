//! Writes a [`Film`] to files: a linear EXR with its layers, and a PNG.
//!
//! No incomplete file appears under a final name. Both files are written as `.part` next to their
//! targets and renamed together at the end ([`atomic`]). They are created before the long work
//! starts, so that a missing or write-protected folder is reported in the first second.

pub mod atomic;
pub mod exr;
pub mod exr_check;
pub mod exr_read;
pub mod finished;
pub mod legend;
pub mod png;
pub mod preview;
pub mod srgb;
pub mod tonemap;

use std::path::{Path, PathBuf};

use rayon::prelude::*;

use crate::{
    error::Result,
    film::{ChannelKind, Dropped, Film},
    monitor::{Monitor, Phase},
    paths,
    scene::Tonemap,
};

use atomic::Part;

/// Largest finite value of a half-float.
pub const HALF_MAX: f32 = 65504.0;

/// Name of the EXR attribute and PNG text that hold the fingerprint: a line that identifies the
/// inputs of the render.
pub const FINGERPRINT: &str = "lightpath:fingerprint";

/// The location of a value in a film.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct ValueLocation {
    /// Pixel of the frame, `[x, y]` from the top left.
    pub pixel: [i32; 2],
    /// Name of the channel.
    pub channel: String,
}

impl std::fmt::Display for ValueLocation {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let [x, y] = self.pixel;
        write!(f, "x {x}, y {y} in {}", self.channel)
    }
}

/// Counts of values that the files cannot hold.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct ValueCounts {
    /// Number of pixels with a NaN or infinite channel. NaN becomes 0, infinities the largest half.
    pub non_finite: u64,
    /// Location of the first such value.
    pub first_non_finite: Option<ValueLocation>,
    /// Number of pixels whose values are all finite, but some beyond the range of the half that is
    /// written.
    pub clamped: u64,
    /// Location of the first such value.
    pub first_clamped: Option<ValueLocation>,
    /// Coverage that the mattes cannot hold.
    pub dropped: Dropped,
}

impl ValueCounts {
    /// Counts the values in all pixels of a film, on the threads of the caller's rayon pool. With
    /// `float`, no value is written as half.
    pub fn count(film: &Film, float: bool) -> Self {
        let width = film.window.width().max(1) as usize;
        let rows = film.pixels.par_chunks(width).enumerate().with_min_len(16);
        let largest = |kind| match kind {
            ChannelKind::Half if !float => HALF_MAX,
            _ => f32::MAX,
        };
        let beauty = largest(ChannelKind::Half);
        let kinds = film.planes.channels.iter().enumerate();
        let floats: Vec<(usize, f32)> = kinds
            .filter(|(_, channel)| channel.kind != ChannelKind::Uint)
            .map(|(i, channel)| (i, largest(channel.kind)))
            .collect();
        let found = rows.map(|(row, pixels)| {
            let mut found = Self::default();
            for (column, pixel) in pixels.iter().enumerate() {
                let index = row * width + column;
                // NaN fails the comparison, so the common case is one test per channel.
                if pixel.iter().all(|c| c.abs() <= beauty)
                    && floats.iter().all(|&(i, limit)| film.planes.float(i, index).abs() <= limit)
                {
                    continue;
                }
                let names = ["R", "G", "B", "A"].into_iter().zip(*pixel).zip([beauty; 4]);
                let planes = floats.iter().map(|&(i, limit)| {
                    let name = film.planes.channels[i].name.as_str();
                    ((name, film.planes.float(i, index)), limit)
                });
                let [left, top] = film.origin();
                let pixel = [left + column as i32, top + row as i32];
                found.add(pixel, names.chain(planes));
            }
            found
        });
        Self { dropped: film.dropped, ..found.reduce(Self::default, Self::then) }
    }

    /// Counts one pixel. Each value has a channel name and a maximum absolute value.
    fn add<'a>(
        &mut self,
        pixel: [i32; 2],
        values: impl Iterator<Item = ((&'a str, f32), f32)> + Clone,
    ) {
        let spot = |name: &str| ValueLocation { pixel, channel: name.to_string() };
        let infinite = values.clone().find(|((_, value), _)| !value.is_finite());
        if let Some(((name, _), _)) = infinite {
            self.non_finite += 1;
            self.first_non_finite.get_or_insert_with(|| spot(name));
        } else if let Some(((name, _), _)) = values.clone().find(|((_, v), max)| v.abs() > *max) {
            self.clamped += 1;
            self.first_clamped.get_or_insert_with(|| spot(name));
        }
    }

    /// Combines the counts of these pixels and of later ones.
    fn then(self, next: Self) -> Self {
        Self {
            non_finite: self.non_finite + next.non_finite,
            first_non_finite: self.first_non_finite.or(next.first_non_finite),
            clamped: self.clamped + next.clamped,
            first_clamped: self.first_clamped.or(next.first_clamped),
            dropped: self.dropped.and(next.dropped),
        }
    }
}

/// Returns a value that every format can hold: NaN becomes 0, infinities the largest half.
#[inline(always)]
pub(crate) fn finite(value: f32) -> f32 {
    if value.is_nan() {
        0.0
    } else if value.is_infinite() {
        HALF_MAX.copysign(value)
    } else {
        value
    }
}

/// The files `PREFIX.exr` and `PREFIX.png` while they are written.
#[derive(Debug)]
pub struct Outputs {
    exr: Part,
    png: Part,
    beside: Vec<Part>,
}

/// Options for writing a film to files.
#[derive(Debug, Clone, Copy)]
pub struct WriteOptions<'a> {
    /// Tone mapping of the PNG.
    pub tonemap: &'a Tonemap,
    /// True if the PNG has an alpha channel.
    pub transparent: bool,
    /// Number of bits of the PNG's channels.
    pub depth: tonemap::Depth,
    /// Legend to draw into the PNG.
    pub legend: Option<&'a legend::Legend>,
    /// Fingerprint of the render's inputs, for both files: an attribute of the EXR, a text of the
    /// PNG.
    pub fingerprint: Option<&'a str>,
    /// Metadata and encoding of the EXR.
    pub exr: exr::Options<'a>,
}

impl Outputs {
    /// Returns the names of the EXR and the PNG for a prefix.
    pub fn names(prefix: &Path) -> [PathBuf; 2] {
        [".exr", ".png"].map(|ending| paths::with_ending(prefix, ending))
    }

    /// Creates both part files.
    ///
    /// # Errors
    /// `Invalid` if the folder is missing, is not a folder or is not writable.
    pub fn create(prefix: &Path) -> Result<Self> {
        let [exr, png] = Self::names(prefix);
        Ok(Self { exr: Part::create(&exr)?, png: Part::create(&png)?, beside: Vec::new() })
    }

    /// Adds a further file of the same picture. It must be written and synced. It gets its final
    /// name together with the other two. Returns that name.
    pub fn add(&mut self, part: Part) -> PathBuf {
        let target = part.target().to_owned();
        self.beside.push(part);
        target
    }

    /// Writes both files, then renames all. Uses the caller's rayon pool.
    ///
    /// # Errors
    /// `Retry` if the disk is full, `Interrupted` if a signal arrives before the renames. No file
    /// has its final name then.
    pub fn write(
        mut self,
        film: &Film,
        options: &WriteOptions,
        monitor: &Monitor,
    ) -> Result<([PathBuf; 2], ValueCounts)> {
        monitor.begin(Phase::Write, 1);
        let (exr, png) = rayon::join(
            || {
                let path = self.exr.target().to_owned();
                let mut attributes = options.exr.attributes.to_vec();
                attributes.extend(options.fingerprint.map(|f| (FINGERPRINT.into(), f.into())));
                let options = exr::Options { attributes: &attributes, ..options.exr };
                exr::write(film, &options, self.exr.file(), &path)?;
                self.exr.sync()
            },
            || {
                let path = self.png.target().to_owned();
                png::write(film, options, self.png.file(), &path)?;
                self.png.sync()
            },
        );
        exr?;
        png?;
        monitor.check()?;
        // Renamed before the EXR, which may refer to them.
        self.beside.into_iter().try_for_each(|part| part.commit().map(drop))?;
        let paths = [self.exr.commit()?, self.png.commit()?];
        Ok((paths, ValueCounts::count(film, options.exr.float)))
    }
}
