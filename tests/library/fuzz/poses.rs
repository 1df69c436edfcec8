//! Reads bytes as a list of cameras. The first byte selects the format: a COLMAP model, binary or
//! text, or JSON. For a COLMAP model, the second byte says how much of the rest is the file
//! `cameras`; the remainder is `images`. The result must be an error with a message, or a list of
//! pictures whose paths do not leave their folder, if it has no error of a name.

use std::path::Path;

use lightpath::poses::{Pose, Poses};

use super::inputs;

/// Runs one input, with its files in a folder. Returns whether it is a list of cameras.
pub fn run(folder: &Path, bytes: &[u8]) -> bool {
    let [format, part, rest @ ..] = bytes else { return false };
    let write = |name: &str, bytes: &[u8]| inputs::write(&folder.join(name), bytes);
    let cut = rest.len() * usize::from(*part) / 255;
    let path = match format % 3 {
        2 => {
            write("list.json", rest);
            folder.join("list.json")
        }
        text => {
            let end = if text == 1 { "txt" } else { "bin" };
            write(&format!("cameras.{end}"), &rest[..cut]);
            write(&format!("images.{end}"), &rest[cut..]);
            folder.join(format!("cameras.{end}"))
        }
    };
    let read = Poses::read(&path, format & 128 != 0);
    match read.and_then(|poses| poses.check(None).map(|()| poses)) {
        Err(error) => {
            inputs::check_error(&error);
            false
        }
        Ok(poses) => {
            assert!(!poses.list.is_empty());
            // A bad name is an error only for frames that are named after pictures.
            let is_inside = |pose: &Pose| inputs::is_inside(Path::new(&pose.image));
            assert!(poses.bad_name.is_some() || poses.list.iter().all(is_inside));
            true
        }
    }
}
