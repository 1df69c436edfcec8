//! Reads EXR files that this program wrote, some rows at a time.

use std::fs::File;
use std::io::BufReader;
use std::ops::Range;
use std::path::{Path, PathBuf};

use exr::block::UncompressedBlock;
use exr::block::chunk::Chunk;
use exr::block::reader::{ChunksReader, Reader as Blocks};
use exr::math::Vec2;
use exr::meta::BlockDescription;
use exr::meta::attribute::{AttributeValue, SampleType};
use half::f16;

use crate::error::{Error, Result};
use crate::files::{Stamp, changed};
use crate::film::{Channel, ChannelKind, Window};
use crate::parallel;

use super::exr::text::decode;
use super::exr::{CameraMatrices, Sequence};
use super::exr_check::{self, exr_error};

/// The header of an EXR with one part, in scanlines. Its display window begins at (0, 0) and
/// contains its data window. [`ExrReader::rows`] opens the file again.
#[derive(Debug)]
pub struct ExrReader {
    path: PathBuf,
    stamp: Option<Stamp>,
    /// Width and height of the display window in pixels.
    pub frame: [u32; 2],
    /// The data window, in pixels of the frame.
    pub window: Window,
    /// Channels in file order, which is the order of their names.
    pub channels: Vec<Channel>,
    /// Text attributes, sorted by name.
    pub attributes: Vec<(String, String)>,
    /// The attribute `software`: the program that wrote the file.
    pub software: String,
    /// The camera; `None` if the file has no `worldToCamera`.
    pub view: Option<CameraMatrices>,
    /// The position of the picture in a sequence.
    pub sequence: Sequence,
}

/// The values of all channels in some rows.
#[derive(Debug)]
pub struct Rows {
    /// Number of channels in a pixel.
    stride: usize,
    width: usize,
    y0: u32,
    /// A word for each channel, pixel by pixel, row by row: the bits of an f32, or a u32.
    words: Vec<u32>,
}

impl Rows {
    /// Returns the channels of a pixel. `x` counts from the left of the data window, `y` from the
    /// top of the frame. Panics outside the rows that were read.
    pub fn pixel(&self, x: usize, y: u32) -> &[u32] {
        let index = ((y - self.y0) as usize * self.width + x) * self.stride;
        &self.words[index..index + self.stride]
    }
}

impl ExrReader {
    /// Opens a file and reads its header.
    ///
    /// # Errors
    /// `Invalid` for a file that is not EXR, is truncated, or is not of the kind of [`ExrReader`].
    /// `Unsupported` for a compression that cannot be read.
    pub fn open(path: &Path) -> Result<Self> {
        exr_check::check(path)?;
        let failed = |error| exr_error(path, error);
        let opened = File::open(path).map_err(|error| Error::io(path, "read", &error))?;
        let data = opened.metadata().map_err(|error| Error::io(path, "read", &error))?;
        let stamp = Stamp::of(&data);
        let blocks = Blocks::read_from_buffered(BufReader::new(opened), true).map_err(failed)?;
        let [header] = blocks.headers() else {
            let help = "a render with --part or --tile keeps --multipart for the merged file";
            return Err(refused(path, "several parts", "one").help(help));
        };
        if header.deep || header.blocks != BlockDescription::ScanLines {
            return Err(refused(path, "tiles or deep data", "scanlines"));
        }
        let display = header.shared_attributes.display_window;
        if display.position.x() != 0 || display.position.y() != 0 {
            return Err(refused(path, "a frame that does not begin at 0, 0", "one that does"));
        }
        let (origin, size) = (header.own_attributes.layer_position, header.layer_size);
        let side = |start: i32, size: usize| {
            let start = u32::try_from(start).ok()?;
            Some([start, start.checked_add(u32::try_from(size).ok()?)?])
        };
        let frame = [display.size.x(), display.size.y()].map(|side| side as u32);
        let within = |end: u32, axis: usize| end <= frame[axis];
        let window = match (side(origin.x(), size.x()), side(origin.y(), size.y())) {
            (Some([x0, x1]), Some([y0, y1])) if within(x1, 0) && within(y1, 1) => {
                Window { x0, y0, x1, y1 }
            }
            _ => return Err(refused(path, "pixels outside of the frame", "a crop of it")),
        };
        let mut channels = Vec::new();
        for channel in &header.channels.list {
            if channel.sampling.x() != 1 || channel.sampling.y() != 1 {
                return Err(refused(path, "subsampled channels", "all pixels"));
            }
            let kind = match channel.sample_type {
                SampleType::F16 => ChannelKind::Half,
                SampleType::F32 => ChannelKind::Float,
                SampleType::U32 => ChannelKind::Uint,
            };
            channels.push(Channel { name: channel.name.to_string(), kind });
        }
        let own = &header.own_attributes;
        let mut attributes: Vec<(String, String)> = Vec::new();
        let mut sequence = Sequence { frame: None, per_second: own.frames_per_second };
        for (name, value) in &own.other {
            match value {
                AttributeValue::Text(text) => {
                    attributes.push((name.to_string(), decode(text)));
                }
                AttributeValue::I32(frame) if *name == *"imageCounter" => {
                    sequence.frame = Some(*frame);
                }
                _ => {}
            }
        }
        attributes.sort();
        let Vec2(x, y) = own.screen_window_center;
        let view = own.world_to_camera.map(|world_to_camera| CameraMatrices {
            world_to_camera,
            world_to_ndc: own.world_to_normalized_device,
            screen_window_width: own.screen_window_width,
            screen_window_center: [x, y],
            pixel_aspect: header.shared_attributes.pixel_aspect,
        });
        let software = own.software_name.as_ref().map(ToString::to_string).unwrap_or_default();
        let path = path.to_owned();
        Ok(Self { path, stamp, frame, window, channels, attributes, software, view, sequence })
    }

