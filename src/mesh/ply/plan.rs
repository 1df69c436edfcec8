//! Decides which properties of a header become which array, and which are skipped.
//!
//! A role is the meaning of one number in a row of `vertex` or `face`, such as "x" or "alpha". It
//! is an index below [`ROLE_COUNT`]. "Scalar property" has two meanings in this module. In a
//! header, it is a property that is no list. In a role or a plan, `scalar` is the one such property
//! that a colour map shows.

use super::choice::{Choice, choose, has_strips, single};
use super::header::{Element, ElementProperty, Header, PropertyType};
use super::options::ReadOptions;
use super::scalar::Scalar;
use crate::error::{Error, Result};
use crate::mesh::arrays::MeshElement;
use crate::units::counted;

/// Number of roles: 0-2 position, 3-5 normal, 6-7 texture coordinates, then the attributes. Faces
/// use the roles of attributes only.
pub(super) const ROLE_COUNT: usize = COLOR + ATTRIBUTE_ROLE_COUNT;
/// Number of roles of attributes: 3 colour, 1 alpha, 1 displayed scalar, 1 texture index. Vertices
/// and faces can have all of them but the texture index, which only faces have.
pub(super) const ATTRIBUTE_ROLE_COUNT: usize = 6;

const NORMAL: usize = 3;
const UV: usize = 6;
const COLOR: usize = 8;
const ALPHA: usize = COLOR + 3;
/// Role of the index of a face's texture among the textures of the file.
pub(super) const TEXTURE: usize = COLOR + 5;
/// Role of the scalar property that a colour map shows.
pub(super) const SCALAR: usize = COLOR + 4;

/// Names of texture coordinates. The first complete pair is read.
const UV_NAMES: [[&str; 2]; 4] =
    [["s", "t"], ["u", "v"], ["texture_u", "texture_v"], ["texture_s", "texture_t"]];

/// For each role, the index of its property within the element; `None` if the role is not read.
pub(super) type Columns = [Option<usize>; ROLE_COUNT];

/// The attributes that are read from an element, with their types in the file. `None`: not read.
#[derive(Debug, Clone, Copy)]
pub(super) struct AttributePlan {
    pub(super) colors: Option<Scalar>,
    pub(super) alpha: Option<Scalar>,
    pub(super) scalar: Option<Scalar>,
    /// Role under which rows store the displayed scalar. It is below [`SCALAR`] if the same
    /// property has another role, too: a coordinate, for example.
    pub(super) scalar_role: usize,
    /// Number of textures that a face can select; 0 if texture indices are not stored.
    pub(super) textures: usize,
}

impl AttributePlan {
    /// The plan that reads no attribute.
    const NOTHING: Self =
        Self { colors: None, alpha: None, scalar: None, scalar_role: SCALAR, textures: 0 };

    /// Returns the plan for `choice` in one element, and enters the roles of its properties into
    /// `columns`.
    fn new(choice: &Choice, element: MeshElement, columns: &mut Columns) -> Self {
        let mut plan = Self::NOTHING;
        if let Some(colors) = choice.colors.filter(|_| choice.colors_of == element) {
            for (role, at) in colors.rgb.into_iter().enumerate() {
                columns[COLOR + role] = Some(at);
            }
            columns[ALPHA] = colors.alpha;
            plan.colors = Some(colors.kind);
            plan.alpha = colors.alpha.map(|_| colors.kind);
        }
        if let Some((at, kind)) = choice.scalar.filter(|_| choice.colors_of == element) {
            columns[SCALAR] = Some(at);
            plan.scalar = Some(kind);
            plan.scalar_role = role_of(columns, at).unwrap_or(SCALAR);
        }
        plan
    }

    /// Returns true if any attribute is read.
    pub(super) fn any(&self) -> bool {
        self.colors.is_some() || self.scalar.is_some() || self.textures > 0
    }

