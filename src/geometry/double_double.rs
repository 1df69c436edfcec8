//! Double-double arithmetic: sums and products of f64 with some 106 bits.
//!
//! Dekker 1971, "A floating-point technique for extending the available precision". The algorithms
//! and their bounds are those of Joldes, Muller and Popescu 2017, "Tight and rigorous error bounds
//! for basic building blocks of double-word arithmetic".

use std::ops::{Add, Mul, Sub};

use glam::DVec3;

/// The unevaluated sum `hi + lo`, with |lo| <= ulp(hi) / 2.
#[derive(Debug, Clone, Copy)]
pub struct DoubleDouble {
    hi: f64,
    lo: f64,
}

impl DoubleDouble {
    /// a + b, exactly (Knuth's TwoSum).
    pub fn sum(a: f64, b: f64) -> Self {
        let hi = a + b;
        let shadow = hi - a;
        Self { hi, lo: (a - (hi - shadow)) + (b - shadow) }
    }

    /// a b, exactly unless it underflows or overflows.
    pub fn product(a: f64, b: f64) -> Self {
        let hi = a * b;
        Self { hi, lo: a.mul_add(b, -hi) }
    }

    /// The square root of a number that is not negative, with some 104 bits (SQRTDWtoDW of Lefevre,
    /// Louvet, Muller, Picot and Rideau 2023, "Accurate calculation of Euclidean norms using
    /// double-word arithmetic", without its last rounding).
    pub fn sqrt(self) -> Self {
        if self.hi <= 0.0 {
            return Self { hi: 0.0, lo: 0.0 };
        }
        let root = self.hi.sqrt();
        let rest = root.mul_add(-root, self.hi) + self.lo;
        quick(root, rest / (2.0 * root))
    }

    /// The value rounded to f64, almost to nearest.
    pub fn value(self) -> f64 {
        self.hi
    }
}

impl Add for DoubleDouble {
    type Output = Self;
    /// Relative error below 3 * 2^-106 (AccurateDWPlusDW).
    fn add(self, other: Self) -> Self {
        let (s, t) = (Self::sum(self.hi, other.hi), Self::sum(self.lo, other.lo));
        let v = quick(s.hi, s.lo + t.hi);
        quick(v.hi, t.lo + v.lo)
    }
}

impl Sub for DoubleDouble {
    type Output = Self;
    fn sub(self, other: Self) -> Self {
        self + Self { hi: -other.hi, lo: -other.lo }
    }
}

impl Mul for DoubleDouble {
    type Output = Self;
    /// Relative error below 8 * 2^-106 (DWTimesDW).
    fn mul(self, other: Self) -> Self {
        let high = Self::product(self.hi, other.hi);
        quick(high.hi, high.lo + (self.hi * other.lo + self.lo * other.hi))
    }
}

/// a + b, exactly for |a| >= |b|.
fn quick(a: f64, b: f64) -> DoubleDouble {
    let hi = a + b;
    DoubleDouble { hi, lo: b - (hi - a) }
}

/// A vector of three double-double coordinates.
#[derive(Debug, Clone, Copy)]
pub struct DoubleDouble3([DoubleDouble; 3]);

impl DoubleDouble3 {
    /// `to - from`, exactly.
    pub fn between(from: DVec3, to: DVec3) -> Self {
        Self([0, 1, 2].map(|axis| DoubleDouble::sum(to[axis], -from[axis])))
    }

    /// Vector (cross) product, with some 106 bits.
    pub fn cross(&self, other: &Self) -> Self {
        let ([a, b, c], [x, y, z]) = (self.0, other.0);
        Self([b * z - c * y, c * x - a * z, a * y - b * x])
    }

    /// Scalar (dot) product, with some 106 bits.
    pub fn dot(&self, other: &Self) -> DoubleDouble {
        let ([a, b, c], [x, y, z]) = (self.0, other.0);
        a * x + b * y + c * z
    }

    /// Length of the vector, with some 104 bits.
    pub fn length(&self) -> DoubleDouble {
        self.dot(self).sqrt()
    }

    /// The coordinates rounded to f64, almost to nearest.
    pub fn value(&self) -> DVec3 {
        DVec3::from(self.0.map(DoubleDouble::value))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn small_terms_survive_beside_large_ones() {
        let big = DoubleDouble::sum(1e16, 0.25);
        assert_eq!((big - DoubleDouble::sum(1e16, 0.0)).value(), 0.25);
        // (1 + 2^-40)^2 - 1 - 2^-39 = 2^-80
        let x = 1.0 + 2f64.powi(-40);
        let square = DoubleDouble::sum(x, 0.0) * DoubleDouble::sum(x, 0.0);
        assert_eq!((square - DoubleDouble::sum(1.0, 2f64.powi(-39))).value(), 2f64.powi(-80));
        assert_eq!((square.sqrt() - DoubleDouble::sum(1.0, 0.0)).value(), 2f64.powi(-40));
        let two = DoubleDouble::sum(2.0, 0.0);
        assert!((two.sqrt() * two.sqrt() - two).value().abs() < 2f64.powi(-100));
        assert_eq!(DoubleDouble::sum(0.0, 0.0).sqrt().value(), 0.0);
    }
}
