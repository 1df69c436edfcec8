//! The PLY reader. It reads any PLY file that holds a mesh, the common ones at memory speed.
//!
//! Each step is a module. [`source`] provides the bytes and [`header`] parses their declaration.
//! [`plan`] selects the properties, and [`layout`] (for text [`lines`]) locates the rows.
//! [`vertex`] and [`face`] fill the arrays, and [`check`] validates triangles. No count in the
//! header is trusted before the rows have been found in the file. A file without faces is read only
//! if its points are requested. Placement and shading are done elsewhere. Format: Turk, "The PLY
//! Polygon File Format" (1994), and common usage.

mod attributes;
mod block;
mod check;
mod choice;
mod context;
mod duplicates;
mod face;
mod faces;
mod header;
mod layout;
mod lines;
mod number;
mod plan;
mod points;
mod polygon;
mod records;
mod request;
mod row;
mod scalar;
mod source;
mod stream;
mod summary;
mod table;
mod unpack;
mod vertex;

use std::path::Path;

use self::context::ReadContext;
use self::faces::Faces;
use self::header::{Element, Format, Header};
use self::plan::MeshPlan;
use self::row::{Row, RowResult};
use self::source::{Bytes, Source, Stream};
use self::table::{RowConsumer, Table};
use self::unpack::Packing;
use self::vertex::Vertices;
use super::{FaceTextures, Mesh, MeshElement, Notes, Positions, Property, Uvs};
use crate::error::{Error, Result};
use crate::monitor::Monitor;
use crate::reserve::MemoryLimit;

pub use request::{ColorRequest, ColorSource};
pub use scalar::Scalar;
pub use summary::{
    ElementSummary, PlySummary, PropertySummary, TriangleCount, inspect, inspect_with,
};

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

/// Reads the PLY file at `path`, plain or compressed with gzip or zstd, in the caller's rayon pool.
pub fn read(path: &Path, options: ReadOptions) -> Result<Mesh> {
    let name = path.display().to_string();
    let job = ReadContext { name: &name, monitor: options.monitor, room: options.room };
    let Source { bytes, stamp } = Source::open(path, options.mmap, options.room)?;
    let mut mesh = match bytes {
        Bytes::Mapped(map) => {
            let mesh = whole(map.bytes(), &job, options);
            map.intact(path)?;
            mesh
        }
        Bytes::Stream(Stream { bytes, length, packing }) => {
            let failed = |error: &std::io::Error| source::failed(path, packing, error);
            stream::read(bytes, length, &failed, &job, options)
        }
    }?;
    mesh.notes.stamp = stamp;
    Ok(mesh)
}

/// Reads a PLY file from memory, plain or compressed. Messages call it `name`.
pub fn read_bytes(bytes: &[u8], name: &str, options: ReadOptions) -> Result<Mesh> {
    let job = ReadContext { name, monitor: options.monitor, room: options.room };
    match Packing::detect(bytes) {
        None => whole(bytes, &job, options),
        Some(packing) => {
            let failed = |e: &std::io::Error| source::failed(name.as_ref(), Some(packing), e);
            let length = Some(bytes.len() as u64);
            let bytes = packing.open(bytes, length, options.room).map_err(|e| failed(&e))?;
            stream::read_here(bytes, &failed, &job, options)
        }
    }
}

/// Reads a mesh from the complete bytes of a file.
fn whole(bytes: &[u8], job: &ReadContext, options: ReadOptions) -> Result<Mesh> {
    let header = header::parse(bytes, job.name)?;
    let plan = plan::plan(&header, job.name, &options)?;
    let data = &bytes[header.data_start..];
    let (spans, trailing_bytes) = layout::locate(data, &header, job)?;
    let table = |at: usize| Table {
        data,
        big: header.format.is_big(),
        span: &spans[at],
        element: &header.elements[at],
        job: *job,
    };
    // Locating rows of text does not check their contents. So the elements that are not used are
    // checked here: their rows may be incomplete.
    let read = |at| at == plan.vertex.element || plan.faces.iter().any(|face| face.element == at);
    let text = header.format == Format::Ascii;
    for table in (0..spans.len()).filter(|at| text && !read(*at)).map(table) {
        table.blocks(|reader| reader.feed(&mut UnusedElement(table.element)), Ok)?;
    }
    let vertices = vertex::read(&table(plan.vertex.element), &plan.vertex)?;
    let rows = |at: usize| spans[at].rows;
    let total: u64 = plan.faces.iter().filter(|f| !f.strips).map(|f| rows(f.element)).sum();
    job.fits(vertices.bytes().saturating_add(total.saturating_mul(size_of::<[u32; 3]>() as u64)))?;
    let mut faces = Faces::default();
    for part in &plan.faces {
        let next = match &vertices.positions {
            Positions::F32(positions) => face::read(&table(part.element), part, positions)?,
            Positions::F64(positions) => face::read(&table(part.element), part, positions)?,
        };
        faces.append(next, job)?;
        job.fits(vertices.bytes().saturating_add(faces.bytes()))?;
    }
    finish(ParsedFile { header, plan, vertices, faces, trailing_bytes }, job, options)
}

