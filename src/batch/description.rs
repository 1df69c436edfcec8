//! The job file as written. These types are the only table of its keys: the JSON Schema, the checks
//! and the help in editors are generated from them.

use std::collections::BTreeMap;

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use serde_json::Value;

use crate::{
    output::exr::Compression,
    scene::written::{Angles, Name, Point, Smooth},
    studio::{Axis, LightsFollow, Turning},
};

/// A lightpath batch: the inputs, how they are shown, and where the pictures go. Paths are relative
/// to the job file.
#[derive(Debug, Clone, Default, Serialize, Deserialize, JsonSchema)]
pub struct JobFile {
    /// Scenes and meshes: files, folders and patterns (`scans/*.ply`; `**` matches folders at any
    /// depth). A folder stands for all meshes in it, or for all scenes if it has no mesh.
    #[schemars(length(min = 1))]
    pub inputs: Vec<Input>,
    /// The scene that shows the meshes; each mesh replaces its first trimesh. Default: the built-in
    /// studio.
    #[serde(default)]
    pub template: Option<Name>,
    /// Which axis of the meshes points up.
    #[serde(default)]
    pub up: Option<Axis>,
    /// Rotation of the meshes in degrees, in place of `up`.
    #[serde(default)]
    pub rotate: Option<Angles>,
    /// Free space around a mesh at each border, as a fraction of the picture.
    #[serde(default)]
    #[schemars(range(min = 0.0), extend("exclusiveMaximum" = 0.5))]
    pub margin: Option<f64>,
    /// Where the normals of meshes are interpolated, in place of the template's `smooth`.
    #[serde(default)]
    pub smooth: Option<Smooth>,
    /// The image for the meshes' texture coordinates.
    #[serde(default)]
    pub texture: Option<Name>,
    /// false: removes the template's plane named `ground`.
    #[serde(default)]
    pub ground: Option<bool>,
    /// Picture width and height in pixels.
    #[serde(default)]
    pub size: Option<[u32; 2]>,
    /// EXR layers by name, as for `--aov`.
    #[serde(default)]
    pub layers: Option<Vec<Name>>,
    /// Number of objects that one pixel of a cryptomatte can hold, as for `--crypto-ranks`.
    #[serde(default)]
    #[schemars(range(min = 2, max = 16), extend("multipleOf" = 2))]
    pub cryptoranks: Option<u32>,
    /// Keys of `camera`, set in every scene. With `position`, meshes are not framed. A run prints
    /// the camera of each mesh; with that camera here, the next run makes the same pictures.
    #[serde(default)]
    #[schemars(schema_with = "open_object")]
    pub camera: BTreeMap<String, Value>,
    /// Values set in every scene, by JSON pointer, as for `--set`.
    #[serde(default)]
    #[schemars(schema_with = "open_object")]
    pub set: BTreeMap<String, Value>,
    /// Several frames of each input, seen from all around.
    #[serde(default)]
    pub turntable: Option<TurntableKeys>,
    /// Folder, names and format of the pictures.
    #[serde(default)]
    pub output: OutputKeys,
    /// Limits of memory and threads. Flags win over them.
    #[serde(default)]
    pub limits: LimitKeys,
}

/// A path or pattern, or an object with a path or pattern and settings for its files only.
#[derive(Debug, Clone, Serialize, Deserialize, JsonSchema)]
#[serde(untagged)]
pub enum Input {
    /// A file, folder or pattern.
    Path(Name),
    /// The same with settings of its own.
    Entry(Box<Entry>),
}

/// Inputs with settings of their own.
#[derive(Debug, Clone, Serialize, Deserialize, JsonSchema)]
pub struct Entry {
    /// A file, folder or pattern.
    pub path: Name,
    /// Which axis of the mesh points up.
    #[serde(default)]
    pub up: Option<Axis>,
    /// Rotation of the mesh in degrees, in place of `up`.
    #[serde(default)]
    pub rotate: Option<Angles>,
    /// Keys of the scene's `camera`.
    #[serde(default)]
    #[schemars(schema_with = "open_object")]
    pub camera: BTreeMap<String, Value>,
    /// Values set in the scene, by JSON pointer.
    #[serde(default)]
    #[schemars(schema_with = "open_object")]
    pub set: BTreeMap<String, Value>,
}

/// Frames spread evenly over one full turn, counterclockwise as seen from above.
#[derive(Debug, Clone, Serialize, Deserialize, JsonSchema)]
pub struct TurntableKeys {
    /// Number of frames in one turn.
    #[schemars(range(min = 1, max = 100000))]
    pub frames: u32,
    /// Which of the two turns: the object or the camera.
    #[serde(default)]
    pub turn: Turning,
    /// Whether the lights stay with the camera or with the object. Default: with the camera if the
    /// object turns, with the object if the camera turns.
    #[serde(default)]
    pub lights: Option<LightsFollow>,
    /// Angle of the first frame in degrees.
    #[serde(default)]
    #[schemars(range(min = -360.0, max = 360.0))]
    pub start: f64,
    /// A point on the axis. Default: the middle of a mesh, or the `target` of a scene's camera.
    #[serde(default)]
    pub pivot: Option<Point>,
}

/// Folder, names and format of the pictures.
#[derive(Debug, Clone, Default, Serialize, Deserialize, JsonSchema)]
#[serde(default)]
pub struct OutputKeys {
    /// Output folder; default `out`.
    pub folder: Option<Name>,
    /// Name of a frame within the folder. Fields: `{stem}` of the input, `{parent}` (the name of
    /// its folder), and the numbers `{input}` and `{frame}`, with a minimum of digits as in
    /// `{frame:04}`.
    pub name: Option<Name>,
    /// Stores 32-bit floats in the EXR instead of 16-bit floats.
    pub float: bool,
    /// Compression method of the EXR.
    pub compression: Compression,
    /// Writes one part of the EXR per layer.
    pub multipart: bool,
    /// Writes the object names of cryptomattes to files beside the EXR instead of its header.
    pub cryptosidecar: bool,
    /// Bits per channel of the PNG: 8 or 16.
    #[schemars(range(min = 8, max = 16))]
    pub pngbits: Option<u8>,
    /// Frame rate for the EXR header in frames per second: 24 or 24000/1001.
    pub fps: Option<Name>,
}

/// Limits of memory and threads.
#[derive(Debug, Clone, Default, Serialize, Deserialize, JsonSchema)]
#[serde(default)]
pub struct LimitKeys {
    /// Limit of memory, as for `--max-memory`: 8G, 512MiB.
    pub memory: Option<Name>,
    /// Number of worker threads.
    #[schemars(range(min = 1, max = 1024))]
    pub threads: Option<u16>,
    /// Number of frames rendered at a time.
    #[schemars(range(min = 1, max = 1024))]
    pub jobs: Option<u16>,
}

/// Schema of an object with arbitrary keys.
fn open_object(_: &mut schemars::SchemaGenerator) -> schemars::Schema {
    schemars::json_schema!({ "type": "object", "additionalProperties": {} })
}
