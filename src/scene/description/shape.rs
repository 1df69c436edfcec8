//! Shapes as written.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::{Angles, ColorSpace, MaterialUse, Name, Point};

/// A shape.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(tag = "type", rename_all = "lowercase")]
pub enum Shape {
    /// A sphere.
    Sphere(Sphere),
    /// A bounded planar convex quad.
    Plane(Plane),
    /// A triangle.
    Triangle(Triangle),
    /// A mesh from a PLY file.
    TriMesh(TriMesh),
}

impl Shape {
    /// Its name and material.
    pub fn common(&self) -> (&Option<Name>, &MaterialUse) {
        match self {
            Self::Sphere(s) => (&s.name, &s.material),
            Self::Plane(s) => (&s.name, &s.material),
            Self::Triangle(s) => (&s.name, &s.material),
            Self::TriMesh(s) => (&s.name, &s.material),
        }
    }

    /// Its material, to change it.
    pub fn material_mut(&mut self) -> &mut MaterialUse {
        match self {
            Self::Sphere(s) => &mut s.material,
            Self::Plane(s) => &mut s.material,
            Self::Triangle(s) => &mut s.material,
            Self::TriMesh(s) => &mut s.material,
        }
    }
}

/// A sphere.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Sphere {
    /// Used for object IDs in the EXR.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub name: Option<Name>,
    /// An inline material or the name of one.
    pub material: MaterialUse,
    /// World position of the centre.
    pub center: Point,
    /// World units.
    #[schemars(range(max = 1e18), extend("exclusiveMinimum" = 0))]
    pub radius: f64,
    /// Axis of the texture's poles.
    #[serde(default)]
    pub pole: Pole,
}

/// Axis of a sphere's texture poles.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "lowercase")]
pub enum Pole {
    /// poles on x
    X,
    /// poles on y
    Y,
    /// poles on z
    #[default]
    Z,
}

/// A bounded planar convex quad, corners in order around it.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Plane {
    /// Used for object IDs in the EXR.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub name: Option<Name>,
    /// An inline material or the name of one.
    pub material: MaterialUse,
    /// Corner 0.
    pub v0: Point,
    /// Corner 1.
    pub v1: Point,
    /// Corner 2.
    pub v2: Point,
    /// Corner 3.
    pub v3: Point,
}

/// A triangle, not of zero area.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Triangle {
    /// Used for object IDs in the EXR.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub name: Option<Name>,
    /// An inline material or the name of one.
    pub material: MaterialUse,
    /// Corner 0.
    pub v0: Point,
    /// Corner 1.
    pub v1: Point,
    /// Corner 2.
    pub v2: Point,
}

/// A mesh from a PLY file, placed by `fit`, then `rotate`, then `size` and `center`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct TriMesh {
    /// Used for object IDs in the EXR.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub name: Option<Name>,
    /// An inline material or the name of one.
    pub material: MaterialUse,
    /// A `.ply` file, relative to the scene file.
    pub path: Name,
    /// Centre the mesh's box on the origin and scale its longest side to this.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schemars(range(max = 1e18), extend("exclusiveMinimum" = 0))]
    pub fit: Option<f64>,
    /// Degrees about the x, then y, then z axis; [-90, 0, 0] stands a z-up scan upright.
    #[serde(default = "no_angles")]
    pub rotate: Angles,
    /// Vertices become `center + size * p`.
    #[serde(default = "one")]
    #[schemars(range(max = 1e18), extend("exclusiveMinimum" = 0))]
    pub size: f64,
    /// Vertices become `center + size * p`.
    #[serde(default = "origin")]
    pub center: Point,
    /// Shade with interpolated vertex normals: true, false, or across edges below an angle. Normals of the
    /// file are taken as they are.
    #[serde(default)]
    pub smooth: Smooth,
    /// false makes the `coursework` backend loop over the mesh's triangles; others ignore it.
    #[serde(default = "yes")]
    pub bvh: bool,
    /// Multiply `diffusecolor` by the file's vertex colours.
    #[serde(default = "yes")]
    pub vertexcolors: bool,
    /// Overrides what the file's colour type implies.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub vertexcolorspace: Option<ColorSpace>,
}

/// Where the normals of a mesh are interpolated.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(untagged)]
pub enum Smooth {
    /// Across every edge, or nowhere.
    Everywhere(bool),
    /// Across edges below an angle.
    Below(Crease),
}

/// Edges that are no creases, by the angle in degrees between the normals of their two faces.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Crease {
    /// The largest angle of a smooth edge.
    #[schemars(range(max = 180), extend("exclusiveMinimum" = 0))]
    pub angle: f64,
    /// The largest one between flat parts: at vertices where such creases make at most three parts, all of whose
    /// faces lie within 5 degrees. Default: `angle`.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schemars(range(max = 180), extend("exclusiveMinimum" = 0))]
    pub flat: Option<f64>,
}

impl Default for Smooth {
    fn default() -> Self {
        Self::Everywhere(false)
    }
}

fn no_angles() -> Angles {
    Angles([0.0; 3])
}

fn origin() -> Point {
    Point([0.0; 3])
}

fn one() -> f64 {
    1.0
}

fn yes() -> bool {
    true
}
