//! Chooses the colours of a mesh: which colours of its file are read, and how they are shown.

use crate::error::{Error, Problem, Result};
use crate::mesh::{self, ColorRequest, Colors, Mesh, MeshElement, Property, Scalars};
use crate::output::legend::Legend;
use crate::output::srgb;
use crate::parallel::{self, GRAIN};
use crate::scene::written::MeshColorDescription::{Property as Mapped, Stored};
use crate::scene::written::{MAX_COLOR, PropertyColorDescription, StoredColor};
use crate::scene::{ColorSpace, Trimesh};
use crate::shading::{ColorSource, MappedScalars, MeshColors, StoredColors};
use crate::units::counted;

/// Returns the colours that a shape needs from its file. `textured` is true if its material has a
/// texture, which hides all colours.
pub fn color_request(spec: &Trimesh, textured: bool) -> ColorRequest<'_> {
    use mesh::ColorChoice as Source;
    let source = match spec.color.as_ref().map(|request| &request.color) {
        _ if textured => Source::Nothing,
        None if spec.vertex_colors => Source::Any,
        None | Some(Stored(StoredColor::None)) => Source::Nothing,
        Some(Stored(StoredColor::Vertex)) => Source::Vertices,
        Some(Stored(StoredColor::Face)) => Source::Faces,
        Some(Mapped(color)) => Source::Property(&color.property.0),
    };
    ColorRequest { source, place: spec.color.as_ref().map_or("", |request| &request.place) }
}

/// Takes the colours that a shape shows from its mesh, with the legend of a colour map. All other
/// colours of the mesh are dropped.
///
/// # Errors
/// If the mesh lacks the requested colours, or the requested property was not read with it.
pub(super) fn take(
    mesh: &mut Mesh,
    spec: &Trimesh,
    textured: bool,
    warnings: &mut Vec<Problem>,
) -> Result<(Option<MeshColors>, Option<Legend>)> {
    let (of_vertices, of_faces) = (mesh.colors.take(), mesh.face_colors.take());
    let (mut alpha, property) = (mesh.alpha.take(), mesh.property.take());
    // Alpha belongs to the colours of the vertices, if there are any.
    let of_alpha = if of_vertices.is_some() { MeshElement::Vertex } else { MeshElement::Face };
    let by_vertices = of_vertices.map(|values| (MeshElement::Vertex, values));
    let by_faces = of_faces.map(|values| (MeshElement::Face, values));
    let lacks = |what: &str| {
        let place = spec.color.as_ref().map_or("", |request| &request.place);
        let message = format!("{} has no colours of its {what}", spec.path.display());
        Error::invalid(place, message)
    };
    let stored = match spec.color.as_ref().map(|request| &request.color) {
        _ if textured => None,
        None if !spec.vertex_colors => None,
        Some(Stored(StoredColor::None)) => None,
        None => by_vertices.or(by_faces),
        Some(Stored(StoredColor::Vertex)) => Some(by_vertices.ok_or_else(|| lacks("vertices"))?),
        Some(Stored(StoredColor::Face)) => Some(by_faces.ok_or_else(|| lacks("faces"))?),
        Some(Mapped(color)) => {
            let (colors, legend) = mapped(property, color, spec, warnings)?;
            return Ok((Some(colors), Some(legend)));
        }
    };
    let stored = stored.map(|(element, mut values)| {
        alpha = alpha.take().filter(|_| element == of_alpha);
        let space = match values {
            Colors::F32(_) => ColorSpace::Linear,
            Colors::U8(_) | Colors::U16(_) => ColorSpace::Srgb,
        };
        let space = spec.vertex_color_space.unwrap_or(space);
        let replaced = replace_unusable(&mut values, alpha.as_mut(), space);
        if replaced > 0 {
            let message = format!(
                "{} not finite or beyond {MAX_COLOR:e}; white is shown",
                counted(replaced, ["colour is", "colours are"])
            );
            warnings.push(Problem::new(spec.path.display().to_string(), message));
        }
        let source = ColorSource::Stored(StoredColors { values, alpha, space });
        MeshColors { element, source }
    });
    Ok((stored, None))
}

