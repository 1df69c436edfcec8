//! The keys of a job file, before they are checked and defaults are filled in.
//!
//! These types are the only definition of the keys. The JSON Schema and the help in editors are
//! generated from them. A [`Name`] is a text that is not empty: a path, a pattern, the name of a
//! layer, a memory size or a frame rate. A [`Map`] keeps the order of the file.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use serde_json::{Map, Value};

use crate::integrate::Relative;
use crate::output::exr::Compression;
use crate::scene::written::{
    Angles, MAX_COORDINATE, MIN_SIZE, MeshColorDescription, Name, Point, SmoothDescription,
};
use crate::studio::{Axis, LightsFollow, Quality, Studio, Turning};

/// A lightpath batch: the inputs, how they are shown, and where the pictures go. Paths are relative
/// to the job file.
#[derive(Debug, Clone, Default, Serialize, Deserialize, JsonSchema)]
pub struct JobFile {
    /// Scenes and meshes: files, folders and patterns (`scans/*.ply`; `**` matches folders at any
    /// depth). A folder stands for all meshes in it, or for all scenes if it has no mesh.
    #[schemars(length(min = 1))]
    pub inputs: Vec<Input>,
    /// Path of the template: the scene that shows the meshes. Each mesh is rendered in place of the
    /// first shape of type `trimesh` in the template. Default: the built-in scene (ground and
    /// lights).
    pub template: Option<Name>,
    /// Which axis of the meshes points up. Default: y. Excludes `rotate`.
    pub up: Option<Axis>,
    /// Rotation of the meshes in degrees about the x, then y, then z axis. Excludes `up`.
    pub rotate: Option<Angles>,
    /// Free space around a mesh at each border, as a fraction of the picture's width (left and
    /// right) and height (top and bottom). Default: 0.08.
    #[schemars(range(min = 0.0), extend("exclusiveMaximum" = 0.5))]
    pub margin: Option<f64>,
    /// Edges across which the normals of meshes are interpolated, in place of the template's
    /// `smooth`.
    pub smooth: Option<SmoothDescription>,
    /// Path of the texture of all meshes, in place of those that the mesh files or the template
    /// name.
    pub texture: Option<Name>,
    /// Camera samples of the built-in studio. Excludes `template`.
    pub quality: Option<Quality>,
    /// Light of the built-in studio. Excludes `template`.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub studio: Option<Studio>,
    /// Colours of all meshes, as `color` of a mesh in a scene.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub color: Option<MeshColorDescription>,
    /// Draws every vertex of the meshes as a sphere of this radius, in the units of the file.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schemars(range(min = MIN_SIZE, max = MAX_COORDINATE))]
    pub points: Option<f64>,
    /// false: removes the template's plane named `ground`. Default: true.
    pub ground: Option<bool>,
    /// Picture width and height in pixels.
    #[schemars(inner(range(min = 1, max = 2147483647)))]
    pub size: Option<[u32; 2]>,
    /// More pixels on every side of the picture, as for `--overscan`.
    #[serde(default)]
    #[schemars(range(max = 65536))]
    pub overscan: u32,
    /// Relative standard error above which the pixels around take more samples, as for `--noise`.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schemars(range(max = 1.0), extend("exclusiveMinimum" = 0.0))]
    pub noise: Option<f64>,
    /// What `noise` is relative to.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub noiseof: Option<Relative>,
    /// Maximum number of samples of a pixel with `noise`, a power of two, as for `--max-spp`.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schemars(range(min = 1, max = 65536))]
    pub maxspp: Option<u32>,
    /// Names of layers to add to the EXR, as for `--aov`.
    pub layers: Option<Vec<Name>>,
    /// Number of objects that one pixel of a cryptomatte can hold, as for `--crypto-ranks`.
    #[schemars(range(min = 2, max = 16), extend("multipleOf" = 2))]
    pub cryptoranks: Option<u32>,
    /// Keys of the scene's `camera`, set in every scene. Unless `position` is among them, the
    /// camera of each mesh moves to where it sees the whole mesh. A run prints this camera.
    /// Repeated in the mesh's entry in `inputs`, it gives the same picture again.
    #[serde(default)]
    #[schemars(schema_with = "open_object")]
    pub camera: Map<String, Value>,
    /// Values set in every scene, by JSON pointer, in this order, as for `--set`.
    #[serde(default)]
    #[schemars(schema_with = "open_object")]
    pub set: Map<String, Value>,
    /// Renders several frames of each input: a full turn around it.
    pub turntable: Option<TurntableKeys>,
    /// Path of a list of cameras: a COLMAP model, transforms.json, or JSON with `cameras`. Each
    /// input is rendered from every camera, in its own coordinates. Excludes `turntable`, `size`
    /// and `camera`.
    pub cameras: Option<Name>,
    /// true: leaves the distortion of the lenses in `cameras` out.
    #[serde(default)]
    pub undistort: bool,
    /// Folder, names and format of the pictures.
    #[serde(default)]
    pub output: OutputKeys,
    /// Limits of memory and threads. Flags of the command line win over them.
    #[serde(default)]
    pub limits: LimitKeys,
}

