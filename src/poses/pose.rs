//! Cameras and the pictures that they belong to.

use std::path::PathBuf;

use crate::error::Error;
use crate::scene::written::CameraDescription;

/// A camera of a list, and the picture that it belongs to.
#[derive(Debug, Clone)]
pub struct Pose {
    /// Name of the picture: a path without its ending, relative to the folder of the pictures.
    pub image: String,
    /// The camera, as a scene writes it.
    pub camera: CameraDescription,
    /// Place of the camera in its file, for messages.
    pub(super) place: String,
    /// Place of the name in its file, for messages.
    pub(super) image_place: String,
}

/// All cameras of a file.
#[derive(Debug, Clone)]
pub struct Poses {
    /// The cameras: of a COLMAP model by the names of their pictures, else in the file's order. At
    /// least one.
    pub list: Vec<Pose>,
    /// The files that were read.
    pub files: Vec<PathBuf>,
    /// The error of the first picture whose name cannot be that of an output.
    pub bad_name: Option<Error>,
}