/// Replaces colours that cannot be multiplied with light: they become white, which leaves the
/// material's colour. Returns their number. `space` is that of the colours.
fn replace_unusable(colors: &mut Colors, alpha: Option<&mut Scalars>, space: ColorSpace) -> u64 {
    let is_usable = |value: f64| value.abs() <= MAX_COLOR;
    let decoded = |channel: f32| match space {
        ColorSpace::Linear => channel.into(),
        ColorSpace::Srgb => srgb::to_linear(channel.into()),
    };
    let mut replaced = 0;
    if let Colors::F32(colors) = colors {
        replaced += replace(colors, [1.0; 3], |rgb| rgb.iter().all(|&c| is_usable(decoded(c))));
    }
    // Without alpha, the colour is white.
    match alpha {
        Some(Scalars::F32(alpha)) => replaced += replace(alpha, 0.0, |&a| is_usable(a.into())),
        Some(Scalars::F64(alpha)) => replaced += replace(alpha, 0.0, |&a| is_usable(a)),
        _ => {}
    }
    replaced
}

/// Replaces what is not good by `by`. Returns its number.
fn replace<T: Copy + Send + Sync>(all: &mut [T], by: T, good: impl Fn(&T) -> bool + Sync) -> u64 {
    let parts = parallel::map(all.chunks_mut(GRAIN), |part| {
        let bad = part.iter_mut().filter(|value| !good(value));
        bad.map(|value| *value = by).count() as u64
    });
    parts.into_iter().sum()
}

/// Range of the finite values of a property.
struct Finite {
    low: f64,
    high: f64,
    /// Number of values that are not finite.
    others: u64,
}

impl Finite {
    const NONE: Self = Self { low: f64::INFINITY, high: f64::NEG_INFINITY, others: 0 };

    fn of(property: &Property) -> Self {
        let values = &property.values;
        let one = |all: Self, i: usize| match values.get(i) {
            value if value.is_finite() => {
                Self { low: all.low.min(value), high: all.high.max(value), ..all }
            }
            _ => Self { others: all.others + 1, ..all },
        };
        let both = |a: Self, b: Self| Self {
            low: a.low.min(b.low),
            high: a.high.max(b.high),
            others: a.others + b.others,
        };
        let parts = parallel::ranges(values.len(), GRAIN);
        let found = parallel::map(parts, |part| part.fold(Self::NONE, one));
        found.into_iter().fold(Self::NONE, both)
    }

    /// Returns the default range of the colour map, which has a width also for equal values.
    fn range(&self) -> [f64; 2] {
        match self.high - self.low {
            // The width may overflow.
            width if width > 0.0 => [self.low, self.high],
            0.0 => {
                let some = 0.5f64.max(self.low.abs() * 1e-6);
                [(self.low - some).max(-f64::MAX), (self.high + some).min(f64::MAX)]
            }
            // There is no finite value.
            _ => [0.0, 1.0],
        }
    }
}

fn mapped(
    property: Option<Property>,
    color: &PropertyColorDescription,
    spec: &Trimesh,
    warnings: &mut Vec<Problem>,
) -> Result<(MeshColors, Legend)> {
    let path = spec.path.display();
    let Some(property) = property else {
        let message = format!("{path} was read without its property {:?}", color.property.0);
        let place = spec.color.as_ref().map_or("", |request| &request.place);
        return Err(Error::invalid(place, message));
    };
    let finite = Finite::of(&property);
    let name = format!("{}.{}", property.element.name(), property.name);
    if finite.others > 0 {
        let [r, g, b] = color.nan.vec().to_array();
        let message = format!(
            "{} of {} values of {name} are not finite; they have the colour [{r}, {g}, {b}]",
            finite.others,
            property.values.len()
        );
        warnings.push(Problem::new(path.to_string(), message));
    }
    let range = color.range.unwrap_or_else(|| finite.range());
    let nan = color.nan.vec().to_array().map(|c| srgb::byte(f64::from(c).clamp(0.0, 1.0)));
    let nan = (finite.others > 0).then_some(nan);
    let legend = Legend { name: property.name, map: color.map, range, nan };
    let scalars = MappedScalars::new(property.values, color.map, range, color.nan.vec());
    let source = ColorSource::Mapped(Box::new(scalars));
    Ok((MeshColors { element: property.element, source }, legend))
}
