//! Compares two picture files layer by layer, for `lightpath compare`.

mod compared;
pub mod file;
pub mod half;
pub mod layer;
pub mod map;
pub mod mattes;
pub mod misses;
mod png;

use crate::error::{Error, ErrorKind, Problem, Result};
use crate::output::tonemap;
use crate::scene::{ToneOperator, Tonemap};

pub use compared::{Compared, NonFinite};

use super::metrics::{self, Metric, MetricValues, flip};
use file::{FileFormat, Picture};
use half::HalfRounding;
use layer::{Meaning, PictureLayer, WORKING_BYTES, has_room};
use mattes::Names;
use misses::Misses;

/// Layers to compare, and the tone mapping of light to 8-bit pictures.
#[derive(Debug, Clone)]
pub struct CompareSettings {
    /// Names of the layers to compare, of some channels or of all of a layer. If empty, all layers
    /// that both files have.
    pub layers: Vec<String>,
    /// Tone curve; `None` for [`CompareSettings::default_tonemap`]. `Max` divides both pictures by
    /// the largest value of the reference.
    pub tonemap: Option<ToneOperator>,
    /// Exposure in stops, applied before the tone curve.
    pub exposure: f32,
}

impl CompareSettings {
    /// Default tone curve: `Max` as in `render`, or `Clamp` if a file is a PNG, which is already
    /// tone mapped.
    pub fn default_tonemap(files: [&Picture; 2]) -> ToneOperator {
        match files.iter().any(|file| file.format == FileFormat::Png) {
            true => ToneOperator::Clamp,
            false => ToneOperator::Max,
        }
    }
}

/// Result of the comparison of two files.
#[derive(Debug)]
pub struct Comparison {
    /// Layers that both files have; at least one.
    pub layers: Vec<Compared>,
    /// Names of layers that only the picture has, and that only the reference has.
    pub alone: [Vec<String>; 2],
    /// Tone mapping of light.
    pub tonemap: Tonemap,
    /// Names of the mattes of both files.
    pub mattes: Names,
}

/// Compares all layers of the same name.
///
/// # Errors
/// If no chosen layer is in both files, or if a layer has another size, position or meaning in the
/// reference.
pub fn compare(
    test: Picture,
    reference: Picture,
    settings: &CompareSettings,
) -> Result<Comparison> {
    let operator = settings.tonemap;
    let operator =
        operator.unwrap_or_else(|| CompareSettings::default_tonemap([&test, &reference]));
    let tonemap = Tonemap { operator, exposure: settings.exposure, srgb: true };
    let both_exr = test.format == FileFormat::Exr && reference.format == FileFormat::Exr;
    let names = |p: &Picture| p.layers.iter().map(|l| l.shown().to_string()).collect::<Vec<_>>();
    let (own, other) = (names(&test), names(&reference));
    let missing = |a: &Picture, b: &Picture| {
        let known = |name: &str| b.layers.iter().any(|layer| layer.name == name);
        let alone = a.layers.iter().filter(|layer| !known(&layer.name));
        alone.map(|layer| layer.shown().to_string()).collect()
    };
    let alone = [missing(&test, &reference), missing(&reference, &test)];
    let chosen = |layer: &PictureLayer| {
        settings.layers.is_empty() || settings.layers.iter().any(|name| layer.is_called(name))
    };
    let mut mattes = reference.mattes;
    for (kind, names) in test.mattes {
        mattes.entry(kind).or_default().extend(names);
    }
    let (test_path, reference_path) = (test.path.clone(), reference.path.clone());
    let mut others = reference.layers;
    let mut layers = Vec::new();
    for layer in test.layers.into_iter().filter(chosen) {
        if let Some(at) = others.iter().position(|other| other.name == layer.name) {
            let other = others.swap_remove(at);
            fit([&test_path, &reference_path], &layer, &other, both_exr)?;
            has_room(&test_path, working_bytes(&layer))?;
            layers.push(compare_layer(layer, other, &tonemap, both_exr));
        }
    }
    if layers.is_empty() {
        let list = |names: &[String]| names.join(", ");
        let message = format!("found the layers {}; none of them can be compared", list(&own));
        return Err(Error::invalid(test_path, message)
            .help(format!("{reference_path} has {}", list(&other))));
    }
    Ok(Comparison { layers, alone, tonemap, mattes })
}

/// Returns an error unless both layers have the same size, position and meaning. A PNG has no
/// position.
fn fit(
    [test, reference]: [&str; 2],
    own: &PictureLayer,
    other: &PictureLayer,
    both_exr: bool,
) -> Result<()> {
    let window = |l: &PictureLayer| {
        let at = match l.origin {
            [0, 0] => String::new(),
            [x, y] => format!(" at {x}, {y}"),
        };
        format!("{} x {} pixels{at}", l.size[0], l.size[1])
    };
    let same_place = own.origin == other.origin || !both_exr;
    let what = match (own.size == other.size && same_place, own.meaning) {
        (false, _) => [window(own), window(other)],
        (true, meaning) if meaning == other.meaning => return Ok(()),
        (true, meaning) => [meaning.name().to_string(), other.meaning.name().to_string()],
    };
    let [found, expected] = what;
    let message = format!(
        "found {found} in the layer {}, expected {expected} as in {reference}",
        own.shown()
    );
    Err(Error::new(ErrorKind::Invalid, Problem::new(test, message)))
}

