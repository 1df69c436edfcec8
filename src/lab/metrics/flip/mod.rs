//! FLIP: the visible difference between two pictures that alternate at the same place.
//!
//! - LDR-FLIP: Andersson et al. 2020, "FLIP: A Difference Evaluator for Alternating Images", with
//!   the separable filters of the authors' version 1.2 and later.
//! - HDR-FLIP: Andersson et al. 2021, "Visualizing Errors in Rendered High Dynamic Range Images".
//!
//! Constants are taken from the papers and the authors' code (github.com/NVlabs/flip). Tests
//! compare the results with the authors' package. The viewer sits 0.7 m from a screen that is 0.7 m
//! wide and has 3840 pixels across.

mod color;
mod exposures;

use glam::{DVec3, dvec3};

use super::plane::{ChannelPlane, gaussian};
use crate::parallel;
use color::{Spaces, hyab};
use exposures::Exposures;

/// Pixels per degree of visual angle.
const PIXELS_PER_DEGREE: f64 = 0.7 * (3840.0 / 0.7) * std::f64::consts::PI / 180.0;
/// Exponent of a colour difference.
const QC: f64 = 0.7;
/// Share of the largest colour difference up to which errors lie between 0 and [`PT`].
const PC: f64 = 0.4;
/// Error of a colour difference at the share [`PC`].
const PT: f64 = 0.95;
/// Width of an edge or point in degrees.
const FEATURE: f64 = 0.082;
/// Exponent of a feature difference.
const QF: f64 = 0.5;

/// Parameters (a, b) of the contrast sensitivity of the achromatic, the red-green and the
/// blue-yellow channel.
///
/// The sensitivity is a sum of Gaussians a sqrt(pi / b) exp(-pi^2 x^2 / b), x in degrees.
const ACHROMATIC: (f64, f64) = (1.0, 0.0047);
const RED_GREEN: (f64, f64) = (1.0, 0.0053);
const BLUE_YELLOW: [(f64, f64); 2] = [(34.1, 0.04), (13.5, 0.025)];

/// LDR-FLIP of each pixel, in [0, 1], for two pictures in linear RGB. Values are clamped to [0, 1].
pub fn ldr(test: &[[f32; 3]], reference: &[[f32; 3]], width: usize) -> Vec<f64> {
    let linear = |p: &[f32; 3]| DVec3::from(p.map(f64::from)).clamp(DVec3::ZERO, DVec3::ONE);
    let planes = |pixels: &[[f32; 3]]| Filtered::new(pixels, width, linear);
    difference(&planes(test), &planes(reference))
}

/// HDR-FLIP of each pixel: the largest LDR-FLIP over several exposures, tone mapped by ACES.
///
/// At the first exposure the brightest pixel of the reference is tone mapped to 0.85, at the last
/// its median. Negative values count as 0.
pub fn hdr(test: &[[f32; 3]], reference: &[[f32; 3]], width: usize) -> Vec<f64> {
    let mut worst = vec![0.0; test.len()];
    for gain in Exposures::of(reference).gains() {
        let mapped = |p: &[f32; 3]| exposures::aces(DVec3::from(p.map(f64::from)) * gain);
        let planes = |pixels: &[[f32; 3]]| Filtered::new(pixels, width, mapped);
        let map = difference(&planes(test), &planes(reference));
        worst.iter_mut().zip(map).for_each(|(worst, value)| *worst = value.max(*worst));
    }
    worst
}

/// Filtered colours and features of a picture, which FLIP compares.
struct Filtered {
    /// Colours filtered by contrast sensitivity, in CIELAB with the Hunt effect.
    colors: Vec<DVec3>,
    /// Strength of edges and of points in each pixel.
    features: Vec<[f64; 2]>,
}

impl Filtered {
    fn new<T: Sync>(
        pixels: &[T],
        width: usize,
        linear: impl Fn(&T) -> DVec3 + Sync + Send,
    ) -> Self {
        let spaces = Spaces::new();
        let opponent = parallel::values(pixels.len(), |i| spaces.opponent(linear(&pixels[i])));
        let plane = |axis: usize| ChannelPlane::map(&opponent, width, move |p| p[axis]);
        let lightness = plane(0);
        let [y, cx] = [(&lightness, ACHROMATIC), (&plane(1), RED_GREEN)].map(|(plane, (a, b))| {
            let kernel = normalised(sensitivity(a, b));
            plane.convolved(&kernel, &kernel).values
        });
        let cz = blue_yellow(&plane(2));
        let color = |i: usize| spaces.hunt_lab(spaces.clamped_rgb(dvec3(y[i], cx[i], cz[i])));
        Self { colors: parallel::values(pixels.len(), color), features: features(&lightness) }
    }
}

/// Radius of the contrast filters in pixels: 3 standard deviations of the widest.
fn radius() -> usize {
    let widest = BLUE_YELLOW[0].1;
    let deviation = (widest / (2.0 * std::f64::consts::PI.powi(2))).sqrt();
    (3.0 * deviation * PIXELS_PER_DEGREE).ceil() as usize
}

