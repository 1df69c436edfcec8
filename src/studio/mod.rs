//! Makes a scene from a mesh alone.
//!
//! A template (the built-in studio, or any scene with a trimesh) defines the look. The mesh
//! replaces its first trimesh. The mesh stands on the plane named `ground`; without such a plane,
//! at the height of the trimesh's `center`. Its lowest point is slightly above the ground. The
//! camera keeps its direction and moves to where it sees every vertex. A calibrated subject is not
//! moved, and neither is the camera. All of this is done by overrides of the template, so the
//! result is an ordinary scene that can be saved. A [`Turntable`] derives further scenes, one per
//! frame.

mod axes;
mod builtin;
mod calibrated;
mod framing;
mod furnish;
mod placing;
mod points;
mod quality;
mod subject;
mod template;
mod turntable;

pub use builtin::Studio;
pub use framing::{FieldOfView, frame, frame_turning};
pub use furnish::{Stand, flags_win, with_default_placement};
pub use points::{UsedVertices, is_mesh, is_named_mesh, read};
pub use quality::Quality;
pub use subject::{Appearance, Axis, MARGIN, Subject, smooth};
pub use template::Template;
pub use turntable::{LightsFollow, Turning, Turntable};

use std::path::{Path, PathBuf};

use glam::DVec3;

use subject::GROUND;

use crate::error::{Error, Problem, Result};
use crate::mesh::{Mesh, ReadOptions};
use crate::monitor::Monitor;
use crate::scene::written::{Name, ShapeCommon, ShapeDescription};
use crate::scene::{Loaded, Overrides, Scene, ShapeKind, Source};
use crate::world::color_request;

/// A scene made from a mesh.
#[derive(Debug)]
pub struct MeshScene {
    /// The scene with all overrides applied.
    pub loaded: Loaded,
    /// Warnings that were collected so far.
    pub warnings: Vec<Problem>,
    /// The mesh, with the path that the scene names.
    pub mesh: (PathBuf, Mesh),
    /// Centre of the mesh's bounding box after placement, in world space. Zero if the subject is
    /// calibrated.
    pub middle: DVec3,
    /// How the mesh stands, for [`show_again`]. `None` if the subject is calibrated.
    pub stand: Option<Stand>,
}

/// Makes a scene that shows a mesh in a template. The user's overrides take precedence.
/// `light_samples` is the parameter of [`load`]. If the monitor has a stop request, reading ends
/// with an error.
///
/// # Errors
/// If the mesh cannot be read, or the template has no trimesh. Every problem of the template and
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
    // If the scene has errors, `wanted` is `None`. `show_mesh` reports them.
    let asked = subject.looks.points.is_some();
    let points = wanted.as_ref().map_or(asked, |(spec, _)| spec.points.is_some());
    let textures = wanted.as_ref().is_none_or(|(spec, hidden)| !hidden && spec.color.is_none());
    let options = ReadOptions::default().color(request.unwrap_or_default());
    let mesh = points::read(subject, options.points(points).textures(textures), monitor)?;
    show_mesh(subject, mesh, template, user, light_samples)
}

/// Makes the same scene as [`show`] from a mesh in memory. The subject's path names the mesh in
/// messages. A texture that the mesh names is looked up in the folder of this path.
///
/// # Errors
/// The errors of [`show`], except those of reading the mesh.
pub fn show_mesh(
    subject: &Subject,
    mesh: Mesh,
    template: &Template,
    user: Overrides,
    light_samples: Option<u32>,
) -> Result<MeshScene> {
    let mut warnings = Vec::new();
    let user = with_quality(subject, template, user)?;
    let furnished = furnish::furnish(subject, mesh, template, &user, &mut warnings)?;
    let (path, mesh) = furnished.mesh;
    let ours = (furnished.overrides, path.as_path());
    let loaded = load_around(subject, template, ours, user, light_samples, &mut warnings)?;
    Ok(MeshScene {
        loaded,
        warnings,
        mesh: (subject.path.to_owned(), mesh),
        middle: furnished.middle,
        stand: furnished.stand,
    })
}

/// Makes the scene of [`show`] for another camera, without the mesh: see [`Stand`]. Also
/// returns its warnings. `None` if it needs the mesh.
///
/// # Errors
/// Every problem of the template and the overrides.
pub fn show_again(
    stand: &Stand,
    subject: &Subject,
    template: &Template,
    user: Overrides,
) -> Result<Option<(Loaded, Vec<Problem>)>> {
    let user = with_quality(subject, template, user)?;
    let Some(ours) = stand.fit(template, &user)? else { return Ok(None) };
    let mut warnings = stand.warnings.clone();
    let ours = (ours, stand.path.as_path());
    let loaded = load_around(subject, template, ours, user, None, &mut warnings)?;
    Ok(Some((loaded, warnings)))
}

