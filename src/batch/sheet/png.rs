//! Draws `sheet.png`: one picture per input with its name, in rows. Failures are red.

use std::path::{Path, PathBuf};

use embedded_graphics::{
    mono_font::{MonoFont, MonoTextStyle, ascii::FONT_6X10},
    pixelcolor::Rgb888,
    prelude::*,
    text::{Baseline, Text},
};
use image::{ImageFormat, Rgb, RgbImage, imageops};

use crate::{
    error::{Error, ErrorKind, Problem, Result},
    output::atomic::PartFile,
};

use super::{
    entry::SheetEntry,
    thumbnails::{SIDE, Strip},
};

const COLUMNS: usize = 15;

const FONT: &MonoFont = &FONT_6X10;
const GAP: u32 = 8;
const LINE: u32 = 14;
const PAPER: Rgb<u8> = Rgb([244, 245, 247]);
const INK: Rgb888 = Rgb888::new(28, 33, 38);
const RED: Rgb888 = Rgb888::new(200, 16, 46);
const PINK: Rgb<u8> = Rgb([253, 225, 229]);
const GREY: Rgb<u8> = Rgb([224, 227, 231]);

/// Writes one sheet of some inputs.
///
/// # Errors
/// A file that cannot be written.
pub fn write(path: &Path, entries: &[SheetEntry], strips: &[Option<Strip>]) -> Result<PathBuf> {
    let sheet = draw(entries, strips);
    let mut part = PartFile::create(path)?;
    let written = sheet.0.write_to(&mut std::io::BufWriter::new(part.file()), ImageFormat::Png);
    written.map_err(|error| {
        let problem = Problem::new(path.display().to_string(), format!("cannot write: {error}"));
        Error::new(ErrorKind::Retry, problem)
    })?;
    part.sync()?;
    part.commit()
}

fn draw(entries: &[SheetEntry], strips: &[Option<Strip>]) -> Sheet {
    let columns = entries.len().clamp(1, COLUMNS) as u32;
    let rows = entries.len().div_ceil(COLUMNS).max(1) as u32;
    let (width, height) = (SIDE + GAP, SIDE + LINE + GAP);
    let mut sheet = Sheet(RgbImage::from_pixel(columns * width + GAP, rows * height + GAP, PAPER));
    for (i, (entry, strip)) in entries.iter().zip(strips).enumerate() {
        let x = GAP + i as u32 % columns * width;
        let y = GAP + i as u32 / columns * height;
        let failure = entry.message();
        match strip {
            Some(strip) => {
                let picture = &strip.first;
                let (dx, dy) = ((SIDE - picture.width()) / 2, (SIDE - picture.height()) / 2);
                imageops::replace(&mut sheet.0, picture, (x + dx).into(), (y + dy).into());
            }
            None => {
                let paper = if failure.is_some() { PINK } else { GREY };
                let cell = RgbImage::from_pixel(SIDE, SIDE, paper);
                imageops::replace(&mut sheet.0, &cell, x.into(), y.into());
                sheet.wrapped(x + 6, y + 6, failure.as_deref().unwrap_or("no picture"));
            }
        }
        let ink = if failure.is_some() { RED } else { INK };
        sheet.line(x, y + SIDE + 3, entry.name(), ink);
    }
    sheet
}

/// A picture to draw text on.
struct Sheet(RgbImage);

impl Sheet {
    /// Draws one line of text, cut off at the width of a thumbnail.
    fn line(&mut self, x: u32, y: u32, text: &str, ink: Rgb888) {
        let most = (SIDE / FONT.character_size.width) as usize;
        let text: String = text.chars().take(most).collect();
        let at = Point::new(x as i32, y as i32);
        let text = Text::with_baseline(&text, at, MonoTextStyle::new(FONT, ink), Baseline::Top);
        // Drawing into memory cannot fail: the error type has no values.
        let _ = text.draw(self);
    }

    /// Draws a text over a whole cell, broken into lines.
    fn wrapped(&mut self, x: u32, y: u32, text: &str) {
        let most = ((SIDE - 12) / FONT.character_size.width) as usize;
        let characters: Vec<char> = text.chars().collect();
        let lines = characters.chunks(most).take(((SIDE - 12) / 11) as usize);
        for (i, line) in lines.enumerate() {
            let line: String = line.iter().map(|c| if c.is_control() { ' ' } else { *c }).collect();
            self.line(x, y + 11 * i as u32, &line, RED);
        }
    }
}

impl OriginDimensions for Sheet {
    fn size(&self) -> Size {
        Size::new(self.0.width(), self.0.height())
    }
}

impl DrawTarget for Sheet {
    type Color = Rgb888;
    type Error = std::convert::Infallible;

    fn draw_iter<I: IntoIterator<Item = Pixel<Rgb888>>>(
        &mut self,
        pixels: I,
    ) -> std::result::Result<(), Self::Error> {
        for Pixel(at, color) in pixels {
            let (Ok(x), Ok(y)) = (u32::try_from(at.x), u32::try_from(at.y)) else { continue };
            if let Some(pixel) = self.0.get_pixel_mut_checked(x, y) {
                *pixel = Rgb([color.r(), color.g(), color.b()]);
            }
        }
        Ok(())
    }
}
