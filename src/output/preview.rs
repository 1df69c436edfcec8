//! Converts layers to 8-bit pictures for viewing (`--png-layer`). Values are mapped to [0, 255].

use crate::film::{ChannelKind, Film};
use crate::parallel;

use super::exr::layer_of;
use super::srgb;

/// How the values of a layer are mapped.
#[derive(Debug, Clone, Copy)]
enum Mapping {
    /// The smallest depth of a hit is white, the largest is dark grey; misses are black.
    Depth,
    /// From [-1, 1] to [0, 1]; zero vectors are black.
    Direction,
    /// Each axis from its smallest to its largest value; zero vectors are black.
    Range,
    /// A pseudo-random colour for each id; 0 is black.
    Number,
    /// The fractional parts of u and v in red and green.
    Coordinates,
    /// Clamped to [0, 1], with the sRGB curve.
    Colour,
    /// Divided by the largest value of the layer, with the sRGB curve.
    Relative,
}

/// Returns R, G, B of every pixel as bytes, or `None` if the film has no such layer. A matte layer
/// shows the id with the most coverage in each pixel.
pub fn bytes(film: &Film, layer: &str) -> Option<Vec<u8>> {
    let channels = channels(film, layer)?;
    let mapping = match layer {
        "Z" | "distance" => Mapping::Depth,
        "P" => Mapping::Range,
        "N" | "Ng" | "Ncam" => Mapping::Direction,
        "uv" => Mapping::Coordinates,
        "variance" | "samples" => Mapping::Relative,
        _ if layer.starts_with("Crypto") => Mapping::Number,
        _ if film.planes.channels[channels[0]].kind == ChannelKind::Uint => Mapping::Number,
        _ => Mapping::Colour,
    };
    let value = |axis: usize, pixel: usize| film.planes.float(channels[axis], pixel);
    let ranges = channels.map(|channel| range(film, channel));
    let largest = ranges.iter().fold(0.0, |max: f32, [_, high]| max.max(*high));
    let within = |x: f32, [low, high]: [f32; 2]| match high > low {
        true => (x - low) / (high - low),
        false => 0.5,
    };
    let picture = parallel::values(film.pixels.len(), |pixel| {
        let [x, y, z] = [0, 1, 2].map(|axis| value(axis, pixel));
        match mapping {
            Mapping::Depth if x > ranges[0][1] => [0; 3],
            Mapping::Depth => [byte(1.0 - 0.9 * within(x, ranges[0])); 3],
            Mapping::Direction if [x, y, z] == [0.0; 3] => [0; 3],
            Mapping::Direction => [x, y, z].map(|c| byte(0.5 + 0.5 * c)),
            Mapping::Range if [x, y, z] == [0.0; 3] => [0; 3],
            Mapping::Range => [0, 1, 2].map(|axis| byte(within(value(axis, pixel), ranges[axis]))),
            Mapping::Number => colour(film.planes.uint(channels[0], pixel)),
            Mapping::Coordinates => [byte(x - x.floor()), byte(y - y.floor()), 0],
            Mapping::Colour => [x, y, z].map(srgb_byte),
            Mapping::Relative => [x, y, z].map(|c| srgb_byte(c / largest)),
        }
    });
    Some(picture.into_flattened())
}

/// Returns the indices of the layer's first three channels, without `A`. If there are fewer, the
/// last index is repeated.
fn channels(film: &Film, layer: &str) -> Option<[usize; 3]> {
    let all = film.planes.channels.iter().enumerate();
    let found: Vec<usize> = all
        .filter(|(_, channel)| layer_of(&channel.name) == layer && !channel.name.ends_with(".A"))
        .map(|(i, _)| i)
        .collect();
    let last = *found.last()?;
    Some(std::array::from_fn(|axis| found.get(axis).copied().unwrap_or(last)))
}

/// Returns the smallest and the largest value of a channel. Ignores NaN and the values of misses:
/// 0, and absolute values of 1e30 or more.
fn range(film: &Film, channel: usize) -> [f32; 2] {
    let none = [f32::INFINITY, f32::NEG_INFINITY];
    let wider = |[a, b]: [f32; 2], [low, high]: [f32; 2]| [a.min(low), b.max(high)];
    let ranges = parallel::map(parallel::ranges(film.pixels.len(), parallel::GRAIN), |pixels| {
        let values = pixels.map(|pixel| film.planes.float(channel, pixel));
        let values = values.filter(|value| *value != 0.0 && value.abs() < 1e30);
        values.fold(none, |all, value| wider(all, [value; 2]))
    });
    ranges.into_iter().fold(none, wider)
}

/// Returns a bright colour for every id but 0: a hash by MurmurHash3's finaliser without its last
/// shift.
fn colour(number: u32) -> [u8; 3] {
    if number == 0 {
        return [0; 3];
    }
    let h = (number ^ (number >> 16)).wrapping_mul(0x85eb_ca6b);
    let h = (h ^ (h >> 13)).wrapping_mul(0xc2b2_ae35);
    [h, h >> 8, h >> 16].map(|bits| 64 + (bits & 255) as u8 / 4 * 3)
}

/// Encodes a linear value as an sRGB byte. NaN becomes 0.
fn srgb_byte(linear: f32) -> u8 {
    srgb::byte(f64::from(linear.clamp(0.0, 1.0)))
}

/// Converts a value in [0, 1] to a byte. NaN becomes 0.
fn byte(x: f32) -> u8 {
    (255.0 * x.clamp(0.0, 1.0)).round() as u8
}
