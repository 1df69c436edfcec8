//! Decides which colours of a file are read, or which scalar property in their place. A scalar
//! property is one that is no list.

use super::header::{Element, Header, PropertyType};
use super::options::ColorChoice;
use super::options::ReadOptions;
use super::scalar::Scalar;
use crate::error::{Error, Result};
use crate::mesh::arrays::MeshElement;
use crate::nearest::did_you_mean;

/// Names of the channels of a colour, with the names that its alpha may have, the usual one first.
const COLOR_NAMES: [([&str; 3], &[&str]); 3] = [
    (["red", "green", "blue"], &["alpha", "a"]),
    (["r", "g", "b"], &["a", "alpha"]),
    (["diffuse_red", "diffuse_green", "diffuse_blue"], &["diffuse_alpha", "alpha", "a"]),
];

/// The properties of an element that form a colour, as indices. All have the same type.
#[derive(Debug, Clone, Copy)]
pub(super) struct ColorColumns {
    /// Type of the stored channels: `uchar`, `ushort` or `float`.
    pub(super) kind: Scalar,
    pub(super) rgb: [usize; 3],
    pub(super) alpha: Option<usize>,
}

/// The colours or the scalar property to read.
#[derive(Debug)]
pub(super) struct Choice {
    /// The element that the colours or the property belong to.
    pub(super) colors_of: MeshElement,
    pub(super) colors: Option<ColorColumns>,
    /// Index and type of the scalar property.
    pub(super) scalar: Option<(usize, Scalar)>,
    /// Name and element of the scalar property.
    pub(super) property: Option<(String, MeshElement)>,
}

/// Decides which colours or property to read for `options.color`.
///
/// # Errors
/// A request for colours or a property that the file lacks. The help lists the scalar properties;
/// for an unknown property it also names the nearest one.
pub(super) fn choose(header: &Header, file: &str, options: &ReadOptions) -> Result<Choice> {
    let request = options.color;
    let vertices = colors(header, MeshElement::Vertex);
    let faces = colors(header, MeshElement::Face).filter(|_| !options.points);
    let chosen = |colors_of, colors| Choice { colors_of, colors, scalar: None, property: None };
    let place = if request.place.is_empty() { file } else { request.place };
    let lacks = |what: &str| {
        let message = format!("{file} has no colours of its {what}");
        Err(Error::invalid(place, message).help(choices(header)))
    };
    match request.source {
        ColorChoice::Nothing => Ok(chosen(MeshElement::Vertex, None)),
        ColorChoice::Any if vertices.is_none() => Ok(chosen(MeshElement::Face, faces)),
        ColorChoice::Any => Ok(chosen(MeshElement::Vertex, vertices)),
        ColorChoice::Vertices if vertices.is_none() => lacks("vertices"),
        ColorChoice::Vertices => Ok(chosen(MeshElement::Vertex, vertices)),
        ColorChoice::Faces if faces.is_none() => lacks("faces"),
        ColorChoice::Faces => Ok(chosen(MeshElement::Face, faces)),
        ColorChoice::Property(name) => {
            let found = property(header, name);
            if found.is_some_and(|(which, ..)| options.points && which == MeshElement::Face) {
                let message = format!("{name:?} is a property of faces, and only points are drawn");
                return Err(Error::invalid(place, message));
            }
            let Some((which, at, kind)) = found else {
                let known = scalars(header);
                let message = format!("{file} has no scalar property {name:?}");
                let near = did_you_mean(name, known.iter().map(String::as_str));
                return Err(Error::invalid(place, message).help(match near {
                    Some(near) => format!("{near} {}", choices(header)),
                    None => choices(header),
                }));
            };
            let own = element(header, which).map(|element| element.properties[at].name.clone());
            let property = own.map(|name| (name, which));
            Ok(Choice { scalar: Some((at, kind)), property, ..chosen(which, None) })
        }
    }
}

