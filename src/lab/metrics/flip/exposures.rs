//! The exposures at which HDR-FLIP compares two pictures.

use crate::math::luminance;
use glam::DVec3;

/// Tone mapped value of a bright pixel that is not yet white: that of the authors' code.
const BRIGHT: f64 = 0.85;

/// Least median of a reference.
const DARKEST: f64 = f32::EPSILON as f64;

/// Coefficients of the ACES curve (a x^2 + b x) / (c x^2 + d x + e) of Narkowicz 2016, without its
/// exposure of 0.6.
const ACES: [f64; 5] = [0.36 * 2.51, 0.6 * 0.03, 0.36 * 2.43, 0.6 * 0.59, 0.14];

/// Tone maps light by the ACES curve, clamped to [0, 1]. Negative light counts as 0.
pub fn aces(light: DVec3) -> DVec3 {
    let [a, b, c, d, e] = ACES;
    let x = light.max(DVec3::ZERO);
    ((x * x * a + x * b) / (x * x * c + x * d + DVec3::splat(e))).clamp(DVec3::ZERO, DVec3::ONE)
}

/// A range of exposures in stops. The first maps the brightest pixel to [`BRIGHT`], the last the
/// median.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Exposures {
    start: f64,
    stop: f64,
    count: u32,
}

impl Exposures {
    /// Exposures for a reference in linear RGB. Negative light counts as 0.
    ///
    /// A median below [`DARKEST`] counts as that, as in the authors' code. A reference that is
    /// nowhere brighter gets one exposure of 0 stops; the authors' code refuses it.
    pub fn of(reference: &[[f32; 3]]) -> Self {
        let light = |p: &[f32; 3]| luminance(p.map(|value| value.max(0.0)));
        let mut all: Vec<f64> = reference.iter().map(light).collect();
        let most = all.iter().copied().fold(0.0, f64::max);
        if most <= DARKEST {
            return Self { start: 0.0, stop: 0.0, count: 1 };
        }
        let middle = all.len() / 2;
        let median = all.select_nth_unstable_by(middle, f64::total_cmp).1.max(DARKEST);
        let bright = inverse_aces(BRIGHT);
        let (start, stop) = ((bright / most).log2(), (bright / median).log2());
        Self { start, stop, count: (stop - start).ceil().max(2.0) as u32 }
    }

    /// Factors on the light, one for each exposure.
    pub fn gains(self) -> impl Iterator<Item = f64> {
        let step = (self.stop - self.start) / f64::from(self.count.max(2) - 1);
        (0..self.count).map(move |i| (self.start + f64::from(i) * step).exp2())
    }
}

/// The light that the ACES curve maps to `t`.
fn inverse_aces(t: f64) -> f64 {
    let [a, b, c, d, e] = ACES;
    let (a, b, c) = (a - t * c, b - t * d, -t * e);
    let half = -0.5 * b / a;
    half + (half * half - c / a).sqrt()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_inverse_inverts_the_curve() {
        let x = inverse_aces(BRIGHT);
        assert!((aces(DVec3::splat(x)).x - BRIGHT).abs() < 1e-12);
        assert_eq!(aces(DVec3::splat(-1.0)), DVec3::ZERO);
        assert_eq!(aces(DVec3::splat(1e6)), DVec3::ONE);
    }

    #[test]
    fn exposures_run_from_the_brightest_pixel_to_the_median() {
        let gray = |v: f32| [v; 3];
        let exposures = Exposures::of(&[gray(16.0), gray(1.0), gray(0.25)]);
        let gains: Vec<f64> = exposures.gains().collect();
        assert_eq!(gains.len(), 4);
        assert!((gains[3] / gains[0] - 16.0).abs() < 1e-6);
        assert!((gains[0] * 16.0 - inverse_aces(BRIGHT)).abs() < 1e-6);
    }

    /// Start and stop are those of flip-evaluator 1.7 for a brightest pixel of 4.
    #[test]
    fn references_with_black_pixels_have_exposures() {
        let half = [[0.0; 3], [0.0; 3], [0.0; 3], [4.0; 3], [1.0; 3]];
        let found = Exposures::of(&half);
        assert!((found.start + 0.916_703).abs() < 1e-5, "{found:?}");
        assert!((found.stop - 24.083_297).abs() < 1e-5 && found.count == 25, "{found:?}");
        for dark in [[[0.0; 3]; 4], [[1e-9; 3]; 4], [[-1.0; 3]; 4]] {
            assert_eq!(Exposures::of(&dark).gains().collect::<Vec<_>>(), [1.0]);
        }
        assert_eq!(Exposures::of(&[]).gains().count(), 1);
        assert_eq!(Exposures::of(&[[0.5; 3]; 4]).gains().count(), 2);
    }

    #[test]
    fn negative_light_counts_as_black() {
        let red = |v: f32| [v, 0.5, 2.0];
        assert_eq!(Exposures::of(&[red(-3.0); 3]), Exposures::of(&[red(0.0); 3]));
    }
}
