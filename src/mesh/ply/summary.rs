//! What a PLY file holds, from its header alone: for `info`, and for planning memory.

use std::path::Path;

use serde::Serialize;

use super::header::{self, Format, Header, MAX_HEADER, Shape};
use super::plan::{self, ColorType, Plan, VertexPlan};
use super::scalar::Scalar;
use super::source::Head;
use super::unpack::Packing;
use crate::error::Result;

/// How sure a number of triangles is.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum TriangleCount {
    /// Computed from the sizes; dropped triangles not subtracted.
    Exact,
    /// At most so many.
    AtMost,
    /// Taking every face for a triangle.
    Estimate,
}

/// A property as the header declares it.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct PropertySummary {
    /// Its name.
    pub name: String,
    /// Its type, of a list the type of the items.
    pub kind: Scalar,
    /// Of a list the type of the count.
    pub list_count: Option<Scalar>,
}

/// An element as the header declares it.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct ElementSummary {
    /// Its name.
    pub name: String,
    /// Declared rows.
    pub count: u64,
    /// Its properties, in the order of the file.
    pub properties: Vec<PropertySummary>,
}

/// What the header says and what reading the file would give.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct PlySummary {
    /// `ascii`, `binary_little_endian`, `binary_big_endian`.
    pub format: &'static str,
    /// Size of the file.
    pub file_bytes: u64,
    /// `gzip` or `zstd`, if it is packed.
    pub packed: Option<&'static str>,
    /// All elements, in the order of the file.
    pub elements: Vec<ElementSummary>,
    /// `element.property` names that would be used.
    pub used: Vec<String>,
    /// `element.property` names that would be read over.
    pub ignored: Vec<String>,
    /// Vertices.
    pub vertices: u64,
    /// Triangles after splitting, as sure as `triangles_are` says.
    pub triangles: u64,
    /// How sure `triangles` is.
    pub triangles_are: TriangleCount,
    /// `float` or `double`.
    pub positions: &'static str,
    /// Whether there are vertex normals.
    pub normals: bool,
    /// `vertex` or `corner`, if there are texture coordinates.
    pub uvs: Option<&'static str>,
    /// `uchar`, `ushort` or `float`, if there are vertex colours.
    pub colors: Option<&'static str>,
    /// What a mesh could have and this one has not: `normals`, `texture coordinates`, `colours`.
    pub missing: Vec<&'static str>,
    /// `comment TextureFile NAME`, all of them.
    pub texture_files: Vec<String>,
    /// Bytes of the arrays of the mesh, by the numbers above.
    pub array_bytes: u64,
}

/// Reads the header of the file at `path`; errors where [`super::read`] could not read a mesh
/// for reasons that the header shows.
pub fn inspect(path: &Path) -> Result<PlySummary> {
    let name = path.display().to_string();
    let Head { bytes, file_bytes, packing } = Head::read(path, MAX_HEADER as u64)?;
    let header = header::parse(&bytes, &name)?;
    let plan = plan::plan(&header, &name)?;
    let data_bytes = file_bytes.saturating_sub(header.data_start as u64);
    let vertices = header.elements[plan.vertex.element].count;
    let (triangles, triangles_are) = match packing {
        None => triangles(&header, &plan, data_bytes),
        Some(_) => (faces(&header, &plan), TriangleCount::Estimate),
    };
    let corner_uvs = plan.faces.iter().any(|face| face.texcoords);
    let array_bytes = vertices
        .saturating_mul(vertex_bytes(&plan, corner_uvs))
        .saturating_add(triangles.saturating_mul(if corner_uvs { 36 } else { 12 }));
    let elements = header.elements.iter().map(|element| ElementSummary {
        name: element.name.clone(),
        count: element.count,
        properties: element.properties.iter().map(property).collect(),
    });
    Ok(PlySummary {
        format: header.format.name(),
        file_bytes,
        packed: packing.map(Packing::name),
        elements: elements.collect(),
        vertices,
        triangles,
        triangles_are,
        positions: if plan.vertex.double { "double" } else { "float" },
        normals: plan.vertex.normals,
        uvs: if corner_uvs { Some("corner") } else { plan.vertex.uvs.then_some("vertex") },
        colors: plan.vertex.colors.map(|colors| match colors {
            ColorType::U8 => "uchar",
            ColorType::U16 => "ushort",
            ColorType::F32 => "float",
        }),
        missing: missing(&plan.vertex, corner_uvs),
        texture_files: header.texture_files,
        used: plan.used,
        ignored: plan.ignored,
        array_bytes,
    })
}

fn missing(vertex: &VertexPlan, corner_uvs: bool) -> Vec<&'static str> {
    let parts = [
        ("normals", vertex.normals),
        ("texture coordinates", vertex.uvs || corner_uvs),
        ("colours", vertex.colors.is_some()),
    ];
    parts.into_iter().filter(|(_, there)| !there).map(|(name, _)| name).collect()
}

fn property(property: &header::Property) -> PropertySummary {
    let (kind, list_count) = match property.shape {
        Shape::Single(kind) => (kind, None),
        Shape::List { count, item } => (item, Some(count)),
    };
    PropertySummary { name: property.name.clone(), kind, list_count }
}

/// Bytes per vertex in the arrays.
fn vertex_bytes(plan: &Plan, corner_uvs: bool) -> u64 {
    let vertex = &plan.vertex;
    let position = if vertex.double { 24 } else { 12 };
    let normal = if vertex.normals { 12 } else { 0 };
    let uv = if vertex.uvs && !corner_uvs { 8 } else { 0 };
    let color = vertex.colors.map_or(0, |colors| match colors {
        ColorType::U8 => 3,
        ColorType::U16 => 6,
        ColorType::F32 => 12,
    });
    position + normal + uv + color
}

/// Declared faces and strips.
fn faces(header: &Header, plan: &Plan) -> u64 {
    let counts = plan.faces.iter().map(|f| header.elements[f.element].count);
    counts.fold(0, u64::saturating_add)
}

/// The number of triangles: where one element has the only list of a binary file, the bytes
/// that are not of fixed size are its corners.
fn triangles(header: &Header, plan: &Plan, data_bytes: u64) -> (u64, TriangleCount) {
    let faces = faces(header, plan);
    let rows = || header.elements.iter().flat_map(|e| e.properties.iter().map(|p| (e.count, p)));
    let lists: Vec<_> = rows()
        .filter_map(|(count, property)| match property.shape {
            Shape::List { item, .. } if count > 0 => Some(item),
            _ => None,
        })
        .collect();
    let ([item], [face], false) = (&lists[..], &plan.faces[..], header.format == Format::Ascii)
    else {
        return (faces, TriangleCount::Estimate);
    };
    let fixed = rows().fold(0u64, |sum, (count, property)| {
        sum.saturating_add(count.saturating_mul(property.shape.least_bytes()))
    });
    let corners = data_bytes.saturating_sub(fixed) / item.size() as u64;
    let triangles = corners.saturating_sub(faces.saturating_mul(2));
    // Restarts of strips, and faces of fewer than three corners, are not seen here.
    let exact = !face.strips && triangles >= faces;
    (triangles, if exact { TriangleCount::Exact } else { TriangleCount::AtMost })
}
