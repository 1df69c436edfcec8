//! The values of some rows as the file has them, before compression.

use std::ops::Range;

use half::{f16, slice::HalfFloatSliceExt};

use crate::{
    film::{ChannelKind, Film},
    output::{HALF_MAX, finite},
};

use super::parts::{From, Source};

/// Fills `bytes` row by row (of the film's window), channel by channel, in native byte order.
pub fn fill(bytes: &mut Vec<u8>, film: &Film, sources: &[Source], rows: Range<usize>) {
    let width = film.window.width() as usize;
    let stride = film.planes.channels.len();
    let size = |kind| if kind == ChannelKind::Half { 2 } else { 4 };
    let pixel: usize = sources.iter().map(|source| size(source.kind)).sum();
    bytes.resize(rows.len() * width * pixel, 0);
    let mut rest = bytes.as_mut_slice();
    let (mut floats, mut halves) = (vec![0.0; width], vec![f16::ZERO; width]);
    for y in rows {
        let row = y * width..(y + 1) * width;
        let pixels = &film.pixels[row.clone()];
        let words = &film.planes.words[row.start * stride..row.end * stride];
        for Source { kind, from, .. } in sources {
            let (to, after) = rest.split_at_mut(width * size(*kind));
            rest = after;
            match *from {
                From::Words(channel) if *kind == ChannelKind::Uint => {
                    let column = words.chunks_exact(stride).map(|words| words[channel]);
                    for (to, word) in to.chunks_exact_mut(4).zip(column) {
                        to.copy_from_slice(&word.to_ne_bytes());
                    }
                    continue;
                }
                From::Words(channel) => {
                    for (float, words) in floats.iter_mut().zip(words.chunks_exact(stride)) {
                        *float = f32::from_bits(words[channel]);
                    }
                }
                From::Beauty(axis) => {
                    for (float, pixel) in floats.iter_mut().zip(pixels) {
                        *float = pixel[axis];
                    }
                }
            }
            if *kind == ChannelKind::Half {
                floats.iter_mut().for_each(|float| *float = within_half(*float));
                halves.convert_from_f32_slice(&floats);
                for (to, half) in to.chunks_exact_mut(2).zip(&halves) {
                    to.copy_from_slice(&half.to_ne_bytes());
                }
            } else {
                for (to, float) in to.chunks_exact_mut(4).zip(&floats) {
                    to.copy_from_slice(&finite(*float).to_ne_bytes());
                }
            }
        }
    }
}

/// What a half can hold; finite for every input.
fn within_half(value: f32) -> f32 {
    // Without branches: what NaN fails becomes 0.
    let within = value.clamp(-HALF_MAX, HALF_MAX);
    if within.is_nan() { 0.0 } else { within }
}
