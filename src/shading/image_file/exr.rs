//! OpenEXR textures: reads the pixels of the data window, wherever it lies in the picture.
//!
//! A texture is the whole picture (the display window), black where the file has no pixels. Memory
//! is allocated only for the pixels in the file, because a small file can declare a picture of any
//! size.

use std::fs::File;
use std::io::{BufReader, Seek};
use std::ops::Range;
use std::path::Path;

use exr::meta::MetaData;
use exr::meta::attribute::SampleType;
use exr::meta::header::Header;
use exr::prelude::{ReadChannels, ReadLayers, read};

use crate::error::{Error, Result};
use crate::output::exr_check::{self, exr_error};
use crate::reserve;

/// Position and size of picture and data window, from the header.
#[derive(Debug, Clone)]
pub struct ExrLayout {
    /// Width and height of the picture.
    pub size: [u32; 2],
    /// Columns of the picture for which the file has pixels.
    pub columns: Range<u32>,
    /// Rows of the picture for which the file has pixels.
    pub rows: Range<u32>,
    /// Top left pixel of the data window, relative to the picture's top left.
    first: [i64; 2],
    /// Whether the file has an alpha channel.
    pub has_alpha: bool,
}

impl ExrLayout {
    /// Reads the layout from the header of a file.
    ///
    /// # Errors
    /// `Invalid` for a file that is no EXR or has no channels R, G and B of half or float.
    pub fn read_header(file: &mut BufReader<File>, path: &Path) -> Result<Self> {
        exr_check::check(path)?;
        rewind(file, path)?;
        let meta = MetaData::read_from_buffered(&mut *file, false);
        let meta = meta.map_err(|error| exr_error(path, error))?;
        let has = |header: &Header, name: &str| {
            header.channels.list.iter().any(|channel| channel.name.eq(name))
        };
        let colour = |h: &&Header| !h.deep && ["R", "G", "B"].iter().all(|name| has(h, name));
        let Some(header) = meta.headers.iter().find(colour) else {
            let message = "cannot read this EXR: found no part with the channels R, G and B";
            return Err(Error::invalid(path.display().to_string(), message));
        };
        let mut colours = header
            .channels
            .list
            .iter()
            .filter(|channel| ["R", "G", "B"].iter().any(|name| channel.name.eq(name)));
        if colours.any(|channel| channel.sample_type == SampleType::U32) {
            let message = "found R, G or B of type uint, expected half or float";
            return Err(Error::invalid(path.display().to_string(), message));
        }
        let display = header.shared_attributes.display_window;
        let (data, first) = (header.layer_size, header.own_attributes.layer_position);
        let side = |size: usize| u32::try_from(size).unwrap_or(u32::MAX);
        let within = |first: i64, count: usize, size: usize| {
            let limit = |at: i64| at.clamp(0, i64::from(side(size))) as u32;
            limit(first)..limit(first.saturating_add(i64::from(side(count))))
        };
        let (start, size) = (display.position, display.size);
        let apart = |a: i32, b: i32| i64::from(a) - i64::from(b);
        let first = [apart(first.x(), start.x()), apart(first.y(), start.y())];
        Ok(Self {
            size: [side(size.x()), side(size.y())],
            columns: within(first[0], data.x(), size.x()),
            rows: within(first[1], data.y(), size.y()),
            first,
            has_alpha: has(header, "A"),
        })
    }

    /// Number of the picture's pixels that the file has.
    pub fn pixels(&self) -> u64 {
        self.columns.len() as u64 * self.rows.len() as u64
    }

    /// Index of a pixel of the data window among the pixels that are kept; `None` if it lies
    /// outside of the picture.
    fn place(&self, x: usize, y: usize) -> Option<usize> {
        let within = |at: usize, first: i64, inside: &Range<u32>| {
            let at = u32::try_from(at as i64 + first).ok()?;
            inside.contains(&at).then(|| (at - inside.start) as usize)
        };
        let x = within(x, self.first[0], &self.columns)?;
        Some(within(y, self.first[1], &self.rows)? * self.columns.len() + x)
    }

    /// Reads R, G, B of the kept pixels, row by row.
    ///
    /// # Errors
    /// `Invalid` for damaged files, `Retry` if memory is short.
    pub fn read(&self, file: &mut BufReader<File>, path: &Path) -> Result<Vec<f32>> {
        let count = usize::try_from(self.pixels()).unwrap_or(usize::MAX).saturating_mul(3);
        let bytes = (count as u64).saturating_mul(size_of::<f32>() as u64);
        reserve::probe(bytes, &path.display().to_string())?;
        rewind(file, path)?;
        let layout = self.clone();
        let image = read()
            .no_deep_data()
            .largest_resolution_level()
            .rgba_channels(
                move |_, _| vec![0.0f32; count],
                move |pixels: &mut Vec<f32>, at, (r, g, b, _): (f32, f32, f32, f32)| {
                    let pixel = layout.place(at.x(), at.y());
                    if let Some(pixel) = pixel.and_then(|at| pixels.get_mut(3 * at..3 * at + 3)) {
                        pixel.copy_from_slice(&[r, g, b]);
                    }
                },
            )
            .first_valid_layer()
            .all_attributes()
            .from_buffered(file)
            .map_err(|error| exr_error(path, error))?;
        Ok(image.layer_data.channel_data.pixels)
    }
}

fn rewind(file: &mut BufReader<File>, path: &Path) -> Result<()> {
    file.rewind().map_err(|error| Error::io(path, "read the texture", &error))
}
