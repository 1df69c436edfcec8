//! A mesh alone becomes a scene.
//!
//! A template (the built-in studio, or any scene with a trimesh) says how it looks. Its first
//! trimesh becomes the file; the mesh stands on the plane named `ground` (without one: at the height
//! of the trimesh's `center`), its lowest vertex a hair above it; the camera keeps its direction and
//! moves to where it sees every vertex. All of it is overrides of the template, so the result is an
//! ordinary scene that can be saved. A [`Turntable`] makes further scenes of it, one per frame.

mod framing;
mod furnish;
mod points;
mod template;
mod turntable;

pub use framing::{Lens, frame, frame_turning};
pub use furnish::unframed;
pub use points::{Points, is_mesh, read};
pub use template::Template;
pub use turntable::{Fixed, Turning, Turntable};

use std::path::{Path, PathBuf};

use glam::DVec3;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::{
    error::{Problem, Result},
    mesh::Mesh,
    monitor::Monitor,
    reserve::Room,
    scene::{self, Loaded, Overrides, ShapeKind, Source, written},
};

/// Distance of the picture's borders from the mesh, as a fraction of its width and height.
pub const MARGIN: f64 = 0.08;

/// The name of the plane that meshes stand on.
const GROUND: &str = "ground";

/// An axis of a mesh file.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "lowercase")]
pub enum Axis {
    /// x points up
    X,
    /// y points up
    Y,
    /// z points up, as scanners and CAD have it
    Z,
}

/// How a mesh and what is around it look, where that is not left to the template.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Looks {
    /// Where its normals are interpolated.
    pub smooth: Option<written::Smooth>,
    /// The image for its texture coordinates, in place of what the file and the template name.
    pub texture: Option<PathBuf>,
    /// Without the template's plane named `ground`.
    pub no_ground: bool,
}

/// What `--smooth` asks for, by the largest angle in degrees of a smooth edge.
pub fn smooth(degrees: f64) -> written::Smooth {
    match degrees {
        0.0 => written::Smooth::Everywhere(false),
        180.0 => written::Smooth::Everywhere(true),
        angle => written::Smooth::Below(written::Crease { angle, flat: None }),
    }
}

/// A mesh file to be shown.
#[derive(Debug, Clone)]
pub struct Subject<'a> {
    /// The file.
    pub path: &'a Path,
    /// Which of its axes points up, if the user says so.
    pub up: Option<Axis>,
    /// Degrees about x, then y, then z, in place of `up`.
    pub rotate: Option<[f64; 3]>,
    /// Kept free at each border of the picture, as a fraction of its width and height; [0, 0.5).
    pub margin: f64,
    /// How it looks.
    pub looks: Looks,
    /// The camera sees every vertex wherever it comes to on a turntable.
    pub turning: bool,
    /// Drop triangles with bad vertices.
    pub repair: bool,
    /// Read the file instead of mapping it.
    pub no_mmap: bool,
    /// The most that its arrays may take.
    pub room: Option<Room>,
}

impl<'a> Subject<'a> {
    /// A file as it is.
    pub fn new(path: &'a Path) -> Self {
        let (up, rotate, margin) = (None, None, MARGIN);
        let (turning, repair, no_mmap, room) = (false, false, false, None);
        let looks = Looks::default();
        Self { path, up, rotate, margin, looks, turning, repair, no_mmap, room }
    }
}

/// A scene around a mesh.
#[derive(Debug)]
pub struct Shown {
    /// The scene, all overrides applied.
    pub loaded: Loaded,
    /// What is suspicious so far.
    pub warnings: Vec<Problem>,
    /// The mesh, by the path that the scene names.
    pub mesh: (PathBuf, Mesh),
    /// The middle of the mesh's box where it stands.
    pub middle: DVec3,
}

/// Shows a mesh in a template. The user's overrides win; `light_samples` is [`load`]'s; a signal at the
/// monitor stops the reading.
///
/// # Errors
/// A mesh that cannot be read, a template without a trimesh, everything that is wrong with it and the
/// overrides.
pub fn show(
    subject: &Subject,
    template: &Template,
    mut user: Overrides,
    light_samples: Option<u32>,
    monitor: &Monitor,
) -> Result<Shown> {
    let mut warnings = Vec::new();
    let read = points::read(subject, monitor)?;
    let furnished = furnish::furnish(subject, read, template, &user, &mut warnings)?;
    user.prepend(furnished.overrides);
    let mut loaded = load(template.source(), user, light_samples, &mut warnings)?;
    // Under a cut-out there is no ground that could cover the frame.
    let cut_out = template.builtin && loaded.scene.transparent;
    if subject.looks.no_ground || cut_out {
        loaded = without_ground(loaded, template)?;
    }
    // Messages name the mesh as the user does, not as the template sees it.
    let (path, mesh) = furnished.mesh;
    for shape in &mut loaded.scene.shapes {
        if let ShapeKind::Trimesh(spec) = &mut shape.kind {
            if spec.path == path {
                spec.path = subject.path.to_owned();
            }
        }
    }
    Ok(Shown { loaded, warnings, mesh: (subject.path.to_owned(), mesh), middle: furnished.middle })
}

/// The scene without the plane that the mesh stands on.
fn without_ground(loaded: Loaded, template: &Template) -> Result<Loaded> {
    let mut description = loaded.description;
    description.scene.shapes.retain(|shape| match shape {
        written::Shape::Plane(plane) => plane.name.as_ref().is_none_or(|name| name.0 != GROUND),
        _ => true,
    });
    let found = scene::from_description(&template.name, &description, &template.folder, &[])?;
    Ok(Loaded { warnings: loaded.warnings, ..found })
}

/// Loads a scene with overrides; `light_samples` sets the samples of every area light before any
/// `--set`.
///
/// # Errors
/// Everything that is wrong with the scene and its overrides.
pub fn load(
    source: Source,
    mut overrides: Overrides,
    light_samples: Option<u32>,
    warnings: &mut Vec<Problem>,
) -> Result<Loaded> {
    let mut loaded = overrides.load(source)?;
    if let Some(samples) = light_samples {
        if overrides.light_samples(samples, &loaded.description) {
            loaded = overrides.load(source)?;
        } else {
            let message = "has no effect: the scene has no area light";
            warnings.push(Problem::new("--light-samples", message));
        }
    }
    warnings.append(&mut loaded.warnings);
    Ok(loaded)
}
