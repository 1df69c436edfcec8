//! Makes the mesh from the parsed elements.

use super::context::ReadContext;
use super::faces::PlyFaces;
use super::header::Header;
use super::options::ReadOptions;
use super::plan::MeshPlan;
use super::vertex::PlyVertices;
use super::{duplicates, points};
use crate::error::{Error, Result};
use crate::mesh::arrays::{FaceTextures, Mesh, MeshElement, Notes, Positions, Property, Uvs};
use crate::mesh::closing_stitches;
use crate::units::counted;

/// Everything that was read from a file.
pub struct ParsedFile {
    pub header: Header,
    pub plan: MeshPlan,
    pub vertices: PlyVertices,
    pub faces: PlyFaces,
    /// Number of bytes after the last row.
    pub trailing_bytes: u64,
}

/// Makes the mesh: drops duplicate triangles, selects the texture and fills in the notes.
///
/// # Errors
/// If no triangle or no point is left. Without `repair`, also if a triangle uses a missing or
/// non-finite vertex, a face selects a missing texture, or a point is not finite.
pub fn finish(found: ParsedFile, context: &ReadContext, options: ReadOptions) -> Result<Mesh> {
    let ParsedFile { header, plan, mut vertices, mut faces, trailing_bytes } = found;
    let vertex_count = vertices.positions.len();
    let duplicates = duplicates::drop(&mut faces, vertex_count, context)?;
    let PlyFaces { triangles, uvs, mut attributes, mut tally } = faces;
    if !options.repair {
        match &vertices.positions {
            Positions::F32(positions) => tally.verdict(positions, context.name)?,
            Positions::F64(positions) => tally.verdict(positions, context.name)?,
        }
        tally.texture_verdict(header.texture_files.len(), context.name)?;
    }
    if options.points {
        points::check(&mut vertices, &mut tally, context, options.repair)?;
    } else if triangles.is_empty() {
        return Err(Error::invalid(
            context.name,
            format!(
                "no triangle is left of {}: {} fewer than 3 corners, {}, {} missing or non-finite \
                 vertices",
                counted(tally.faces, ["face", "faces"]),
                counted(tally.too_small, ["has", "have"]),
                counted(
                    tally.degenerate,
                    [
                        "triangle has no area or repeats a vertex",
                        "triangles have no area or repeat a vertex"
                    ]
                ),
                counted(tally.unusable, ["uses", "use"])
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
    let position = |vertex: u32| vertices.positions.get(vertex as usize);
    let stitches = closing_stitches(&tally.stitches, &triangles, vertex_count, position);
    notes.duplicates_dropped = duplicates;
    // If all triangles have the same texture, no index per triangle is needed.
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
    let indices = attributes.textures.take().filter(|_| several);
    let textures = indices.map(|indices| FaceTextures { files: header.texture_files, indices });
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
        stitches,
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
