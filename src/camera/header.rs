//! What a picture's header says about its camera, and the sizes of frames and pixels.

use glam::DVec3;
use serde_json::{Value, json};

use super::axes::axes;
use crate::calibration::{Calibration, Distortion, Model};
use crate::scene::{CheckedCamera, Projection};

/// Width and height of a perspective frame at distance 1 from the camera.
fn frame_at_one(camera: &CheckedCamera, fov_deg: f64) -> [f64; 2] {
    let height = 2.0 * (fov_deg.to_radians() / 2.0).tan();
    [f64::from(camera.width) / f64::from(camera.height) * height, height]
}

/// The frame in OpenEXR's terms.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Screen {
    /// Width of the frame at distance 1: `screenWindowWidth`.
    pub width: f64,
    /// Middle of the frame at distance 1, x right and y up: `screenWindowCenter`.
    pub center: [f64; 2],
    /// Width of a pixel over its height: `pixelAspectRatio`.
    pub pixel_aspect: f64,
}

/// The frame of a camera. Only a camera whose frame is a rectangle of a plane has width and centre;
/// others get OpenEXR's defaults.
pub fn screen(camera: &CheckedCamera) -> Screen {
    let default = Screen { width: 1.0, center: [0.0; 2], pixel_aspect: 1.0 };
    match camera.projection {
        Projection::Perspective { fov_deg, .. } => {
            Screen { width: frame_at_one(camera, fov_deg)[0], ..default }
        }
        Projection::Calibrated(calibration) => {
            let Calibration { focal: [fx, fy], principal: [cx, cy], .. } = calibration;
            let [width, height] = [camera.width, camera.height].map(f64::from);
            let center = [(width / 2.0 - cx) / fx, (cy - height / 2.0) / fy];
            Screen { width: width / fx, center, pixel_aspect: fy / fx }
        }
        Projection::Distorted(Calibration { focal: [fx, fy], .. }, ..) => {
            Screen { pixel_aspect: fy / fx, ..default }
        }
        Projection::Orthographic { .. } | Projection::Panorama { .. } => default,
    }
}

/// OpenEXR's `worldToCamera`, for row vectors times matrix, row by row. x right, y up, z forward.
pub fn world_to_camera(camera: &CheckedCamera) -> [[f64; 4]; 4] {
    let axes = axes(camera);
    let at = |row: usize| [axes[0][row], axes[1][row], axes[2][row], 0.0];
    let [x, y, z] = axes.map(|axis| -camera.position.dot(axis));
    [at(0), at(1), at(2), [x, y, z, 1.0]]
}

/// OpenEXR's `worldToNDC`, if a matrix can express the camera. After the division by w, x and y run
/// from 0 at the top left to 1 at the bottom right of the frame. For perspective cameras z is 0 at
/// distance 1 and 1 at infinity, because there is no far plane. For orthographic ones z is the
/// distance.
pub fn world_to_ndc(camera: &CheckedCamera) -> Option<[[f64; 4]; 4]> {
    let [columns, rows] = [camera.width, camera.height].map(f64::from);
    let rows_of = world_to_camera(camera);
    Some(match camera.projection {
        Projection::Perspective { fov_deg, .. } => {
            let [width, height] = frame_at_one(camera, fov_deg);
            rows_of.map(|[x, y, z, w]| [x / width + 0.5 * z, -y / height + 0.5 * z, z - w, z])
        }
        Projection::Calibrated(Calibration { focal: [fx, fy], principal: [cx, cy], skew }) => {
            rows_of.map(|[x, y, z, w]| {
                let column = (fx * x - skew * y + cx * z) / columns;
                [column, (cy * z - fy * y) / rows, z - w, z]
            })
        }
        Projection::Orthographic { width } => {
            let height = width * rows / columns;
            rows_of.map(|[x, y, z, w]| [x / width + 0.5 * w, -y / height + 0.5 * w, z, w])
        }
        Projection::Distorted(..) | Projection::Panorama { .. } => return None,
    })
}

