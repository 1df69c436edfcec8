//! Options for reading a mesh file. Optional data is stored only if a scene uses it.

use crate::monitor::Monitor;
use crate::reserve::MemoryLimit;

/// The colours to read.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub enum ColorSource<'a> {
    /// Colours of the vertices, or else of the faces, if the file has any.
    #[default]
    Any,
    /// No colours.
    Nothing,
    /// Colours of the vertices. A file without them is an error.
    Vertices,
    /// Colours of the faces. A file without them is an error.
    Faces,
    /// Values of a scalar property: `NAME` of the vertices, else of the faces. `vertex.NAME` and
    /// `face.NAME` select one. A file without it is an error.
    Property(&'a str),
}

/// The colours to read, and who asks for them.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct ColorRequest<'a> {
    /// Source of the colours.
    pub source: ColorSource<'a>,
    /// Place of the request in a scene, for messages. Empty: messages name the mesh file.
    pub place: &'a str,
}

/// Default window in bytes: it fits into the caches and gives every thread enough work.
const WINDOW: usize = 1 << 23;

/// Options for reading a mesh file.
#[derive(Debug, Clone, Copy)]
#[non_exhaustive]
pub struct ReadOptions<'a> {
    /// Drops triangles that use a missing or non-finite vertex. Without it, such a triangle is an
    /// error.
    pub repair: bool,
    /// Maps the file into memory. Without it, the file is read through a window of fixed size.
    pub mmap: bool,
    /// Size in bytes of the window on an unmapped file. The window grows for longer rows.
    pub window: usize,
    /// Stops the reader on request: reading then ends with `Interrupted`.
    pub monitor: Option<&'a Monitor>,
    /// Limit of the memory for the arrays of the mesh.
    pub room: Option<MemoryLimit>,
    /// The colours or the scalar property to read.
    pub color: ColorRequest<'a>,
    /// Reads the vertices as points: no faces, normals or texture coordinates.
    pub points: bool,
    /// Stores which of several textures each face has.
    pub textures: bool,
}

impl Default for ReadOptions<'_> {
    fn default() -> Self {
        let color = ColorRequest::default();
        let (repair, points, textures) = (false, false, true);
        let (monitor, room) = (None, None);
        Self { repair, mmap: true, window: WINDOW, monitor, room, color, points, textures }
    }
}

impl<'a> ReadOptions<'a> {
    /// Returns the options with `repair` changed.
    pub fn repair(self, repair: bool) -> Self {
        Self { repair, ..self }
    }

    /// Returns the options with `mmap` changed.
    pub fn mmap(self, mmap: bool) -> Self {
        Self { mmap, ..self }
    }

    /// Returns the options with `window` changed.
    pub fn window(self, window: usize) -> Self {
        Self { window, ..self }
    }

    /// Returns the options with `room` changed.
    pub fn room(self, room: Option<MemoryLimit>) -> Self {
        Self { room, ..self }
    }

    /// Returns the options with `color` changed.
    pub fn color(self, color: ColorRequest<'a>) -> Self {
        Self { color, ..self }
    }

    /// Returns the options with `points` changed.
    pub fn points(self, points: bool) -> Self {
        Self { points, ..self }
    }

    /// Returns the options with `textures` changed.
    pub fn textures(self, textures: bool) -> Self {
        Self { textures, ..self }
    }

    /// Returns the options with `monitor` changed.
    pub fn monitor(self, monitor: &'a Monitor) -> Self {
        Self { monitor: Some(monitor), ..self }
    }
}
