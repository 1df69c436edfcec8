//! Converts rows of the film to the values of the file, before compression.

use std::ops::Range;

use half::f16;
use half::slice::HalfFloatSliceExt;

use crate::film::{ChannelKind, Film};
use crate::simd::Kernel;

use super::parts::{ChannelSource, ValueSource};

/// Number of pixels that are processed together. Their words stay in the L1 cache for all channels.
const BATCH: usize = 256;

/// Fills `bytes` with some `rows` of the film's window: row by row, channel by channel in each row,
/// in native byte order.
pub struct Fill<'a, 'b> {
    pub bytes: &'b mut Vec<u8>,
    pub film: &'a Film,
    pub sources: &'a [ValueSource<'a>],
    pub rows: Range<usize>,
    /// True if floats keep all bits.
    pub exact: bool,
}

impl Kernel for Fill<'_, '_> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        let Self { bytes, film, sources, rows, exact } = self;
        let width = film.window.width() as usize;
        let stride = film.planes.channels.len();
        let row_bytes = width * sources.iter().map(|source| size(source.kind)).sum::<usize>();
        bytes.resize(rows.len() * row_bytes, 0);
        for (y, row) in rows.zip(bytes.chunks_exact_mut(row_bytes)) {
            for x in (0..width).step_by(BATCH) {
                let count = BATCH.min(width - x);
                let first = y * width + x;
                let pixels = &film.pixels[first..first + count];
                let words = &film.planes.words[first * stride..(first + count) * stride];
                let mut begin = 0;
                for source in sources {
                    let size = size(source.kind);
                    let to = &mut row[begin + x * size..][..count * size];
                    begin += width * size;
                    let mut floats = [0.0; BATCH];
                    match source.from {
                        ChannelSource::Beauty(axis) => {
                            for (float, pixel) in floats.iter_mut().zip(pixels) {
                                *float = pixel[axis];
                            }
                        }
                        ChannelSource::Words(channel) if source.kind == ChannelKind::Uint => {
                            let words = words.chunks_exact(stride);
                            for (to, words) in to.chunks_exact_mut(4).zip(words) {
                                to.copy_from_slice(&words[channel].to_ne_bytes());
                            }
                            continue;
                        }
                        ChannelSource::Words(channel) => {
                            for (float, words) in floats.iter_mut().zip(words.chunks_exact(stride))
                            {
                                *float = f32::from_bits(words[channel]);
                            }
                        }
                    }
                    store(source, exact, &mut floats[..count], to);
                }
            }
        }
    }
}

/// Returns the size in bytes of a value in the file.
#[inline(always)]
fn size(kind: ChannelKind) -> usize {
    if kind == ChannelKind::Half { 2 } else { 4 }
}

/// Writes at most [`BATCH`] values in the type of the file. Only with `exact`, floats may be NaN or
/// infinite.
#[inline(always)]
fn store(source: &ValueSource, exact: bool, floats: &mut [f32], to: &mut [u8]) {
    let is_half = source.kind == ChannelKind::Half;
    if is_half || !exact {
        for float in floats.iter_mut() {
            *float = within(*float, source.largest);
        }
    }
    if !is_half {
        for (to, float) in to.chunks_exact_mut(4).zip(floats) {
            to.copy_from_slice(&float.to_ne_bytes());
        }
        return;
    }
    let mut halves = [f16::ZERO; BATCH];
    let halves = &mut halves[..floats.len()];
    halves.convert_from_f32_slice(floats);
    for (to, half) in to.chunks_exact_mut(2).zip(halves) {
        to.copy_from_slice(&half.to_ne_bytes());
    }
}

/// Clamps a value to the range of its channel. NaN becomes 0, so the result is always finite.
#[inline(always)]
fn within(value: f32, largest: f32) -> f32 {
    // Written without branches, because it runs for every value.
    // Unlike `clamp`, the comparisons check no limits.
    let value = if value < -largest { -largest } else { value };
    let value = if value > largest { largest } else { value };
    if value.is_nan() { 0.0 } else { value }
}
