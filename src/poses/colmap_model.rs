//! What the files of a COLMAP model hold.

use std::collections::HashMap;

use crate::error::{Error, Result};
use crate::scene::did_you_mean;

/// Camera models that OpenCV's models cover: number in binary files, name, number of parameters.
pub(super) const MODELS: [(i32, &str, usize); 9] = [
    (0, "SIMPLE_PINHOLE", 3),
    (1, "PINHOLE", 4),
    (2, "SIMPLE_RADIAL", 4),
    (3, "RADIAL", 5),
    (4, "OPENCV", 8),
    (5, "OPENCV_FISHEYE", 8),
    (6, "FULL_OPENCV", 12),
    (8, "SIMPLE_RADIAL_FISHEYE", 4),
    (9, "RADIAL_FISHEYE", 5),
];

/// Camera models that none of OpenCV's covers, as [`MODELS`].
pub(super) const OTHERS: [(i32, &str, usize); 3] =
    [(7, "FOV", 5), (10, "THIN_PRISM_FISHEYE", 12), (11, "RAD_TAN_THIN_PRISM_FISHEYE", 16)];

/// The cameras of a model by id. The error of a camera whose model is unknown counts only if a
/// picture has this camera.
pub(super) type Sensors = HashMap<u32, Result<Sensor>>;

/// A camera of `cameras.txt` or `cameras.bin`.
#[derive(Debug, Clone)]
pub(super) struct Sensor {
    /// Row of [`MODELS`].
    pub model: usize,
    pub size: [u32; 2],
    pub params: Vec<f64>,
}

/// A picture of `images.txt` or `images.bin`.
#[derive(Debug, Clone)]
pub(super) struct Image {
    /// Rotation from world to camera: w, x, y, z.
    pub rotation: [f64; 4],
    pub translation: [f64; 3],
    pub camera: u32,
    pub name: String,
    /// Place in its file, for messages.
    pub place: String,
}

/// Returns the row of a model's name.
pub(super) fn model(place: &str, name: &str) -> Result<usize> {
    let names = MODELS.map(|(_, name, _)| name);
    names.iter().position(|known| *known == name).ok_or_else(|| {
        let message =
            format!("found the camera model {name:?}, expected one of {}", names.join(", "));
        Error::invalid(place, message).maybe_help(did_you_mean(name, names))
    })
}
