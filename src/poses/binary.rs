//! `cameras.bin` and `images.bin` of COLMAP. All numbers are little-endian.

use std::fs::File;
use std::io::{BufRead, BufReader, Read};
use std::path::Path;

use super::colmap_model::{Image, MODELS, OTHERS, Sensor, Sensors};
use crate::error::{Error, Result};
use crate::units::plural;

/// Bytes of a point of a picture: x, y, the id of a 3D point.
const POINT_BYTES: u64 = 24;

/// Maximum length of a text in bytes, with its end: longer than any path.
const MAX_TEXT_BYTES: u64 = 1 << 16;

/// A file, read from front to back.
struct Reader<'p> {
    path: &'p Path,
    file: BufReader<File>,
    /// Number of bytes before the next one.
    at: u64,
    /// Number of bytes from the next one to the end.
    left: u64,
}

impl<'p> Reader<'p> {
    fn open(path: &'p Path) -> Result<Self> {
        let opened = File::open(path).and_then(|file| Ok((file.metadata()?.len(), file)));
        let (left, file) = opened.map_err(|error| Error::io(path, "read", &error))?;
        Ok(Self { path, file: BufReader::new(file), at: 0, left })
    }

    fn place(&self) -> String {
        format!("{}: byte {}", self.path.display(), self.at)
    }

    /// Passes over `count` bytes by `pass`.
    fn advance(
        &mut self,
        count: u64,
        what: &str,
        pass: impl FnOnce(&mut BufReader<File>) -> std::io::Result<()>,
    ) -> Result<()> {
        if count > self.left {
            let left = self.left;
            let message = format!(
                "found the end of the file, expected {what}: {} where {left} are left",
                plural(count as usize, "byte")
            );
            return Err(Error::invalid(self.place(), message).help("the file is cut short"));
        }
        pass(&mut self.file).map_err(|error| Error::io(self.path, "read", &error))?;
        (self.at, self.left) = (self.at + count, self.left - count);
        Ok(())
    }

    fn skip(&mut self, count: u64, what: &str) -> Result<()> {
        // A file has fewer than 2^63 bytes.
        self.advance(count, what, |file| file.seek_relative(count as i64))
    }

    fn array<const N: usize>(&mut self, what: &str) -> Result<[u8; N]> {
        let mut array = [0; N];
        self.advance(N as u64, what, |file| file.read_exact(&mut array))?;
        Ok(array)
    }

    fn u32(&mut self, what: &str) -> Result<u32> {
        Ok(u32::from_le_bytes(self.array(what)?))
    }

    fn u64(&mut self, what: &str) -> Result<u64> {
        Ok(u64::from_le_bytes(self.array(what)?))
    }

    fn finite(&mut self, what: &str) -> Result<f64> {
        let place = self.place();
        let number = f64::from_le_bytes(self.array(what)?);
        match number.is_finite() {
            true => Ok(number),
            false => Err(Error::invalid(place, format!("found {number}, expected {what}"))),
        }
    }

    /// A text that ends with a zero byte.
    fn text(&mut self, what: &str) -> Result<String> {
        let mut text = Vec::new();
        let read = self.file.by_ref().take(MAX_TEXT_BYTES).read_until(0, &mut text);
        read.map_err(|error| Error::io(self.path, "read", &error))?;
        if text.pop() != Some(0) {
            return Err(Error::invalid(self.place(), format!("found no end of {what}"))
                .help("the file is cut short or damaged"));
        }
        let count = text.len() as u64 + 1;
        let text = String::from_utf8(text)
            .map_err(|_| Error::invalid(self.place(), format!("found {what} that is not UTF-8")))?;
        (self.at, self.left) = (self.at + count, self.left.saturating_sub(count));
        Ok(text)
    }

    fn end(&self) -> Result<()> {
        match self.left {
            0 => Ok(()),
            more => {
                let bytes = plural(more as usize, "byte");
                let message = format!("found {bytes} after the last entry, expected the end");
                Err(Error::invalid(self.place(), message))
            }
        }
    }
}

/// Reads the cameras of a `cameras.bin`, by id.
pub fn cameras(path: &Path) -> Result<Sensors> {
    let mut file = Reader::open(path)?;
    let mut sensors = Sensors::new();
    for _ in 0..file.u64("the number of cameras")? {
        let start = file.place();
        let id = file.u32("the number of a camera")?;
        let place = file.place();
        let number = i32::from_le_bytes(file.array("a camera model")?);
        let Some(model) = MODELS.iter().position(|(known, ..)| *known == number) else {
            let names = MODELS.map(|(number, name, _)| format!("{number} {name}"));
            let message =
                format!("found the camera model {number}, expected one of {}", names.join(", "));
            let error = Error::invalid(place, message);
            // The length of an entry is that of its model.
            let Some((.., count)) = OTHERS.iter().find(|(other, ..)| *other == number) else {
                return Err(error);
            };
            file.skip(2 * 8 + 8 * *count as u64, "the size and parameters of a camera")?;
            add(&mut sensors, (start, id), Err(error))?;
            continue;
        };
        let mut size = [0; 2];
        for side in &mut size {
            let place = file.place();
            let pixels = file.u64("the size of a picture")?;
            *side = u32::try_from(pixels).map_err(|_| {
                Error::invalid(place, format!("found {pixels} pixels, expected fewer"))
            })?;
        }
        let (_, name, count) = MODELS[model];
        let what = format!("{} of {name}", plural(count, "parameter"));
        let params = (0..count).map(|_| file.finite(&what)).collect::<Result<_>>()?;
        add(&mut sensors, (start, id), Ok(Sensor { model, size, params }))?;
    }
    file.end()?;
    Ok(sensors)
}

/// Adds a camera; `start` is the place of its entry.
fn add(sensors: &mut Sensors, (start, id): (String, u32), sensor: Result<Sensor>) -> Result<()> {
    match sensors.insert(id, sensor) {
        None => Ok(()),
        Some(_) => Err(Error::invalid(start, format!("found camera {id} a second time"))),
    }
}

/// Reads the pictures of an `images.bin`, in the order of the file.
pub fn images(path: &Path) -> Result<Vec<Image>> {
    let mut file = Reader::open(path)?;
    let mut images = Vec::new();
    for _ in 0..file.u64("the number of pictures")? {
        let place = file.place();
        file.u32("the number of a picture")?;
        let mut numbers = [0.0; 7];
        for value in &mut numbers {
            *value = file.finite("the pose of a picture")?;
        }
        let camera = file.u32("the number of a camera")?;
        let name = file.text("the name of a picture")?;
        let points = file.u64("the number of points")?;
        file.skip(points.saturating_mul(POINT_BYTES), "points of a picture")?;
        let [w, x, y, z, tx, ty, tz] = numbers;
        let (rotation, translation) = ([w, x, y, z], [tx, ty, tz]);
        images.push(Image { rotation, translation, camera, name, place });
    }
    file.end()?;
    Ok(images)
}
