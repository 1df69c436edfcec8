//! Decides which properties of a header become which array, and which are skipped.
//!
//! A role is the meaning of one number of a vertex row, as an index below [`ROLES`].

use super::header::{Element, Header, Property, PropertyType};
use super::scalar::Scalar;
use crate::error::{Error, Result};

/// Number of roles: 0-2 position, 3-5 normal, 6-7 texture coordinate, 8-10 colour.
pub(super) const ROLES: usize = 11;

const NORMAL: usize = 3;
const UV: usize = 6;
const COLOR: usize = 8;

const UV_NAMES: [[&str; 2]; 4] =
    [["s", "t"], ["u", "v"], ["texture_u", "texture_v"], ["texture_s", "texture_t"]];
const COLOR_NAMES: [[&str; 3]; 3] =
    [["red", "green", "blue"], ["r", "g", "b"], ["diffuse_red", "diffuse_green", "diffuse_blue"]];

/// The type of vertex colours.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum ColorType {
    U8,
    U16,
    F32,
}

/// How one property of a row is read.
#[derive(Debug, Clone, Copy)]
pub(super) enum Step {
    /// A number of a vertex: its type and its role.
    Value(Scalar, usize),
    /// The corners of a face or strip.
    Corners {
        count: Scalar,
        item: Scalar,
    },
    /// The texture coordinates of a face's corners.
    Texcoords {
        count: Scalar,
        item: Scalar,
    },
    /// The index of the face's texture among the textures of the file.
    Texnumber(Scalar),
    Skip(PropertyType),
}

/// How the rows of `vertex` are converted to arrays.
#[derive(Debug)]
pub(super) struct VertexPlan {
    /// Index of the element in the header.
    pub(super) element: usize,
    pub(super) steps: Vec<Step>,
    /// For each role, the index of its property within the element.
    pub(super) columns: [Option<usize>; ROLES],
    /// True if a coordinate has a declared type that `f32` cannot hold exactly: `double`, `int` or
    /// `uint`.
    pub(super) double: bool,
    pub(super) normals: bool,
    pub(super) uvs: bool,
    pub(super) colors: Option<ColorType>,
}

/// How the rows of `face` or `tristrips` are converted to triangles.
#[derive(Debug)]
pub(super) struct FacePlan {
    pub(super) element: usize,
    pub(super) steps: Vec<Step>,
    /// Index within the element of the property that holds the corners.
    pub(super) corners: usize,
    pub(super) texcoords: bool,
    pub(super) strips: bool,
}

#[derive(Debug)]
pub(super) struct MeshPlan {
    pub(super) vertex: VertexPlan,
    pub(super) faces: Vec<FacePlan>,
    /// Names `element.property` of the properties that are read.
    pub(super) used: Vec<String>,
    /// Names `element.property` of the properties that are skipped.
    pub(super) ignored: Vec<String>,
}

/// Decides which properties are read. Returns an error if the file cannot be a mesh. Messages name
/// the file as `file`.
pub(super) fn plan(header: &Header, file: &str) -> Result<MeshPlan> {
    let vertex = vertex_plan(header, file)?;
    let mut faces = Vec::new();
    for (element, strips) in [("face", false), ("tristrips", true)] {
        faces.extend(face_plan(header, element, strips, file)?);
    }
    // In file order: rows are read in this order.
    faces.sort_by_key(|face| face.element);
    if faces.iter().all(|face| header.elements[face.element].count == 0) {
        return Err(no_faces(header, &vertex, file));
    }
    let mut used = Vec::new();
    let mut ignored = Vec::new();
    for (element_index, element) in header.elements.iter().enumerate() {
        let steps = std::iter::once((vertex.element, &vertex.steps))
            .chain(faces.iter().map(|f| (f.element, &f.steps)))
            .find(|(index, _)| *index == element_index);
        for (property_index, property) in element.properties.iter().enumerate() {
            let skipped =
                steps.is_none_or(|(_, steps)| matches!(steps[property_index], Step::Skip(_)));
            let list = if skipped { &mut ignored } else { &mut used };
            list.push(format!("{}.{}", element.name, property.name));
        }
    }
    Ok(MeshPlan { vertex, faces, used, ignored })
}

fn no_faces(header: &Header, vertex: &VertexPlan, file: &str) -> Error {
    let points = header.elements[vertex.element].count;
    Error::invalid(file, format!("has no faces: it is a point cloud of {points} points"))
        .help("make a mesh of it first, for example with Poisson reconstruction in MeshLab or CloudCompare")
}