/// Returns the overrides of the user after those of the quality that the subject asks for.
///
/// # Errors
/// A studio or a quality beside a template of the user.
fn with_quality(subject: &Subject, template: &Template, mut user: Overrides) -> Result<Overrides> {
    if subject.looks.studio.is_some() && !template.builtin {
        let message = format!("found with {}, expected without a template", template.name);
        return Err(Error::invalid("--studio", message));
    }
    if let Some(quality) = subject.looks.quality {
        user.prepend(quality.overrides(template)?);
    }
    Ok(user)
}

/// Loads the template around a mesh: with the overrides that fit it to the mesh, which has a path
/// in it, and with those of the user.
fn load_around(
    subject: &Subject,
    template: &Template,
    (ours, path): (Overrides, &Path),
    mut user: Overrides,
    light_samples: Option<u32>,
    warnings: &mut Vec<Problem>,
) -> Result<Loaded> {
    user.prepend(ours);
    let mut loaded = load_sampled(template.source(), user, light_samples)?;
    if subject.looks.no_ground || (template.builtin && subject.calibrated) {
        loaded = with_other_ground(loaded, template, |_| false)?;
    } else if template.builtin && loaded.scene.transparent {
        // If alpha is coverage, the ground must not cover the frame. As a shadow catcher it keeps
        // only the shadows.
        loaded = with_other_ground(loaded, template, |ground| {
            ground.shadow_catcher = ground.visible.camera && !ground.holdout;
            true
        })?;
    }
    // A ground that catches shadows uses the samples also of lights that are drawn.
    take_warnings(&mut loaded, light_samples, warnings);
    // Messages name the mesh by the user's path, not relative to the template.
    for shape in &mut loaded.scene.shapes {
        if let ShapeKind::Trimesh(spec) = &mut shape.kind {
            if spec.path == path {
                spec.path = subject.path.to_owned();
            }
        }
    }
    Ok(loaded)
}

/// Returns the scene with `change` applied to every plane named `ground`. The plane is removed if
/// `change` returns false. The warnings stay those of `loaded`.
fn with_other_ground(
    loaded: Loaded,
    template: &Template,
    change: impl Fn(&mut ShapeCommon) -> bool,
) -> Result<Loaded> {
    let mut description = loaded.description.clone();
    let is_ground = |name: &Option<Name>| name.as_ref().is_some_and(|name| name.0 == GROUND);
    description.scene.shapes.retain_mut(|shape| match shape {
        ShapeDescription::Plane(plane) if is_ground(&plane.common.name) => {
            change(&mut plane.common)
        }
        _ => true,
    });
    let found = loaded.with_description(&template.name, &description, &template.folder)?;
    Ok(Loaded { warnings: loaded.warnings, ..found })
}

/// Loads a scene with overrides. `light_samples` sets the `samples` of every area light, sun and
/// environment, unless a `--set` names them. Warnings are appended to `warnings`.
///
/// # Errors
/// Every problem of the scene and its overrides.
pub fn load(
    source: Source,
    overrides: Overrides,
    light_samples: Option<u32>,
    warnings: &mut Vec<Problem>,
) -> Result<Loaded> {
    let mut loaded = load_sampled(source, overrides, light_samples)?;
    take_warnings(&mut loaded, light_samples, warnings);
    Ok(loaded)
}

/// Does the same as [`load`], without the warning about `light_samples`.
fn load_sampled(
    source: Source,
    mut overrides: Overrides,
    light_samples: Option<u32>,
) -> Result<Loaded> {
    let loaded = overrides.load(source)?;
    if let Some(samples) = light_samples {
        if overrides.light_samples(samples, source, &loaded.description)? {
            return overrides.load(source);
        }
    }
    Ok(loaded)
}

/// Moves the warnings of a scene to `warnings`, after one about `light_samples` without effect.
fn take_warnings(loaded: &mut Loaded, light_samples: Option<u32>, warnings: &mut Vec<Problem>) {
    let unused = light_samples.and_then(|_| unused_light_samples(&loaded.scene));
    warnings.extend(unused.map(|message| Problem::new("--light-samples", message)));
    warnings.append(&mut loaded.warnings);
}

/// Returns the message for `--light-samples` in a scene where it changes nothing; `None` in any
/// other scene.
pub fn unused_light_samples(scene: &Scene) -> Option<&'static str> {
    let drawn = scene.lights.iter().any(|light| light.kind.has_extent());
    let message = match drawn {
        true => "has no effect: `emittersamples` draws lights, and takes one point on each",
        false => "has no effect: the scene has no area light, environment or sun with an angle",
    };
    (!scene.uses_light_samples()).then_some(message)
}
