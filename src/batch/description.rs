//! A job file exactly as it is written: the one table of its keys. Schema, checks and what an editor
//! shows come from these types, as for scenes.

use std::collections::BTreeMap;

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use serde_json::Value;

use crate::{
    output::exr::Compression,
    scene::written::{Angles, Name, Point, Smooth},
    studio::{Axis, Fixed, Turning},
};

/// A lightpath batch: what is rendered, how it is shown, where it goes. Paths are relative to the job
/// file.
#[derive(Debug, Clone, Default, Serialize, Deserialize, JsonSchema)]
pub struct JobFile {
    /// Scenes and meshes: files, folders (all meshes in it, or else all scenes), patterns (`scans/*.ply`,
    /// `**` for folders of any depth).
    #[schemars(length(min = 1))]
    pub inputs: Vec<Input>,
    /// The scene that shows meshes, its first trimesh replaced; the built-in studio otherwise.
    #[serde(default)]
    pub template: Option<Name>,
    /// Which axis of the meshes points up.
    #[serde(default)]
    pub up: Option<Axis>,
    /// Turns the meshes, in place of `up`.
    #[serde(default)]
    pub rotate: Option<Angles>,
    /// Kept free around a mesh at each border, as a fraction of the picture.
    #[serde(default)]
    #[schemars(range(min = 0.0), extend("exclusiveMaximum" = 0.5))]
    pub margin: Option<f64>,
    /// Where the normals of meshes are interpolated, in place of the template's `smooth`.
    #[serde(default)]
    pub smooth: Option<Smooth>,
    /// The image for the meshes' texture coordinates.
    #[serde(default)]
    pub texture: Option<Name>,
    /// false: without the template's plane named `ground`.
    #[serde(default)]
    pub ground: Option<bool>,
    /// Picture width and height in pixels.
    #[serde(default)]
    pub size: Option<[u32; 2]>,
    /// EXR layers by name, as `--aov` takes them.
    #[serde(default)]
    pub layers: Option<Vec<Name>>,
    /// How many things a pixel of a cryptomatte can hold, as `--crypto-ranks` takes it.
    #[serde(default)]
    #[schemars(range(min = 2, max = 16), extend("multipleOf" = 2))]
    pub cryptoranks: Option<u32>,
    /// Keys of the scene's `camera`, set in every scene; with `position` nothing is framed. What a run
    /// prints as a mesh's camera makes the same pictures of it again.
    #[serde(default)]
    #[schemars(schema_with = "open_object")]
    pub camera: BTreeMap<String, Value>,
    /// Values of every scene by JSON pointer, as `--set` takes them.
    #[serde(default)]
    #[schemars(schema_with = "open_object")]
    pub set: BTreeMap<String, Value>,
    /// Several frames of each input, from around.
    #[serde(default)]
    pub turntable: Option<TurntableKeys>,
    /// What is written.
    #[serde(default)]
    pub output: OutputKeys,
    /// What the machine may be asked for; flags win.
    #[serde(default)]
    pub limits: LimitKeys,
}

/// A path or pattern, or an object that says how its files differ from the others.
#[derive(Debug, Clone, Serialize, Deserialize, JsonSchema)]
#[serde(untagged)]
pub enum Input {
    /// A file, folder or pattern.
    Path(Name),
    /// The same with overrides.
    Entry(Box<Entry>),
}

/// Inputs that differ from the others.
#[derive(Debug, Clone, Serialize, Deserialize, JsonSchema)]
pub struct Entry {
    /// A file, folder or pattern.
    pub path: Name,
    /// Which axis of the mesh points up.
    #[serde(default)]
    pub up: Option<Axis>,
    /// Turns the mesh, in place of `up`.
    #[serde(default)]
    pub rotate: Option<Angles>,
    /// Keys of the scene's `camera`.
    #[serde(default)]
    #[schemars(schema_with = "open_object")]
    pub camera: BTreeMap<String, Value>,
    /// Values of the scene by JSON pointer.
    #[serde(default)]
    #[schemars(schema_with = "open_object")]
    pub set: BTreeMap<String, Value>,
}

/// Frames evenly around a whole turn, counterclockwise as seen from above.
#[derive(Debug, Clone, Serialize, Deserialize, JsonSchema)]
pub struct TurntableKeys {
    /// How many frames.
    #[schemars(range(min = 1, max = 100000))]
    pub frames: u32,
    /// What turns.
    #[serde(default)]
    pub turn: Turning,
    /// What the lights stay with; by default the camera if the object turns, the object if the camera
    /// does.
    #[serde(default)]
    pub lights: Option<Fixed>,
    /// Degrees at the first frame.
    #[serde(default)]
    #[schemars(range(min = -360.0, max = 360.0))]
    pub start: f64,
    /// Where the axis stands; by default in the middle of a mesh, at the `target` of a scene's camera.
    #[serde(default)]
    pub pivot: Option<Point>,
}

/// What is written.
#[derive(Debug, Clone, Default, Serialize, Deserialize, JsonSchema)]
#[serde(default)]
pub struct OutputKeys {
    /// Where everything goes; `out` unless given.
    pub folder: Option<Name>,
    /// Name of a frame in it: `{stem}` of the input, its `{parent}` folder's name, `{input}` and
    /// `{frame}` numbers, with digits as in `{frame:04}`.
    pub name: Option<Name>,
    /// 32-bit floats in the EXR in place of halves.
    pub float: bool,
    /// Compression of the EXR.
    pub compression: Compression,
    /// A part of the EXR for every layer.
    pub multipart: bool,
    /// Names of cryptomattes in files beside the EXR in place of its header.
    pub cryptosidecar: bool,
    /// Bits of the PNG's channels: 8, or 16.
    #[schemars(range(min = 8, max = 16))]
    pub pngbits: Option<u8>,
    /// Frames per second, for the EXRs: 24 or 24000/1001.
    pub fps: Option<Name>,
}

/// What the machine may be asked for.
#[derive(Debug, Clone, Default, Serialize, Deserialize, JsonSchema)]
#[serde(default)]
pub struct LimitKeys {
    /// As `--max-memory` takes it: 8G, 512MiB.
    pub memory: Option<Name>,
    /// Worker threads.
    #[schemars(range(min = 1, max = 1024))]
    pub threads: Option<u16>,
    /// Frames rendered at a time.
    #[schemars(range(min = 1, max = 1024))]
    pub jobs: Option<u16>,
}

/// An object of any keys.
fn open_object(_: &mut schemars::SchemaGenerator) -> schemars::Schema {
    schemars::json_schema!({ "type": "object", "additionalProperties": {} })
}