    /// Returns the size in bytes of the stored attributes of one vertex or triangle.
    pub(super) fn bytes(&self) -> u64 {
        let each = |kind: Option<Scalar>| kind.map_or(0, |kind| kind.size() as u64);
        // `Scalars` has no signed integers: 8 and 16 bits are stored as f32, 32 bits as f64.
        let scalar = self.scalar.map_or(0, |kind| match kind {
            Scalar::I8 | Scalar::I16 => 4,
            Scalar::I32 | Scalar::U32 => 8,
            kind => kind.size() as u64,
        });
        let texture = if self.textures > 0 { 2 } else { 0 };
        3 * each(self.colors) + each(self.alpha) + scalar + texture
    }
}

/// How one property of a row is read.
#[derive(Debug, Clone, Copy)]
pub(super) enum Step {
    /// A number that is stored: its type and its role.
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
    /// The index of a face's texture: its type, and its role if a colour map shows it, too.
    Texnumber(Scalar, Option<usize>),
    Skip(PropertyType),
}

/// How the rows of `vertex` are converted to arrays. One step per property, in file order.
#[derive(Debug)]
pub(super) struct VertexPlan {
    /// Index of the element in the header.
    pub(super) element: usize,
    pub(super) steps: Vec<Step>,
    pub(super) columns: Columns,
    /// True if a coordinate has a declared type that `f32` cannot hold exactly: `double`, `int` or
    /// `uint`.
    pub(super) double: bool,
    pub(super) normals: bool,
    pub(super) uvs: bool,
    pub(super) attributes: AttributePlan,
}

/// How the rows of `face` or `tristrips` are converted to triangles. One step per property, in file
/// order.
#[derive(Debug)]
pub(super) struct FacePlan {
    pub(super) element: usize,
    pub(super) steps: Vec<Step>,
    /// Index within the element of the property that holds the corners.
    pub(super) corners: usize,
    pub(super) texcoords: bool,
    pub(super) texnumbers: bool,
    /// Number of textures that the file names.
    pub(super) texture_files: usize,
    pub(super) strips: bool,
    pub(super) columns: Columns,
    pub(super) attributes: AttributePlan,
}

#[derive(Debug)]
pub(super) struct MeshPlan {
    pub(super) vertex: VertexPlan,
    pub(super) faces: Vec<FacePlan>,
    /// Name of the scalar property that a colour map shows, and its element.
    pub(super) property: Option<(String, MeshElement)>,
    /// Names `element.property` of the properties that are read.
    pub(super) used: Vec<String>,
    /// Names `element.property` of the properties that are skipped.
    pub(super) ignored: Vec<String>,
}

