//! Converts radiance to 8-bit or 16-bit values for viewing: the PNG, and pictures in reports. The
//! EXR is not tone mapped. docs/guide/scene-format.md, `tonemap`, specifies the conversion.
//!
//! A transparent picture has straight alpha: colour is first divided by alpha, also to find the
//! maximum for the operator `max`. `finite` replaces NaN and infinite values.

use clap::ValueEnum;
use serde::{Deserialize, Serialize};

use crate::parallel::{self, GRAIN};
use crate::scene::{ToneOperator, Tonemap};

use super::srgb;
use super::value_counts::finite;

/// The format of a PNG's pixels.
#[derive(Debug, Clone, Copy)]
pub struct PixelFormat {
    /// True for R, G, B, A; false for R, G, B.
    pub alpha: bool,
    /// True if values are sRGB-encoded, false if they are linear.
    pub srgb: bool,
    /// Bits of each channel.
    pub depth: Depth,
}

/// Number of bits of a channel.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize, ValueEnum)]
pub enum Depth {
    /// One byte per channel.
    #[default]
    #[serde(rename = "8")]
    #[value(name = "8")]
    Eight,
    /// Two bytes per channel, big-endian as in a PNG.
    #[serde(rename = "16")]
    #[value(name = "16")]
    Sixteen,
}

impl Depth {
    /// Returns the number of bits, 8 or 16.
    pub fn bits(self) -> u8 {
        match self {
            Self::Eight => 8,
            Self::Sixteen => 16,
        }
    }
}

/// Returns the bytes of the pixels, row-major: 4 channels with `transparent`, else 3. Each channel
/// has the bytes of `depth`.
pub fn to_samples(pixels: &[[f32; 4]], curve: &Curve, transparent: bool, depth: Depth) -> Vec<u8> {
    let channels = if transparent { 4 } else { 3 };
    let size = usize::from(depth.bits() / 8);
    let mut bytes = vec![0; pixels.len() * channels * size];
    let parts = bytes.chunks_mut(channels * size * GRAIN).zip(pixels.chunks(GRAIN));
    parallel::each(parts, |(bytes, pixels)| {
        for (to, pixel) in bytes.chunks_mut(channels * size).zip(pixels) {
            let [r, g, b] = straight(pixel, transparent).map(|value| curve.exposed(value));
            let alpha = f64::from(finite(pixel[3])).clamp(0.0, 1.0);
            match depth {
                Depth::Eight => {
                    let bytes = [curve.byte(r), curve.byte(g), curve.byte(b), quantise(alpha)];
                    to.copy_from_slice(&bytes[..channels]);
                }
                Depth::Sixteen => {
                    let levels = [curve.encode(r), curve.encode(g), curve.encode(b), alpha];
                    for (to, level) in to.chunks_exact_mut(size).zip(levels) {
                        to.copy_from_slice(&((65535.0 * level).round() as u16).to_be_bytes());
                    }
                }
            }
        }
    });
    bytes
}

/// A tone curve, with its scale computed for a picture.
#[derive(Debug, Clone, Copy)]
pub struct Curve {
    operator: ToneOperator,
    /// 2^exposure. For `max`, divided by the picture's largest value, unless that is 0.
    scale: f64,
    srgb: bool,
}

impl Curve {
    /// Makes the curve for a picture. Only the operator `max` depends on its pixels.
    pub fn new<'a>(
        pixels: impl IntoIterator<Item = &'a [f32; 4]>,
        tonemap: &Tonemap,
        transparent: bool,
    ) -> Self {
        let gain = f64::from(tonemap.exposure).exp2();
        let scale = match tonemap.operator {
            ToneOperator::Max => match largest(pixels, transparent) {
                max if max > 0.0 => gain / max,
                _ => gain, // black stays black
            },
            ToneOperator::Clamp | ToneOperator::Reinhard => gain,
        };
        Self { operator: tonemap.operator, scale, srgb: tonemap.srgb }
    }

    /// Maps the value of one channel, in radiance and divided by alpha, to a byte.
    pub fn to_byte(&self, value: f64) -> u8 {
        self.byte(self.exposed(value))
    }

    /// Maps the value of one channel to [0, 1]: exposure and operator, without the sRGB curve.
    #[inline(always)]
    fn exposed(&self, value: f64) -> f64 {
        let x = (value * self.scale).max(0.0);
        let x = match self.operator {
            ToneOperator::Max | ToneOperator::Clamp => x,
            ToneOperator::Reinhard => x / (1.0 + x),
        };
        // The transfer curve maps [0, 1] to [0, 1], so clamping before it gives the same result.
        x.min(1.0)
    }

    /// Encodes a value in [0, 1] with the transfer curve: sRGB or linear.
    fn encode(&self, x: f64) -> f64 {
        if self.srgb { srgb::from_linear(x) } else { x }
    }

    #[inline(always)]
    fn byte(&self, x: f64) -> u8 {
        if self.srgb { srgb::byte(x) } else { quantise(x) }
    }
}

/// Converts a value in [0, 1] to a byte, rounded half up.
#[inline(always)]
fn quantise(x: f64) -> u8 {
    (255.0 * x + 0.5) as u8
}

/// Returns the colour to tone map: divided by alpha if the picture is transparent; black where
/// alpha is not positive.
fn straight(pixel: &[f32; 4], transparent: bool) -> [f64; 3] {
    let [r, g, b, a] = pixel.map(|c| f64::from(finite(c)));
    match transparent {
        true if a > 0.0 => [r / a, g / a, b / a],
        true => [0.0; 3],
        false => [r, g, b],
    }
}

fn largest<'a>(pixels: impl IntoIterator<Item = &'a [f32; 4]>, transparent: bool) -> f64 {
    let colours = pixels.into_iter().flat_map(|pixel| straight(pixel, transparent));
    colours.fold(0.0, f64::max)
}
