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

/// The page.
const PAGE: &str = "index.html";
/// Thumbnails in one page: more frames of few inputs, fewer of many.
const MOST_THUMBNAILS: usize = 20_000;
/// Thumbnails of one input.
const MOST_FRAMES: usize = 24;

/// The names of the sheets of so many inputs, in the job's folder.
pub fn names(inputs: usize) -> Vec<String> {
    let name = |number: usize| match number {
        1 => "sheet.png".to_string(),
        n => format!("sheet.{n}.png"),
    };
    (1..=inputs.div_ceil(png::CELLS).max(1)).map(name).collect()
}

/// All files that [`write()`] writes.
pub fn paths(job: &Job) -> impl Iterator<Item = PathBuf> {
    let sheets = names(job.inputs.len());
    [PAGE.to_string()].into_iter().chain(sheets).map(|name| job.folder.join(name))
}

/// Writes the sheet of all that the pictures and the journals of a job's folder tell.
///
/// # Errors
/// Where it cannot be written. Pictures that cannot be read are left out.
pub fn write(job: &Job, threads: usize) -> Result<Vec<PathBuf>> {
    let each = (MOST_THUMBNAILS / job.inputs.len().max(1)).clamp(1, MOST_FRAMES);
    let pool = ThreadPoolBuilder::new().num_threads(threads).build().map_err(|error| {
        let message = format!("cannot start {threads} threads: {error}");
        Error::new(Kind::Retry, Problem::new("--threads", message))
    })?;
    let entries = pool.install(|| Entry::all(job, &journal::read(&job.folder)));
    let strip = |entry: &Entry| Strip::of(job, entry, each);
    let strips: Vec<Option<Strip>> = pool.install(|| entries.par_iter().map(strip).collect());
    let sweep = Sweep::default();
    let page = || text(&sweep, &job.folder.join(PAGE), &page::html(job, &entries, &strips));
    let names = names(entries.len());
    let sheet = |(number, (entries, strips)): (usize, (&[Entry], &[Option<Strip>]))| {
        let path = job.folder.join(&names[number]);
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
