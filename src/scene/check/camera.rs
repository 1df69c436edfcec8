//! Checks the camera: it must have one view direction, an `up` that is not parallel to it, and not
//! too many pixels.

use glam::DVec3;

use crate::scene::checked::{CheckedCamera, CheckedLens, Projection};
use crate::scene::description::{Aim, CameraDescription, Direction, Interval, Panorama, Point};

use super::context::Check;

/// Maximum number of pixels of a frame: 32768 x 32768.
pub const MAX_PIXELS: u64 = 1 << 30;
/// Size in bytes of a pixel in the film: R, G, B, A in f32.
const FILM_BYTES: u64 = 16;
/// Minimum |Z x up| / |up|, where Z is the unit view direction; from docs/guide/cameras.md.
const MIN_SINE: f64 = 1e-6;

/// Position, view direction and up direction of a camera.
pub(super) struct CameraPose {
    pub position: DVec3,
    pub lookat: DVec3,
    pub up: DVec3,
}

impl Check<'_, '_> {
    /// Checks `/camera` and makes the checked camera.
    pub(super) fn camera(&mut self) -> Option<CheckedCamera> {
        let camera: CameraDescription = self.part("/camera")?;
        let [width, height] = camera.size();
        let sized = self.picture_size(width, height);
        let projection = match &camera {
            CameraDescription::Pinhole(c) => {
                Some(Projection::Perspective { fov_deg: c.fov, lens: None })
            }
            CameraDescription::Thinlens(c) => {
                // A lens of diameter 0 is a pinhole.
                let lens = CheckedLens { aperture: c.aperture, focal_distance: c.focaldistance };
                let lens = Some(lens).filter(|lens| lens.aperture > 0.0);
                Some(Projection::Perspective { fov_deg: c.pinhole.fov, lens })
            }
            CameraDescription::Intrinsics(c) => self.calibrated(c, sized),
            CameraDescription::Orthographic(c) => {
                Some(Projection::Orthographic { width: c.viewwidth })
            }
            CameraDescription::Panorama(c) => self.panorama(c),
        };
        let pose = match (&camera, camera.stand()) {
            (CameraDescription::Intrinsics(c), _) => self.matrix_pose(c),
            (_, Some((position, aim))) => self.stand_pose(position.vec(), aim),
            (_, None) => None,
        };
        let CameraPose { position, lookat, up } = pose?;
        Some(CheckedCamera { width, height, position, lookat, up, projection: projection? })
    }

    /// Checks position, view direction and up direction of a camera without a matrix.
    fn stand_pose(&mut self, position: DVec3, aim: &Aim) -> Option<CameraPose> {
        let lookat = self.view_direction(position, aim.lookat, aim.target);
        let up = scaled_to_range(aim.up);
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
        Some(CameraPose { position, lookat: lookat?, up })
    }

    /// Checks the number of pixels. Returns false if there are too many.
    fn picture_size(&mut self, width: u32, height: u32) -> bool {
        let pixels = u64::from(width) * u64::from(height);
        if pixels > MAX_PIXELS {
            let gib = (u128::from(pixels) * u128::from(FILM_BYTES)) as f64 / (1u64 << 30) as f64;
            let message = format!(
                "found a picture of {width} x {height} pixels, whose film alone takes {gib:.1} GiB, expected at most {MAX_PIXELS} pixels (32768 x 32768)",
            );
            self.problems.error("/camera/width", message, None);
        }
        pixels <= MAX_PIXELS
    }

    fn panorama(&mut self, camera: &Panorama) -> Option<Projection> {
        let Interval(longitude_deg @ [left, right]) = camera.longitude;
        let Interval(latitude_deg @ [low, high]) = camera.latitude;
        let mut good = true;
        if !(left < right && right - left <= 360.0) {
            let message = format!(
                "found the angles {left} to {right}, expected a left one below the right one, at most 360 degrees apart"
            );
            self.problems.error("/camera/longitude", message, None);
            good = false;
        }
        if !(-90.0 <= low && low < high && high <= 90.0) {
            let message = format!(
                "found the angles {low} to {high}, expected a lower one below the upper one, both in [-90, 90]"
            );
            self.problems.error("/camera/latitude", message, None);
            good = false;
        }
        good.then_some(Projection::Panorama { longitude_deg, latitude_deg })
    }

    fn view_direction(
        &mut self,
        position: DVec3,
        lookat: Option<Direction>,
        target: Option<Point>,
    ) -> Option<DVec3> {
        match (lookat, target) {
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
                let lookat = target.vec() - position;
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
pub(super) fn scaled_to_range(direction: Direction) -> DVec3 {
    let direction = DVec3::from(direction.0);
    let largest = direction.abs().max_element();
    if largest == 0.0 || (1e-100..=1e100).contains(&largest) {
        return direction;
    }
    // In two steps, because the reciprocal of a denormal is infinite.
    let scaled = if largest < 1.0 { direction * 1e150 } else { direction };
    scaled / scaled.abs().max_element()
}
