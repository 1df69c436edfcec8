//! The built-in studio around a mesh that stays in its own coordinates: the lights move instead.

use glam::{DMat3, DVec3};

use super::axes::turn;
use super::placing::standing;
use super::points::UsedVertices;
use super::subject::Subject;
use super::template::trimesh;
use crate::error::{Error, Result};
use crate::mesh::Mesh;
use crate::scene::{LightKind, Loaded, Overrides};
use crate::world::{Bounds, extent};

/// Adds overrides that keep the mesh at its coordinates and move the lights instead. Lights and
/// mesh then stand to each other as in the studio. `--up` and `--rotate` turn the lights. `studio`
/// is the studio without the user's overrides, which come later and hold as written.
///
/// # Errors
/// If the mesh has no triangle, or its extent is not finite.
pub fn keep_coordinates(
    subject: &Subject,
    mesh: &Mesh,
    (loaded, studio): (&Loaded, &Loaded),
    shape: &str,
    ours: &mut Overrides,
) -> Result<()> {
    let empty = || Error::invalid(subject.path.display().to_string(), "found no triangle to show");
    let spec = trimesh(loaded, shape).ok_or_else(empty)?;
    let points = UsedVertices::new(mesh);
    let bounds = points.bounds(|p| p);
    let (longest, middle) = (extent(spec, bounds), bounds.center());
    if !(longest > 0.0 && longest.is_finite()) {
        return Err(empty());
    }
    // With this `fit` the scale is exactly 1.
    let list = |v: DVec3| Some(v.to_array().to_vec());
    ours.flag("--cameras", &format!("{shape}/fit"), Some(longest));
    ours.flag("--cameras", &format!("{shape}/center"), list(middle));
    let up = subject.up.map(|up| turn(up, loaded.scene.camera.up));
    let [x, y, z] = subject.rotate.or(up).unwrap_or_default().map(f64::to_radians);
    let to_studio =
        DMat3::from_rotation_z(z) * DMat3::from_rotation_y(y) * DMat3::from_rotation_x(x);
    let scale = longest / spec.fit.unwrap_or(2.0);
    // In the studio, the mesh stands on the ground.
    let Bounds { min, max } = points.bounds(|p| to_studio * (p - middle) / scale);
    let radius = spec.points.unwrap_or(0.0) / scale;
    let center = trimesh(studio, shape).ok_or_else(empty)?.center;
    let center = standing(studio, center, (min - radius, max + radius));
    let moved = |p: DVec3| to_studio.transpose() * (p - center) * scale + middle;
    for (index, light) in studio.scene.lights.iter().enumerate() {
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
                // The suns of the studios have these keys, and `direction` excludes them.
                let towards = to_studio.transpose() * towards;
                let azimuth = towards.x.atan2(-towards.z);
                let elevation = towards.y.atan2(towards.x.hypot(towards.z));
                for (key, angle) in [("azimuth", azimuth), ("elevation", elevation)] {
                    let pointer = format!("/scene/lightsources/{index}/{key}");
                    ours.flag("--cameras", &pointer, Some(angle.to_degrees()));
                }
            }
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use super::*;
    use crate::monitor::Monitor;
    use crate::scene::ShapeKind;
    use crate::studio::{Studio, Template, show};
    use crate::world::placement;

    /// Lights and mesh stand to each other as in the studio.
    #[test]
    fn lamps_stand_to_the_mesh_as_in_the_studio() {
        let path = Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/assets/teapot.ply"));
        for rotate in [None, Some([0.0; 3]), Some([-90.0, 0.0, 0.0]), Some([10.0, 20.0, 30.0])] {
            let plain = Subject { rotate, ..Subject::new(path) };
            let kept = Subject { calibrated: true, ..plain.clone() };
            let [studio, kept] = [plain, kept].map(|subject| {
                let (template, user) = (Template::studio(Studio::Lamps), Overrides::default());
                show(&subject, &template, user, None, &Monitor::default()).unwrap()
            });
            // From the file to the studio.
            let bounds = UsedVertices::new(&studio.mesh.1).bounds(|p| p);
            let mut shapes = studio.loaded.scene.shapes.iter();
            let spec = shapes.find_map(|shape| match &shape.kind {
                ShapeKind::Trimesh(spec) => Some(spec),
                _ => None,
            });
            let spec = spec.unwrap();
            let (linear, middle) = placement(spec, bounds);
            let placed = |p: DVec3| linear * (p - middle) + spec.center;
            let lamps = [&studio.loaded, &kept.loaded].map(|loaded| {
                let lights = loaded.scene.lights.iter().map(|light| match &light.kind {
                    LightKind::Area { corner, edge, height, .. } => {
                        [*corner, *corner + *edge, *corner + *height]
                    }
                    other => panic!("{other:?}"),
                });
                lights.collect::<Vec<_>>()
            });
            assert_eq!([lamps[0].len(), lamps[1].len()], [2, 2]);
            for (there, here) in lamps[0].iter().flatten().zip(lamps[1].iter().flatten()) {
                assert!((placed(*here) - *there).length() < 1e-9, "{rotate:?} {there} {here}");
            }
        }
    }

    /// The suns of the studios turn against the mesh.
    #[test]
    fn suns_turn_with_the_studio() {
        let mesh = Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/assets/ball.ply"));
        let rotate = Some([90.0, 0.0, 0.0]);
        let subject = Subject { calibrated: true, rotate, ..Subject::new(mesh) };
        let plain = Subject::new(mesh);
        let template = Template::studio(Studio::Soft);
        let [still, turned] = [plain, subject].map(|subject| {
            let user = Overrides::default();
            let shown = show(&subject, &template, user, None, &Monitor::default()).unwrap();
            let suns = shown.loaded.scene.lights.into_iter().filter_map(|light| match light.kind {
                LightKind::Sun { towards, .. } => Some(towards),
                _ => None,
            });
            suns.collect::<Vec<_>>()
        });
        assert_eq!(still.len(), 1);
        let [x, y, z] = still[0].to_array();
        assert!((turned[0] - DVec3::new(x, z, -y)).length() < 1e-12, "{turned:?}");
    }
}
