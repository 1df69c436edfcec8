//! `transforms.json` of nerfstudio, instant-ngp and NeRF. A key of a frame wins over the same key
//! of the file. Unknown keys are ignored, because every tool adds its own.

use std::path::Path;

use super::pose::Pose;
use crate::error::{Error, Failures, Result};
use crate::scene::written::{
    Axes, BrownConrady, CameraDescription, DistortionDescription, Fisheye, Intrinsics, Matrix,
};
use crate::scene::{Document, JsonNode, NodeKind, list};

/// Values of `camera_model` that OpenCV's models cover.
const MODELS: [&str; 7] = [
    "SIMPLE_PINHOLE",
    "PINHOLE",
    "SIMPLE_RADIAL",
    "RADIAL",
    "OPENCV",
    "OPENCV_FISHEYE",
    "SIMPLE_RADIAL_FISHEYE",
];

/// Help where a picture does not have the size of its calibration.
const CALIBRATED_SIZE: &str = "the intrinsics are those of one size: use the picture that was \
     calibrated, or scale fl_x, fl_y, cx, cy, w and h with it";

/// Reads all frames. `folder` is the folder of the file.
pub fn read(document: &Document, folder: &Path) -> Result<Vec<Pose>> {
    let count = match document.get("/frames").map(|node| &node.kind) {
        Some(NodeKind::List(items)) => items.len(),
        _ => {
            let message = "found `frames` that is no array, expected one object per picture";
            return Err(Error::invalid(document.place("/frames"), message));
        }
    };
    let mut failures = Failures::default();
    let mut list = Vec::new();
    for number in 0..count {
        let frame = FrameEntry { document, pointer: format!("/frames/{number}") };
        list.extend(failures.keep(frame.pose(folder)));
    }
    failures.check()?;
    Ok(list)
}

struct FrameEntry<'d> {
    document: &'d Document,
    pointer: String,
}

