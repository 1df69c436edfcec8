//! Exact signs and quotients of determinants over f32 coordinates.
//!
//! A determinant is first computed in f64 with a proved error bound. Integers take over where the
//! bound does not decide. Every f32 is a whole multiple of 2^-149. So sums and products of f32
//! values are integers in that unit: nothing is rounded, overflows or underflows. A product of
//! three differences of f32 stays within the range of f64 too: each difference is 0 or between
//! 2^-149 and 2^129.

use std::cmp::Ordering;

use glam::DVec3;
use num_bigint::{BigInt, Sign};

/// A vector in units of 2^-149.
pub type Integers = [BigInt; 3];

/// Converts `x`, an f32 value, to an integer in units of 2^-149.
pub fn integer(x: f64) -> BigInt {
    let bits = (x as f32).to_bits();
    debug_assert_eq!(f64::from(f32::from_bits(bits)), x);
    let (exponent, fraction) = ((bits >> 23) & 0xff, bits & 0x7f_ffff);
    let magnitude = match exponent {
        0 => BigInt::from(fraction),
        _ => BigInt::from(fraction | 0x80_0000) << (exponent - 1),
    };
    if x < 0.0 { -magnitude } else { magnitude }
}

/// Converts a vector of f32 values to integers in units of 2^-149.
pub fn integers(v: DVec3) -> Integers {
    v.to_array().map(integer)
}

/// Returns `a - b` without rounding.
pub fn difference(a: &Integers, b: &Integers) -> Integers {
    std::array::from_fn(|k| &a[k] - &b[k])
}

/// Returns `a . (b x c)` without rounding.
pub fn determinant(a: &Integers, b: &Integers, c: &Integers) -> BigInt {
    &a[0] * (&b[1] * &c[2] - &b[2] * &c[1])
        + &a[1] * (&b[2] * &c[0] - &b[0] * &c[2])
        + &a[2] * (&b[0] * &c[1] - &b[1] * &c[0])
}

/// A determinant in f64 with a bound on its error.
#[derive(Debug, Clone, Copy)]
pub struct BoundedDeterminant {
    /// Value of the determinant, rounded.
    pub value: f64,
    /// Bound on the distance between `value` and the exact determinant.
    pub error: f64,
}

impl BoundedDeterminant {
    /// Computes `a . (b x c)`. Each coordinate is an f32 or the rounded difference of two f32.
    ///
    /// The differences, products and sums of one term round seven times in all. Shewchuk 1997,
    /// section 4.3, bounds the error by (7 + 56u)u times the permanent, u = 2^-53. This bound uses
    /// 8u, which leaves room for the rounding of the permanent itself. If the permanent is 0, the
    /// determinant is exactly 0.
    #[inline(always)]
    pub fn of(a: DVec3, b: DVec3, c: DVec3) -> Self {
        let value = a.x * (b.y * c.z - b.z * c.y)
            + a.y * (b.z * c.x - b.x * c.z)
            + a.z * (b.x * c.y - b.y * c.x);
        let permanent = a.x.abs() * ((b.y * c.z).abs() + (b.z * c.y).abs())
            + a.y.abs() * ((b.z * c.x).abs() + (b.x * c.z).abs())
            + a.z.abs() * ((b.x * c.y).abs() + (b.y * c.x).abs());
        Self { value, error: 4.0 * f64::EPSILON * permanent }
    }

    /// Returns the sign of the exact determinant, or `None` if the bound does not decide the sign.
    #[inline(always)]
    pub fn sign(&self) -> Option<Ordering> {
        if self.value > self.error {
            Some(Ordering::Greater)
        } else if self.value < -self.error {
            Some(Ordering::Less)
        } else if self.error == 0.0 {
            Some(Ordering::Equal)
        } else {
            None
        }
    }
}

/// Returns the sign of an integer, as its ordering to 0.
pub fn sign(x: &BigInt) -> Ordering {
    match x.sign() {
        Sign::Minus => Ordering::Less,
        Sign::NoSign => Ordering::Equal,
        Sign::Plus => Ordering::Greater,
    }
}

/// An exact quotient of integers. The denominator is positive; the fraction need not be reduced.
/// Comparisons are of values: 1/2 equals 2/4.
#[derive(Debug, Clone)]
pub struct Fraction {
    numerator: BigInt,
    denominator: BigInt,
}

