//! The list of cameras of a job, and the keys that it excludes.

use std::path::Path;

use crate::error::{Error, Result};
use crate::poses::Poses;
use crate::scene::written::Name;

use super::description::{Input as Written, JobFile};
use super::flags::Flags;
use super::places::Places;

/// Reads the list of cameras, if the job has one.
///
/// # Errors
/// A list that cannot be read; a turntable, or a size or camera of the job, its entries or the
/// flags; those of [`refuse_placing`].
pub fn poses(file: &JobFile, base: &Path, flags: &Flags) -> Result<Option<Poses>> {
    let Some(Name(path)) = &file.cameras else {
        return match file.undistort {
            true => {
                let place = flags.places.at("/undistort");
                Err(Error::invalid(place, "found without a list of cameras"))
            }
            false => Ok(None),
        };
    };
    let entry = |input: &Written| match input {
        Written::Path(_) => false,
        Written::Entry(e) => {
            !e.camera.is_empty() || e.set.keys().any(|key| key.starts_with("/camera"))
        }
    };
    let set = file.set.keys().any(|key| key.starts_with("/camera"));
    let camera = !file.camera.is_empty() || set || file.inputs.iter().any(entry);
    let size = file.size.is_some() || camera || flags.overrides.touches("/camera");
    for (what, found) in [("/turntable", file.turntable.is_some()), ("/camera", size)] {
        if found {
            let message =
                "found with a list of cameras, which has the size and pose of each picture";
            return Err(Error::invalid(flags.places.at(what), message));
        }
    }
    refuse_placing(file, &flags.places)?;
    let poses = Poses::read(&base.join(path), file.undistort)?;
    poses.check(flags.range.as_ref())?;
    Ok(Some(poses))
}

/// Refuses what frames or places a mesh, beside a list of cameras: its cameras do not move, and in
/// a template, neither does the mesh.
///
/// # Errors
/// `Invalid` for a margin; for `up` or `rotate` with a template.
fn refuse_placing(file: &JobFile, places: &Places) -> Result<()> {
    if file.margin.is_some() {
        let message = "found with a list of cameras, which do not move";
        return Err(Error::invalid(places.at("/margin"), message));
    }
    if file.template.is_none() {
        return Ok(());
    }
    let mut turned = vec![(String::new(), file.up.is_some(), file.rotate.is_some())];
    for (number, input) in file.inputs.iter().enumerate() {
        if let Written::Entry(e) = input {
            turned.push((format!("/inputs/{number}"), e.up.is_some(), e.rotate.is_some()));
        }
    }
    let keys = turned.iter().flat_map(|(at, up, rotate)| [(at, "up", up), (at, "rotate", rotate)]);
    match keys.into_iter().find(|(.., given)| **given) {
        None => Ok(()),
        Some((at, key, _)) => {
            let message = "found with a list of cameras and a template, which places the mesh";
            let help = "set `rotate` of the mesh in the template";
            Err(Error::invalid(places.at(&format!("{at}/{key}")), message).help(help))
        }
    }
}
