//! COLMAP models: `cameras` and `images`, as text or binary. Formats: "Output Format" in COLMAP's
//! documentation.

use std::path::{Path, PathBuf};

use glam::{DMat3, DQuat, DVec3};

use super::colmap_model::{Image, MODELS, Sensor, Sensors};
use super::pose::{Pose, Poses};
use super::{binary, text};
use crate::error::{Error, Result};
use crate::scene::written::{
    Axes, BrownConrady, CameraDescription, DistortionDescription, Fisheye, Intrinsics, Matrix,
};

/// Reads a model from its folder, or from the folder of one of its files.
pub(super) fn read(path: &Path) -> Result<Poses> {
    let place = path.display().to_string();
    let folder = if path.is_dir() { path } else { path.parent().unwrap_or(Path::new("")) };
    if !path.exists() {
        return Err(Error::invalid(place, "found no such file, expected a list of cameras"));
    }
    let binary = match path.is_dir() {
        true => folder.join("cameras.bin").is_file() || !folder.join("cameras.txt").is_file(),
        false => path.extension().is_some_and(|end| end == "bin"),
    };
    let end = if binary { "bin" } else { "txt" };
    let files: Vec<PathBuf> =
        ["cameras", "images"].map(|n| folder.join(n).with_extension(end)).into();
    if let Some(missing) = files.iter().find(|file| !file.is_file()) {
        let message =
            format!("found no {}, expected a COLMAP model or a .json file", missing.display());
        let help = "name the folder with cameras.txt and images.txt, or cameras.bin and images.bin";
        return Err(Error::invalid(place, message).help(help));
    }
    let [cameras, images] = [&files[0], &files[1]];
    let (sensors, images) = match binary {
        true => (binary::cameras(cameras)?, binary::images(images)?),
        false => (text::cameras(cameras)?, text::images(images)?),
    };
    let mut list = Vec::with_capacity(images.len());
    for image in &images {
        list.push(pose(image, &sensors)?);
    }
    list.sort_by(|a, b| a.image.cmp(&b.image));
    Ok(Poses { list, files, bad_name: None })
}

fn pose(image: &Image, sensors: &Sensors) -> Result<Pose> {
    let Image { rotation: [w, x, y, z], translation: [tx, ty, tz], .. } = *image;
    let Some(sensor) = sensors.get(&image.camera) else {
        let mut ids: Vec<u32> = sensors.keys().copied().collect();
        ids.sort_unstable();
        let few: Vec<String> = ids.iter().take(8).map(u32::to_string).collect();
        let message = format!(
            "found the picture {:?} of camera {}, which the model lacks, expected one of {}",
            image.name,
            image.camera,
            few.join(", ")
        );
        return Err(Error::invalid(&image.place, message));
    };
    let sensor = sensor.as_ref().map_err(Clone::clone)?;
    let quaternion = DQuat::from_xyzw(x, y, z, w);
    let length = quaternion.length();
    if !(0.5..2.0).contains(&length) {
        let message = format!(
            "found a quaternion of length {length:.3} for the picture {:?}, expected 1",
            image.name
        );
        return Err(Error::invalid(&image.place, message));
    }
    let rotation = DMat3::from_quat(quaternion.normalize());
    let row = |k: usize, t: f64| {
        let row: DVec3 = rotation.row(k);
        [row.x, row.y, row.z, t]
    };
    let rows = [row(0, tx), row(1, ty), row(2, tz), [0.0, 0.0, 0.0, 1.0]];
    let camera = CameraDescription::Intrinsics(Intrinsics {
        world_to_camera: Some(Matrix(rows)),
        ..sensor.intrinsics()
    });
    let place = image.place.clone();
    Ok(Pose { image: image.name.clone(), camera, image_place: place.clone(), place })
}

impl Sensor {
    /// The camera without a pose. COLMAP's principal point counts from the corner of the picture,
    /// OpenCV's from the centre of the first pixel.
    fn intrinsics(&self) -> Intrinsics {
        let p = |k: usize| self.params.get(k).copied().unwrap_or(0.0);
        let name = MODELS[self.model].1;
        let single = matches!(
            name,
            "SIMPLE_PINHOLE"
                | "SIMPLE_RADIAL"
                | "RADIAL"
                | "SIMPLE_RADIAL_FISHEYE"
                | "RADIAL_FISHEYE"
        );
        // One focal length, or two; then the principal point; then coefficients.
        let first = if single { 1 } else { 2 };
        let k = |i: usize| p(first + 2 + i);
        let radial = BrownConrady { k1: k(0), k2: k(1), ..BrownConrady::default() };
        let full = BrownConrady { p1: k(2), p2: k(3), ..radial };
        let distortion = match name {
            "SIMPLE_RADIAL" | "RADIAL" => Some(DistortionDescription::BrownConrady(radial)),
            "OPENCV" => Some(DistortionDescription::BrownConrady(full)),
            "FULL_OPENCV" => Some(DistortionDescription::BrownConrady(BrownConrady {
                k3: k(4),
                k4: k(5),
                k5: k(6),
                k6: k(7),
                ..full
            })),
            "OPENCV_FISHEYE" | "SIMPLE_RADIAL_FISHEYE" | "RADIAL_FISHEYE" => {
                Some(DistortionDescription::Fisheye(Fisheye {
                    k1: k(0),
                    k2: k(1),
                    k3: k(2),
                    k4: k(3),
                }))
            }
            _ => None,
        };
        Intrinsics {
            width: self.size[0],
            height: self.size[1],
            fx: p(0),
            fy: Some(p(first - 1)),
            cx: Some(p(first) - 0.5),
            cy: Some(p(first + 1) - 0.5),
            skew: 0.0,
            distortion,
            world_to_camera: None,
            camera_to_world: None,
            axes: Axes::OpenCv,
        }
    }
}
