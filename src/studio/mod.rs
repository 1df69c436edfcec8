//! Makes a scene from a mesh alone.
//!
//! A template (the built-in studio, or any scene with a trimesh) defines the look. Its first
//! trimesh is replaced by the file. The mesh stands on the plane named `ground`; without one, at
//! the height of the trimesh's `center`. Its lowest vertex is slightly above the ground. The camera
//! keeps its direction and moves to where it sees every vertex. All of this is done by overrides of
//! the template, so the result is an ordinary scene that can be saved. A [`Turntable`] derives
//! further scenes, one per frame.

mod framing;
mod furnish;
mod points;
mod template;
mod turntable;

pub use framing::{FieldOfView, frame, frame_turning};
pub use furnish::with_default_placement;
pub use points::{Points, is_mesh, read};
pub use template::Template;
pub use turntable::{LightsFollow, Turning, Turntable};

use std::path::{Path, PathBuf};

use glam::DVec3;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::{
    error::{Problem, Result},
    mesh::{Mesh, ReadOptions},
    monitor::Monitor,
    reserve::MemoryLimit,
    scene::{self, Loaded, Overrides, ShapeKind, Source, written},
    world::color_request,
};

/// Default margin between the mesh and the picture's borders, as a fraction of width and height.
pub const MARGIN: f64 = 0.08;

/// Name of the plane on which meshes stand.
const GROUND: &str = "ground";

/// An axis of a mesh file.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "lowercase")]
pub enum Axis {
    /// the x axis points up
    X,
    /// the y axis points up
    Y,
    /// the z axis points up, as scanners and CAD programs have it
    Z,
}

/// Choices for the look of a mesh and its surroundings that override the template.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Appearance {
    /// Edges across which normals are interpolated.
    pub smooth: Option<written::Smooth>,
    /// Texture image, in place of the one that the file or the template names.
    pub texture: Option<PathBuf>,
    /// True to remove the template's plane named `ground`.
    pub no_ground: bool,
    /// Source of the colours of the mesh.
    pub color: Option<written::MeshColor>,
    /// Radius of spheres that replace the faces, in the units of the file.
    pub points: Option<f64>,
}

/// Converts the value of `--smooth`: the maximum angle of a smooth edge in degrees.
pub fn smooth(degrees: f64) -> written::Smooth {
    match degrees {
        0.0 => written::Smooth::Everywhere(false),
        180.0 => written::Smooth::Everywhere(true),
        angle => written::Smooth::Below(written::Crease { angle, flat: None }),
    }
}

/// A mesh file to show, with options.
#[derive(Debug, Clone)]
pub struct Subject<'a> {
    /// Path of the mesh file.
    pub path: &'a Path,
    /// Axis of the file that points up, if the user gives one.
    pub up: Option<Axis>,
    /// Rotation in degrees about the x, then y, then z axis, in place of `up`.
    pub rotate: Option<[f64; 3]>,
    /// Margin to keep free at each border, as a fraction of the picture's width and height; in [0,
    /// 0.5).
    pub margin: f64,
    /// Choices for the look of the mesh.
    pub looks: Appearance,
    /// True to frame the mesh so that the camera sees every vertex in all frames of a turntable.
    pub turning: bool,
    /// True to drop triangles with missing or non-finite vertices.
    pub repair: bool,
    /// True to read the file instead of mapping it.
    pub no_mmap: bool,
    /// Limit of the memory for the arrays of the mesh.
    pub room: Option<MemoryLimit>,
}

impl<'a> Subject<'a> {
    /// Makes a subject with default options.
    pub fn new(path: &'a Path) -> Self {
        let (up, rotate, margin) = (None, None, MARGIN);
        let (turning, repair, no_mmap, room) = (false, false, false, None);
        let looks = Appearance::default();
        Self { path, up, rotate, margin, looks, turning, repair, no_mmap, room }
    }
}

/// A scene made from a mesh.
#[derive(Debug)]
pub struct MeshScene {
    /// The scene with all overrides applied.
    pub loaded: Loaded,
    /// Warnings that were collected so far.
    pub warnings: Vec<Problem>,
    /// The mesh, with the path that the scene names.
    pub mesh: (PathBuf, Mesh),
    /// Centre of the mesh's bounding box after placement, in world space.
    pub middle: DVec3,
}

/// Makes a scene that shows a mesh in a template. The user's overrides take precedence.
/// `light_samples` is the parameter of [`load`]. A stop request at the monitor ends the reading.
///
/// # Errors
/// A mesh that cannot be read, a template without a trimesh, and every problem of the template and
/// the overrides.
pub fn show(
    subject: &Subject,
    template: &Template,
    user: Overrides,
    light_samples: Option<u32>,
    monitor: &Monitor,
) -> Result<MeshScene> {
    let wanted = furnish::wanted(subject, template, &user);
    let request = wanted.as_ref().map(|(spec, textured)| color_request(spec, *textured));
    // A scene with errors is reported after the mesh is read.
    let asked = subject.looks.points.is_some();
    let points = wanted.as_ref().map_or(asked, |(spec, _)| spec.points.is_some());
    let textures = wanted.as_ref().is_none_or(|(spec, hidden)| !hidden && spec.color.is_none());
    let options = ReadOptions::default().color(request.unwrap_or_default());
    let mesh = points::read(subject, options.points(points).textures(textures), monitor)?;
    show_mesh(subject, mesh, template, user, light_samples)
}

/// [`show`] with a mesh in memory. The subject's path names it in messages, and says where the
/// texture lies that it names.
///
/// # Errors
/// The errors of [`show`], but for those of reading the mesh.
pub fn show_mesh(
    subject: &Subject,
    mesh: Mesh,
    template: &Template,
    mut user: Overrides,
    light_samples: Option<u32>,
) -> Result<MeshScene> {
    let mut warnings = Vec::new();
    let furnished = furnish::furnish(subject, mesh, template, &user, &mut warnings)?;
    user.prepend(furnished.overrides);
    let mut loaded = load(template.source(), user, light_samples, &mut warnings)?;
    // In a cut-out the ground must not cover the frame.
    let cut_out = template.builtin && loaded.scene.transparent;
    if subject.looks.no_ground || cut_out {
        loaded = without_ground(loaded, template)?;
    }
    // Messages name the mesh by the user's path, not relative to the template.
    let (path, mesh) = furnished.mesh;
    for shape in &mut loaded.scene.shapes {
        if let ShapeKind::Trimesh(spec) = &mut shape.kind {
            if spec.path == path {
                spec.path = subject.path.to_owned();
            }
        }
    }
    Ok(MeshScene {
        loaded,
        warnings,
        mesh: (subject.path.to_owned(), mesh),
        middle: furnished.middle,
    })
}

/// Returns the scene without the plane named `ground`.
fn without_ground(loaded: Loaded, template: &Template) -> Result<Loaded> {
    let mut description = loaded.description;
    description.scene.shapes.retain(|shape| match shape {
        written::Shape::Plane(plane) => plane.name.as_ref().is_none_or(|name| name.0 != GROUND),
        _ => true,
    });
    let found = scene::from_description(&template.name, &description, &template.folder, &[])?;
    Ok(Loaded { warnings: loaded.warnings, ..found })
}

/// Loads a scene with overrides. `light_samples` sets the samples of every area light before any
/// `--set`.
///
/// # Errors
/// Every problem of the scene and its overrides.
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
