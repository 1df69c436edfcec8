//! Draws `sheet.png`: one picture per input with its name, in rows. Failures are red.

use std::fs::File;
use std::io::{BufReader, BufWriter, Write};
use std::path::{Path, PathBuf};

use embedded_graphics::mono_font::MonoFont;
use embedded_graphics::mono_font::iso_8859_1::FONT_6X10;
use image::codecs::png::PngEncoder;
use image::{Rgb, RgbImage, imageops};

use crate::error::{Error, ErrorKind, Problem, Result};
use crate::output::atomic::PartFile;
use crate::output::png_read;
use crate::output::text::draw_text;

use super::entry::SheetEntry;
use super::thumbnails::{SIDE, Strip};

const COLUMNS: usize = 15;

const FONT: &MonoFont = &FONT_6X10;
const GAP: u32 = 8;
const LINE: u32 = 14;
/// Width and height of a picture with its name and the gap after it.
const CELL: [u32; 2] = [SIDE + GAP, SIDE + LINE + GAP];
const PAPER: Rgb<u8> = Rgb([244, 245, 247]);
const INK: [u8; 3] = [28, 33, 38];
const RED: [u8; 3] = [200, 16, 46];
const PINK: Rgb<u8> = Rgb([253, 225, 229]);
const GREY: Rgb<u8> = Rgb([224, 227, 231]);

/// Writes one sheet of some inputs.
///
/// # Errors
/// A file that cannot be written.
pub fn write(path: &Path, entries: &[SheetEntry], strips: &[Option<Strip>]) -> Result<PathBuf> {
    let sheet = draw(entries, strips);
    let mut part = PartFile::create(path)?;
    part.fill_by(|file, _| {
        let mut buffered = BufWriter::new(file);
        let written = sheet.write_with_encoder(PngEncoder::new(&mut buffered));
        written.map_err(|error| {
            let message = format!("cannot write: {error}");
            Error::new(ErrorKind::Retry, Problem::new(path.display().to_string(), message))
        })?;
        // Dropping a BufWriter would ignore the error of a full disk.
        buffered.flush().map_err(|error| Error::io(path, "write", &error))
    })?;
    part.commit().map(|(path, _)| path)
}

/// Returns true for a PNG that [`write`] has made, by its size and its upper margin.
pub fn is_sheet(path: &Path) -> bool {
    let look = || {
        let file = File::open(path).ok()?;
        let bytes = file.metadata().ok()?.len();
        let mut reader = png_read::header(BufReader::new(file), bytes).ok()?;
        let (width, height) = reader.info().size();
        let has_cells = |side: u32, cell: u32| side > GAP && side % cell == GAP;
        let fits = has_cells(width, CELL[0]) && has_cells(height, CELL[1]);
        Some(fits && reader.next_row().ok()??.data() == PAPER.0.repeat(width as usize))
    };
    look().unwrap_or(false)
}

fn draw(entries: &[SheetEntry], strips: &[Option<Strip>]) -> RgbImage {
    let columns = entries.len().clamp(1, COLUMNS) as u32;
    let rows = entries.len().div_ceil(COLUMNS).max(1) as u32;
    let [width, height] = CELL;
    let mut sheet = RgbImage::from_pixel(columns * width + GAP, rows * height + GAP, PAPER);
    for (i, (entry, strip)) in entries.iter().zip(strips).enumerate() {
        let x = GAP + i as u32 % columns * width;
        let y = GAP + i as u32 / columns * height;
        let failure = entry.message();
        let ink = if failure.is_some() { RED } else { INK };
        match strip {
            Some(strip) => {
                let picture = &strip.first;
                let (dx, dy) = ((SIDE - picture.width()) / 2, (SIDE - picture.height()) / 2);
                imageops::replace(&mut sheet, picture, (x + dx).into(), (y + dy).into());
            }
            None => {
                let paper = if failure.is_some() { PINK } else { GREY };
                let cell = RgbImage::from_pixel(SIDE, SIDE, paper);
                imageops::replace(&mut sheet, &cell, x.into(), y.into());
                let text = failure.as_deref().unwrap_or("no picture");
                wrapped(&mut sheet, [x + 6, y + 6], text, ink);
            }
        }
        line(&mut sheet, x, y + SIDE + 3, entry.name(), ink);
    }
    sheet
}

/// Draws one line of text, cut off at the width of a thumbnail.
fn line(sheet: &mut RgbImage, x: u32, y: u32, text: &str, ink: [u8; 3]) {
    let most = (SIDE / FONT.character_size.width) as usize;
    let shown = |c: char| if c.is_control() { ' ' } else { c };
    let text: String = text.chars().take(most).map(shown).collect();
    let size = sheet.dimensions().into();
    let put = |x, y, color| sheet.put_pixel(x, y, Rgb(color));
    draw_text(size, put, (&text, FONT), [x, y], ink);
}

/// Draws a text over a whole cell, broken into lines.
fn wrapped(sheet: &mut RgbImage, [x, y]: [u32; 2], text: &str, ink: [u8; 3]) {
    let most = ((SIDE - 12) / FONT.character_size.width) as usize;
    let characters: Vec<char> = text.chars().collect();
    let lines = characters.chunks(most).take(((SIDE - 12) / 11) as usize);
    for (i, characters) in lines.enumerate() {
        let text: String = characters.iter().collect();
        line(sheet, x, y + 11 * i as u32, &text, ink);
    }
}
