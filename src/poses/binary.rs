//! `cameras.bin` and `images.bin` of COLMAP. All numbers are little-endian.

use std::collections::HashMap;
use std::path::Path;

use super::bytes::bytes;
use super::colmap_model::{Image, MODELS, Sensor};
use crate::error::{Error, Result};

/// Bytes of a point of a picture: x, y, the id of a 3D point.
const POINT_BYTES: u64 = 24;

/// A file, read from front to back.
struct Reader<'b> {
    name: String,
    all: &'b [u8],
    at: usize,
}

impl<'b> Reader<'b> {
    fn new(path: &Path, all: &'b [u8]) -> Self {
        Self { name: path.display().to_string(), all, at: 0 }
    }

    fn place(&self) -> String {
        format!("{}: byte {}", self.name, self.at)
    }

    fn take(&mut self, count: u64, what: &str) -> Result<&'b [u8]> {
        let left = &self.all[self.at..];
        match usize::try_from(count).ok().filter(|count| *count <= left.len()) {
            Some(count) => {
                self.at += count;
                Ok(&left[..count])
            }
            None => {
                let message = format!(
                    "found the end of the file, expected {what}: {count} bytes where {} are left",
                    left.len()
                );
                Err(Error::invalid(self.place(), message).help("the file is cut short"))
            }
        }
    }

    fn array<const N: usize>(&mut self, what: &str) -> Result<[u8; N]> {
        let bytes = self.take(N as u64, what)?;
        let mut array = [0; N];
        array.copy_from_slice(bytes);
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
        let left = &self.all[self.at..];
        let end = left.iter().position(|byte| *byte == 0);
        let Some(end) = end else {
            return Err(Error::invalid(self.place(), format!("found no end of {what}"))
                .help("the file is cut short"));
        };
        let text = std::str::from_utf8(&left[..end])
            .map_err(|_| Error::invalid(self.place(), format!("found {what} that is not UTF-8")))?;
        self.at += end + 1;
        Ok(text.to_string())
    }

    fn end(&self) -> Result<()> {
        match self.all.len() - self.at {
            0 => Ok(()),
            more => {
                let message = format!("found {more} bytes after the last entry, expected the end");
                Err(Error::invalid(self.place(), message))
            }
        }
    }
}

/// Reads the cameras of a `cameras.bin`, by id.
pub fn cameras(path: &Path) -> Result<HashMap<u32, Sensor>> {
    let all = bytes(path)?;
    let mut file = Reader::new(path, &all);
    let mut sensors = HashMap::new();
    for _ in 0..file.u64("the number of cameras")? {
        let id = file.u32("the number of a camera")?;
        let place = file.place();
        let number = i32::from_le_bytes(file.array("a camera model")?);
        let Some(model) = MODELS.iter().position(|(known, ..)| *known == number) else {
            let names = MODELS.map(|(number, name, _)| format!("{number} {name}"));
            let message =
                format!("found the camera model {number}, expected one of {}", names.join(", "));
            return Err(Error::invalid(place, message));
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
        let what = format!("{count} parameters of {name}");
        let params = (0..count).map(|_| file.finite(&what)).collect::<Result<_>>()?;
        sensors.insert(id, Sensor { model, size, params });
    }
    file.end()?;
    Ok(sensors)
}

/// Reads the pictures of an `images.bin`, in the order of the file.
pub fn images(path: &Path) -> Result<Vec<Image>> {
    let all = bytes(path)?;
    let mut file = Reader::new(path, &all);
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
        file.take(points.saturating_mul(POINT_BYTES), "points of a picture")?;
        let [w, x, y, z, tx, ty, tz] = numbers;
        let (rotation, translation) = ([w, x, y, z], [tx, ty, tz]);
        images.push(Image { rotation, translation, camera, name, place });
    }
    file.end()?;
    Ok(images)
}
