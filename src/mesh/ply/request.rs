//! Which optional data of a file a scene uses. Nothing else is stored.

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
