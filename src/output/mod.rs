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
pub mod over;
pub mod png;
pub mod png_read;
pub mod preview;
pub mod srgb;
pub mod stored_curve;
pub mod text;
pub mod tonemap;
mod value_counts;
mod write_options;

use std::fs::File;
use std::path::{Path, PathBuf};

use crate::error::{Error, Result};
use crate::film::Film;
use crate::monitor::{Monitor, Phase};
use crate::paths;

pub use finished::FINGERPRINT;
pub use value_counts::{HALF_MAX, ValueCounts, ValueLocation};
pub use write_options::WriteOptions;

use atomic::PartFile;

/// The part files of `PREFIX.exr`, `PREFIX.png` and further files of the same picture.
#[derive(Debug)]
pub struct Outputs {
    exr: PartFile,
    png: PartFile,
    further_files: Vec<PartFile>,
}

impl Outputs {
    /// Returns the names of the EXR and the PNG for a prefix.
    pub fn names(prefix: &Path) -> [PathBuf; 2] {
        [".exr", ".png"].map(|ending| paths::with_ending(prefix, ending))
    }

    /// Creates the part files of the EXR and the PNG.
    ///
    /// # Errors
    /// The same as [`PartFile::create`]; a prefix that names a device or a pipe.
    pub fn create(prefix: &Path) -> Result<Self> {
        let is_special = |data: std::fs::Metadata| !data.is_file() && !data.is_dir();
        if std::fs::metadata(prefix).is_ok_and(is_special) {
            let message = "is a device or a pipe, expected the start of the names of two files";
            return Err(Error::invalid(prefix.display().to_string(), message));
        }
        let [exr, png] = Self::names(prefix);
        Ok(Self {
            exr: PartFile::create(&exr)?,
            png: PartFile::create(&png)?,
            further_files: Vec::new(),
        })
    }

    /// Adds a further file of the same picture, which must be written and synced.
    /// [`Outputs::write`] gives it its final name. Returns that name.
    pub fn add(&mut self, part: PartFile) -> PathBuf {
        let target = part.target().to_owned();
        self.further_files.push(part);
        target
    }

    /// Writes the EXR and the PNG, then renames all files. Uses the caller's rayon pool. Returns
    /// the names and open files of EXR, PNG and further files, and counts of the values that EXR
    /// and PNG cannot hold.
    ///
    /// # Errors
    /// `Retry` if the disk is full, `Limit` for a size that a format cannot hold, `Interrupted` if
    /// a signal arrives before the renames. No file has its final name then. If a rename fails, the
    /// files that were renamed before it stay.
    pub fn write(
        mut self,
        film: &Film,
        options: &WriteOptions,
        monitor: &Monitor,
    ) -> Result<(Vec<(PathBuf, File)>, ValueCounts)> {
        monitor.begin(Phase::Write, 1);
        let (exr, png) = rayon::join(
            || {
                let mut attributes = options.exr.attributes.to_vec();
                attributes.extend(options.fingerprint.map(|f| (FINGERPRINT.into(), f.into())));
                let options = exr::Options { attributes: &attributes, ..options.exr };
                self.exr.fill_by(|file, path| exr::write(film, &options, file, path))
            },
            || self.png.fill_by(|file, path| png::write(film, options, file, path)),
        );
        exr?;
        png?;
        monitor.check()?;
        // The EXR may refer to the further files, so they are renamed first.
        let further = self.further_files.into_iter().map(PartFile::commit);
        let further = further.collect::<Result<Vec<_>>>()?;
        let written = [self.exr.commit()?, self.png.commit()?].into_iter().chain(further).collect();
        monitor.set_done(1);
        let largest = |name: &str, kind| options.exr.largest(name, kind);
        let shown = film.in_frame();
        let size = [shown.width(), shown.height()];
        // The tiles of a picture may be too small where the merged picture is not.
        let legend = options.legend.filter(|_| !options.exr.exact);
        let legend_left_out = legend.is_some_and(|legend| !legend.fits(size));
        Ok((written, ValueCounts { legend_left_out, ..ValueCounts::count(film, largest) }))
    }
}