impl JobFile {
    /// Returns the first given key that has an effect on meshes only.
    pub fn mesh_key(&self) -> Option<&'static str> {
        let keys = [
            ("template", self.template.is_some()),
            ("up", self.up.is_some()),
            ("rotate", self.rotate.is_some()),
            ("margin", self.margin.is_some()),
            ("smooth", self.smooth.is_some()),
            ("texture", self.texture.is_some()),
            ("quality", self.quality.is_some()),
            ("studio", self.studio.is_some()),
            ("color", self.color.is_some()),
            ("points", self.points.is_some()),
            ("ground", self.ground == Some(false)),
        ];
        keys.into_iter().find(|(_, given)| *given).map(|(key, _)| key)
    }
}

/// A path or pattern, or an object that adds settings for the files of one path or pattern.
#[derive(Debug, Clone, Serialize, Deserialize, JsonSchema)]
#[serde(untagged)]
pub enum Input {
    /// A file, folder or pattern.
    Path(Name),
    /// A file, folder or pattern, and settings for its files only.
    Entry(Box<Entry>),
}

/// A file, folder or pattern, and settings for its files only. They win over those of the job.
#[derive(Debug, Clone, Serialize, Deserialize, JsonSchema)]
pub struct Entry {
    /// A file, folder or pattern.
    pub path: Name,
    /// Which axis of the mesh points up, in place of the job's `up` or `rotate`. Excludes `rotate`.
    pub up: Option<Axis>,
    /// Rotation of the mesh in degrees about the x, then y, then z axis, in place of the job's `up`
    /// or `rotate`. Excludes `up`.
    pub rotate: Option<Angles>,
    /// Keys of the scene's `camera`, set after the job's `camera` and `set`.
    #[serde(default)]
    #[schemars(schema_with = "open_object")]
    pub camera: Map<String, Value>,
    /// Values set in the scene, by JSON pointer, after the job's `camera` and `set`.
    #[serde(default)]
    #[schemars(schema_with = "open_object")]
    pub set: Map<String, Value>,
}

/// Frames at equal angles over one full turn. The object or the camera (`turn`) moves
/// counterclockwise as seen from above.
#[derive(Debug, Clone, Serialize, Deserialize, JsonSchema)]
pub struct TurntableKeys {
    /// Number of frames in one turn.
    #[schemars(range(min = 1, max = 100000))]
    pub frames: u32,
    /// What turns: the object or the camera.
    #[serde(default)]
    pub turn: Turning,
    /// Whether the lights stay with the camera or with the object. Default: with the camera if the
    /// object turns, with the object if the camera turns.
    pub lights: Option<LightsFollow>,
    /// Angle of the first frame in degrees. At 0 this frame is the scene itself.
    #[serde(default)]
    #[schemars(range(min = -360.0, max = 360.0))]
    pub start: f64,
    /// A point on the vertical axis of the turn. Default: the middle of a mesh, or the `target` of
    /// a scene's camera.
    pub pivot: Option<Point>,
}

/// Folder, names and format of the pictures.
#[derive(Debug, Clone, Default, Serialize, Deserialize, JsonSchema)]
#[serde(default)]
pub struct OutputKeys {
    /// Output folder. Default: `out` in the working folder.
    pub folder: Option<Name>,
    /// Name of a frame within the folder. Fields: `{stem}` (the input's file name without its
    /// ending), `{parent}` (the name of the input's folder), `{image}` (the picture's name in
    /// `cameras`), `{input}` and `{frame}` (numbers from 0). `{frame:04}` pads with zeros to 4
    /// digits.
    pub name: Option<Name>,
    /// Stores 32-bit floats in the EXR instead of 16-bit floats.
    pub float: bool,
    /// Compression method of the EXR.
    pub compression: Compression,
    /// Writes one part of the EXR per layer.
    pub multipart: bool,
    /// Writes the object names of cryptomattes to files beside the EXR instead of its header.
    pub cryptosidecar: bool,
    /// A frame with a NaN or infinite pixel fails and is not written.
    pub strict: bool,
    /// Bits per channel of the PNG: 8 or 16.
    #[schemars(extend("enum" = [8, 16, null]))]
    pub pngbits: Option<u8>,
    /// Frame rate for the EXR header in frames per second, as a text such as "24" or "24000/1001".
    pub fps: Option<Name>,
}

/// Limits of memory and threads.
#[derive(Debug, Clone, Default, Serialize, Deserialize, JsonSchema)]
#[serde(default)]
pub struct LimitKeys {
    /// Limit of memory, as for `--max-memory`, such as "8G" or "512MiB".
    pub memory: Option<Name>,
    /// Number of worker threads.
    #[schemars(range(min = 1, max = 1024))]
    pub threads: Option<u16>,
    /// Number of frames rendered at the same time, as for `--jobs`.
    #[schemars(range(min = 1, max = 1024))]
    pub jobs: Option<u16>,
}

/// Schema of an object with arbitrary keys.
fn open_object(_: &mut schemars::SchemaGenerator) -> schemars::Schema {
    schemars::json_schema!({ "type": "object", "additionalProperties": {} })
}
