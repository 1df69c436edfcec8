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
use crate::reserve;
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
/// If no triangle or no point is left, if there is not enough memory, or after a signal. Without
/// `repair`, also if a triangle uses a missing or non-finite vertex, a face selects a missing
/// texture, or a point is not finite.
pub fn finish(found: ParsedFile, context: &ReadContext, options: ReadOptions) -> Result<Mesh> {
    let ParsedFile { header, plan, mut vertices, mut faces, trailing_bytes } = found;
    let vertex_count = vertices.positions.len();
    let duplicates = duplicates::drop(&mut faces, vertex_count, context)?;
    let held = vertices.bytes().saturating_add(faces.bytes());
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
    let candidates = std::mem::take(&mut tally.stitches);
    let ready = |bytes: u64| {
        context.check()?;
        context.fits(held.saturating_add(bytes))?;
        reserve::probe(bytes, context.name)
    };
    let stitches = closing_stitches(&candidates, &triangles, vertex_count, position, ready)?;
    drop(candidates);
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

#[cfg(test)]
mod tests {
    use std::fmt::Write as _;

    use crate::error::ErrorKind;
    use crate::mesh::{ReadOptions, read_ply_bytes};
    use crate::reserve::MemoryLimit;

    /// A file of one face and of 4,060 between three of 30 points on a line.
    fn faces_without_area() -> String {
        let mut ply = String::from(
            "ply\nformat ascii 1.0\nelement vertex 32\nproperty float x\nproperty float y\n\
             property float z\nelement face 4061\nproperty list uchar int vertex_indices\n\
             end_header\n0 1 0\n0 0 1\n",
        );
        (0..30).for_each(|x| writeln!(ply, "{x} 0 0").expect("text"));
        ply += "3 0 1 2\n";
        for c in 2..32 {
            for b in 2..c {
                (2..b).for_each(|a| writeln!(ply, "3 {a} {b} {c}").expect("text"));
            }
        }
        ply
    }

    /// The arrays take 50 KB, the choice among the faces without area 585 KB more.
    #[test]
    fn faces_without_area_count_within_the_memory_limit() {
        let ply = faces_without_area();
        let read = |bytes| {
            let limit = MemoryLimit { bytes, set_by_user: true };
            let options = ReadOptions::default().memory_limit(Some(limit));
            read_ply_bytes(ply.as_bytes(), "x.ply", options)
        };
        for bytes in [60_000, 600_000] {
            let error = read(bytes).expect_err("too little memory");
            assert_eq!(error.kind, ErrorKind::Limit, "{error}");
        }
        let mesh = read(800_000).expect("a mesh");
        let notes = &mesh.notes;
        assert_eq!((mesh.triangles.len(), mesh.stitches.len()), (1, 0));
        assert_eq!((notes.faces, notes.degenerate_dropped), (4061, 4060));
    }
}
