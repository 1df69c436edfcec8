//! Small numeric helpers that the standard library lacks.

use glam::{DMat3, DVec3};

/// Returns an upper bound of the condition number of a matrix, by sums of the magnitudes in its
/// rows. Infinite or NaN for a singular matrix.
pub fn condition(matrix: &DMat3) -> f64 {
    row_norm(matrix) * row_norm(&matrix.inverse())
}

/// Returns the largest sum of magnitudes in a row: the factor by which a matrix can enlarge the
/// largest coordinate of a vector.
pub fn row_norm(matrix: &DMat3) -> f64 {
    (absolute(matrix) * DVec3::ONE).max_element()
}

/// Returns the magnitudes of the entries.
pub fn absolute(matrix: &DMat3) -> DMat3 {
    DMat3::from_cols(matrix.x_axis.abs(), matrix.y_axis.abs(), matrix.z_axis.abs())
}

/// Returns `x^n` for finite x, n >= 0, with 0^0 = 1. Relative error below 1e-7, or absolute error
/// below 1e-38 where the result is subnormal.
///
/// Computed in f64 without branches, from bits and polynomials: log2 by the series of atanh, 2^f by
/// Taylor's series. So a loop over lanes compiles to SIMD code, and every machine computes the same
/// bits. `pow` of libm differs between C libraries.
#[inline(always)]
pub fn pow(x: f64, n: f32) -> f32 {
    let bits = x.to_bits();
    let exponent = (bits >> 52) as i32 - 1023;
    let mantissa = f64::from_bits((bits & 0x000f_ffff_ffff_ffff) | 0x3ff0_0000_0000_0000);
    let high = mantissa > std::f64::consts::SQRT_2;
    let m = if high { mantissa * 0.5 } else { mantissa };
    let e = f64::from(exponent) + if high { 1.0 } else { 0.0 };
    let s = (m - 1.0) / (m + 1.0);
    let z = s * s;
    // 2 s (1 + z/3 + z^2/5 + ...), |z| < 0.0295.
    let p = 1.0 / 13.0 + z * (1.0 / 15.0);
    let p = 1.0 / 9.0 + z * (1.0 / 11.0 + z * p);
    let p = 1.0 + z * (1.0 / 3.0 + z * (1.0 / 5.0 + z * (1.0 / 7.0 + z * p)));
    let log2 = e + s * p * (2.0 * std::f64::consts::LOG2_E);
    let y = (log2 * f64::from(n)).clamp(-1000.0, 1000.0);
    // Adding and subtracting 1.5 * 2^52 rounds to the nearest integer.
    const ROUND: f64 = 6_755_399_441_055_744.0;
    let k = (y + ROUND) - ROUND;
    let f = (y - k) * std::f64::consts::LN_2;
    let q = 1.0 / 5040.0 + f * (1.0 / 40320.0 + f * (1.0 / 362_880.0));
    let q = 1.0 / 24.0 + f * (1.0 / 120.0 + f * (1.0 / 720.0 + f * q));
    let q = 1.0 + f * (1.0 + f * (0.5 + f * (1.0 / 6.0 + f * q)));
    let scale = f64::from_bits(((k as i32 + 1023) as u64) << 52);
    let power = (q * scale) as f32;
    let at_zero = if n == 0.0 { 1.0 } else { 0.0 };
    if x > 0.0 { power } else { at_zero }
}

/// Returns the angle of the finite vector (x, y) from the x axis, in [-pi, pi], as `f32::atan2`.
/// Absolute error below 4e-7. A negative zero x counts as 0: atan2(0, -0) is 0.
///
/// Has no branches, and gives the same bits on every machine, as [`pow`] does. The polynomial is
/// from `atanf` in the Cephes library (Moshier 1989).
#[inline(always)]
pub fn atan2(y: f32, x: f32) -> f32 {
    use std::f32::consts::{FRAC_PI_2, FRAC_PI_4, PI};
    let (small, large) = (x.abs().min(y.abs()), x.abs().max(y.abs()));
    let ratio = if large > 0.0 { small / large } else { 0.0 };
    // Above tan(pi / 8), the angle is pi / 4 plus a small one.
    let wide = ratio > 0.414_213_57;
    let a = if wide { (ratio - 1.0) / (ratio + 1.0) } else { ratio };
    let z = a * a;
    let p = 0.080_537_446 * z - 0.138_776_86;
    let p = (p * z + 0.199_777_1) * z - 0.333_329_5;
    let angle = a + a * z * p + if wide { FRAC_PI_4 } else { 0.0 };
    let angle = if y.abs() > x.abs() { FRAC_PI_2 - angle } else { angle };
    let angle = if x < 0.0 { PI - angle } else { angle };
    angle.copysign(y)
}