/// Estimated bytes that the comparison of a layer takes.
fn working_bytes(layer: &PictureLayer) -> u64 {
    let per_pixel = match layer.meaning {
        Meaning::Light => WORKING_BYTES,
        _ => 24 * layer.values_per_pixel() as u64,
    };
    per_pixel * layer.size[0] as u64 * layer.size[1] as u64
}

fn compare_layer(
    test: PictureLayer,
    reference: PictureLayer,
    tonemap: &Tonemap,
    both_exr: bool,
) -> Compared {
    let width = test.size[0];
    let half = [test.half, reference.half];
    let misses = Misses::of(&test, &reference);
    let hits = misses.map(|_| misses::hits(&test, &reference));
    let [x, r] = match &hits {
        Some([x, r]) => [&x[..], &r[..]],
        None => [&test.values[..], &reference.values[..]],
    };
    let floor = (half.contains(&true) && test.meaning != Meaning::Ids)
        .then(|| HalfRounding::of([x, r], half))
        .filter(|floor| floor.rmse.is_finite());
    let non_finite = non_finite(&test, &reference);
    let light = test.meaning == Meaning::Light;
    let pictures = light.then(|| pictures(x, r, tonemap));
    let (mut values, mut flip) = (MetricValues::default(), None);
    if non_finite.is_none() {
        values = match test.meaning {
            Meaning::Light => MetricValues::of_light(x, r),
            Meaning::Data => MetricValues::of_data(x, r),
            Meaning::Ids => MetricValues::of_ids(x, r),
        };
        if let Some(misses) = misses {
            values.count_different(x.len() / test.values_per_pixel(), misses.differing());
        }
    }
    if let Some([a, b]) = pictures.as_ref().filter(|_| non_finite.is_none()) {
        let (more, map) = MetricValues::of_pictures(a, b, width);
        values.extend(more.iter());
        flip = Some(map);
        if both_exr {
            let map = flip::hdr(&pixels(x), &pixels(r), width);
            values.extend([(Metric::HdrFlip, metrics::mean(&map))]);
            flip = Some(map);
        }
    }
    Compared { test, reference, values, non_finite, misses, half, floor, pictures, flip }
}

fn pixels(values: &[f32]) -> Vec<[f32; 3]> {
    values.chunks_exact(3).map(|p| [p[0], p[1], p[2]]).collect()
}

/// Tone maps picture and reference with the curve of the reference.
fn pictures(test: &[f32], reference: &[f32], tonemap: &Tonemap) -> [Vec<[u8; 3]>; 2] {
    let opaque = |values: &[f32]| -> Vec<[f32; 4]> {
        values.chunks_exact(3).map(|p| [p[0], p[1], p[2], 1.0]).collect()
    };
    let curve = tonemap::Curve::new(&opaque(reference), tonemap, false);
    [test, reference].map(|values| {
        let byte = |v: f32| curve.to_byte(if v.is_nan() { 0.0 } else { f64::from(v) });
        values.chunks_exact(3).map(|p| [byte(p[0]), byte(p[1]), byte(p[2])]).collect()
    })
}

fn non_finite(test: &PictureLayer, reference: &PictureLayer) -> Option<NonFinite> {
    if test.meaning == Meaning::Ids {
        return None;
    }
    let of = |layer: &PictureLayer| metrics::non_finite(&layer.values, layer.values_per_pixel());
    let ((a, first_a), (b, first_b)) = (of(test), of(reference));
    let first = [first_a, first_b].into_iter().flatten().min()?;
    // A PNG has no position; its origin is 0, 0.
    let placed = if test.origin == [0, 0] { reference } else { test };
    Some(NonFinite { pixels: [a, b], first: placed.position(first) })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_pixel_that_is_not_finite_has_its_position_in_the_frame() {
        let layer = |origin, last| PictureLayer {
            name: String::new(),
            meaning: Meaning::Light,
            size: [2, 1],
            origin,
            channels: ["R", "G", "B"].map(String::from).to_vec(),
            values: vec![0.0, 0.0, 0.0, 0.0, 0.0, last],
            half: false,
        };
        let (png, crop) = (layer([0, 0], 1.0), layer([5, 7], f32::NAN));
        for (a, b) in [(&png, &crop), (&crop, &png)] {
            assert_eq!(non_finite(a, b).unwrap().first, [6, 7]);
        }
    }
}
