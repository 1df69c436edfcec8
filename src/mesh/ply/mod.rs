//! The PLY reader: any PLY file that holds a mesh, at the speed of memory for the common ones.
//!
//! The steps, each a module: [`source`] the bytes, [`header`] what they should be, [`plan`] which
//! properties are wanted, [`layout`] (and [`lines`] for text) where the rows are, [`vertex`] and
//! [`face`] the arrays, [`check`] what is wrong with them. No count of the header is believed
//! before the rows have been found in the file. It refuses point clouds, and leaves placing and
//! shading to others. Format: Turk, "The PLY Polygon File Format" (1994), and common usage.

mod block;
mod check;
mod face;
mod header;
mod layout;
mod lines;
mod number;
mod plan;
mod polygon;
mod row;
mod scalar;
mod source;
mod summary;
mod table;
mod vertex;

use std::path::Path;

use self::block::Span;
use self::check::Tally;
use self::face::Faces;
use self::header::{Element, Format, Header, Shape};
use self::plan::Plan;
use self::row::{Row, Values};
use self::source::Source;
use self::table::{Sink, Table};
use super::normals::Point;
use super::{Mesh, Notes, Positions, Uvs};
use crate::error::{Error, Result};

pub use scalar::Scalar;
pub use summary::{ElementSummary, PlySummary, PropertySummary, TriangleCount, inspect};

/// How to read a mesh file.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[non_exhaustive]
pub struct ReadOptions {
    /// Drop triangles that use a missing or non-finite vertex instead of failing.
    pub repair: bool,
    /// Map the file into memory; off, it is read (safe where another program may cut the file
    /// short meanwhile, at the cost of its size in memory).
    pub mmap: bool,
}

impl Default for ReadOptions {
    fn default() -> Self {
        Self { repair: false, mmap: true }
    }
}

impl ReadOptions {
    /// Options with `repair` as given.
    pub fn repair(mut self, repair: bool) -> Self {
        self.repair = repair;
        self
    }

    /// Options with `mmap` as given.
    pub fn mmap(mut self, mmap: bool) -> Self {
        self.mmap = mmap;
        self
    }
}

/// Reads the PLY file at `path`, in the caller's rayon pool.
pub fn read(path: &Path, options: ReadOptions) -> Result<Mesh> {
    let source = Source::open(path, options.mmap)?;
    read_bytes(source.bytes(), &path.display().to_string(), options)
}

/// Reads a PLY file that is in memory; messages call it `name`.
pub fn read_bytes(bytes: &[u8], name: &str, options: ReadOptions) -> Result<Mesh> {
    let header = header::parse(bytes, name)?;
    let plan = plan::plan(&header, name)?;
    let data = &bytes[header.data_start..];
    let (spans, trailing_bytes) = layout::locate(data, &header, name)?;
    let file = Body { header: &header, data, spans: &spans, name };
    file.check_unread(&plan)?;
    let vertices = vertex::read(&file.table(plan.vertex.element), &plan.vertex)?;
    let (faces, tally) = match &vertices.positions {
        Positions::F32(positions) => faces(&file, &plan, positions, options)?,
        Positions::F64(positions) => faces(&file, &plan, positions, options)?,
    };
    let uvs = faces.uvs.map(Uvs::PerCorner).or(vertices.uvs.map(Uvs::PerVertex));
    let mut notes = Notes {
        format: header.format.name(),
        trailing_bytes,
        used: plan.used,
        ignored: plan.ignored,
        ..Notes::default()
    };
    tally.write(&mut notes);
    Ok(Mesh {
        positions: vertices.positions,
        triangles: faces.triangles,
        normals: vertices.normals,
        uvs,
        colors: vertices.colors,
        texture_file: header.texture_file,
        notes,
    })
}

/// A file whose rows have been found.
struct Body<'a> {
    header: &'a Header,
    data: &'a [u8],
    spans: &'a [Span],
    name: &'a str,
}

impl Body<'_> {
    fn table(&self, element: usize) -> Table<'_> {
        Table {
            data: self.data,
            big: match self.header.format {
                Format::Ascii => None,
                format => Some(format == Format::Big),
            },
            span: &self.spans[element],
            element: &self.header.elements[element],
            name: self.name,
        }
    }

    /// Checks the lines of elements that nobody reads: finding rows of text did not look inside
    /// them, and the last one may be cut short.
    fn check_unread(&self, plan: &Plan) -> Result<()> {
        let read = |at: usize| {
            at == plan.vertex.element || plan.faces.iter().any(|face| face.element == at)
        };
        let text = self.header.format == Format::Ascii;
        for at in (0..self.header.elements.len()).filter(|at| text && !read(*at)) {
            let table = self.table(at);
            table.blocks(|reader| reader.feed(&mut Unread(table.element)))?;
        }
        Ok(())
    }
}

/// Reads over the rows of an element.
struct Unread<'a>(&'a Element);

impl Sink for Unread<'_> {
    fn take<R: Row>(&mut self, values: &mut R, _: u64) -> Values<()> {
        for property in &self.0.properties {
            match property.shape {
                Shape::Single(kind) => values.skip(kind, 1)?,
                Shape::List { count, item } => {
                    let count = values.count(count)?;
                    values.skip(item, count)?;
                }
            }
        }
        Ok(())
    }
}

/// The triangles of all elements that have any.
fn faces<P: Point>(
    file: &Body,
    plan: &Plan,
    positions: &[P],
    options: ReadOptions,
) -> Result<(Faces, Tally)> {
    let mut all = Faces::default();
    for part in &plan.faces {
        let next = face::read(&file.table(part.element), part, positions)?;
        let with_uvs = all.uvs.is_some() || next.uvs.is_some();
        all.append(next, with_uvs);
    }
    let mut tally = std::mem::take(&mut all.tally);
    if !options.repair {
        tally.verdict(positions, file.name)?;
    }
    if all.triangles.is_empty() {
        return Err(Error::invalid(
            file.name,
            format!(
                "no triangle is left of {} faces: {} have fewer than 3 corners, {} triangles have no \
                 area or repeat a vertex, {} use missing or non-finite vertices",
                tally.faces, tally.too_small, tally.degenerate, tally.unusable
            ),
        ));
    }
    Ok((all, tally))
}
