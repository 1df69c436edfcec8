//! Places a mesh on the ground of a template, and moves the camera to where it sees the mesh.

use glam::{DAffine3, DVec3};
use rayon::iter::Either;
use rayon::prelude::*;

use crate::error::{Error, Result};
use crate::scene::{Loaded, Overrides, ShapeKind};
use crate::world::{Bounds, placement};

use super::axes::main_axis;
use super::framing::{FieldOfView, frame, frame_turning};
use super::points::UsedVertices;
use super::subject::{GROUND, Subject};
use super::template::{copies, trimesh};

/// Height of the mesh above the ground, as a fraction of the mesh's longest side. It is too small
/// to see, but a flat mesh does not coincide with the ground plane.
const GROUND_GAP: f64 = 1e-4;

/// Adds overrides that place the mesh on the ground. Instances are placed with it. Returns the
/// centre of the bounding box in world space, and where the camera sees all of them.
///
/// # Errors
/// If there is no triangle, or if the camera is neither `pinhole` nor `thinlens`.
pub(super) fn place(
    subject: &Subject,
    points: &UsedVertices,
    (loaded, user): (&Loaded, &Overrides),
    shape: &str,
    ours: &mut Overrides,
) -> Result<(DVec3, DVec3)> {
    let empty = || Error::invalid(subject.path.display().to_string(), "found no triangle to show");
    let spec = trimesh(loaded, shape).ok_or_else(empty)?;
    let (linear, middle) = placement(spec, points.bounds(|p| p));
    let turned = |p: DVec3| linear * (p - middle);
    // If points are drawn as spheres, the box contains the spheres.
    let radius = spec.points.unwrap_or(0.0) * linear.x_axis.length();
    let Bounds { min, max } = points.bounds(turned);
    let (low, high) = (min - radius, max + radius);
    let camera = &loaded.scene.camera;
    let vertical = main_axis(camera.up);
    let mut center = standing(loaded, spec.center, (low, high));
    // Without `fit`, `placement` does not move the centre of the box to zero.
    if spec.fit.is_none() {
        let height = std::mem::replace(&mut center[vertical], 0.0);
        center -= (low + high) / 2.0;
        center[vertical] = height;
    }
    let Some((fov_deg, _)) = camera.perspective() else {
        let message =
            "found a template whose camera cannot be framed, expected a `pinhole` or `thinlens`";
        return Err(Error::invalid("/camera/type", message));
    };
    let aspect = f64::from(camera.width) / f64::from(camera.height);
    let copies = copies(loaded, shape);
    let (middle, placed) = match copies.is_empty() {
        true => {
            let placed = points.par_iter().map(|p| turned(p) + center);
            (center + (low + high) / 2.0, Either::Left(placed))
        }
        false => {
            let one = Bounds { min: low + center, max: high + center };
            let all = copies.iter().map(|copy| one.transformed(copy));
            // A mesh may have many instances, so their boxes stand for their vertices.
            let corners = |copy: &DAffine3| one.corners().map(|p| copy.transform_point3(p));
            let corners: Vec<DVec3> = copies.iter().flat_map(corners).collect();
            (
                all.fold(Bounds::EMPTY, Bounds::union).center(),
                Either::Right(corners.into_par_iter()),
            )
        }
    };
    let lens = FieldOfView { fov_deg, aspect, margin: subject.margin, radius };
    let target = user.touches("/camera/target").then(|| loaded.description.camera.target());
    let target = target.flatten().map(|point| DVec3::from(point.0));
    let position = match subject.turning {
        false => frame(placed, camera.lookat, camera.up, lens, target),
        true => {
            let axis = (subject.pivot.unwrap_or(middle), DVec3::AXES[vertical]);
            frame_turning(placed, axis, camera.lookat, camera.up, lens, target)
        }
    };
    let position = position.ok_or_else(empty)?;
    ours.flag("FILE.ply", &format!("{shape}/center"), Some(center.to_array().to_vec()));
    Ok((middle, position))
}

/// Returns `center` with the height at which a box around zero, from `low` to `high`, stands on the
/// ground; without a ground, on the height of `center`.
pub(super) fn standing(loaded: &Loaded, mut center: DVec3, (low, high): (DVec3, DVec3)) -> DVec3 {
    let up = loaded.scene.camera.up;
    let vertical = main_axis(up);
    let up = up[vertical].signum();
    let lowest = if up > 0.0 { low } else { high }[vertical];
    let gap = up * GROUND_GAP * (high - low).max_element();
    center[vertical] = ground(loaded, vertical).unwrap_or(center[vertical]) + gap - lowest;
    center
}

/// Adds overrides for the camera's new position, unless the user gives one. A lens is focused on
/// the centre of the mesh.
pub(super) fn point(
    (loaded, user): (&Loaded, &Overrides),
    framed: DVec3,
    middle: DVec3,
    ours: &mut Overrides,
) {
    let camera = &loaded.scene.camera;
    let list = |v: DVec3| Some(v.to_array().to_vec());
    let z = camera.lookat.normalize();
    let is_given = user.touches("/camera/position");
    let position = if is_given { camera.position } else { framed };
    if !is_given {
        ours.flag("FILE.ply", "/camera/position", list(position));
        // The camera has moved, and so has the point in its direction.
        if loaded.description.camera.target().is_some() {
            ours.flag("FILE.ply", "/camera/target", list(position + z));
        }
    }
    if camera.perspective().is_some_and(|(_, lens)| lens.is_some()) {
        let distance = Some((middle - position).dot(z)).filter(|distance| *distance > 0.0);
        ours.flag("FILE.ply", "/camera/focaldistance", distance);
    }
}

/// Largest difference of the heights of a level plane's corners, relative to its size. Exported
/// planes are rounded.
const LEVEL: f64 = 1e-4;

/// Returns the height of the plane named `ground`. `None` if there is none, or if its corners do
/// not agree: then the camera's `up` is not the direction in which things stand on the plane.
fn ground(loaded: &Loaded, vertical: usize) -> Option<f64> {
    let named = loaded.scene.shapes.iter();
    let mut planes = named.filter(|shape| shape.name.as_deref() == Some(GROUND));
    planes.find_map(|shape| match &shape.kind {
        ShapeKind::Plane { corners } => {
            let height = corners[0][vertical];
            let size = corners.iter().map(|c| (*c - corners[0]).abs().max_element());
            let size = size.fold(0.0, f64::max);
            let is_level = |c: &DVec3| (c[vertical] - height).abs() <= LEVEL * size;
            corners.iter().all(is_level).then_some(height)
        }
        _ => None,
    })
}
