//! Decoding of sRGB values, over all real numbers.

/// Decodes sRGB to linear (IEC 61966-2-1). An odd function, so that negative values of float images
/// survive.
pub fn linear_from_srgb(value: f64) -> f64 {
    let x = value.abs();
    let linear = if x <= 0.04045 { x / 12.92 } else { ((x + 0.055) / 1.055).powf(2.4) };
    linear.copysign(value)
}
