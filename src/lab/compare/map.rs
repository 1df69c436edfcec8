//! Error maps in false colour.
//!
//! The colour scale is magma (van der Walt and Smith 2015) from the crate `colorous`. Equal steps
//! look equally large, also in grey and with most kinds of colour blindness.

use image::RgbImage;

use crate::lab::metrics::ValueErrors;
use crate::lab::png;

use super::layer::{Meaning, PictureLayer};
use super::misses::Miss;

/// Errors at the dark and the bright end of the logarithmic scale.
pub const RANGE: [f64; 2] = [1e-4, 1.0];

/// Colour of pixels that are not finite or miss in one file alone. It is not in the scale.
pub const NOT_FINITE: [u8; 3] = [0, 230, 255];

/// Computes the relative error of every pixel. NaN if a value is not finite.
///
/// - Light: the root of the mean over its channels of d^2 / (r^2 + 0.01).
/// - Data: the length of d over the root mean square length of all r. Pixels that miss are not in
///   that mean; they have the error 0 if they miss in both files, NaN if in one.
/// - Ids: 1 if they differ, else 0.
pub fn errors(test: &PictureLayer, reference: &PictureLayer) -> Vec<f64> {
    let channels = test.values_per_pixel();
    let pixels = test.values.chunks_exact(channels).zip(reference.values.chunks_exact(channels));
    let square = |v: f32| f64::from(v) * f64::from(v);
    let data = test.meaning == Meaning::Data;
    let miss = |x: &[f32], r: &[f32]| if data { Miss::of(x, r) } else { Miss::Neither };
    let power = if data {
        let hits = pixels.clone().filter(|(x, r)| miss(x, r) == Miss::Neither);
        let (sum, count) = hits.fold((0.0, 0usize), |(sum, count), (_, r)| {
            let finite = r.iter().filter(|v| v.is_finite());
            (sum + finite.map(|v| square(*v)).sum::<f64>(), count + 1)
        });
        sum / count.max(1) as f64
    } else {
        0.0
    };
    let pixel = |(x, r): (&[f32], &[f32])| {
        match miss(x, r) {
            Miss::Neither => {}
            Miss::Both => return 0.0,
            Miss::Test | Miss::Reference => return f64::NAN,
        }
        let pairs = || x.iter().zip(r);
        if test.meaning == Meaning::Ids {
            return f64::from(u8::from(pairs().any(|(x, r)| x.to_bits() != r.to_bits())));
        }
        let d2 = |x: f32, r: f32| (f64::from(x) - f64::from(r)).powi(2);
        let sum: f64 = match test.meaning {
            Meaning::Light => {
                let terms = pairs().map(|(x, r)| d2(*x, *r) / (square(*r) + ValueErrors::EPSILON));
                terms.sum::<f64>() / channels as f64
            }
            _ => match pairs().map(|(x, r)| d2(*x, *r)).sum::<f64>() {
                0.0 => 0.0,
                sum => sum / power,
            },
        };
        // One infinity alone would give an infinite error, not NaN.
        if pairs().all(|(x, r)| x.is_finite() && r.is_finite()) { sum.sqrt() } else { f64::NAN }
    };
    pixels.map(pixel).collect()
}

/// Position of an error on the logarithmic scale: 0 at the dark end, 1 at the bright end.
pub fn position(error: f64) -> f64 {
    let [low, high] = RANGE;
    (error / low).log10() / (high / low).log10()
}

/// Colour at a position of the scale, clamped to [0, 1]. NaN gives [`NOT_FINITE`].
pub fn color(position: f64) -> [u8; 3] {
    if position.is_nan() {
        return NOT_FINITE;
    }
    let c = colorous::MAGMA.eval_continuous(position.clamp(0.0, 1.0));
    [c.r, c.g, c.b]
}

/// Returns the map of the errors of a layer's pixels as a PNG.
pub fn error_map(test: &PictureLayer, reference: &PictureLayer) -> Vec<u8> {
    colored(errors(test, reference).into_iter().map(position), test.size[0])
}

/// Returns a PNG of positions on the colour scale, row by row.
pub fn colored(positions: impl Iterator<Item = f64>, width: usize) -> Vec<u8> {
    png(&positions.map(color).collect::<Vec<_>>(), width)
}

/// Encodes 8-bit pixels as a PNG file.
pub fn png(pixels: &[[u8; 3]], width: usize) -> Vec<u8> {
    let (across, down) = (width as u32, (pixels.len() / width.max(1)) as u32);
    let image = RgbImage::from_raw(across, down, pixels.as_flattened().to_vec());
    image.map_or_else(Vec::new, |image| png::encode(&image))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn layer(meaning: Meaning, channels: usize, values: &[f32]) -> PictureLayer {
        PictureLayer {
            name: String::new(),
            meaning,
            size: [values.len() / channels, 1],
            origin: [0, 0],
            channels: vec![String::new(); channels],
            values: values.to_vec(),
            half: false,
        }
    }

    #[test]
    fn errors_of_pixels() {
        let light = |values: &[f32]| layer(Meaning::Light, 3, values);
        let nan = f32::NAN;
        let found = errors(
            &light(&[1.0, 1.0, 1.0, 0.5, 0.5, 0.5, nan, 0.0, 0.0]),
            &light(&[0.0, 0.0, 0.0, 0.5, 0.5, 0.5, 0.0, 0.0, 0.0]),
        );
        assert!((found[0] - 10.0).abs() < 1e-9 && found[1] == 0.0 && found[2].is_nan());
        let data = |values: &[f32]| layer(Meaning::Data, 1, values);
        assert_eq!(errors(&data(&[2.0, 2.5]), &data(&[2.0, 2.0])), [0.0, 0.25]);
        assert!(errors(&data(&[f32::INFINITY]), &data(&[1.0]))[0].is_nan());
        // Pixels that miss neither count as errors nor make those of others look small.
        let found = errors(&data(&[2.0, 2.5, 1e30, 1e30]), &data(&[2.0, 2.0, 1e30, 2.0]));
        assert!(found[..3] == [0.0, 0.25, 0.0] && found[3].is_nan(), "{found:?}");
        let ids = |values: &[f32]| layer(Meaning::Ids, 1, values);
        assert_eq!(errors(&ids(&[nan, 1.0]), &ids(&[nan, 2.0])), [0.0, 1.0]);
    }

    #[test]
    fn the_scale_is_monotonic_in_brightness() {
        let light = |p: f64| color(p).iter().map(|c| u32::from(*c)).sum::<u32>();
        for step in 0..20 {
            assert!(light(f64::from(step) / 20.0) < light(f64::from(step + 1) / 20.0));
        }
        assert_eq!(color(f64::NEG_INFINITY), color(0.0));
        assert_eq!(color(position(100.0)), color(1.0));
        assert_eq!(color(position(0.0)), [0, 0, 4]);
        assert_eq!((position(1e-4), position(1e-2), position(1.0)), (0.0, 0.5, 1.0));
        assert_eq!(color(f64::NAN), NOT_FINITE);
    }
}