/// One-dimensional weights exp(-pi^2 x^2 / b) times the root of a sqrt(pi / b). Their product along
/// x and y is the filter in 2D.
fn sensitivity(a: f64, b: f64) -> Vec<f64> {
    let pi = std::f64::consts::PI;
    let radius = radius() as i32;
    let at = |i: i32| {
        let x = f64::from(i) / PIXELS_PER_DEGREE;
        (a * (pi / b).sqrt()).sqrt() * (-pi * pi * x * x / b).exp()
    };
    (-radius..=radius).map(at).collect()
}

fn normalised(weights: Vec<f64>) -> Vec<f64> {
    let sum: f64 = weights.iter().sum();
    weights.into_iter().map(|w| w / sum).collect()
}

/// Filters the blue-yellow channel by a sum of two Gaussians. The sum is not separable, but each
/// Gaussian is.
fn blue_yellow(plane: &ChannelPlane) -> Vec<f64> {
    let kernels = BLUE_YELLOW.map(|(a, b)| sensitivity(a, b));
    let sums = kernels.each_ref().map(|kernel| kernel.iter().sum::<f64>());
    let whole = sums[0].hypot(sums[1]);
    let [one, two] = kernels.map(|kernel| {
        let kernel: Vec<f64> = kernel.iter().map(|w| w / whole).collect();
        plane.convolved(&kernel, &kernel).values
    });
    one.iter().zip(two).map(|(a, b)| a + b).collect()
}

/// Lengths of the first and second derivatives of the lightness along x and y, for each pixel.
fn features(lightness: &ChannelPlane) -> Vec<[f64; 2]> {
    let gray = ChannelPlane::map(&lightness.values, lightness.width, |y| (y + 16.0) / 116.0);
    let deviation = 0.5 * FEATURE * PIXELS_PER_DEGREE;
    let radius = (3.0 * deviation).ceil() as usize;
    let smooth = gaussian(deviation, radius);
    let place = |i: usize| i as f64 - radius as f64;
    let derivative = |weight: &dyn Fn(f64) -> f64| {
        let weights = smooth.iter().enumerate().map(|(i, w)| weight(place(i)) * w);
        balanced(weights.collect())
    };
    let first = derivative(&|x| -x);
    let second = derivative(&|x| x * x / (deviation * deviation) - 1.0);
    let of = |kernel: &[f64]| {
        (gray.convolved(kernel, &smooth).values, gray.convolved(&smooth, kernel).values)
    };
    let ((dx, dy), (ddx, ddy)) = (of(&first), of(&second));
    let lengths = (0..dx.len()).map(|i| [dx[i].hypot(dy[i]), ddx[i].hypot(ddy[i])]);
    lengths.collect()
}

/// Scales positive weights to the sum 1 and negative weights to the sum -1.
fn balanced(weights: Vec<f64>) -> Vec<f64> {
    let sum = |sign: f64| weights.iter().map(|w| (sign * w).max(0.0)).sum::<f64>();
    let (above, below) = (sum(1.0), sum(-1.0));
    weights.iter().map(|w| w / if *w > 0.0 { above } else { below }).collect()
}

/// The FLIP error of each pixel.
fn difference(test: &Filtered, reference: &Filtered) -> Vec<f64> {
    let spaces = Spaces::new();
    let (green, blue) = (spaces.hunt_lab(DVec3::Y), spaces.hunt_lab(DVec3::Z));
    let largest = hyab(green, blue).powf(QC);
    let knee = PC * largest;
    let pixel = |i: usize| {
        let color = hyab(test.colors[i], reference.colors[i]).powf(QC);
        let color = match color < knee {
            true => color * PT / knee,
            false => PT + (color - knee) / (largest - knee) * (1.0 - PT),
        };
        let [edge, point] = [0, 1].map(|k| (test.features[i][k] - reference.features[i][k]).abs());
        let feature = (edge.max(point) / std::f64::consts::SQRT_2).powf(QF);
        color.powf(1.0 - feature)
    };
    parallel::values(test.colors.len(), pixel)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn equal_pictures_have_no_error() {
        let picture: Vec<[f32; 3]> = (0..100).map(|i| [i as f32 / 50.0, 0.3, 0.9]).collect();
        assert_eq!(ldr(&picture, &picture, 10), [0.0; 100]);
        assert_eq!(hdr(&picture, &picture, 10), [0.0; 100]);
    }

    #[test]
    fn black_against_white_has_the_error_of_their_lightness() {
        // Without edges only the colour difference counts: 100 in L.
        let (black, white) = ([[0.0; 3]; 64], [[1.0; 3]; 64]);
        let spaces = Spaces::new();
        let largest = hyab(spaces.hunt_lab(DVec3::Y), spaces.hunt_lab(DVec3::Z)).powf(QC);
        let color = 100f64.powf(QC);
        let expected = PT + (color - PC * largest) / (largest - PC * largest) * (1.0 - PT);
        for value in ldr(&black, &white, 8) {
            assert!((value - expected).abs() < 1e-9, "{value} {expected}");
        }
    }

    #[test]
    fn filters_have_the_widths_of_the_authors_code() {
        assert_eq!((radius(), (1.5 * FEATURE * PIXELS_PER_DEGREE).ceil()), (10, 9.0));
        assert!((PIXELS_PER_DEGREE - 67.02).abs() < 0.01);
    }
}
