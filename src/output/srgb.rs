//! The sRGB transfer curve of IEC 61966-2-1, and a table for bytes that avoids the power function.

use std::sync::LazyLock;

/// Encodes a linear value in [0, 1] as sRGB.
pub fn from_linear(x: f64) -> f64 {
    if x <= 0.003_130_8 { 12.92 * x } else { 1.055 * x.powf(1.0 / 2.4) - 0.055 }
}

/// Decodes an sRGB value to a linear one. An odd function, so that negative values of float images
/// survive.
pub fn to_linear(value: f64) -> f64 {
    let x = value.abs();
    let linear = if x <= 0.040_45 { x / 12.92 } else { ((x + 0.055) / 1.055).powf(2.4) };
    linear.copysign(value)
}

/// Returns `from_linear(x)` as a byte, rounded half up, for x in [0, 1]. Returns 0 for NaN.
pub fn byte(x: f64) -> u8 {
    BYTES.lookup(x)
}

static BYTES: LazyLock<Bytes> = LazyLock::new(Bytes::new);

/// Number of bins of [0, 1] in the table. The curve rises by at most 12.92 * 255 = 3295 bytes per
/// unit of x, less than one byte per bin. So the byte increases at most once in a bin.
const BINS: usize = 4096;

/// Table of the values at which the byte increases.
struct Bytes {
    /// Minimum x of each byte; infinity after the last byte.
    min_x: [f64; 257],
    /// The byte at the lower end of each bin.
    first: [u8; BINS + 1],
}

impl Bytes {
    fn new() -> Self {
        let mut min_x = [f64::INFINITY; 257];
        for (byte, min_x) in min_x[..256].iter_mut().enumerate() {
            *min_x = step(byte as u8);
        }
        let mut first = [0; BINS + 1];
        for (bin, first) in first.iter_mut().enumerate() {
            *first = rounded(bin as f64 / BINS as f64);
        }
        Self { min_x, first }
    }

    #[inline(always)]
    fn lookup(&self, x: f64) -> u8 {
        let first = self.first[((x * BINS as f64) as usize).min(BINS)];
        first + u8::from(x >= self.min_x[usize::from(first) + 1])
    }
}

/// Computes a byte without the table.
fn rounded(x: f64) -> u8 {
    (255.0 * from_linear(x) + 0.5) as u8
}

/// Returns the minimum x for which [`rounded`] returns `byte`.
fn step(byte: u8) -> f64 {
    if byte == 0 {
        return 0.0;
    }
    let y = (f64::from(byte) - 0.5) / 255.0;
    let mut x = if y <= 0.040_45 { y / 12.92 } else { ((y + 0.055) / 1.055).powf(2.4) };
    // The inverse may be off by some ulp. Step from below to the first x of the byte.
    while rounded(x) >= byte {
        x = f64::from_bits(x.to_bits() - 1);
    }
    while rounded(x) < byte {
        x = f64::from_bits(x.to_bits() + 1);
    }
    x
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn table_lookups_equal_the_rounded_curve() {
        for i in 0..=1_000_000u32 {
            let x = f64::from(i) * 1e-6;
            assert_eq!(byte(x), rounded(x), "{x}");
        }
        let below = |x: f64| f64::from_bits(x.to_bits() - 1);
        for step in (1..=255).map(step) {
            assert_eq!(byte(step), byte(below(step)) + 1, "{step}");
        }
        for bin in 1..=BINS {
            let x = bin as f64 / BINS as f64;
            assert_eq!([byte(x), byte(below(x))], [rounded(x), rounded(below(x))]);
        }
        assert_eq!([0.0, 0.5, 1.0].map(byte), [0, 188, 255]);
    }
}