/// Decides which properties are read. Messages name the file as `file`.
///
/// # Errors
/// If the file cannot be a mesh, or lacks the requested colours or property.
pub(super) fn plan(header: &Header, file: &str, options: &ReadOptions) -> Result<MeshPlan> {
    let choice = choose(header, file, options)?;
    let vertex = vertex_plan(header, file, &choice, options.points)?;
    let mut faces = Vec::new();
    let elements = [("face", false), ("tristrips", true)];
    for (element, strips) in elements.into_iter().filter(|_| !options.points) {
        faces.extend(face_plan(
            header,
            element,
            strips,
            (&choice, [options.textures, vertex.uvs]),
            file,
        )?);
    }
    // Rows are read in file order.
    faces.sort_by_key(|face| face.element);
    if !options.points && faces.iter().all(|face| header.elements[face.element].count == 0) {
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
    Ok(MeshPlan { vertex, faces, property: choice.property, used, ignored })
}

fn no_faces(header: &Header, vertex: &VertexPlan, file: &str) -> Error {
    let points = header.elements[vertex.element].count;
    if points == 0 {
        return Error::invalid(file, "has no faces and no points");
    }
    let points = counted(points, ["point", "points"]);
    Error::invalid(file, format!("has no faces: it is a point cloud of {points}"))
        .help("draw its points as spheres: --points RADIUS; or make a mesh of it first, for example with Poisson reconstruction in MeshLab or CloudCompare")
}

fn vertex_plan(header: &Header, file: &str, choice: &Choice, points: bool) -> Result<VertexPlan> {
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
    let mut columns = [None; ROLE_COUNT];
    for (role, axis) in ["x", "y", "z"].into_iter().enumerate() {
        columns[role] = Some(single(element, axis).ok_or_else(|| {
            Error::invalid(file, format!("element vertex has no scalar property '{axis}'"))
                .help("positions are the properties x y z")
        })?);
    }
    if !points {
        assign(element, &["nx", "ny", "nz"], &mut columns[NORMAL..UV]);
        // Takes the first complete pair: `any` stops at the first `true`.
        UV_NAMES.iter().any(|names| assign(element, names, &mut columns[UV..COLOR]));
    }
    let attributes = AttributePlan::new(choice, MeshElement::Vertex, &mut columns);
    let double = columns[..NORMAL].iter().flatten().any(|&at| {
        use Scalar as S;
        matches!(element.properties[at].shape, PropertyType::Single(S::F64 | S::I32 | S::U32))
    });
    let steps = element.properties.iter().enumerate().map(|(at, property)| {
        match (property.shape, role_of(&columns, at)) {
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
        attributes,
    })
}

/// Returns the lowest role of the property with index `at`.
fn role_of(columns: &Columns, at: usize) -> Option<usize> {
    columns.iter().position(|column| *column == Some(at))
}

/// Fills `columns` with the indices of the properties called `names`. Returns false, and changes
/// nothing, if any of them is missing or a list.
fn assign(element: &Element, names: &[&str], columns: &mut [Option<usize>]) -> bool {
    let found: Option<Vec<usize>> = names.iter().map(|name| single(element, name)).collect();
    let Some(found) = found else { return false };
    for (column, at) in columns.iter_mut().zip(found) {
        *column = Some(at);
    }
    true
}

fn face_plan(
    header: &Header,
    which: &str,
    strips: bool,
    (choice, [textures, vertex_uvs]): (&Choice, [bool; 2]),
    file: &str,
) -> Result<Option<FacePlan>> {
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
    let is_float_list =
        |shape| matches!(shape, PropertyType::List { item, .. } if !item.is_integer());
    let is_texcoord_list = |p: &ElementProperty| p.name == "texcoord" && is_float_list(p.shape);
    let texcoords = !strips && element.properties.iter().any(is_texcoord_list);
    let mut columns = [None; ROLE_COUNT];
    // The reader of strips stores triangles only, no attributes.
    let mut attributes = match strips {
        true => AttributePlan::NOTHING,
        false => AttributePlan::new(choice, MeshElement::Face, &mut columns),
    };
    let is_texnumber = |at: usize| {
        let ElementProperty { name, shape } = &element.properties[at];
        !strips
            && name == "texnumber"
            && matches!(shape, PropertyType::Single(kind) if kind.is_integer())
    };
    let texnumbers = (0..element.properties.len()).any(is_texnumber);
    // Texture indices are useless without texture coordinates. Triangles of strips have no index.
    if textures && texnumbers && (texcoords || vertex_uvs) && !has_strips(header) {
        attributes.textures = header.texture_files.len();
    }
    let steps = element.properties.iter().enumerate().map(|(at, property)| match property.shape {
        PropertyType::List { count, item } if at == corners => Step::Corners { count, item },
        PropertyType::List { count, item } if texcoords && is_texcoord_list(property) => {
            Step::Texcoords { count, item }
        }
        PropertyType::Single(kind) if is_texnumber(at) => {
            Step::Texnumber(kind, role_of(&columns, at))
        }
        shape => match (shape, role_of(&columns, at)) {
            (PropertyType::Single(kind), Some(role)) => Step::Value(kind, role),
            _ => Step::Skip(shape),
        },
    });
    let steps = steps.collect();
    let element = element_index;
    Ok(Some(FacePlan {
        element,
        steps,
        corners,
        texcoords,
        texnumbers,
        texture_files: header.texture_files.len(),
        strips,
        columns,
        attributes,
    }))
}
