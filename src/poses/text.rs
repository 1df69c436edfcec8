//! `cameras.txt` and `images.txt` of COLMAP.

use std::path::Path;
use std::str::FromStr;

use super::MAX_FILE_MIB;
use super::colmap_model::{Image, MODELS, Sensor, Sensors, model};
use crate::error::{Error, Result};
use crate::files::read_within;
use crate::units::plural;

/// The lines of a file that are no comments: number from 1, and text. `empty`: keeps empty lines.
fn lines(text: &str, empty: bool) -> impl Iterator<Item = (usize, &str)> {
    let all = text.lines().enumerate().map(|(i, line)| (i + 1, line.trim()));
    all.filter(move |(_, line)| !line.starts_with('#') && (empty || !line.is_empty()))
}

fn read(path: &Path) -> Result<String> {
    String::from_utf8(read_within(path, MAX_FILE_MIB, "a list of cameras")?).map_err(|error| {
        let at = error.utf8_error().valid_up_to();
        let message = format!("found bytes that are not UTF-8 at byte {at}, expected text");
        Error::invalid(path.display().to_string(), message)
    })
}

/// Words of a line, read one after the other.
struct Words<'t> {
    place: String,
    words: std::str::SplitWhitespace<'t>,
}

impl<'t> Words<'t> {
    fn new(path: &Path, number: usize, line: &'t str) -> Self {
        let place = format!("{}:{number}", path.display());
        Self { place, words: line.split_whitespace() }
    }

    fn word(&mut self, what: &str) -> Result<&'t str> {
        self.words.next().ok_or_else(|| {
            Error::invalid(&self.place, format!("found the end of the line, expected {what}"))
        })
    }

    fn number<T: FromStr>(&mut self, what: &str) -> Result<T> {
        let word = self.word(what)?;
        word.parse()
            .map_err(|_| Error::invalid(&self.place, format!("found {word:?}, expected {what}")))
    }

    fn finite(&mut self, what: &str) -> Result<f64> {
        let number: f64 = self.number(what)?;
        match number.is_finite() {
            true => Ok(number),
            false => Err(Error::invalid(&self.place, format!("found {number}, expected {what}"))),
        }
    }
}

/// Reads `cameras.txt`: `CAMERA_ID MODEL WIDTH HEIGHT PARAMS...`.
pub fn cameras(path: &Path) -> Result<Sensors> {
    let text = read(path)?;
    let mut sensors = Sensors::new();
    for (number, line) in lines(&text, false) {
        let mut words = Words::new(path, number, line);
        let id = words.number("the number of a camera")?;
        let name = words.word("a camera model")?;
        let sensor = match model(&words.place, name) {
            Ok(model) => Ok(sensor(&mut words, model)?),
            Err(error) => Err(error),
        };
        if sensors.insert(id, sensor).is_some() {
            return Err(Error::invalid(&words.place, format!("found camera {id} a second time")));
        }
    }
    Ok(sensors)
}

/// Reads the words after the model's name.
fn sensor(words: &mut Words, model: usize) -> Result<Sensor> {
    let size = [words.number("a width in pixels")?, words.number("a height in pixels")?];
    let (_, name, count) = MODELS[model];
    let what = format!("{} of {name}", plural(count, "parameter"));
    let params = (0..count).map(|_| words.finite(&what)).collect::<Result<_>>()?;
    match words.words.next() {
        None => Ok(Sensor { model, size, params }),
        Some(more) => Err(Error::invalid(&words.place, format!("found {more:?} after {what}"))),
    }
}

/// Reads `images.txt`. A picture has two lines: `IMAGE_ID QW QX QY QZ TX TY TZ CAMERA_ID NAME`, and
/// the points in it. The points are not used, and there may be none.
pub fn images(path: &Path) -> Result<Vec<Image>> {
    let text = read(path)?;
    let mut images = Vec::new();
    let mut lines = lines(&text, true);
    while let Some((number, line)) = lines.next() {
        // An empty line here is no picture: some tools end the file with one.
        if line.is_empty() {
            continue;
        }
        let mut words = Words::new(path, number, line);
        words.number::<u32>("the number of a picture")?;
        let mut numbers = [0.0; 7];
        for value in &mut numbers {
            *value = words.finite("the pose QW QX QY QZ TX TY TZ")?;
        }
        let camera = words.number("the number of a camera")?;
        // Names may hold blanks.
        let mut name = words.word("the name of a picture")?.to_string();
        for word in words.words.by_ref() {
            name = name + " " + word;
        }
        let [w, x, y, z, tx, ty, tz] = numbers;
        let (rotation, translation) = ([w, x, y, z], [tx, ty, tz]);
        images.push(Image { rotation, translation, camera, name, place: words.place });
        if let Some((number, points)) = lines.next() {
            let is_number = |word: &str| word.parse::<f64>().is_ok();
            if points.split_whitespace().count() % 3 != 0
                || !points.split_whitespace().all(is_number)
            {
                let place = format!("{}:{number}", path.display());
                let message = "found a line of points that is not made of three numbers each, \
                               expected X Y POINT3D_ID";
                return Err(Error::invalid(place, message)
                    .help("each picture has two lines; the second may be empty"));
            }
        }
    }
    Ok(images)
}
