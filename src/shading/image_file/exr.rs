//! OpenEXR textures: reads the pixels of the data window, wherever it lies in the picture. A file
//! with a Y channel alone is grey.
//!
//! A texture is the whole picture (the display window), black where the file has no pixels. Memory
//! is allocated only for the pixels in the file, because a small file can declare a picture of any
//! size.

use std::fs::File;
use std::io::Seek;
use std::ops::Range;
use std::path::Path;

use exr::math::Vec2;
use exr::meta::attribute::{ChannelList, SampleType};
use exr::meta::header::Header;
use exr::prelude::{ReadChannels, ReadLayers, ReadSpecificChannel, read};

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
    /// Whether its only colour is the luminance Y.
    is_grey: bool,
    /// All channels of the part with the texture.
    channels: Box<ChannelList>,
    /// Whether the file has an alpha channel.
    pub has_alpha: bool,
}

impl ExrLayout {
    /// Reads the layout from the header of a file.
    ///
    /// # Errors
    /// `Invalid` for a file that is no EXR or has neither R, G and B nor Y alone, as half or float.
    pub fn read_header(file: &File, path: &Path) -> Result<Self> {
        exr_check::check(path)?;
        let meta = exr_check::meta(file, false).map_err(|error| exr_error(path, error))?;
        let has = |header: &Header, name: &str| {
            header.channels.list.iter().any(|channel| channel.name.eq(name))
        };
        let is_color = |h: &&Header| !h.deep && ["R", "G", "B"].iter().all(|name| has(h, name));
        // Beside these channels, Y is no grey: RY and BY are chroma, X Y Z is another colour space.
        let colors = ["R", "G", "B", "X", "RY", "BY"];
        let is_grey = |h: &&Header| !h.deep && has(h, "Y") && !colors.iter().any(|c| has(h, c));
        let color = meta.headers.iter().find(is_color);
        let Some(header) = color.or_else(|| meta.headers.iter().find(is_grey)) else {
            let message = "cannot read this EXR: found no part with the channels R, G and B, or Y";
            return Err(Error::invalid(path.display().to_string(), message));
        };
        let names: &[&str] = if color.is_some() { &["R", "G", "B"] } else { &["Y"] };
        let mut channels = header.channels.list.iter();
        let integer = channels.find(|channel| {
            channel.sample_type == SampleType::U32 && names.iter().any(|name| channel.name.eq(name))
        });
        if let Some(channel) = integer {
            let message = format!("found {} of type uint, expected half or float", channel.name);
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
            is_grey: color.is_none(),
            channels: Box::new(header.channels.clone()),
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

    /// Stores a pixel of the data window in the kept pixels, if it is one of them.
    fn store(&self, pixels: &mut [f32], at: Vec2<usize>, color: [f32; 3]) {
        let pixel = self.place(at.x(), at.y());
        if let Some(pixel) = pixel.and_then(|at| pixels.get_mut(3 * at..3 * at + 3)) {
            pixel.copy_from_slice(&color);
        }
    }

    /// Reads R, G, B of the kept pixels, row by row. A grey file has the same value in all three.
    ///
    /// # Errors
    /// `Invalid` for damaged files, `Retry` if memory is short.
    pub fn read(&self, mut file: File, path: &Path) -> Result<Vec<f32>> {
        let count = usize::try_from(self.pixels()).unwrap_or(usize::MAX).saturating_mul(3);
        let bytes = (count as u64).saturating_mul(size_of::<f32>() as u64);
        reserve::probe(bytes, &path.display().to_string())?;
        file.rewind().map_err(|error| Error::io(path, "read the texture", &error))?;
        let layout = self.clone();
        let level = read().no_deep_data().largest_resolution_level();
        let pixels = if self.is_grey {
            let black = move |_: Vec2<usize>, _: &_| vec![0.0f32; count];
            let store = move |all: &mut Vec<f32>, at, (y,): (f32,)| layout.store(all, at, [y; 3]);
            let read = level.specific_channels().required("Y").collect_pixels(black, store);
            let image = Part { channels: &self.channels, read }
                .first_valid_layer()
                .all_attributes()
                .from_unbuffered(file);
            image.map(|image| image.layer_data.channel_data.pixels)
        } else {
            let black = move |_: Vec2<usize>, _: &_| vec![0.0f32; count];
            let store = move |all: &mut Vec<f32>, at, (r, g, b, _): (f32, f32, f32, f32)| {
                layout.store(all, at, [r, g, b]);
            };
            let read = level.rgba_channels(black, store);
            let image = Part { channels: &self.channels, read }
                .first_valid_layer()
                .all_attributes()
                .from_unbuffered(file);
            image.map(|image| image.layer_data.channel_data.pixels)
        };
        pixels.map_err(|error| exr_error(path, error))
    }
}

/// Reads the first part with exactly these channels, which is the one that
/// [`ExrLayout::read_header`] chose. The crate alone takes the first part that has the channels of
/// a colour, whatever else it has.
struct Part<'c, C> {
    channels: &'c ChannelList,
    read: C,
}

impl<'s, C: ReadChannels<'s>> ReadChannels<'s> for Part<'_, C> {
    type Reader = C::Reader;

    fn create_channels_reader(&'s self, header: &Header) -> exr::error::Result<Self::Reader> {
        if header.deep || header.channels != *self.channels {
            return Err(exr::error::Error::Invalid("another part holds the texture".into()));
        }
        self.read.create_channels_reader(header)
    }
}
