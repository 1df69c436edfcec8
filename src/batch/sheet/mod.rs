//! The contact sheet: what a batch made, to look at. `index.html`, one file that needs no other, and
//! `sheet.png`.

mod entry;
mod missing;
mod page;
mod png;
mod thumbnails;

use std::path::{Path, PathBuf};

use rayon::{ThreadPoolBuilder, prelude::*};

use crate::{
    error::{Error, Kind, Problem, Result},
    output::atomic::{Sweep, TextFile},
};

use super::{job::Job, journal};

pub use missing::missing;

use entry::Entry;
use thumbnails::Strip;

/// Thumbnails in one page: more frames of few inputs, fewer of many.
const MOST_THUMBNAILS: usize = 20_000;
/// Thumbnails of one input.
const MOST_FRAMES: usize = 24;

/// Writes the sheet of all that the journals and the pictures of a job's folder tell.
///
/// # Errors
/// Where it cannot be written. Pictures that cannot be read are left out.
pub fn write(job: &Job, threads: usize) -> Result<Vec<PathBuf>> {
    let entries = Entry::all(job, &journal::read(&job.folder));
    let each = (MOST_THUMBNAILS / entries.len().max(1)).clamp(1, MOST_FRAMES);
    let pool = ThreadPoolBuilder::new().num_threads(threads).build().map_err(|error| {
        let message = format!("cannot start {threads} threads: {error}");
        Error::new(Kind::Retry, Problem::new("--threads", message))
    })?;
    let strip = |entry: &Entry| Strip::of(job, entry, each);
    let strips: Vec<Option<Strip>> = pool.install(|| entries.par_iter().map(strip).collect());
    let sweep = Sweep::default();
    let page = || text(&sweep, &job.folder.join("index.html"), &page::html(&entries, &strips));
    let sheet = |(number, (entries, strips)): (usize, (&[Entry], &[Option<Strip>]))| {
        let name = match number {
            0 => "sheet.png".to_string(),
            n => format!("sheet.{}.png", n + 1),
        };
        let path = job.folder.join(name);
        sweep.target(&path);
        png::write(&path, entries, strips)
    };
    let parts = entries.par_chunks(png::CELLS).zip(strips.par_chunks(png::CELLS)).enumerate();
    let sheets = || parts.map(sheet).collect::<Result<Vec<PathBuf>>>();
    let (page, sheets) = pool.install(|| rayon::join(page, sheets));
    Ok([vec![page?], sheets?].concat())
}

fn text(sweep: &Sweep, path: &Path, text: &str) -> Result<PathBuf> {
    sweep.target(path);
    TextFile::create(path)?.finish(text)
}
