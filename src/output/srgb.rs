//! The sRGB transfer curve of IEC 61966-2-1, and its bytes without a power for each.

use std::sync::LazyLock;

/// For [0, 1].
pub fn from_linear(x: f64) -> f64 {
    if x <= 0.003_130_8 { 12.92 * x } else { 1.055 * x.powf(1.0 / 2.4) - 0.055 }
}

/// `from_linear(x)` as a byte, rounded half up, for x in [0, 1].
pub fn byte(x: f64) -> u8 {
    BYTES.of(x)
}

static BYTES: LazyLock<Bytes> = LazyLock::new(Bytes::new);

/// The curve rises by at most 12.92 * 255 = 3295 bytes per unit: no bin holds two steps.
const BINS: usize = 4096;

/// Where the byte steps up.
struct Bytes {
    /// The least x of each byte, and after the last one infinity.
    least: [f64; 257],
    /// The byte at the lower end of each bin.
    first: [u8; BINS + 1],
}

impl Bytes {
    fn new() -> Self {
        let mut least = [f64::INFINITY; 257];
        for (byte, least) in least[..256].iter_mut().enumerate() {
            *least = step(byte as u8);
        }
        let mut first = [0; BINS + 1];
        for (bin, first) in first.iter_mut().enumerate() {
            *first = rounded(bin as f64 / BINS as f64);
        }
        Self { least, first }
    }

    #[inline(always)]
    fn of(&self, x: f64) -> u8 {
        let first = self.first[((x * BINS as f64) as usize).min(BINS)];
        first + u8::from(x >= self.least[usize::from(first) + 1])
    }
}

/// What the table holds.
fn rounded(x: f64) -> u8 {
    (255.0 * from_linear(x) + 0.5) as u8
}

/// The least x of a byte.
fn step(byte: u8) -> f64 {
    if byte == 0 {
        return 0.0;
    }
    let y = (f64::from(byte) - 0.5) / 255.0;
    let mut x = if y <= 0.040_45 { y / 12.92 } else { ((y + 0.055) / 1.055).powf(2.4) };
    // The inverse is off by some ulp.
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
    fn the_table_is_the_curve() {
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
