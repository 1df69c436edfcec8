//! Reads a mesh from bytes that are all in memory.

use super::context::ReadContext;
use super::faces::PlyFaces;
use super::finish::{ParsedFile, finish};
use super::header::{self, Format};
use super::options::ReadOptions;
use super::table::Table;
use super::unused::UnusedElement;
use super::{face, layout, plan, vertex};
use crate::error::Result;
use crate::mesh::arrays::{Mesh, Positions};

/// Reads a mesh from the complete bytes of a file.
pub fn whole(bytes: &[u8], context: &ReadContext, options: ReadOptions) -> Result<Mesh> {
    let header = header::parse(bytes, context.name)?;
    let plan = plan::plan(&header, context.name, &options)?;
    let data = &bytes[header.data_start..];
    let (spans, trailing_bytes) = layout::locate(data, &header, context)?;
    let table = |at: usize| Table {
        data,
        big: header.format.is_big(),
        span: &spans[at],
        element: &header.elements[at],
        context: *context,
    };
    // Locating rows of text does not check their contents. So the rows of unused elements are
    // checked here: they may be incomplete.
    let read = |at| at == plan.vertex.element || plan.faces.iter().any(|face| face.element == at);
    let text = header.format == Format::Ascii;
    for table in (0..spans.len()).filter(|at| text && !read(*at)).map(table) {
        table.blocks(|reader| reader.feed(&mut UnusedElement(table.element)), Ok)?;
    }
    let vertices = vertex::read(&table(plan.vertex.element), &plan.vertex)?;
    let rows = |at: usize| spans[at].rows;
    let total: u64 = plan.faces.iter().filter(|f| !f.strips).map(|f| rows(f.element)).sum();
    context.fits(
        vertices.bytes().saturating_add(total.saturating_mul(size_of::<[u32; 3]>() as u64)),
    )?;
    let mut faces = PlyFaces::default();
    for part in &plan.faces {
        let next = match &vertices.positions {
            Positions::F32(positions) => face::read(&table(part.element), part, positions)?,
            Positions::F64(positions) => face::read(&table(part.element), part, positions)?,
        };
        faces.append(next, context)?;
        context.fits(vertices.bytes().saturating_add(faces.bytes()))?;
    }
    finish(ParsedFile { header, plan, vertices, faces, trailing_bytes }, context, options)
}