/// The camera as JSON for an attribute of the header: projection in the keys of a scene file, then
/// `position`, `lookat` and `up` of every camera, in doubles. The matrices of the header are
/// floats, too coarse for positions far from 0.
pub fn described(camera: &CheckedCamera) -> String {
    let intrinsics = |calibration: &Calibration, distortion: Option<&Distortion>| {
        let Calibration { focal: [fx, fy], principal: [cx, cy], skew } = *calibration;
        let mut json = json!({ "type": "intrinsics", "fx": fx, "fy": fy, "cx": cx - 0.5,
            "cy": cy - 0.5, "skew": skew });
        if let Some(distortion) = distortion {
            json["distortion"] = lens(distortion);
        }
        json
    };
    let mut json = match &camera.projection {
        Projection::Perspective { fov_deg, lens: None } => {
            json!({ "type": "pinhole", "fov": fov_deg })
        }
        Projection::Perspective { fov_deg, lens: Some(lens) } => {
            json!({ "type": "thinlens", "fov": fov_deg, "aperture": lens.aperture,
                "focaldistance": lens.focal_distance })
        }
        Projection::Calibrated(calibration) => intrinsics(calibration, None),
        Projection::Distorted(calibration, distortion, _) => {
            intrinsics(calibration, Some(distortion))
        }
        Projection::Orthographic { width } => json!({ "type": "orthographic", "viewwidth": width }),
        Projection::Panorama { longitude_deg, latitude_deg } => {
            json!({ "type": "panorama", "longitude": longitude_deg, "latitude": latitude_deg })
        }
    };
    for (key, value) in
        [("position", camera.position), ("lookat", camera.lookat), ("up", camera.up)]
    {
        json[key] = json!(value.to_array());
    }
    json.to_string()
}

fn lens(distortion: &Distortion) -> Value {
    let ([a1, a2, a3, a4], [b1, b2, b3]) = (distortion.numerator, distortion.denominator);
    let [p1, p2] = distortion.tangential;
    match distortion.model {
        Model::Fisheye => json!({ "type": "fisheye", "k1": a1, "k2": a2, "k3": a3, "k4": a4 }),
        Model::BrownConrady => json!({ "type": "brownconrady", "k1": a1, "k2": a2, "k3": a3,
            "k4": b1, "k5": b2, "k6": b3, "p1": p1, "p2": p2 }),
    }
}

/// Size of a pixel in the middle of the frame: the smaller side, at distance 1 from the camera, or
/// everywhere for an orthographic camera.
pub fn pixel_size(camera: &CheckedCamera) -> f64 {
    let [columns, rows] = [camera.width, camera.height].map(f64::from);
    match camera.projection {
        Projection::Perspective { fov_deg, .. } => {
            2.0 * (fov_deg.to_radians() / 2.0).tan() / f64::from(camera.height)
        }
        Projection::Calibrated(Calibration { focal: [fx, fy], .. })
        | Projection::Distorted(Calibration { focal: [fx, fy], .. }, ..) => 1.0 / fx.max(fy),
        Projection::Orthographic { width } => width / columns,
        Projection::Panorama { longitude_deg: [left, right], latitude_deg: [low, high] } => {
            let across = (right - left).to_radians() / columns;
            across.min((high - low).to_radians() / rows)
        }
    }
}

/// Half-spaces that contain everything that a camera can see: points p with
/// `n . (p - position) + d >= 0`. Empty if the camera's view is not bounded by planes.
pub fn sides(camera: &CheckedCamera) -> Vec<(DVec3, f64)> {
    let [x, y, z] = axes(camera);
    let (columns, rows) = (f64::from(camera.width), f64::from(camera.height));
    match camera.projection {
        // A point of the lens sees past the sides of the frustum, out of focus.
        Projection::Perspective { lens: Some(_), .. } => vec![(z, 0.0)],
        Projection::Perspective { fov_deg, lens: None } => {
            let tan = (fov_deg.to_radians() / 2.0).tan();
            let wide = tan * columns / rows;
            [z, z * wide + x, z * wide - x, z * tan + y, z * tan - y].map(|n| (n, 0.0)).to_vec()
        }
        Projection::Calibrated(calibration) => {
            let at = |u: f64, v: f64| {
                let [px, py] = calibration.plane([u, v]);
                x * px - y * py + z
            };
            let [a, b] = [at(0.0, 0.0), at(columns, 0.0)];
            let [c, d] = [at(columns, rows), at(0.0, rows)];
            let middle = at(columns / 2.0, rows / 2.0);
            let inward = |n: DVec3| if n.dot(middle) < 0.0 { -n } else { n };
            let sides = [a.cross(b), b.cross(c), c.cross(d), d.cross(a)].map(inward);
            [z, sides[0], sides[1], sides[2], sides[3]].map(|n| (n, 0.0)).to_vec()
        }
        Projection::Orthographic { width } => {
            let (half, high) = (width / 2.0, width * rows / columns / 2.0);
            vec![(z, 0.0), (x, half), (-x, half), (y, high), (-y, high)]
        }
        Projection::Distorted(..) | Projection::Panorama { .. } => Vec::new(),
    }
}
