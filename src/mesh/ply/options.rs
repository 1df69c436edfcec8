//! Options for reading a mesh file. With them, a scene requests the optional data that it uses.

use crate::monitor::Monitor;
use crate::reserve::MemoryLimit;

/// The colours to read.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub enum ColorChoice<'a> {
    /// Colours of the vertices, or else of the faces, if the file has any.
    #[default]
    Any,
    /// No colours, even if the file has some.
    Nothing,
    /// Colours of the vertices. A file without them is an error.
    Vertices,
    /// Colours of the faces. A file without them is an error.
    Faces,
    /// Values of a property that is no list: `NAME` of the vertices, else of the faces.
    /// `vertex.NAME` and `face.NAME` select one element. A file without it is an error.
    Property(&'a str),
}

/// The colours to read, and the place of the request for messages.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct ColorRequest<'a> {
    /// Source of the colours.
    pub source: ColorChoice<'a>,
    /// Place of the request in a scene, for messages. Empty: messages name the mesh file.
    pub place: &'a str,
}

/// Default window in bytes: it fits into the caches and gives every thread enough work.
const WINDOW: usize = 1 << 23;

/// Options for reading a mesh file.
#[derive(Debug, Clone, Copy)]
#[non_exhaustive]
pub struct ReadOptions<'a> {
    /// Drops triangles that use a missing or non-finite vertex, drops points that are not finite,
    /// and ignores texture indices out of range. Without it, each of these is an error.
    pub repair: bool,
    /// Maps the file into memory if possible. Without it, the file is read through a window.
    pub mmap: bool,
    /// Size in bytes of the window through which an unmapped file is read. It grows for longer
    /// rows.
    pub window: usize,
    /// Stops the reader on request: reading then ends with `Interrupted`.
    pub monitor: Option<&'a Monitor>,
    /// Limit of the memory for the arrays of the mesh.
    pub memory_limit: Option<MemoryLimit>,
    /// The colours or the scalar property to read.
    pub color: ColorRequest<'a>,
    /// Reads the vertices as points: no faces, normals or texture coordinates.
    pub points: bool,
    /// Stores the index of the texture of each face, if the file names several textures.
    pub textures: bool,
}

impl Default for ReadOptions<'_> {
    fn default() -> Self {
        let color = ColorRequest::default();
        let (repair, points, textures) = (false, false, true);
        let (monitor, memory_limit) = (None, None);
        Self { repair, mmap: true, window: WINDOW, monitor, memory_limit, color, points, textures }
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

    /// Returns the options with `memory_limit` changed.
    pub fn memory_limit(self, memory_limit: Option<MemoryLimit>) -> Self {
        Self { memory_limit, ..self }
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
