//! The built-in studio around a mesh that stays in its own coordinates: the lights move instead.

use glam::{DMat3, DVec3};

use super::axes::{main_axis, turn};
use super::points::UsedVertices;
use super::subject::Subject;
use super::template::trimesh;
use crate::error::{Error, Result};
use crate::mesh::Mesh;
use crate::scene::{LightKind, Loaded, Overrides};

/// Adds overrides that keep the mesh at its coordinates and move the lights instead. Lights and
/// mesh then stand to each other as in the studio. `--up` and `--rotate` turn the lights.
///
/// # Errors
/// If the mesh has no triangle, or its extent is zero or not finite.
pub fn keep_coordinates(
    subject: &Subject,
    mesh: &Mesh,
    loaded: &Loaded,
    shape: &str,
    ours: &mut Overrides,
) -> Result<()> {
    let empty = || Error::invalid(subject.path.display().to_string(), "found no triangle to show");
    let spec = trimesh(loaded, shape).ok_or_else(empty)?;
    let bounds = UsedVertices::new(mesh).bounds(|p| p);
    let (longest, middle) = (bounds.longest_side(), bounds.center());
    if !(longest > 0.0 && longest.is_finite()) {
        return Err(empty());
    }
    // With this `fit` the scale is exactly 1.
    let list = |v: DVec3| Some(v.to_array().to_vec());
    ours.flag("--cameras", &format!("{shape}/fit"), Some(longest));
    ours.flag("--cameras", &format!("{shape}/center"), list(middle));
    let up = subject.up.map(|up| turn(up, main_axis(loaded.scene.camera.up)));
    let [x, y, z] = subject.rotate.or(up).unwrap_or_default().map(f64::to_radians);
    let to_studio =
        DMat3::from_rotation_z(z) * DMat3::from_rotation_y(y) * DMat3::from_rotation_x(x);
    let scale = longest / spec.fit.unwrap_or(2.0);
    let moved = |p: DVec3| to_studio.transpose() * p * scale + middle;
    for (index, light) in loaded.scene.lights.iter().enumerate() {
        let mut set = |key: &str, p: DVec3| {
            let pointer = format!("/scene/lightsources/{index}/{key}");
            ours.flag("--cameras", &pointer, list(moved(p)));
        };
        match light.kind {
            LightKind::Point { position } => set("position", position),
            LightKind::Area { corner, edge, height, .. } => {
                set("v0", corner);
                set("v1", corner + edge);
                set("v2", corner + height);
            }
            LightKind::Environment { .. } => {}
            LightKind::Sun { towards, .. } => {
                let pointer = format!("/scene/lightsources/{index}/direction");
                ours.flag("--cameras", &pointer, list(-(to_studio.transpose() * towards)));
            }
        }
    }
    Ok(())
}
