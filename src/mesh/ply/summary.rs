//! Summarises a PLY file from its header alone, for `info` and for memory predictions.

use std::path::Path;

use serde::Serialize;

use super::choice::scalar_names;
use super::header::{self, Format, Header, MAX_HEADER, PropertyType};
use super::options::ReadOptions;
use super::plan::{self, MeshPlan};
use super::scalar::Scalar;
use super::source::Head;
use super::unpack::Packing;
use crate::error::Result;
use crate::mesh::arrays::MeshElement;

/// How reliable a number of triangles is.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum TriangleCount {
    /// Exact if every face has three corners or more and the file ends with its last row. Computed
    /// from the sizes of the file and its rows. Includes the triangles that the reader will drop.
    /// If some faces have fewer corners, the mesh has more triangles, but fewer than three times as
    /// many.
    Exact,
    /// An upper bound: for triangle strips, which may have restarts, and for files in which some
    /// faces must have fewer than three corners.
    AtMost,
    /// An estimate that counts every face or strip as one triangle.
    Estimate,
}

/// A property as the header declares it.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct PropertySummary {
    /// Name of the property, such as `vertex_indices`.
    pub name: String,
    /// Type of the value; for a list, the type of its items.
    pub kind: Scalar,
    /// Type of the count of a list; `None` for a single number.
    pub list_count: Option<Scalar>,
}

/// An element as the header declares it.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct ElementSummary {
    /// Name of the element, such as `vertex`.
    pub name: String,
    /// Number of declared rows.
    pub count: u64,
    /// Properties of a row, in file order.
    pub properties: Vec<PropertySummary>,
}

/// The contents of a header, and a description of the mesh that reading the file would give.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct PlySummary {
    /// The encoding: `ascii`, `binary_little_endian` or `binary_big_endian`.
    pub format: &'static str,
    /// Size of the file as stored, in bytes; for a pipe, the number of bytes read.
    pub file_bytes: u64,
    /// The compression, `gzip` or `zstd`, if the file is compressed.
    pub packed: Option<&'static str>,
    /// All elements, in file order.
    pub elements: Vec<ElementSummary>,
    /// Names `element.property` of the properties that would be used.
    pub used: Vec<String>,
    /// Names `element.property` of the properties that would be skipped.
    pub ignored: Vec<String>,
    /// Number of declared vertices.
    pub vertices: u64,
    /// Number of triangles after polygons are split. `triangles_are` states how reliable it is.
    pub triangles: u64,
    /// How reliable `triangles` is.
    pub triangles_are: TriangleCount,
    /// Type of the position arrays: `float` or `double`.
    pub positions: &'static str,
    /// True if there are vertex normals.
    pub normals: bool,
    /// Where texture coordinates are stored, `vertex` or `corner`, if there are any.
    pub uvs: Option<&'static str>,
    /// Type of the colours, `uchar`, `ushort` or `float`, if there are any.
    pub colors: Option<&'static str>,
    /// Element that has the colours: `vertex` or `face`.
    pub colors_of: Option<&'static str>,
    /// Names `element.property` of the numbers that a colour map can show.
    pub scalars: Vec<String>,
    /// Optional data that the file lacks: `normals`, `texture coordinates`, `colours`.
    pub missing: Vec<&'static str>,
    /// The names in the lines `comment TextureFile NAME`, in file order.
    pub texture_files: Vec<String>,
    /// Size in bytes of the arrays of the mesh. Computed from `vertices` and `triangles`, and as
    /// reliable as `triangles`.
    pub array_bytes: u64,
}

/// Summarises the file at `path` from its header.
///
/// # Errors
/// If the file cannot be read, or its header alone shows that [`read`](super::read()) would reject
/// it.
pub fn inspect(path: &Path) -> Result<PlySummary> {
    inspect_with(path, &ReadOptions::default())
}

