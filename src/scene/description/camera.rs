//! Cameras as a scene file writes them.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::values::{Direction, Interval, MAX_COORDINATE, MIN_SIZE, Matrix, Point};

/// The camera that takes the picture.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(tag = "type", rename_all = "lowercase")]
#[expect(clippy::large_enum_variant, reason = "a scene has one camera")]
#[schemars(rename = "Camera")]
pub enum CameraDescription {
    /// A perspective camera with everything in focus.
    Pinhole(Pinhole),
    /// A perspective camera with depth of field.
    Thinlens(Thinlens),
    /// A calibrated camera: intrinsics in pixels, a pose as a matrix, lens distortion.
    Intrinsics(Intrinsics),
    /// Parallel rays.
    Orthographic(Orthographic),
    /// An equirectangular picture of all directions, or a part of it.
    Panorama(Panorama),
}

/// A perspective camera with everything in focus. It has exactly one of `lookat` and `target`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[schemars(extend("oneOf" = [{ "required": ["lookat"] }, { "required": ["target"] }]))]
pub struct Pinhole {
    /// Picture width in pixels.
    #[schemars(range(min = 1, max = 2147483647))]
    pub width: u32,
    /// Picture height in pixels.
    #[schemars(range(min = 1, max = 2147483647))]
    pub height: u32,
    /// Full vertical angle of view in degrees.
    #[schemars(extend("exclusiveMinimum" = 0, "exclusiveMaximum" = 180))]
    pub fov: f64,
    /// Position in world units.
    pub position: Point,
    /// Directions of the camera.
    #[serde(flatten)]
    pub aim: Aim,
}

/// A perspective camera with depth of field. It has exactly one of `lookat` and `target`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Thinlens {
    /// The camera without its lens.
    #[serde(flatten)]
    pub pinhole: Pinhole,
    /// Diameter of the lens in world units; 0 is the same as `pinhole`.
    #[schemars(range(min = 0.0, max = 1e18))]
    pub aperture: f64,
    /// Distance of the plane in focus, along the view direction, in world units.
    #[schemars(range(min = MIN_SIZE, max = MAX_COORDINATE))]
    pub focaldistance: f64,
}

/// A calibrated camera. Pixels count as in OpenCV: the centre of the top left pixel is (0, 0). It
/// has exactly one of `world_to_camera` and `camera_to_world`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[schemars(extend(
    "oneOf" = [{ "required": ["world_to_camera"] }, { "required": ["camera_to_world"] }]
))]
pub struct Intrinsics {
    /// Picture width in pixels.
    #[schemars(range(min = 1, max = 2147483647))]
    pub width: u32,
    /// Picture height in pixels.
    #[schemars(range(min = 1, max = 2147483647))]
    pub height: u32,
    /// Horizontal focal length in pixels.
    #[schemars(range(min = 1e-3, max = 1e12))]
    pub fx: f64,
    /// Vertical focal length in pixels. Default: `fx`, square pixels.
    #[schemars(range(min = 1e-3, max = 1e12))]
    pub fy: Option<f64>,
    /// Column of the principal point. Default: the middle of the picture, (width - 1) / 2.
    #[schemars(range(min = -1e9, max = 1e9))]
    pub cx: Option<f64>,
    /// Row of the principal point. Default: the middle of the picture, (height - 1) / 2.
    #[schemars(range(min = -1e9, max = 1e9))]
    pub cy: Option<f64>,
    /// Entry (0, 1) of OpenCV's camera matrix, in pixels.
    #[serde(default)]
    #[schemars(range(min = -1e6, max = 1e6))]
    pub skew: f64,
    /// Distortion of the lens. Default: none.
    pub distortion: Option<DistortionDescription>,
    /// Rows of the matrix that takes world coordinates to camera coordinates.
    pub world_to_camera: Option<Matrix>,
    /// Rows of the matrix that takes camera coordinates to world coordinates.
    pub camera_to_world: Option<Matrix>,
    /// Axes of the camera coordinates in the matrix.
    #[serde(default)]
    pub axes: Axes,
}

/// Axes of camera coordinates.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "lowercase")]
pub enum Axes {
    /// x right, y down, z forward, as in OpenCV and COLMAP
    #[default]
    OpenCv,
    /// x right, y up, z backward, as in OpenGL, Blender and NeRF
    OpenGl,
}

/// Distortion of a lens, as OpenCV defines it.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(tag = "type", rename_all = "lowercase")]
#[schemars(rename = "Distortion")]
pub enum DistortionDescription {
    /// OpenCV's model of `calib3d`: rational radial and tangential terms.
    BrownConrady(BrownConrady),
    /// OpenCV's model of `fisheye`, of Kannala and Brandt.
    Fisheye(Fisheye),
}

