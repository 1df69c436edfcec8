//! Parses numbers in text. Common forms take a short exact path. All others use the standard
//! library.

/// The powers of ten that f64 holds exactly.
const POWERS: [f64; 23] = [
    1e0, 1e1, 1e2, 1e3, 1e4, 1e5, 1e6, 1e7, 1e8, 1e9, 1e10, 1e11, 1e12, 1e13, 1e14, 1e15, 1e16,
    1e17, 1e18, 1e19, 1e20, 1e21, 1e22,
];

/// Parses a number of at most 18 digits with a small exponent at the start of `text`. It must end
/// at a blank or at the end of `text`. Returns the value and its length in bytes. `None` means only
/// that [`any`] must parse it.
///
/// The result is correctly rounded. Digits up to 2^53 and powers up to 1e22 are exact in `f64`, so
/// the one multiplication or division rounds once (Clinger 1990).
#[inline]
pub(super) fn plain(text: &[u8]) -> Option<(f64, usize)> {
    let mut at = 0;
    let negative = text.first() == Some(&b'-');
    at += usize::from(negative);
    let (mut digits, mut count, mut scale) = (0u64, 0u32, 0i32);
    while let Some(digit) = digit(text, at) {
        digits = digits.wrapping_mul(10).wrapping_add(digit);
        count += 1;
        at += 1;
    }
    if text.get(at) == Some(&b'.') {
        at += 1;
        let point = at;
        while let Some(digit) = digit(text, at) {
            digits = digits.wrapping_mul(10).wrapping_add(digit);
            at += 1;
        }
        let places = (at - point).min(100) as u32;
        count += places;
        scale = -(places as i32);
    }
    // 18 digits always fit into 64 bits.
    if count == 0 || count > 18 {
        return None;
    }
    if let Some(b'e' | b'E') = text.get(at) {
        let (exponent, length) = small_exponent(&text[at + 1..])?;
        scale += exponent;
        at += 1 + length;
    }
    if text.get(at).is_some_and(|b| !b.is_ascii_whitespace()) {
        return None;
    }
    if digits > 1 << 53 || scale.unsigned_abs() > 22 {
        return None;
    }
    let power = POWERS[scale.unsigned_abs() as usize];
    let value = digits as f64;
    let value = if scale < 0 { value / power } else { value * power };
    Some((if negative { -value } else { value }, at))
}

#[inline(always)]
fn digit(text: &[u8], at: usize) -> Option<u64> {
    let digit = text.get(at)?.wrapping_sub(b'0');
    (digit < 10).then_some(digit as u64)
}

/// Parses the exponent after `e`, up to 99. Returns the value and its length in bytes.
fn small_exponent(text: &[u8]) -> Option<(i32, usize)> {
    let negative = text.first() == Some(&b'-');
    let signed = usize::from(negative || text.first() == Some(&b'+'));
    let (mut value, mut at) = (0, signed);
    while let Some(digit) = digit(text, at) {
        value = value * 10 + digit as i32;
        at += 1;
        if value > 99 {
            return None;
        }
    }
    (at > signed).then_some((if negative { -value } else { value }, at))
}

/// Rounds `value` to `f32`. Returns `None` where rounding the decimal number directly could give a
/// different result: exactly between two `f32`, or below the normal range.
#[inline]
pub(super) fn to_f32(value: f64) -> Option<f64> {
    let between = value.to_bits() & 0x1fff_ffff == 0x1000_0000;
    let small = value != 0.0 && value.abs() < f32::MIN_POSITIVE as f64;
    (!between && !small).then_some(value as f32 as f64)
}

/// Parses any number, including NaN and infinity as C libraries spell them. With `single`, the
/// decimal number is rounded once, to f32.
pub(super) fn any(word: &[u8], single: bool) -> Option<f64> {
    let text = std::str::from_utf8(word).ok()?;
    let parsed = match single {
        true => text.parse::<f32>().ok().map(f64::from),
        false => text.parse::<f64>().ok(),
    };
    parsed.or_else(|| {
        // NaN: nan(ind), -nan(0x8...), 1.#QNAN, -1.#IND. Infinity: 1.#INF.
        let bare = text.trim_start_matches(['-', '+']).to_ascii_lowercase();
        if bare == "1.#inf" {
            Some(if text.starts_with('-') { f64::NEG_INFINITY } else { f64::INFINITY })
        } else if bare.starts_with("nan(") || bare.starts_with("1.#") {
            Some(f64::NAN)
        } else {
            None
        }
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn plain_agrees_with_the_standard_library() {
        let mut seed = 1u64;
        let mut taken = 0;
        for _ in 0..200_000 {
            seed = seed.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
            let digits = (seed >> 11) >> (seed % 50);
            let places = (seed >> 20) % 12;
            let text = match seed % 3 {
                0 => format!("{}", digits as f64 / 10f64.powi(places as i32)),
                1 => format!("-{}e{}", digits, places as i64 - 6),
                _ => format!("{}.{digits}", places),
            };
            let Some((value, length)) = plain(text.as_bytes()) else {
                continue;
            };
            taken += 1;
            assert_eq!(length, text.len());
            assert_eq!(value.to_bits(), text.parse::<f64>().unwrap().to_bits(), "{text}");
            if let Some(single) = to_f32(value) {
                let expected = text.parse::<f32>().unwrap();
                assert_eq!((single as f32).to_bits(), expected.to_bits(), "{text}");
            }
        }
        assert!(taken > 100_000, "{taken}");
    }

    #[test]
    fn unusual_spellings_are_left_to_any() {
        assert_eq!(plain(b"1.5 2"), Some((1.5, 3)));
        assert_eq!(plain(b"-0"), Some((-0.0, 2)));
        for text in ["", ".", "-", "e5", "1e", "nan", "1x", "+1", "12345678901234567890"] {
            assert_eq!(plain(text.as_bytes()), None, "{text}");
        }
        assert_eq!(any(b"+1.5", true), Some(1.5));
        assert_eq!(any(b"-inf", false), Some(f64::NEG_INFINITY));
        assert_eq!(any(b"-1.#INF", false), Some(f64::NEG_INFINITY));
        assert!(any(b"-nan(ind)", false).unwrap().is_nan());
        assert!(any(b"1.#QNAN", true).unwrap().is_nan());
        assert_eq!(any(b"abc", false), None);
        // This number is half-way between two floats once rounded to f64, but not in decimal.
        let text = b"1.00000005960464477540";
        assert_eq!(any(text, true), Some(f32::from_bits(0x3f80_0001) as f64));
    }
}
