//! The contact sheet: an overview of a batch's pictures. It consists of `index.html`, which needs
//! no other file to show thumbnails, and of `sheet.png` (`sheet.2.png`... for many inputs).

mod entry;
mod missing;
mod page;
mod png;
mod thumbnails;

use std::path::{Path, PathBuf};

use crate::error::{Problem, Result};
use crate::monitor::Monitor;
use crate::output::atomic::{PartFile, Sweep};
use crate::output::finished;
use crate::parallel;
use crate::threads;

use super::job::Job;
use super::journal;
use super::names::{PAGE, PICTURES_PER_SHEET, sheets};

pub use missing::missing;

use entry::SheetEntry;
use thumbnails::Strip;

/// Number of thumbnails on the page to aim for: the more inputs, the fewer frames of each are
/// shown. Each input gets at least one, so a page of more inputs exceeds it.
const MAX_THUMBNAILS: usize = 20_000;
/// Maximum number of thumbnails of one input.
const MAX_FRAMES: usize = 24;

/// Returns the paths of all files that [`write()`] writes.
pub fn paths(job: &Job) -> impl Iterator<Item = PathBuf> {
    let sheets = sheets(job.inputs.len());
    [PAGE.to_string()].into_iter().chain(sheets).map(|name| job.folder.join(name))
}

/// Returns the first page or picture under the name of a sheet's file that no batch has made.
pub fn foreign(job: &Job) -> Option<PathBuf> {
    let page = Some(job.folder.join(PAGE)).filter(|page| page::is_foreign(page));
    let mut paths = sheets(job.inputs.len()).into_iter().map(|name| job.folder.join(name));
    page.or_else(|| paths.find(|path| finished::is_foreign(path) && !png::is_sheet(path)))
}

/// Writes the contact sheet from the pictures and journals in the job's folder.
///
/// Pictures that cannot be read are left out. `problems` are those of [`missing()`] if the frames
/// were compared with the job, else empty.
///
/// # Errors
/// Files that cannot be written; a stop request in the monitor.
pub fn write(
    job: &Job,
    problems: &[Vec<Problem>],
    threads: usize,
    monitor: &Monitor,
) -> Result<Vec<PathBuf>> {
    let each = (MAX_THUMBNAILS / job.inputs.len().max(1)).clamp(1, MAX_FRAMES);
    let pool = threads::pool(threads)?;
    let entries = pool.install(|| SheetEntry::all(job, &journal::read(&job.folder)));
    let strip = |entry: &SheetEntry| Strip::of(job, entry, each, monitor);
    let strips = pool.install(|| parallel::try_map(entries.iter(), strip))?;
    let sweep = Sweep::default();
    let html = page::html(job, &entries, &strips, problems);
    let page = || write_text(&sweep, &job.folder.join(PAGE), &html);
    let names = sheets(entries.len());
    let sheet = |(number, (entries, strips)): (usize, (&[SheetEntry], &[Option<Strip>]))| {
        let path = job.folder.join(&names[number]);
        sweep.target(&path);
        png::write(&path, entries, strips)
    };
    let parts =
        entries.chunks(PICTURES_PER_SHEET).zip(strips.chunks(PICTURES_PER_SHEET)).enumerate();
    let sheets = || parallel::try_map(parts, sheet);
    let (page, sheets) = pool.install(|| rayon::join(page, sheets));
    Ok([vec![page?], sheets?].concat())
}

fn write_text(sweep: &Sweep, path: &Path, text: &str) -> Result<PathBuf> {
    sweep.target(path);
    PartFile::create(path)?.finish(text)
}