impl Fraction {
    /// Returns the fraction `numerator / denominator`. The denominator must not be 0.
    pub fn new(numerator: BigInt, denominator: BigInt) -> Self {
        if denominator.sign() == Sign::Minus {
            Self { numerator: -numerator, denominator: -denominator }
        } else {
            Self { numerator, denominator }
        }
    }

    /// Returns the f32 value `x` as a fraction.
    pub fn of(x: f64) -> Self {
        Self { numerator: integer(x), denominator: BigInt::from(1) << 149 }
    }

    /// Converts to f64, to within two ulp. Values outside the range become 0 or infinite.
    pub fn to_f64(&self) -> f64 {
        let shift = 64 + self.denominator.bits() as i64 - self.numerator.bits() as i64;
        let quotient = if shift >= 0 {
            (&self.numerator << shift as u64) / &self.denominator
        } else {
            &self.numerator / (&self.denominator << shift.unsigned_abs())
        };
        // Between 2^63 and 2^65; an i128 holds it.
        let quotient = i128::try_from(quotient).unwrap_or(0) as f64;
        // Scale in two steps: 2^shift alone may leave the range of f64.
        let half = shift / 2;
        quotient * 2f64.powi(-half as i32) * 2f64.powi((half - shift) as i32)
    }
}

impl PartialEq for Fraction {
    fn eq(&self, other: &Self) -> bool {
        self.cmp(other) == Ordering::Equal
    }
}

impl Eq for Fraction {}

impl Ord for Fraction {
    fn cmp(&self, other: &Self) -> Ordering {
        (&self.numerator * &other.denominator).cmp(&(&other.numerator * &self.denominator))
    }
}

impl PartialOrd for Fraction {
    fn partial_cmp(&self, other: &Self) -> Option<Ordering> {
        Some(self.cmp(other))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// Finite f32 values, every exponent equally likely.
    fn any_f32() -> impl Strategy<Value = f64> {
        any::<u32>().prop_map(|bits| {
            let x = f32::from_bits(bits);
            if x.is_finite() { f64::from(x) } else { 1.0 }
        })
    }

    fn any_vector() -> impl Strategy<Value = DVec3> {
        prop::array::uniform3(any_f32()).prop_map(DVec3::from)
    }

    /// Three vectors that lie nearly in one plane.
    fn near_plane() -> impl Strategy<Value = [DVec3; 3]> {
        let unit = || prop::array::uniform3(-1f32..1.0);
        (unit(), unit(), -2f32..2.0, -2f32..2.0).prop_map(|(a, b, s, t)| {
            let c = [0, 1, 2].map(|k| a[k] * s + b[k] * t);
            [a, b, c].map(|v| DVec3::from(v.map(f64::from)))
        })
    }

    #[test]
    fn equal_values_are_equal_fractions() {
        let fraction = |a: i32, b: i32| Fraction::new(a.into(), b.into());
        assert_eq!(fraction(1, 2), fraction(-2, -4));
        assert_ne!(fraction(1, 2), fraction(2, 3));
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(4000))]
        #[test]
        fn an_estimate_that_decides_is_right(
            [a, b, c] in prop_oneof![near_plane(), prop::array::uniform3(any_vector())], o in any_vector(),
        ) {
            for o in [DVec3::ZERO, o] {
                let estimate = BoundedDeterminant::of(a, b - o, c - o);
                let o = integers(o);
                let (b, c) = (difference(&integers(b), &o), difference(&integers(c), &o));
                let exact = determinant(&integers(a), &b, &c);
                if let Some(found) = estimate.sign() {
                    prop_assert_eq!(found, sign(&exact));
                }
                let unit = Fraction::new(exact, BigInt::from(1) << 447u32).to_f64();
                prop_assert!((unit - estimate.value).abs() <= estimate.error * (1.0 + 1e-10));
            }
        }

        #[test]
        fn fractions_are_ordered_as_their_values(a in any_f32(), b in any_f32()) {
            prop_assert_eq!(Fraction::of(a).cmp(&Fraction::of(b)), a.total_cmp(&b).then(Ordering::Equal)
                .min(if a == b { Ordering::Equal } else { Ordering::Greater }));
            prop_assert_eq!(Fraction::of(a).to_f64(), a);
            if b != 0.0 {
                let quotient = Fraction::new(integer(a), integer(b)).to_f64();
                prop_assert!((quotient - a / b).abs() <= 4.0 * f64::EPSILON * (a / b).abs());
            }
        }
    }
}
