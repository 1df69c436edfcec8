//! Shapes as a scene file writes them.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::color::MeshColorDescription;
use super::material::{ColorSpace, MaterialUse};
use super::values::{Angles, MAX_COORDINATE, MIN_SIZE, Matrix, Name, Point};
use super::visible::Visible;

/// A shape of the scene.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(tag = "type", rename_all = "lowercase")]
#[schemars(rename = "Shape")]
pub enum ShapeDescription {
    /// A sphere with centre and radius.
    Sphere(SphereDescription),
    /// A bounded planar convex quad.
    Plane(PlaneDescription),
    /// A triangle with three corners.
    Triangle(TriangleDescription),
    /// A mesh from a PLY file.
    TriMesh(TriMeshDescription),
}

impl ShapeDescription {
    /// Returns the keys that shapes of every type have.
    pub fn common(&self) -> &ShapeCommon {
        match self {
            Self::Sphere(s) => &s.common,
            Self::Plane(s) => &s.common,
            Self::Triangle(s) => &s.common,
            Self::TriMesh(s) => &s.common,
        }
    }

    /// Returns mutable references to the path, if the shape is a mesh, and to the material.
    pub fn parts_mut(&mut self) -> (Option<&mut Name>, &mut MaterialUse) {
        match self {
            Self::Sphere(s) => (None, &mut s.common.material),
            Self::Plane(s) => (None, &mut s.common.material),
            Self::Triangle(s) => (None, &mut s.common.material),
            Self::TriMesh(s) => (Some(&mut s.path), &mut s.common.material),
        }
    }
}

/// The keys that shapes of every type have.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct ShapeCommon {
    /// Name for object IDs in the EXR.
    pub name: Option<Name>,
    /// An inline material or the name of one.
    pub material: MaterialUse,
    /// Kinds of rays that can hit the shape.
    #[serde(default)]
    pub visible: Visible,
    /// Camera rays that hit the shape end without colour, alpha or layers.
    #[serde(default)]
    pub holdout: bool,
    /// The shape stands for a surface of the plate: its colour is black, and alpha is the share of
    /// light that shadows take.
    #[serde(default)]
    pub shadow_catcher: bool,
    /// Class of the shape in the picture of semantic ids; 0 for none.
    #[serde(default)]
    #[schemars(range(max = 65535))]
    pub semantic: u16,
}

/// A sphere with centre and radius.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[schemars(rename = "Sphere")]
pub struct SphereDescription {
    /// The keys that shapes of every type have.
    #[serde(flatten)]
    pub common: ShapeCommon,
    /// World position of the centre.
    pub center: Point,
    /// Radius in world units.
    #[schemars(range(min = MIN_SIZE, max = MAX_COORDINATE))]
    pub radius: f64,
    /// Axis of the texture's poles.
    #[serde(default)]
    pub pole: Pole,
}

/// Axis of a sphere's texture poles.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "lowercase")]
pub enum Pole {
    /// poles on the x axis
    X,
    /// poles on the y axis
    Y,
    /// poles on the z axis
    #[default]
    Z,
}

/// A bounded planar convex quad. Its corners are in order around it.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[schemars(rename = "Plane")]
pub struct PlaneDescription {
    /// The keys that shapes of every type have.
    #[serde(flatten)]
    pub common: ShapeCommon,
    /// Corner 0 in world units.
    pub v0: Point,
    /// Corner 1 in world units.
    pub v1: Point,
    /// Corner 2 in world units.
    pub v2: Point,
    /// Corner 3 in world units.
    pub v3: Point,
}

/// A triangle. Its area must not be zero.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[schemars(rename = "Triangle")]
pub struct TriangleDescription {
    /// The keys that shapes of every type have.
    #[serde(flatten)]
    pub common: ShapeCommon,
    /// Corner 0 in world units.
    pub v0: Point,
    /// Corner 1 in world units.
    pub v1: Point,
    /// Corner 2 in world units.
    pub v2: Point,
}

/// A mesh from a PLY file, placed by `fit`, then `rotate`, then `size` and `center`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[schemars(rename = "TriMesh")]
pub struct TriMeshDescription {
    /// The keys that shapes of every type have.
    #[serde(flatten)]
    pub common: ShapeCommon,
    /// A `.ply` file, relative to the scene file.
    pub path: Name,
    /// Moves the centre of the mesh's bounding box to the origin and scales its longest side to
    /// this length.
    #[schemars(range(min = MIN_SIZE, max = MAX_COORDINATE))]
    pub fit: Option<f64>,
    /// Rotation in degrees about the x, then y, then z axis. [-90, 0, 0] turns a z-up scan upright.
    #[serde(default)]
    pub rotate: Angles,
    /// Scale factor: a vertex p becomes `center + size * p`.
    #[serde(default = "one")]
    #[schemars(range(min = MIN_SIZE, max = MAX_COORDINATE))]
    pub size: f64,
    /// Offset: a vertex p becomes `center + size * p`.
    #[serde(default)]
    pub center: Point,
    /// Interpolates vertex normals: true, false, or only across edges up to an angle. Unless false,
    /// normals of the file are used if there are any.
    #[serde(default)]
    pub smooth: SmoothDescription,
    /// false: the `coursework` backend loops over the triangles of the mesh. Other backends ignore
    /// it.
    #[serde(default = "yes")]
    pub bvh: bool,
    /// Multiplies `diffusecolor` by the colours of the file: of its vertices, else of its faces.
    #[serde(default = "yes")]
    pub vertexcolors: bool,
    /// Encoding of the colours of the file. Default: implied by their type in the file.
    pub vertexcolorspace: Option<ColorSpace>,
    /// What multiplies `diffusecolor`: `vertex` or `face` colours of the file, or a property
    /// through a colour map. Default: by `vertexcolors`.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub color: Option<MeshColorDescription>,
    /// Draws every vertex of the file as a sphere of this radius, in the units of the file, in
    /// place of its faces.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schemars(range(min = MIN_SIZE, max = MAX_COORDINATE))]
    pub points: Option<f64>,
    /// Places copies of the mesh that share its memory: for each, the rows of a 4 x 4 matrix that
    /// is applied after `fit`, `rotate`, `size` and `center`.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schemars(length(min = 1))]
    pub instances: Option<Vec<Matrix>>,
}

/// Edges across which the normals of a mesh are interpolated.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(untagged)]
#[schemars(rename = "Smooth")]
pub enum SmoothDescription {
    /// Across every edge (true) or no edge (false).
    Everywhere(bool),
    /// Only across edges up to an angle.
    Below(Crease),
}

/// Maximum angle of a smooth edge: the angle in degrees between the normals of its two faces.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Crease {
    /// Maximum angle of a smooth edge in general.
    #[schemars(range(max = 180), extend("exclusiveMinimum" = 0))]
    pub angle: f64,
    /// Maximum angle of a smooth edge between flat parts. It applies at a vertex if its creases
    /// form at most three parts, and if all faces of each part lie within 5 degrees of the part's
    /// normal. Default: `angle`.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schemars(range(max = 180), extend("exclusiveMinimum" = 0))]
    pub flat: Option<f64>,
}

impl Default for SmoothDescription {
    fn default() -> Self {
        Self::Everywhere(false)
    }
}

fn one() -> f64 {
    1.0
}

fn yes() -> bool {
    true
}
