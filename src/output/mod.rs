//! [`Film`] -> files: a linear half-float EXR and an 8-bit PNG.
//!
//! Nothing appears under a final name before it is complete: both files grow beside their targets
//! as `.part` and are renamed together at the end ([`atomic`]). They are created before the long
//! work starts, so that a folder that is missing or full of rules is found in the first second.

pub mod atomic;
pub mod exr;
mod exr_header;
pub mod png;
pub mod tonemap;

use std::path::{Path, PathBuf};

use rayon::prelude::*;

use crate::{
    error::Result,
    film::Film,
    monitor::{Monitor, Phase},
    scene::Tonemap,
};

use atomic::Part;

/// Largest finite half-float.
pub const HALF_MAX: f32 = 65504.0;

/// What the files cannot hold, counted instead of written.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Oddities {
    /// Pixels with a NaN or an infinite channel; NaN becomes 0, infinities the largest half.
    pub non_finite: u64,
    /// The first such pixel of the frame, `[x, y]` from the top left.
    pub first_non_finite: Option<[u32; 2]>,
    /// Pixels with a finite channel beyond the range of half, clamped in the EXR.
    pub clamped: u64,
    /// The first such pixel.
    pub first_clamped: Option<[u32; 2]>,
}

impl Oddities {
    /// Looks at every pixel of a film, on the threads of the caller's rayon pool.
    pub fn of(film: &Film) -> Self {
        let width = film.window.width().max(1) as usize;
        let rows = film.pixels.par_chunks(width).enumerate().with_min_len(16);
        let found = rows.map(|(row, pixels)| {
            let mut found = Self::default();
            for (column, pixel) in pixels.iter().enumerate() {
                // NaN fails the comparison, so the common case is one test per channel.
                if pixel.iter().all(|c| c.abs() <= HALF_MAX) {
                    continue;
                }
                let at = [film.window.x0 + column as u32, film.window.y0 + row as u32];
                if pixel.iter().all(|c| c.is_finite()) {
                    found.clamped += 1;
                    found.first_clamped.get_or_insert(at);
                } else {
                    found.non_finite += 1;
                    found.first_non_finite.get_or_insert(at);
                }
            }
            found
        });
        found.reduce(Self::default, Self::then)
    }

    /// Of these pixels and those after them.
    fn then(self, next: Self) -> Self {
        Self {
            non_finite: self.non_finite + next.non_finite,
            first_non_finite: self.first_non_finite.or(next.first_non_finite),
            clamped: self.clamped + next.clamped,
            first_clamped: self.first_clamped.or(next.first_clamped),
        }
    }
}

/// A value that every format holds: NaN is 0, infinities are the largest half.
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
}

/// How a film becomes files.
#[derive(Debug, Clone, Copy)]
pub struct WriteOptions<'a> {
    /// Radiance to 8-bit values; PNG only.
    pub tonemap: &'a Tonemap,
    /// The PNG gets an alpha channel.
    pub transparent: bool,
    /// Custom EXR attributes, `lightpath:NAME` and value, sorted by name.
    pub attributes: &'a [(String, String)],
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
        Ok(Self { exr: Part::create(&exr)?, png: Part::create(&png)? })
    }

    /// Writes both files, then renames both. Uses the caller's rayon pool.
    ///
    /// # Errors
    /// `Retry` for a full disk, `Interrupted` if a signal came before the renames; then neither
    /// file exists under its final name.
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
                exr::write(film, options.attributes, self.exr.file(), &path)?;
                self.exr.sync()
            },
            || {
                let path = self.png.target().to_owned();
                let transparent = options.transparent;
                png::write(film, options.tonemap, transparent, self.png.file(), &path)?;
                self.png.sync()
            },
        );
        exr?;
        png?;
        monitor.check()?;
        let paths = [self.exr.commit()?, self.png.commit()?];
        Ok((paths, Oddities::of(film)))
    }
}