/// OpenCV's model of `calib3d`: rational radial and tangential terms.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default)]
pub struct BrownConrady {
    /// Coefficient of r^2 in the numerator.
    pub k1: f64,
    /// Coefficient of r^4 in the numerator.
    pub k2: f64,
    /// Coefficient of r^6 in the numerator.
    pub k3: f64,
    /// Coefficient of r^2 in the denominator.
    pub k4: f64,
    /// Coefficient of r^4 in the denominator.
    pub k5: f64,
    /// Coefficient of r^6 in the denominator.
    pub k6: f64,
    /// First tangential coefficient.
    pub p1: f64,
    /// Second tangential coefficient.
    pub p2: f64,
}

/// OpenCV's model of `fisheye`, of Kannala and Brandt.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default)]
pub struct Fisheye {
    /// Coefficient of theta^3.
    pub k1: f64,
    /// Coefficient of theta^5.
    pub k2: f64,
    /// Coefficient of theta^7.
    pub k3: f64,
    /// Coefficient of theta^9.
    pub k4: f64,
}

/// Parallel rays. The camera has exactly one of `lookat` and `target`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[schemars(extend("oneOf" = [{ "required": ["lookat"] }, { "required": ["target"] }]))]
pub struct Orthographic {
    /// Picture width in pixels.
    #[schemars(range(min = 1, max = 2147483647))]
    pub width: u32,
    /// Picture height in pixels.
    #[schemars(range(min = 1, max = 2147483647))]
    pub height: u32,
    /// Width of the view in world units. Pixels are square.
    #[schemars(range(min = MIN_SIZE, max = MAX_COORDINATE))]
    pub viewwidth: f64,
    /// Middle of the plane in which all rays start, in world units.
    pub position: Point,
    /// Directions of the camera.
    #[serde(flatten)]
    pub aim: Aim,
}

/// An equirectangular picture of all directions, or a part of it. The camera has exactly one of
/// `lookat` and `target`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[schemars(extend("oneOf" = [{ "required": ["lookat"] }, { "required": ["target"] }]))]
pub struct Panorama {
    /// Picture width in pixels.
    #[schemars(range(min = 1, max = 2147483647))]
    pub width: u32,
    /// Picture height in pixels.
    #[schemars(range(min = 1, max = 2147483647))]
    pub height: u32,
    /// Angles of the left and the right border in degrees, to the right of the view direction.
    #[serde(default = "around")]
    pub longitude: Interval,
    /// Angles of the lower and the upper border in degrees, above the view direction.
    #[serde(default = "over")]
    pub latitude: Interval,
    /// Position in world units.
    pub position: Point,
    /// Directions of the camera.
    #[serde(flatten)]
    pub aim: Aim,
}

fn around() -> Interval {
    Interval([-180.0, 180.0])
}

fn over() -> Interval {
    Interval([-90.0, 90.0])
}

/// Directions of a camera, of all types but `intrinsics`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Aim {
    /// The view DIRECTION, not a point; of any length.
    pub lookat: Option<Direction>,
    /// A point to look at, other than `position`.
    pub target: Option<Point>,
    /// Up direction, of any length, not parallel to the view.
    pub up: Direction,
}

impl CameraDescription {
    /// Returns the width and the height of the picture in pixels.
    pub fn size(&self) -> [u32; 2] {
        match self {
            Self::Pinhole(c) => [c.width, c.height],
            Self::Thinlens(c) => [c.pinhole.width, c.pinhole.height],
            Self::Intrinsics(c) => [c.width, c.height],
            Self::Orthographic(c) => [c.width, c.height],
            Self::Panorama(c) => [c.width, c.height],
        }
    }

    /// Returns the point to look at, if the scene names one.
    pub fn target(&self) -> Option<Point> {
        self.stand()?.1.target
    }

    /// Returns position and directions; `None` for a camera whose pose is a matrix.
    pub fn stand(&self) -> Option<(Point, &Aim)> {
        match self {
            Self::Pinhole(c) => Some((c.position, &c.aim)),
            Self::Thinlens(c) => Some((c.pinhole.position, &c.pinhole.aim)),
            Self::Orthographic(c) => Some((c.position, &c.aim)),
            Self::Panorama(c) => Some((c.position, &c.aim)),
            Self::Intrinsics(_) => None,
        }
    }

    /// Returns mutable references to position and directions.
    pub fn stand_mut(&mut self) -> Option<(&mut Point, &mut Aim)> {
        match self {
            Self::Pinhole(c) => Some((&mut c.position, &mut c.aim)),
            Self::Thinlens(c) => Some((&mut c.pinhole.position, &mut c.pinhole.aim)),
            Self::Orthographic(c) => Some((&mut c.position, &mut c.aim)),
            Self::Panorama(c) => Some((&mut c.position, &mut c.aim)),
            Self::Intrinsics(_) => None,
        }
    }
}