    /// Returns the value of a text attribute.
    pub fn attribute(&self, name: &str) -> Option<&str> {
        let found = self.attributes.iter().find(|(known, _)| known == name);
        found.map(|(_, value)| value.as_str())
    }

    /// Reads the rows that are in `rows` (rows of the frame) and in the data window: none if the
    /// two do not overlap. Decompresses on the caller's rayon pool.
    ///
    /// # Errors
    /// `Invalid` for damaged or missing pixels. `Retry` if the file has changed since
    /// [`ExrReader::open`].
    pub fn rows(&self, rows: Range<u32>) -> Result<Rows> {
        let failed = |error| exr_error(&self.path, error);
        let window = self.window;
        let y0 = rows.start.clamp(window.y0, window.y1);
        let y1 = rows.end.clamp(y0, window.y1);
        let read = |error: std::io::Error| Error::io(&self.path, "read", &error);
        let file = File::open(&self.path).map_err(read)?;
        // The header was read earlier. The file must not have changed since.
        if Stamp::of(&file.metadata().map_err(read)?) != self.stamp {
            return Err(changed(&self.path));
        }
        let blocks = Blocks::read_from_buffered(BufReader::new(file), true).map_err(failed)?;
        let (first, end) = ((y0 - window.y0) as usize, (y1 - window.y0) as usize);
        let chunks = blocks
            // `true` refuses a table of offsets that names a chunk twice.
            .filter_chunks(true, |_, _, block| {
                let (y, height) = (block.pixel_position.1, block.pixel_size.1);
                y < end && y + height > first
            })
            .map_err(failed)?;
        let meta = chunks.meta_data().clone();
        let chunks = chunks.collect::<std::result::Result<Vec<Chunk>, _>>().map_err(failed)?;
        let decompress = |chunk: Chunk| UncompressedBlock::decompress_chunk(chunk, &meta, true);
        let blocks = parallel::try_map(chunks.into_iter(), decompress).map_err(failed)?;
        let (stride, width) = (self.channels.len(), window.width() as usize);
        let mut words = vec![0; (end - first) * width * stride];
        let mut seen = vec![false; end - first];
        for block in &blocks {
            self.unpack(block, first, &mut seen, &mut words);
        }
        if seen.contains(&false) {
            return Err(refused(&self.path, "missing rows", "a complete file"));
        }
        Ok(Rows { stride, width, y0, words })
    }

    /// Copies the lines of a block to `words`, whose first row is row `first` of the data window.
    /// Sets `seen` for each row that was copied.
    fn unpack(
        &self,
        block: &UncompressedBlock,
        first: usize,
        seen: &mut [bool],
        words: &mut [u32],
    ) {
        let (stride, width) = (self.channels.len(), self.window.width() as usize);
        let mut bytes = block.data.as_slice();
        for line in
            block.index.pixel_position.1..block.index.pixel_position.1 + block.index.pixel_size.1
        {
            let row = line.checked_sub(first).filter(|row| *row < seen.len());
            for (c, channel) in self.channels.iter().enumerate() {
                let size = if channel.kind == ChannelKind::Half { 2 } else { 4 };
                let (values, rest) = bytes.split_at((size * width).min(bytes.len()));
                bytes = rest;
                let Some(row) = row else { continue };
                let to = words[row * width * stride..][..width * stride].iter_mut();
                let to = to.skip(c).step_by(stride);
                match channel.kind {
                    ChannelKind::Half => {
                        for (to, two) in to.zip(values.chunks_exact(2)) {
                            *to = f16::from_ne_bytes([two[0], two[1]]).to_f32().to_bits();
                        }
                    }
                    ChannelKind::Float | ChannelKind::Uint => {
                        for (to, four) in to.zip(values.chunks_exact(4)) {
                            *to = u32::from_ne_bytes([four[0], four[1], four[2], four[3]]);
                        }
                    }
                }
            }
            if let Some(row) = row {
                seen[row] = true;
            }
        }
    }
}

fn refused(path: &Path, found: &str, expected: &str) -> Error {
    Error::invalid(path.display().to_string(), format!("found {found}, expected {expected}"))
}