/// Everything that was read from a file.
struct ParsedFile {
    header: Header,
    plan: MeshPlan,
    vertices: Vertices,
    faces: Faces,
    trailing_bytes: u64,
}

/// Makes the mesh: drops duplicates, reports bad vertices and fills in the notes.
fn finish(found: ParsedFile, job: &ReadContext, options: ReadOptions) -> Result<Mesh> {
    let ParsedFile { header, plan, mut vertices, mut faces, trailing_bytes } = found;
    let vertex_count = vertices.positions.len();
    let duplicates = duplicates::drop(&mut faces, vertex_count, job)?;
    let Faces { triangles, uvs, mut attributes, mut tally } = faces;
    if !options.repair {
        match &vertices.positions {
            Positions::F32(positions) => tally.verdict(positions, job.name)?,
            Positions::F64(positions) => tally.verdict(positions, job.name)?,
        }
        tally.texture_verdict(header.texture_files.len(), job.name)?;
    }
    if options.points {
        points::check(&mut vertices, &mut tally, job, options.repair)?;
    } else if triangles.is_empty() {
        return Err(Error::invalid(
            job.name,
            format!(
                "no triangle is left of {} faces: {} have fewer than 3 corners, {} triangles have no \
                 area or repeat a vertex, {} use missing or non-finite vertices",
                tally.faces, tally.too_small, tally.degenerate, tally.unusable
            ),
        ));
    }
    let mut notes = Notes {
        format: header.format.name(),
        trailing_bytes,
        used: plan.used,
        ignored: plan.ignored,
        texture_files: header.texture_files.len(),
        ..Notes::default()
    };
    tally.write(&mut notes);
    let mut stitches = Faces { triangles: tally.stitches.split_off(0), ..Faces::default() };
    duplicates::drop(&mut stitches, vertex_count, job)?;
    notes.duplicates_dropped = duplicates;
    // One texture on all faces needs no numbers.
    let several = tally.textures.len() > 1;
    let main = tally.main_texture();
    let named =
        main.and_then(|n| usize::try_from(n).ok()).and_then(|n| header.texture_files.get(n));
    let all_choose_one = main.is_some() && !several;
    let texture_file = if all_choose_one { named } else { named.or(header.texture_files.first()) };
    let texture_file = texture_file.cloned();
    if all_choose_one {
        notes.texture_files = 1;
    }
    let numbers = attributes.textures.take().filter(|_| several);
    let textures = numbers.map(|numbers| FaceTextures { files: header.texture_files, numbers });
    notes.alpha_ignored = vertices.attributes.drop_plain_alpha() | attributes.drop_plain_alpha();
    let of_vertices = vertices.attributes;
    let property = plan.property.and_then(|(name, element)| {
        let values = match element {
            MeshElement::Vertex => of_vertices.scalars,
            MeshElement::Face => attributes.scalars,
        };
        Some(Property { name, element, values: values? })
    });
    Ok(Mesh {
        positions: vertices.positions,
        triangles,
        stitches: stitches.triangles,
        normals: vertices.normals,
        uvs: uvs.map(Uvs::PerCorner).or(vertices.uvs.map(Uvs::PerVertex)),
        colors: of_vertices.colors,
        face_colors: attributes.colors,
        alpha: of_vertices.alpha.or(attributes.alpha),
        property,
        texture_file,
        textures,
        notes,
    })
}

/// Checks the rows of an element that is not used, without storing them.
struct UnusedElement<'a>(&'a Element);

impl RowConsumer for UnusedElement<'_> {
    fn take<R: Row>(&mut self, values: &mut R, _: u64) -> RowResult<()> {
        self.0.properties.iter().try_for_each(|property| values.skip_property(property.shape))
    }
}
