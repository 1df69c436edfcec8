//! Layers as pictures to look at: 8 bits, values mapped so that something can be seen.

use rayon::prelude::*;

use crate::film::{ChannelKind, Film};

use super::srgb;

/// What a layer's values become.
#[derive(Debug, Clone, Copy)]
enum Look {
    /// From the smallest (white) to the largest (dark) of what was hit; misses are black.
    Depth,
    /// [-1, 1] to [0, 1].
    Direction,
    /// Each axis from its smallest to its largest value; zero stays black.
    Range,
    /// A colour for each number; 0 is black.
    Number,
    /// The fractions of u and v in red and green.
    Coordinates,
    /// Clamped to [0, 1], sRGB curve.
    Colour,
    /// Divided by the largest value, sRGB curve.
    Relative,
}

/// R, G, B of every pixel, or `None` where the film has no such layer. Mattes are shown by what covers
/// most of a pixel.
pub fn bytes(film: &Film, layer: &str) -> Option<Vec<u8>> {
    let channels = channels(film, layer)?;
    let look = match layer {
        "Z" => Look::Depth,
        "P" => Look::Range,
        "N" | "Ng" => Look::Direction,
        "uv" => Look::Coordinates,
        "variance" | "samples" => Look::Relative,
        _ if layer.starts_with("Crypto") => Look::Number,
        _ if film.planes.channels[channels[0]].kind == ChannelKind::Uint => Look::Number,
        _ => Look::Colour,
    };
    let value = |axis: usize, pixel: usize| film.planes.float(channels[axis], pixel);
    let ranges = channels.map(|channel| range(film, channel));
    let largest = ranges.iter().fold(0.0, |most: f32, [_, high]| most.max(*high));
    let within = |x: f32, [low, high]: [f32; 2]| match high > low {
        true => (x - low) / (high - low),
        false => 0.5,
    };
    let picture = (0..film.pixels.len()).into_par_iter().with_min_len(1024).map(|pixel| {
        let [x, y, z] = [0, 1, 2].map(|axis| value(axis, pixel));
        match look {
            Look::Depth if x > ranges[0][1] => [0; 3],
            Look::Depth => [byte(1.0 - 0.9 * within(x, ranges[0])); 3],
            Look::Direction if [x, y, z] == [0.0; 3] => [0; 3],
            Look::Direction => [x, y, z].map(|c| byte(0.5 + 0.5 * c)),
            Look::Range if [x, y, z] == [0.0; 3] => [0; 3],
            Look::Range => [0, 1, 2].map(|axis| byte(within(value(axis, pixel), ranges[axis]))),
            Look::Number => colour(film.planes.uint(channels[0], pixel)),
            Look::Coordinates => [byte(x - x.floor()), byte(y - y.floor()), 0],
            Look::Colour => [x, y, z].map(lit),
            Look::Relative => [x, y, z].map(|c| lit(c / largest)),
        }
    });
    Some(picture.collect::<Vec<[u8; 3]>>().into_flattened())
}

/// The layer's first three channels; the last one again where there are fewer.
fn channels(film: &Film, layer: &str) -> Option<[usize; 3]> {
    let all = film.planes.channels.iter().enumerate();
    let belongs = |name: &str| match name.strip_prefix(layer) {
        Some(rest) => rest.is_empty() || rest.starts_with('.') || rest.starts_with("00."),
        None => false,
    };
    let found: Vec<usize> =
        all.filter(|(_, channel)| belongs(&channel.name)).map(|(i, _)| i).collect();
    let last = *found.last()?;
    Some(std::array::from_fn(|axis| found.get(axis).copied().unwrap_or(last)))
}

/// The smallest and the largest value of a channel, those of misses (0 or 1e30) left out.
fn range(film: &Film, channel: usize) -> [f32; 2] {
    let values = (0..film.pixels.len()).into_par_iter().with_min_len(4096);
    let values = values.map(|pixel| film.planes.float(channel, pixel));
    let values = values.filter(|value| *value != 0.0 && value.abs() < 1e30);
    let none = || [f32::INFINITY, f32::NEG_INFINITY];
    let wider = |[a, b]: [f32; 2], [low, high]: [f32; 2]| [a.min(low), b.max(high)];
    values.map(|value| [value; 2]).reduce(none, wider)
}

/// A bright colour for every number but 0, by the last mixing step of MurmurHash3.
fn colour(number: u32) -> [u8; 3] {
    if number == 0 {
        return [0; 3];
    }
    let h = (number ^ (number >> 16)).wrapping_mul(0x85eb_ca6b);
    let h = (h ^ (h >> 13)).wrapping_mul(0xc2b2_ae35);
    [h, h >> 8, h >> 16].map(|bits| 64 + (bits & 255) as u8 / 4 * 3)
}

/// NaN becomes 0.
fn lit(linear: f32) -> u8 {
    srgb::byte(f64::from(linear.clamp(0.0, 1.0)))
}

/// NaN becomes 0.
fn byte(x: f32) -> u8 {
    (255.0 * x.clamp(0.0, 1.0)).round() as u8
}