fn vertex_plan(header: &Header, file: &str) -> Result<VertexPlan> {
    let element_index =
        header.elements.iter().position(|e| e.name == "vertex").ok_or_else(|| {
            let names: Vec<_> = header.elements.iter().map(|e| e.name.as_str()).collect();
            Error::invalid(file, format!("has no element 'vertex', only: [{}]", names.join(", ")))
        })?;
    let element = &header.elements[element_index];
    if element.count > u32::MAX as u64 {
        let message = format!("has {} vertices; the most is {}", element.count, u32::MAX);
        return Err(Error::invalid(file, message).help("split the mesh into several files"));
    }
    let mut columns = [None; ROLES];
    for (role, axis) in ["x", "y", "z"].into_iter().enumerate() {
        columns[role] = Some(single(element, axis).ok_or_else(|| {
            Error::invalid(file, format!("element vertex has no scalar property '{axis}'"))
                .help("positions are the properties x y z")
        })?);
    }
    assign(element, &["nx", "ny", "nz"], &mut columns[NORMAL..UV]);
    // Takes the first complete pair: `any` stops at the first `true`.
    UV_NAMES.iter().any(|names| assign(element, names, &mut columns[UV..COLOR]));
    let colors = COLOR_NAMES.iter().find_map(|names| {
        let kind = color_type(element, names)?;
        assign(element, names, &mut columns[COLOR..]).then_some(kind)
    });
    let double = columns[..NORMAL].iter().flatten().any(|&at| {
        use Scalar as S;
        matches!(element.properties[at].shape, PropertyType::Single(S::F64 | S::I32 | S::U32))
    });
    let steps = (0..element.properties.len()).map(|at| {
        let shape = element.properties[at].shape;
        match (shape, columns.iter().position(|c| *c == Some(at))) {
            (PropertyType::Single(kind), Some(role)) => Step::Value(kind, role),
            (shape, _) => Step::Skip(shape),
        }
    });
    Ok(VertexPlan {
        element: element_index,
        steps: steps.collect(),
        columns,
        double,
        normals: columns[NORMAL].is_some(),
        uvs: columns[UV].is_some(),
        colors,
    })
}

/// Returns the index of the property called `name` if it is a scalar and not a list.
fn single(element: &Element, name: &str) -> Option<usize> {
    let at = element.find(name)?;
    matches!(element.properties[at].shape, PropertyType::Single(_)).then_some(at)
}

/// Fills `columns` with the properties called `names`. Returns false, and changes nothing, if the
/// element lacks one.
fn assign(element: &Element, names: &[&str], columns: &mut [Option<usize>]) -> bool {
    let found: Option<Vec<usize>> = names.iter().map(|name| single(element, name)).collect();
    let Some(found) = found else { return false };
    for (column, at) in columns.iter_mut().zip(found) {
        *column = Some(at);
    }
    true
}

/// Returns the common type of three colour channels. `None` if a channel is missing, if the types
/// differ, or if colours cannot have this type.
fn color_type(element: &Element, names: &[&str; 3]) -> Option<ColorType> {
    let shapes = names.map(|name| element.find(name).map(|at| element.properties[at].shape));
    if shapes.iter().any(|shape| *shape != shapes[0]) {
        return None;
    }
    match shapes[0]? {
        PropertyType::Single(Scalar::U8) => Some(ColorType::U8),
        PropertyType::Single(Scalar::U16) => Some(ColorType::U16),
        PropertyType::Single(Scalar::F32 | Scalar::F64) => Some(ColorType::F32),
        _ => None,
    }
}

fn face_plan(header: &Header, which: &str, strips: bool, file: &str) -> Result<Option<FacePlan>> {
    let Some(element_index) = header.elements.iter().position(|e| e.name == which) else {
        return Ok(None);
    };
    let element = &header.elements[element_index];
    let corners = element.find("vertex_indices").or_else(|| element.find("vertex_index"));
    let integers = |at: usize| match element.properties[at].shape {
        PropertyType::List { item, .. } => item.is_integer(),
        PropertyType::Single(_) => false,
    };
    let Some(corners) = corners.filter(|&at| integers(at)) else {
        if element.count == 0 {
            return Ok(None);
        }
        return Err(Error::invalid(
            file,
            format!("element {which} has no list of integers 'vertex_indices' or 'vertex_index'"),
        ));
    };
    let is_texcoord_list = |p: &Property| matches!(p.shape, PropertyType::List { item, .. } if p.name == "texcoord" && !item.is_integer());
    let texcoords = !strips && element.properties.iter().any(is_texcoord_list);
    let steps = element.properties.iter().enumerate().map(|(at, property)| match property.shape {
        PropertyType::List { count, item } if at == corners => Step::Corners { count, item },
        PropertyType::List { count, item } if texcoords && is_texcoord_list(property) => {
            Step::Texcoords { count, item }
        }
        PropertyType::Single(kind)
            if texcoords && property.name == "texnumber" && kind.is_integer() =>
        {
            Step::Texnumber(kind)
        }
        shape => Step::Skip(shape),
    });
    let steps = steps.collect();
    Ok(Some(FacePlan { element: element_index, steps, corners, texcoords, strips }))
}
