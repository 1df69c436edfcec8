//! Checks the camera: one view direction, an `up` that is not parallel to it, a bounded size.

use glam::DVec3;

use crate::scene::{
    checked::{Camera, Lens},
    description::{self, CameraType, Direction},
};

use super::Check;

/// Maximum number of pixels of a frame: 32768 x 32768.
pub const MAX_PIXELS: u64 = 1 << 30;
/// Size in bytes of a pixel in the film: R, G, B, A in f32.
const FILM_BYTES: u64 = 16;
/// Minimum |Z x up| / |up|, from docs/scene-format.md.
const MIN_SINE: f64 = 1e-6;

impl Check<'_, '_> {
    /// Checks `/camera` and makes the checked camera.
    pub(super) fn camera(&mut self) -> Option<Camera> {
        let camera: description::Camera = self.part("/camera")?;
        self.picture_size(&camera);
        let lens = self.lens(&camera);
        let lookat = self.view_direction(&camera);
        let up = scaled_to_range(camera.up);
        if up == DVec3::ZERO {
            self.problems.error("/camera/up", "found a zero vector, expected a direction", None);
        } else if let Some(lookat) = lookat {
            let sine = lookat.normalize().cross(up.normalize()).length();
            if sine < MIN_SINE {
                let help = "choose an up that is at an angle to the view, for example [0, 0, 1] or [0, 1, 0]";
                let message = format!(
                    "found an up parallel to the view (|Z x up| / |up| = {sine:.1e}), expected at least {MIN_SINE:e}"
                );
                self.problems.error("/camera/up", message, Some(help.into()));
            }
        }
        Some(Camera {
            width: camera.width,
            height: camera.height,
            fov_deg: camera.fov,
            position: camera.position.vec(),
            lookat: lookat?,
            up,
            lens,
        })
    }

    fn picture_size(&mut self, camera: &description::Camera) {
        let pixels = u64::from(camera.width) * u64::from(camera.height);
        if pixels > MAX_PIXELS {
            let gib = (u128::from(pixels) * u128::from(FILM_BYTES)) as f64 / (1u64 << 30) as f64;
            let message = format!(
                "found a picture of {} x {} pixels, whose film alone takes {gib:.1} GiB, expected at most {MAX_PIXELS} pixels (32768 x 32768)",
                camera.width, camera.height
            );
            self.problems.error("/camera/width", message, None);
        }
    }

    /// Returns the lens; `None` for a pinhole and for a lens of diameter 0.
    fn lens(&mut self, camera: &description::Camera) -> Option<Lens> {
        let keys = [("aperture", camera.aperture), ("focaldistance", camera.focaldistance)];
        for (key, value) in keys {
            match (camera.kind, value) {
                (CameraType::Pinhole, Some(_)) => {
                    let message = format!(
                        "found `{key}` in a pinhole camera, expected it with type `thinlens` only"
                    );
                    let help = "remove the key, or set the camera's type to `thinlens`";
                    self.problems.error(&format!("/camera/{key}"), message, Some(help.into()));
                }
                (CameraType::Thinlens, None) => {
                    let message =
                        format!("missing key `{key}`, expected a number: the type is `thinlens`");
                    self.problems.error("/camera", message, None);
                }
                _ => {}
            }
        }
        let aperture = camera.aperture.filter(|a| *a > 0.0)?;
        Some(Lens { aperture, focal_distance: camera.focaldistance? })
    }

    fn view_direction(&mut self, camera: &description::Camera) -> Option<DVec3> {
        match (camera.lookat, camera.target) {
            (None, None) => {
                let message = "missing key `lookat` (a direction) or `target` (a point), expected exactly one";
                self.problems.error("/camera", message, None);
                None
            }
            (Some(_), Some(_)) => {
                let message = "found both `lookat` (a direction) and `target` (a point), expected exactly one";
                self.problems.error("/camera/target", message, Some("remove one of them".into()));
                None
            }
            (Some(lookat), None) => {
                let lookat = scaled_to_range(lookat);
                if lookat == DVec3::ZERO {
                    let help =
                        "lookat is the view direction, not a point; use `target` for a point";
                    self.problems.error(
                        "/camera/lookat",
                        "found a zero vector, expected a direction",
                        Some(help.into()),
                    );
                    return None;
                }
                Some(lookat)
            }
            (None, Some(target)) => {
                let lookat = target.vec() - camera.position.vec();
                if lookat == DVec3::ZERO {
                    let message = "found a target equal to the position, expected another point";
                    self.problems.error("/camera/target", message, None);
                    return None;
                }
                Some(scaled_to_range(Direction(lookat.to_array())))
            }
        }
    }
}

/// Returns the direction unchanged, or scaled if its square would overflow or underflow f64.
fn scaled_to_range(direction: Direction) -> DVec3 {
    let direction = DVec3::from(direction.0);
    let largest = direction.abs().max_element();
    if largest == 0.0 || (1e-100..=1e100).contains(&largest) {
        return direction;
    }
    // In two steps, because the reciprocal of a denormal is infinite.
    let scaled = if largest < 1.0 { direction * 1e150 } else { direction };
    scaled / scaled.abs().max_element()
}