/// Returns the angle of the vector (x, y) from the x axis for y >= 0, in [0, pi], as
/// `f64::atan2(y, x)`. Absolute error below 1e-10, and relative error below 1e-10 for small angles.
/// Returns 0 for the zero vector.
///
/// Has no branches, and gives the same bits on every machine, as [`pow`] does. The polynomial
/// interpolates atan(t) / t at the Chebyshev nodes of t^2 in [0, tan(pi / 8)^2].
#[inline(always)]
pub fn angle(y: f64, x: f64) -> f64 {
    use std::f64::consts::{FRAC_PI_2, FRAC_PI_4, PI};
    let away = if x < 0.0 { -x } else { x };
    let steep = y > away;
    let (small, large) = if steep { (away, y) } else { (y, away) };
    // Above tan(pi / 8), the angle is pi / 4 plus a small one.
    let wide = small > 0.414_213_562_373_095_03 * large;
    let (rise, run) = if wide { (small - large, small + large) } else { (small, large) };
    let t = if large > 0.0 { rise / run } else { 0.0 };
    let z = t * t;
    let p = -0.084_561_927_835_227_85 + z * 0.047_073_479_234_750_78;
    let p = -0.142_815_887_711_887_38 + z * (0.110_404_892_090_018_9 + z * p);
    let p = -0.333_333_320_976_087_03 + z * (0.199_998_838_564_986_13 + z * p);
    let angle = t * (0.999_999_999_978_398_7 + z * p) + if wide { FRAC_PI_4 } else { 0.0 };
    let angle = if steep { FRAC_PI_2 - angle } else { angle };
    if x < 0.0 { PI - angle } else { angle }
}

/// Returns `a - b`.
#[inline(always)]
pub fn sub(a: [f64; 3], b: [f64; 3]) -> [f64; 3] {
    [a[0] - b[0], a[1] - b[1], a[2] - b[2]]
}

/// Returns the dot product.
#[inline(always)]
pub fn dot(a: [f64; 3], b: [f64; 3]) -> f64 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

/// Returns the cross product.
#[inline(always)]
pub fn cross(a: [f64; 3], b: [f64; 3]) -> [f64; 3] {
    [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
}

/// Luminance of linear RGB with the primaries of ITU-R BT.709.
#[inline(always)]
pub fn luminance([r, g, b]: [f32; 3]) -> f64 {
    0.2126 * f64::from(r) + 0.7152 * f64::from(g) + 0.0722 * f64::from(b)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn pow_agrees_with_libm(x in 1e-6f64..1.5, n in 0f32..2000.0) {
            let exact = x.powf(f64::from(n));
            let error = (f64::from(pow(x, n)) - exact).abs();
            prop_assert!(error <= 1e-7 * exact + 1e-38 || exact > f64::from(f32::MAX), "{x}^{n}");
        }
    }

    proptest! {
        #[test]
        fn atan2_agrees_with_libm(x in -2f32..2.0, y in -2f32..2.0, shrink in 0..30) {
            let y = y / (1u32 << shrink) as f32;
            for (y, x) in [(y, x), (x, y)] {
                let exact = f64::from(y).atan2(f64::from(x));
                prop_assert!((f64::from(atan2(y, x)) - exact).abs() <= 4e-7, "{y} {x}");
            }
        }
    }

    proptest! {
        #[test]
        fn angle_agrees_with_libm(x in -2f64..2.0, y in 0f64..2.0, shrink in 0..60) {
            let small = y / (1u64 << shrink) as f64;
            for (y, x) in [(small, x), (x.abs(), small), (x.abs(), -small), (y, x)] {
                let exact = y.atan2(x);
                prop_assert!((angle(y, x) - exact).abs() <= 1e-10 * exact.min(1.0), "{y} {x}");
            }
        }
    }

    #[test]
    fn angle_on_the_axes() {
        use std::f64::consts::{FRAC_PI_2, PI};
        for (y, x, exact) in [(0.0, 1.0, 0.0), (1e-200, 0.0, FRAC_PI_2), (0.0, -1.0, PI)] {
            assert_eq!(angle(y, x), exact);
        }
        assert_eq!(angle(0.0, 0.0), 0.0);
    }

    #[test]
    fn atan2_on_the_axes() {
        use std::f32::consts::{FRAC_PI_2, PI};
        let cases = [
            (0.0, 1.0, 0.0),
            (1.0, 0.0, FRAC_PI_2),
            (-1.0, 0.0, -FRAC_PI_2),
            (0.0, -1.0, PI),
            (-0.0, -1.0, -PI),
            (0.0, 0.0, 0.0),
        ];
        for (y, x, angle) in cases {
            assert_eq!(atan2(y, x), angle);
        }
    }

    #[test]
    fn pow_at_zero_one_and_huge_exponents() {
        assert_eq!(pow(0.0, 0.0), 1.0);
        assert_eq!(pow(0.0, 1e-3), 0.0);
        assert_eq!(pow(0.0, 5.0), 0.0);
        assert_eq!(pow(1.0, 1e30), 1.0);
        assert_eq!(pow(0.5, 0.0), 1.0);
        assert_eq!(pow(0.999, 1e30), 0.0);
    }
}