impl FrameEntry<'_> {
    /// Returns a value of the frame, or else of the file, and its pointer.
    fn get(&self, key: &str) -> Option<(&JsonNode, String)> {
        let own = format!("{}/{key}", self.pointer);
        let common = format!("/{key}");
        let found = |pointer: String| Some((self.document.get(&pointer)?, pointer));
        found(own).or_else(|| found(common))
    }

    fn number(&self, key: &str) -> Result<Option<f64>> {
        let Some((node, pointer)) = self.get(key) else { return Ok(None) };
        match node.number().filter(|number| number.is_finite()) {
            Some(number) => Ok(Some(number)),
            None => Err(self.wrong(&pointer, "a number")),
        }
    }

    fn wrong(&self, pointer: &str, expected: &str) -> Error {
        let what = match self.document.get(pointer).and_then(JsonNode::text) {
            Some(text) => format!("{text:?}"),
            None => "another value".to_string(),
        };
        Error::invalid(self.document.place(pointer), format!("found {what}, expected {expected}"))
    }

    fn missing(&self, key: &str, expected: &str) -> Error {
        let message = format!("missing key `{key}`, expected {expected}");
        Error::invalid(self.document.place(&self.pointer), message)
    }

    fn pose(&self, folder: &Path) -> Result<Pose> {
        let image = self.get("file_path").and_then(|(node, _)| node.text());
        let image = image.ok_or_else(|| self.missing("file_path", "the name of the picture"))?;
        let [width, height] = self.size(folder, image)?;
        self.check_principal_point(image, [width, height])?;
        let (w, h) = (f64::from(width), f64::from(height));
        let by_angle = |side: f64, angle: Option<f64>| angle.map(|a| side / 2.0 / (a / 2.0).tan());
        let fx = self.number("fl_x")?.or(by_angle(w, self.number("camera_angle_x")?));
        let fx = fx.ok_or_else(|| self.missing("fl_x", "a focal length, or `camera_angle_x`"))?;
        let fy = self.number("fl_y")?.or(by_angle(h, self.number("camera_angle_y")?));
        // These count from the corner of the picture, OpenCV's from the centre of its first pixel.
        let [cx, cy] = [("cx", w), ("cy", h)].map(|(key, side)| Ok((self.number(key)?, side)));
        let [cx, cy] = [cx?, cy?].map(|(c, side)| Some(c.unwrap_or(side / 2.0) - 0.5));
        let camera = CameraDescription::Intrinsics(Intrinsics {
            width,
            height,
            fx,
            fy,
            cx,
            cy,
            skew: 0.0,
            distortion: self.distortion()?,
            world_to_camera: None,
            camera_to_world: Some(self.matrix()?),
            axes: Axes::OpenGl,
        });
        let place = self.document.place(&self.pointer);
        let image_place = self.document.place(&format!("{}/file_path", self.pointer));
        Ok(Pose { image: image.to_string(), camera, place, image_place })
    }

    /// The size by the keys `w` and `h`, or else of the picture itself. A picture of another size
    /// was scaled after it was calibrated.
    fn size(&self, folder: &Path, image: &str) -> Result<[u32; 2]> {
        let picture = size_of_picture(folder, image);
        let mut size = [0; 2];
        for (side, key) in size.iter_mut().zip(["w", "h"]) {
            let Some(number) = self.number(key)? else {
                return picture.ok_or_else(|| {
                    self.missing(key, "the width and height of the picture in `w` and `h`").help(
                        "or put the pictures where `file_path` names them: their size is read",
                    )
                });
            };
            let whole = number.fract() == 0.0 && (1.0..=f64::from(i32::MAX)).contains(&number);
            if !whole {
                let message = format!("found {number}, expected a number of pixels");
                return Err(self.invalid(key, message));
            }
            *side = number as u32;
        }
        match picture.filter(|&picture| picture != size) {
            None => Ok(size),
            Some([width, height]) => {
                let message = format!(
                    "found {} x {}, but {image} is {width} x {height}, expected the same size",
                    size[0], size[1]
                );
                Err(self.invalid("w", message).help(CALIBRATED_SIZE))
            }
        }
    }

    /// Checks that a principal point lies in a picture whose size is not in the list. Otherwise the
    /// picture was scaled after it was calibrated.
    fn check_principal_point(&self, image: &str, [width, height]: [u32; 2]) -> Result<()> {
        for (key, size, side) in [("cx", "w", width), ("cy", "h", height)] {
            let Some(c) = self.number(key)?.filter(|_| self.get(size).is_none()) else { continue };
            if !(0.0..=f64::from(side)).contains(&c) {
                let message = format!("found {c}, outside of {image}, which is {width} x {height}");
                return Err(self.invalid(key, message).help(CALIBRATED_SIZE));
            }
        }
        Ok(())
    }

    /// An error at a key of the frame, or else of the file.
    fn invalid(&self, key: &str, message: String) -> Error {
        let pointer = self.get(key).map(|(_, pointer)| pointer).unwrap_or_default();
        Error::invalid(self.document.place(&pointer), message)
    }

    fn distortion(&self) -> Result<Option<DistortionDescription>> {
        let model = match self.get("camera_model") {
            None => "OPENCV",
            Some((node, pointer)) => match node.text().filter(|text| MODELS.contains(text)) {
                Some(model) => model,
                None => return Err(self.wrong(&pointer, &list(MODELS))),
            },
        };
        let fisheye = model.ends_with("FISHEYE") || {
            let flag = self.get("is_fisheye").map(|(node, _)| &node.kind);
            matches!(flag, Some(NodeKind::Bool(true)))
        };
        let mut k = [0.0; 6];
        for (value, key) in k.iter_mut().zip(["k1", "k2", "k3", "k4", "p1", "p2"]) {
            *value = self.number(key)?.unwrap_or(0.0);
        }
        let [k1, k2, k3, k4, p1, p2] = k;
        if k == [0.0; 6] && !fisheye {
            return Ok(None);
        }
        if fisheye {
            return Ok(Some(DistortionDescription::Fisheye(Fisheye { k1, k2, k3, k4 })));
        }
        if k4 != 0.0 {
            // nerfstudio's k4 belongs to r^8, which OpenCV's model lacks.
            let message = format!("found {k4}, expected 0: OpenCV's model has no term of r^8");
            return Err(self.invalid("k4", message));
        }
        let lens = BrownConrady { k1, k2, k3, p1, p2, ..BrownConrady::default() };
        Ok(Some(DistortionDescription::BrownConrady(lens)))
    }

    fn matrix(&self) -> Result<Matrix> {
        let expected = "4 rows of 4 numbers, or 3";
        let Some((node, pointer)) = self.get("transform_matrix") else {
            return Err(self.missing("transform_matrix", expected));
        };
        let mut rows = [[0.0; 4], [0.0; 4], [0.0; 4], [0.0, 0.0, 0.0, 1.0]];
        let items = |node: &JsonNode| match &node.kind {
            NodeKind::List(items) => items.clone(),
            _ => Vec::new(),
        };
        let written = items(node);
        if !(3..=4).contains(&written.len()) {
            return Err(self.wrong(&pointer, expected));
        }
        for (i, (row, written)) in rows.iter_mut().zip(&written).enumerate() {
            let numbers: Option<Vec<f64>> = items(written).iter().map(JsonNode::number).collect();
            let numbers = numbers.and_then(|numbers| <[f64; 4]>::try_from(numbers).ok());
            *row = numbers
                .ok_or_else(|| self.wrong(&format!("{pointer}/{i}"), "a row of 4 numbers"))?;
        }
        Ok(Matrix(rows))
    }
}

/// Width and height of the picture, if it is there.
fn size_of_picture(folder: &Path, image: &str) -> Option<[u32; 2]> {
    // NeRF's files leave the ending out.
    let paths = [folder.join(image), folder.join(format!("{image}.png"))];
    let found = paths.into_iter().find(|path| path.is_file());
    let (width, height) = found.and_then(|path| image::image_dimensions(path).ok())?;
    Some([width, height])
}
