//! [`Film`] -> files: a linear EXR with its layers and a PNG.
//!
//! Nothing appears under a final name before it is complete: both files grow beside their targets
//! as `.part` and are renamed together at the end ([`atomic`]). They are created before the long
//! work starts, so that a folder that is missing or full of rules is found in the first second.

pub mod atomic;
pub mod exr;
pub mod exr_check;
pub mod exr_read;
pub mod finished;
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
    scene::Tonemap,
};

use atomic::Part;

/// Largest finite half-float.
pub const HALF_MAX: f32 = 65504.0;

/// Attribute of an EXR and keyword of a PNG's text that say what a picture was made of.
pub const FINGERPRINT: &str = "lightpath:fingerprint";

/// A value in a film.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Spot {
    /// Pixel of the frame, `[x, y]` from the top left.
    pub pixel: [i32; 2],
    /// Channel.
    pub channel: String,
}

impl std::fmt::Display for Spot {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let [x, y] = self.pixel;
        write!(f, "x {x}, y {y} in {}", self.channel)
    }
}

/// What the files cannot hold, counted instead of written.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Oddities {
    /// Pixels with a NaN or an infinite channel; NaN becomes 0, infinities the largest half.
    pub non_finite: u64,
    /// The first such value.
    pub first_non_finite: Option<Spot>,
    /// Pixels with finite values alone, some of them beyond the range of half where half is written.
    pub clamped: u64,
    /// The first such value.
    pub first_clamped: Option<Spot>,
    /// What the mattes could not hold.
    pub dropped: Dropped,
}

impl Oddities {
    /// Looks at every pixel of a film, on the threads of the caller's rayon pool. `float`: nothing
    /// is written as half.
    pub fn of(film: &Film, float: bool) -> Self {
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
                    && floats.iter().all(|&(i, most)| film.planes.float(i, index).abs() <= most)
                {
                    continue;
                }
                let names = ["R", "G", "B", "A"].into_iter().zip(*pixel).zip([beauty; 4]);
                let planes = floats.iter().map(|&(i, most)| {
                    let name = film.planes.channels[i].name.as_str();
                    ((name, film.planes.float(i, index)), most)
                });
                let [left, top] = film.origin();
                let pixel = [left + column as i32, top + row as i32];
                found.add(pixel, names.chain(planes));
            }
            found
        });
        Self { dropped: film.dropped, ..found.reduce(Self::default, Self::then) }
    }

    /// Looks at the values of one pixel, each with its name and the most that it may be.
    fn add<'a>(
        &mut self,
        pixel: [i32; 2],
        values: impl Iterator<Item = ((&'a str, f32), f32)> + Clone,
    ) {
        let spot = |name: &str| Spot { pixel, channel: name.to_string() };
        let infinite = values.clone().find(|((_, value), _)| !value.is_finite());
        if let Some(((name, _), _)) = infinite {
            self.non_finite += 1;
            self.first_non_finite.get_or_insert_with(|| spot(name));
        } else if let Some(((name, _), _)) = values.clone().find(|((_, v), most)| v.abs() > *most) {
            self.clamped += 1;
            self.first_clamped.get_or_insert_with(|| spot(name));
        }
    }

    /// Of these pixels and those after them.
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

/// A value that every format holds: NaN is 0, infinities are the largest half.
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

/// `PREFIX.exr` and `PREFIX.png`, being written.
#[derive(Debug)]
pub struct Outputs {
    exr: Part,
    png: Part,
    beside: Vec<Part>,
}

/// How a film becomes files.
#[derive(Debug, Clone, Copy)]
pub struct WriteOptions<'a> {
    /// Radiance to what is shown; PNG only.
    pub tonemap: &'a Tonemap,
    /// The PNG gets an alpha channel.
    pub transparent: bool,
    /// Bits of the PNG's channels.
    pub depth: tonemap::Depth,
    /// Says of both files what they were made of: an attribute of the EXR, a text of the PNG.
    pub fingerprint: Option<&'a str>,
    /// What the EXR says and how it is stored.
    pub exr: exr::Options<'a>,
}

impl Outputs {
    /// The two names of a prefix.
    pub fn names(prefix: &Path) -> [PathBuf; 2] {
        [".exr", ".png"].map(|ending| {
            let mut name = prefix.as_os_str().to_owned();
            name.push(ending);
            PathBuf::from(name)
        })
    }

    /// Creates both part files.
    ///
    /// # Errors
    /// `Invalid` where the folder is missing, not a folder or not writable.
    pub fn create(prefix: &Path) -> Result<Self> {
        let [exr, png] = Self::names(prefix);
        Ok(Self { exr: Part::create(&exr)?, png: Part::create(&png)?, beside: Vec::new() })
    }

    /// Takes a file of the same picture that is written and synced: it gets its name together with the two.
    /// Returns that name.
    pub fn add(&mut self, part: Part) -> PathBuf {
        let target = part.target().to_owned();
        self.beside.push(part);
        target
    }

    /// Writes both files, then renames all. Uses the caller's rayon pool.
    ///
    /// # Errors
    /// `Retry` for a full disk, `Interrupted` if a signal came before the renames; then no file
    /// has got its final name.
    pub fn write(
        mut self,
        film: &Film,
        options: &WriteOptions,
        monitor: &Monitor,
    ) -> Result<([PathBuf; 2], Oddities)> {
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
                let &WriteOptions { tonemap, transparent, depth, fingerprint, .. } = options;
                let file = self.png.file();
                png::write(film, tonemap, transparent, depth, fingerprint, file, &path)?;
                self.png.sync()
            },
        );
        exr?;
        png?;
        monitor.check()?;
        // Before the EXR, which may name them.
        self.beside.into_iter().try_for_each(|part| part.commit().map(drop))?;
        let paths = [self.exr.commit()?, self.png.commit()?];
        Ok((paths, Oddities::of(film, options.exr.float)))
    }
}