/// Summarises the file at `path` as [`inspect`] does, for a reader with these options.
///
/// # Errors
/// If the file cannot be read, or its header alone shows that [`read`](super::read()) would reject
/// it.
pub fn inspect_with(path: &Path, options: &ReadOptions) -> Result<PlySummary> {
    let name = path.display().to_string();
    let Head { bytes, file_bytes, packing } = Head::read(path, MAX_HEADER as u64)?;
    let header = header::parse(&bytes, &name)?;
    let plan = plan::plan(&header, &name, options)?;
    let data_bytes = file_bytes.saturating_sub(header.data_start as u64);
    let vertices = header.elements[plan.vertex.element].count;
    let (triangles, triangles_are) = match packing {
        None => triangles(&header, &plan, data_bytes),
        Some(_) => (faces(&header, &plan), TriangleCount::Estimate),
    };
    let corner_uvs = plan.faces.iter().any(|face| face.texcoords);
    let of_faces = plan.faces.iter().map(|face| face.attributes.bytes()).max().unwrap_or(0);
    // Three indices a triangle, and three pairs of texture coordinates if corners have them.
    let of_triangle = of_faces + if corner_uvs { 36 } else { 12 };
    let array_bytes = vertices
        .saturating_mul(vertex_bytes(&plan, corner_uvs))
        .saturating_add(triangles.saturating_mul(of_triangle));
    let face_colors = plan.faces.iter().find_map(|face| face.attributes.colors);
    let colors = plan.vertex.attributes.colors.or(face_colors);
    let colors_of = if face_colors.is_some() { MeshElement::Face } else { MeshElement::Vertex };
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
        colors: colors.map(Scalar::name),
        colors_of: colors.map(|_| colors_of.name()),
        scalars: scalar_names(&header),
        missing: missing(&plan, corner_uvs, colors.is_some()),
        texture_files: header.texture_files,
        used: plan.used,
        ignored: plan.ignored,
        array_bytes,
    })
}

fn missing(plan: &MeshPlan, corner_uvs: bool, colors: bool) -> Vec<&'static str> {
    let vertex = &plan.vertex;
    let parts = [
        ("normals", vertex.normals),
        ("texture coordinates", vertex.uvs || corner_uvs),
        ("colours", colors),
    ];
    parts.into_iter().filter(|(_, there)| !there).map(|(name, _)| name).collect()
}

fn property(property: &header::ElementProperty) -> PropertySummary {
    let (kind, list_count) = match property.shape {
        PropertyType::Single(kind) => (kind, None),
        PropertyType::List { count, item } => (item, Some(count)),
    };
    PropertySummary { name: property.name.clone(), kind, list_count }
}

/// Returns the size in bytes of one vertex, summed over all arrays.
fn vertex_bytes(plan: &MeshPlan, corner_uvs: bool) -> u64 {
    let vertex = &plan.vertex;
    let position = if vertex.double { 24 } else { 12 };
    let normal = if vertex.normals { 12 } else { 0 };
    let uv = if vertex.uvs && !corner_uvs { 8 } else { 0 };
    position + normal + uv + vertex.attributes.bytes()
}

/// Returns the number of declared rows of faces and strips.
fn faces(header: &Header, plan: &MeshPlan) -> u64 {
    let counts = plan.faces.iter().map(|f| header.elements[f.element].count);
    counts.fold(0, u64::saturating_add)
}

/// Returns the number of triangles, and how reliable it is.
///
/// It can be computed if a binary file has a single list property: the corners of its faces or
/// strips. All rows without their list items take `fixed` bytes. The other bytes are corners, and a
/// face with n corners gives n - 2 triangles. Any other file is estimated.
fn triangles(header: &Header, plan: &MeshPlan, data_bytes: u64) -> (u64, TriangleCount) {
    let faces = faces(header, plan);
    let rows = || header.elements.iter().flat_map(|e| e.properties.iter().map(|p| (e.count, p)));
    let lists: Vec<_> = rows()
        .filter_map(|(count, property)| match property.shape {
            PropertyType::List { item, .. } if count > 0 => Some(item),
            _ => None,
        })
        .collect();
    let ([item], [face], false) = (&lists[..], &plan.faces[..], header.format == Format::Ascii)
    else {
        return (faces, TriangleCount::Estimate);
    };
    let fixed = rows().fold(0u64, |sum, (count, property)| {
        sum.saturating_add(count.saturating_mul(property.shape.min_bytes()))
    });
    let corners = data_bytes.saturating_sub(fixed) / item.size() as u64;
    let triangles = corners.saturating_sub(faces.saturating_mul(2));
    // Strips may have restarts, which the sizes do not show. Fewer triangles than faces prove that
    // some faces have fewer than three corners. Then one face may have nearly all corners.
    match !face.strips && triangles >= faces {
        true => (triangles, TriangleCount::Exact),
        false => (corners.saturating_sub(2), TriangleCount::AtMost),
    }
}
