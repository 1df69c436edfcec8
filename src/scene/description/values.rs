//! The value types of scene files. Their bounds keep every later product finite: coordinates
//! squared in f32, colours times coefficients.

use std::borrow::Cow;

use glam::{DVec3, Vec3};
use schemars::{JsonSchema, Schema, SchemaGenerator, json_schema};
use serde::{Deserialize, Serialize};

/// Maximum absolute value of a coordinate in world units. Its square still fits f32.
pub const MAX_COORDINATE: f64 = 1e18;
/// Minimum of radii, sizes and distances in world units. Embree finds no sphere of a denormal
/// radius, and f32 is denormal below 1.2e-38.
pub const MIN_SIZE: f64 = 1e-37;
/// Maximum absolute value of an angle of any number of turns, in degrees.
pub const MAX_TURN: f64 = 1e6;
/// Maximum absolute value of a colour component.
pub const MAX_COLOR: f64 = 1e18;

/// A colour in linear RGB. Components may exceed 1.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize, Deserialize)]
#[serde(transparent)]
pub struct Color(pub [f64; 3]);

/// A point in world units.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize, Deserialize)]
#[serde(transparent)]
pub struct Point(pub [f64; 3]);

/// A direction of any length.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(transparent)]
pub struct Direction(pub [f64; 3]);

/// Rotation angles in degrees about the x, then y, then z axis.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize, Deserialize)]
#[serde(transparent)]
pub struct Angles(pub [f64; 3]);

/// Two angles in degrees, the lower one first.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(transparent)]
pub struct Interval(pub [f64; 2]);

/// Rows of a 4 x 4 matrix for column vectors. The last row is 0, 0, 0, 1.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(transparent)]
pub struct Matrix(pub [[f64; 4]; 4]);

/// A text that is not empty.
#[derive(Debug, Clone, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(transparent)]
pub struct Name(pub String);

impl Color {
    /// Converts to the vector type of the renderer.
    pub fn vec(self) -> Vec3 {
        DVec3::from(self.0).as_vec3()
    }
}

impl Point {
    /// Converts to the vector type of the renderer.
    pub fn vec(self) -> DVec3 {
        self.0.into()
    }
}

fn three(limit: Option<f64>, description: &str) -> Schema {
    numbers(3, limit, description)
}

fn numbers(count: u32, limit: Option<f64>, description: &str) -> Schema {
    let mut item = serde_json::json!({ "type": "number" });
    if let Some(limit) = limit {
        item["minimum"] = (-limit).into();
        item["maximum"] = limit.into();
    }
    json_schema!({
        "description": description,
        "type": "array",
        "items": item,
        "minItems": count,
        "maxItems": count,
    })
}

/// Implements `JsonSchema` with a hand-written schema that is inlined where it is used.
macro_rules! inline_schema {
    ($type:ident, $schema:expr) => {
        impl JsonSchema for $type {
            fn inline_schema() -> bool {
                true
            }
            fn schema_name() -> Cow<'static, str> {
                stringify!($type).into()
            }
            fn json_schema(_: &mut SchemaGenerator) -> Schema {
                $schema
            }
        }
    };
}

inline_schema!(Color, three(Some(MAX_COLOR), "Linear RGB, may exceed 1."));
inline_schema!(Point, three(Some(MAX_COORDINATE), "A point in world units."));
inline_schema!(Direction, three(None, "A direction of any length."));
inline_schema!(Angles, three(Some(MAX_TURN), "Degrees about the x, then y, then z axis."));
inline_schema!(Interval, numbers(2, Some(360.0), "Two angles in degrees, the lower one first."));
inline_schema!(
    Matrix,
    json_schema!({
        "description": "Four rows of four numbers, for column vectors; the last row is 0, 0, 0, 1.",
        "type": "array",
        "items": numbers(4, Some(MAX_COORDINATE), "A row."),
        "minItems": 4,
        "maxItems": 4,
    })
);
inline_schema!(Name, json_schema!({ "type": "string", "minLength": 1 }));
