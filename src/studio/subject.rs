//! A mesh file to show, and the user's options for its placement and its look.

use std::path::{Path, PathBuf};

use clap::ValueEnum;
use glam::DVec3;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::builtin::Studio;
use super::quality::Quality;
use crate::reserve::MemoryLimit;
use crate::scene::written::{Crease, MeshColorDescription, SmoothDescription};

/// Default margin between the mesh and the picture's borders, as a fraction of width and height.
pub const MARGIN: f64 = 0.08;

/// Name of the plane on which meshes stand.
pub const GROUND: &str = "ground";

/// An axis of a mesh file.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema, ValueEnum)]
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
    pub smooth: Option<SmoothDescription>,
    /// Texture image, in place of the one that the file or the template names.
    pub texture: Option<PathBuf>,
    /// True to remove the template's plane named `ground`.
    pub no_ground: bool,
    /// Source of the colours of the mesh.
    pub color: Option<MeshColorDescription>,
    /// Radius of spheres that replace the faces, in the units of the file.
    pub points: Option<f64>,
    /// Number of camera samples in the built-in studio, in place of its own `spp`.
    pub quality: Option<Quality>,
    /// The built-in studio; default: [`Studio::Lamps`]. An error with a template of the user.
    pub studio: Option<Studio>,
}

/// Converts the value of `--smooth`: the maximum angle of a smooth edge in degrees.
pub fn smooth(degrees: f64) -> SmoothDescription {
    match degrees {
        0.0 => SmoothDescription::Everywhere(false),
        180.0 => SmoothDescription::Everywhere(true),
        angle => SmoothDescription::Below(Crease { angle, flat: None }),
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
    /// Point on the axis of the turntable. `None` for the middle of the mesh.
    pub pivot: Option<DVec3>,
    /// True to keep the mesh in the coordinates of its file, for cameras that are given in them.
    /// The lights of the built-in studio move to the mesh, and its ground is left out. In a
    /// template of the user nothing moves: the mesh has the placement of the template's trimesh.
    pub calibrated: bool,
    /// True to drop triangles with missing or non-finite vertices.
    pub repair: bool,
    /// True to read the file instead of mapping it.
    pub no_mmap: bool,
    /// Limit of the memory for the arrays of the mesh.
    pub memory_limit: Option<MemoryLimit>,
}

impl<'a> Subject<'a> {
    /// Makes a subject with default options.
    pub fn new(path: &'a Path) -> Self {
        Self {
            path,
            up: None,
            rotate: None,
            margin: MARGIN,
            looks: Appearance::default(),
            turning: false,
            pivot: None,
            calibrated: false,
            repair: false,
            no_mmap: false,
            memory_limit: None,
        }
    }
}