/// Returns the element if its attributes can be read. Triangle strips have no attributes, and all
/// triangles share the same arrays. So attributes of faces are not read in a file with strips.
fn element(header: &Header, which: MeshElement) -> Option<&Element> {
    let find = |name: &str| header.elements.iter().find(|element| element.name == name);
    match which {
        MeshElement::Vertex => find("vertex"),
        MeshElement::Face => find("face").filter(|face| face.count > 0 && !has_strips(header)),
    }
}

/// Returns the first complete colour of an element: three properties of the same type. Its alpha is
/// the first of its names with that type, too.
fn colors(header: &Header, which: MeshElement) -> Option<ColorColumns> {
    let element = element(header, which)?;
    let shape = |at: usize| element.properties[at].shape;
    COLOR_NAMES.iter().find_map(|(names, alphas)| {
        let [r, g, b] = names.map(|name| single(element, name));
        let rgb = [r?, g?, b?];
        if rgb.iter().any(|&at| shape(at) != shape(rgb[0])) {
            return None;
        }
        let kind = match shape(rgb[0]) {
            PropertyType::Single(kind @ (Scalar::U8 | Scalar::U16)) => kind,
            PropertyType::Single(Scalar::F32 | Scalar::F64) => Scalar::F32,
            _ => return None,
        };
        let alpha = alphas
            .iter()
            .filter_map(|name| single(element, name))
            .find(|&at| shape(at) == shape(rgb[0]));
        Some(ColorColumns { kind, rgb, alpha })
    })
}

/// Finds the scalar property `NAME`, `vertex.NAME` or `face.NAME`. Vertices are searched first.
fn property(header: &Header, name: &str) -> Option<(MeshElement, usize, Scalar)> {
    [MeshElement::Vertex, MeshElement::Face].into_iter().find_map(|which| {
        let element = element(header, which)?;
        let prefix = format!("{}.", which.name());
        let at = single(element, name)
            .or_else(|| single(element, name.strip_prefix(prefix.as_str())?))?;
        match element.properties[at].shape {
            PropertyType::Single(kind) => Some((which, at, kind)),
            PropertyType::List { .. } => None,
        }
    })
}

/// Returns the names of all scalar properties, first without and then with their element.
fn scalars(header: &Header) -> Vec<String> {
    let full = scalar_names(header);
    let bare = full.iter().filter_map(|name| Some(name.split_once('.')?.1.to_string()));
    bare.chain(full.iter().cloned()).collect()
}

/// Returns the names `element.property` of all scalar properties that a colour map can show.
pub(super) fn scalar_names(header: &Header) -> Vec<String> {
    let elements = [MeshElement::Vertex, MeshElement::Face];
    let elements = elements.into_iter().filter_map(|which| element(header, which));
    let names = elements.flat_map(|element| {
        let scalar = |shape| matches!(shape, PropertyType::Single(_));
        let all = element.properties.iter().filter(move |property| scalar(property.shape));
        all.map(|property| format!("{}.{}", element.name, property.name))
    });
    names.collect()
}

/// Maximum number of properties that a message lists.
const MAX_LISTED: usize = 20;

/// Lists the scalar properties of a file, for messages.
fn choices(header: &Header) -> String {
    let names = scalar_names(header);
    let more = match names.len().saturating_sub(MAX_LISTED) {
        0 => String::new(),
        more => format!(" and {more} more"),
    };
    let shown: Vec<&str> = names.iter().take(MAX_LISTED).map(String::as_str).collect();
    if shown.is_empty() {
        return "it has no scalar properties".to_string();
    }
    format!("its scalar properties are {}{more}", shown.join(", "))
}

/// Returns true if the file has triangle strips.
pub(super) fn has_strips(header: &Header) -> bool {
    header.elements.iter().any(|element| element.name == "tristrips" && element.count > 0)
}

/// Returns the index of the property called `name` if it is a scalar and not a list.
pub(super) fn single(element: &Element, name: &str) -> Option<usize> {
    let at = element.find(name)?;
    matches!(element.properties[at].shape, PropertyType::Single(_)).then_some(at)
}
