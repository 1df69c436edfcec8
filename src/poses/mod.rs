//! Lists of calibrated cameras: COLMAP models, `transforms.json` of nerfstudio and NeRF, and a list
//! of our own. docs/guide/cameras.md describes them.

mod binary;
mod colmap;
mod colmap_model;
mod pose;
mod text;
mod transforms;

use std::collections::HashSet;
use std::ops::Range;
use std::path::{Component, Path};

pub use self::pose::{Pose, Poses};

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::error::{Error, Result};
use crate::files::read_within;
use crate::scene::written::{CameraDescription, Name};
use crate::scene::{self, Document};

/// Maximum size of a file of cameras.
const MAX_FILE_MIB: u64 = 1 << 10;

/// Most cameras of a list; turntables have the same limit.
const MAX_POSES: usize = 100_000;

/// A list of cameras as lightpath writes it.
#[derive(Debug, Clone, Serialize, Deserialize, JsonSchema)]
pub struct CameraList {
    /// The cameras. Each has the keys of a scene's `camera`.
    pub cameras: Vec<Named>,
}

/// A camera of a list.
#[derive(Debug, Clone, Serialize, Deserialize, JsonSchema)]
pub struct Named {
    /// Name of the picture: a path relative to the output folder. Its ending does not count.
    pub image: Name,
    /// The camera of the picture.
    pub camera: CameraDescription,
}

impl Poses {
    /// Reads a list of cameras: a JSON file, a folder with a COLMAP model, or one of its files.
    /// With `undistort`, leaves the distortion of lenses out.
    ///
    /// # Errors
    /// All problems of the list, without those of its cameras: see [`Poses::check`].
    pub fn read(path: &Path, undistort: bool) -> Result<Self> {
        let json = path.extension().is_some_and(|end| end.eq_ignore_ascii_case("json"));
        let mut poses = if json && path.is_file() { from_json(path)? } else { colmap::read(path)? };
        let place = path.display().to_string();
        if poses.list.is_empty() {
            return Err(Error::invalid(place, "found no camera, expected at least one"));
        }
        if poses.list.len() > MAX_POSES {
            let message =
                format!("found {} cameras, expected at most {MAX_POSES}", poses.list.len());
            return Err(Error::invalid(place, message));
        }
        if undistort {
            for pose in &mut poses.list {
                if let CameraDescription::Intrinsics(camera) = &mut pose.camera {
                    camera.distortion = None;
                }
            }
        }
        for pose in &mut poses.list {
            match picture_name(&pose.image) {
                Some(name) => pose.image = name,
                None => {
                    let error = || bad_name(&pose.image_place, &pose.image);
                    poses.bad_name.get_or_insert_with(error);
                }
            }
        }
        Ok(poses)
    }

    /// Checks the cameras of a range of frames as cameras of a scene; `None` for all. Each input of
    /// a batch has a frame for each camera. Intrinsics that many cameras share are checked once.
    ///
    /// # Errors
    /// Cameras that a scene would refuse.
    pub fn check(&self, range: Option<&Range<u64>>) -> Result<()> {
        let count = self.list.len() as u64;
        let in_range = |camera: u64| {
            range.is_none_or(|range| {
                let first = range.start + (camera + count - range.start % count) % count;
                first < range.end
            })
        };
        let mut known = HashSet::new();
        let mut problems = Vec::new();
        let cameras = (0..).zip(&self.list).filter(|(number, _)| in_range(*number));
        for (_, pose) in cameras {
            let mut camera = pose.camera.clone();
            if let CameraDescription::Intrinsics(camera) = &mut camera {
                let mut shared = camera.clone();
                (shared.world_to_camera, shared.camera_to_world) = (None, None);
                let shared = format!("{shared:?}");
                // A distortion is the costly part.
                if !known.insert(shared) {
                    camera.distortion = None;
                }
            }
            if let Err(error) = scene::check_camera(&pose.place, &camera) {
                problems.extend(error.problems);
            }
            if problems.len() >= MAX_PROBLEMS {
                break;
            }
        }
        Error::check(crate::error::ErrorKind::Invalid, problems)
    }
}

/// Problems after which a list is not checked further.
const MAX_PROBLEMS: usize = 20;

/// Returns the name of a picture without its ending, with `/` between folders. Digits are no
/// ending, as in `frame.0001`. `None` if it leads out of a folder or is empty.
fn picture_name(name: &str) -> Option<String> {
    let name = name.replace('\\', "/");
    let path = Path::new(&name);
    let plain = |part: &Component| !matches!(part, Component::CurDir);
    let parts: Vec<Component> = path.components().filter(plain).collect();
    let good = parts.iter().all(|part| matches!(part, Component::Normal(_)));
    let file = path.file_name()?.to_str()?;
    let is_ending = |end: &str| end.is_empty() || !end.bytes().all(|byte| byte.is_ascii_digit());
    let stem = match file.rsplit_once('.') {
        Some((stem, end)) if !stem.is_empty() && is_ending(end) => stem.to_string(),
        _ => file.to_string(),
    };
    let parts = parts.iter().filter_map(|part| part.as_os_str().to_str());
    let mut parts: Vec<String> = parts.map(str::to_string).collect();
    *parts.last_mut()? = stem;
    let printable = !name.chars().any(char::is_control);
    // The stem of `..png` is `.`, the folder itself.
    (good && printable && *parts.last()? != ".").then(|| parts.join("/"))
}

fn bad_name(place: &str, name: &str) -> Error {
    let message = format!("found the picture {name:?}, expected a path that stays in its folder");
    Error::invalid(place, message).help("choose names without {image}: --name '{stem}/{frame:04}'")
}

fn from_json(path: &Path) -> Result<Poses> {
    let name = path.display().to_string();
    let document = Document::parse(&name, &read_within(path, MAX_FILE_MIB, "a list of cameras")?)?;
    let files = vec![path.to_owned()];
    if document.get("/frames").is_some() {
        let list = transforms::read(&document, path.parent().unwrap_or(Path::new("")))?;
        return Ok(Poses { list, files, bad_name: None });
    }
    if document.get("/cameras").is_none() {
        let message = "found neither `cameras` nor `frames`, expected a list of cameras";
        return Err(Error::invalid(name, message)
            .help("`frames` is the list of transforms.json, `cameras` that of lightpath"));
    }
    let list: CameraList = scene::read_as(&document)?;
    let list = list.cameras.into_iter().enumerate().map(|(i, named)| Pose {
        image: named.image.0,
        camera: named.camera,
        place: document.place(&format!("/cameras/{i}/camera")),
        image_place: document.place(&format!("/cameras/{i}/image")),
    });
    Ok(Poses { list: list.collect(), files, bad_name: None })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_of_pictures_lose_their_ending_and_stay_in_their_folder() {
        let name = |text: &str| picture_name(text);
        assert_eq!(name("a/b.c.jpg").unwrap(), "a/b.c");
        assert_eq!(name("./images/IMG_1.png").unwrap(), "images/IMG_1");
        assert_eq!(name("r_0").unwrap(), "r_0");
        assert_eq!(name("./im/frame.0001").unwrap(), "im/frame.0001");
        assert_eq!(name("im/frame.0001.JPG").unwrap(), "im/frame.0001");
        assert_eq!(name("DSCF0001.RAF").unwrap(), "DSCF0001");
        assert_eq!(name("im.d/.png").unwrap(), "im.d/.png");
        assert_eq!(name("a\\b.png").unwrap(), "a/b");
        for bad in ["", "..", "../a.png", "/a.png", "a/../b.png", "a\n.png"] {
            assert_eq!(name(bad), None, "{bad:?}");
        }
    }
}
