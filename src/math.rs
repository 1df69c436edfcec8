//! Small numeric helpers that the standard library lacks.

/// `x^n` for x, n >= 0, with 0^0 = 1. Relative error below 1e-7.
///
/// Computed in f64 without branches, from bits and polynomials: log2 by the series of atanh, 2^f by
/// Taylor's series. So a loop over lanes compiles to SIMD code, and every machine computes the same
/// bits. libm's `pow` differs between C libraries.
#[inline(always)]
pub fn pow(x: f32, n: f32) -> f32 {
    let bits = f64::from(x).to_bits();
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

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn pow_agrees_with_libm(x in 1e-6f32..1.5, n in 0f32..2000.0) {
            let exact = f64::from(x).powf(f64::from(n));
            let error = (f64::from(pow(x, n)) - exact).abs();
            prop_assert!(error <= 1e-7 * exact + 1e-38 || exact > f64::from(f32::MAX), "{x}^{n}");
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
